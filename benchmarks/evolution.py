"""Evolution by the clock: the network's forward pass, and held-out costs after some seconds."""

from __future__ import annotations

import tempfile
import time

import numpy as np

from agents.controllers.learned import Learned
from agents.evaluation.episodes import evaluate
from agents.evolution.network import Network
from agents.evolution.network_kernel import forward
from agents.evolution.search import evolve
from agents.evolution.settings import EvolveSettings
from agents.evolution.starts import Start
from agents.policies import load_policy
from agents.training.runs import Run
from benchmarks.report import table

SEEDS = 10

SECONDS = {"PreStretchShock": 1, "CarriageForceFriction": 3, "Hybrid": 5, "PreStretchNoise": 5}
"""Time of the search of each task [s], without imports and compilation."""

OWN = {"CarriageForceFriction": {"hidden": 16}, "Hybrid": {"hidden": 6, "candidates": 32}}
"""Settings in which a task differs from the defaults."""

CANDIDATES, EPISODES, CALLS, ROUNDS = 48, 64, 20, 30


def evolution() -> str:
    """Return the section on evolution, with two threads."""
    rows = [_row(task, seconds) for task, seconds in SECONDS.items()]
    header = ("task", "seconds", f"cost, median of {SEEDS} seeds", "least", "most", "M frames/s")
    rate = lanes_per_second() / 1e6
    text = (
        f"A network of 4-16-1 acts for {rate:.0f} M lanes a second on one core, {CANDIDATES} "
        f"networks of {EPISODES} lanes. Searches of `agents.evolve` on two threads, by the clock, "
        "from a warm cache; cost on the same 100 held-out episodes."
    )
    return "\n".join(["## Evolution", "", text, "", table(header, rows), ""])


def lanes_per_second() -> float:
    """Return the rate of the forward pass of 4-16-1, the best of the rounds, in processor time."""
    start = Start(np.empty((0, 2, 4)), np.empty((0, 4)), np.zeros((1, 5)), np.empty(0))
    network = Network(start, 16, odd=False)
    rng = np.random.default_rng(0)
    parameters = rng.standard_normal((CANDIDATES, network.free.size)).astype(np.float32)
    lanes = CANDIDATES * EPISODES
    observed = rng.standard_normal((4, lanes)).astype(np.float32)
    fixed = np.empty((0, 4), np.float32), np.empty((0, 0), np.float32), np.empty((0, 0), np.float32)
    sums = np.empty((0, lanes), np.float32)
    actions = np.empty((1, lanes), np.float32)
    best = np.inf
    for _ in range(1 + ROUNDS):  # the first compiles
        began = time.thread_time()
        for _ in range(CALLS):
            forward(parameters, fixed, observed, sums, actions, network.sizes, 0, CANDIDATES)
        best = min(best, time.thread_time() - began)
    return CALLS * lanes / best


def _row(task: str, seconds: int) -> tuple[str, ...]:
    costs, rates = zip(*(_outcome(task, seconds, seed) for seed in range(-1, SEEDS)), strict=True)
    kept = costs[1:]  # the first compiles
    numbers = (np.median(kept), min(kept), max(kept))
    return (
        task,
        str(seconds),
        *(f"{number:.4f}" for number in numbers),
        f"{np.median(rates[1:]):.1f}",
    )


def _outcome(task: str, seconds: int, seed: int) -> tuple[float, float]:
    """Return the cost on the held-out episodes, and the search's rate [M frames/s]."""
    settings = EvolveSettings.of(
        {
            "task": f"mm_gym/{task}-v0",
            "seed": max(seed, 0),
            "generations": 100_000,
            "evaluations": 5_000,
            "time_budget": seconds if seed >= 0 else 0.1,
            **OWN.get(task, {}),
        }
    )
    scene = settings.load_scene()
    with tempfile.TemporaryDirectory() as folder:
        run = Run("search", folder)
        evolve(settings, run)
        cost = evaluate(scene, Learned(load_policy(run.policy)), episodes=100).cost
        frames = np.loadtxt(run.metrics, delimiter=",", skiprows=1, ndmin=2)[-1, 0]
        spent = np.loadtxt(run.times, delimiter=",", skiprows=1, ndmin=2)[-1, 1]
    return cost, frames / spent / 1e6
