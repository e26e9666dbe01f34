"""Evolution by the clock: the network's forward pass, and held-out costs after some seconds."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from agents.evolution.network_kernel import forward
from agents.training.network import Network
from agents.training.runs import Run
from agents.training.start import Start
from benchmarks.report import table

ROOT = Path(__file__).parents[1]

SEEDS = 10

SECONDS = {"PreStretchShock": 1, "CarriageForceFriction": 3, "Hybrid": 5, "PreStretchNoise": 20}
"""Time of the search of each task [s], without imports."""

CANDIDATES, EPISODES, CALLS, ROUNDS = 48, 64, 20, 30


def evolution() -> str:
    """Return the section on evolution, with two threads."""
    rows = [row(task) for task in SECONDS]
    header = ("task", "seconds", f"cost, median of {SEEDS} seeds", "least", "most", "M frames/s")
    rate = lanes_per_second() / 1e6
    text = (
        f"Networks of 4-16-1 compute {rate:.0f} M actions a second on one core ({CANDIDATES} "
        f"networks of {EPISODES} lanes each). The table has the costs on the same 100 held-out "
        "episodes after `python -m agents evolve TASK --time-budget SECONDS` with default "
        "settings, two threads and a warm cache. The time by the clock includes validations, the "
        "reading of compiled code, and delays by other programs on a shared machine."
    )
    return "\n".join(["## Evolution", "", text, "", table(header, rows), ""])


def lanes_per_second() -> float:
    """Return the rate of the forward pass of 4-16-1, the best of the rounds, in processor time."""
    start = Start.linear(np.zeros((1, 5)))
    network = Network(start, 16, odd=False)
    rng = np.random.default_rng(0)
    parameters = rng.standard_normal((CANDIDATES, network.free.size)).astype(np.float32)
    lanes = CANDIDATES * EPISODES
    observed = rng.standard_normal((4, lanes)).astype(np.float32)
    fixed = np.empty((0, 4), np.float32), np.empty((0, 0), np.float32), np.empty((0, 0), np.float32)
    sums, memory = np.empty((0, lanes), np.float32), np.empty((6, EPISODES), np.float32)
    actions = np.empty((1, lanes), np.float32)
    best = np.inf
    for _ in range(1 + ROUNDS):  # the first compiles
        began = time.thread_time()
        for _ in range(CALLS):
            forward(observed, actions, parameters, fixed, sums, memory, network.sizes)
        best = min(best, time.thread_time() - began)
    return CALLS * lanes / best


def row(task: str) -> tuple[str, ...]:
    """Return a task's row of the table."""
    search(task, 0)  # compiles
    costs, rates = zip(*(search(task, seed) for seed in range(SEEDS)), strict=True)
    numbers = (np.median(costs), min(costs), max(costs))
    rate = f"{np.median(rates):.1f}"
    return task, str(SECONDS[task]), *(f"{number:.4f}" for number in numbers), rate


def search(task: str, seed: int) -> tuple[float, float]:
    """Return the cost on the held-out episodes, and the search's rate [M frames/s]."""
    flags = ("--time-budget", str(SECONDS[task]), "--seed", str(seed), "--name", "search")
    with TemporaryDirectory() as folder:
        found = subprocess.run(
            [sys.executable, "-m", "agents", "evolve", task, *flags],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            capture_output=True,
            check=True,
            text=True,
        )
        frames, _, seconds = Run("search", Path(folder) / "runs").validations()
    return float(found.stdout.split()[0]), frames[-1] / seconds[-1] / 1e6
