"""Controllers as policies, which C, ONNX and NumPy files are written from."""

from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.control.controller import Controller
from agents.control.scene import ENDLESS
from agents.network.graph import Graph, Signal
from agents.network.policy import Policy
from mm_gym import MovingMassVectorEnv, Scene, SceneError
from mm_gym.arrays import Array
from mm_gym.errors import refuse

LANES, STEPS = 20, 1000  # of the episodes on which a policy is compared with its controller

CLOSE, NUDGE, NUDGES = 1e-6, 1e-8, 8
"""Largest difference of numbers that are the same; relative change of what is read, and how many,
where the numbers differ: rounding may turn a switch round, as such a change does."""

ALLOWED = (
    "one that makes its action of observations and of what it remembers by NumPy's arithmetic, "
    "with no choice, search or compiled code between"
)
OTHERWISE = (
    "as random numbers, a clock, whole numbers, sums of truth values, lanes that know each other, "
    "or what is not in the memory, make it"
)


def controller_policy(controller: Controller, scene: Scene, name: str) -> Policy:
    """Return a controller as a policy: the arithmetic that it does on NumPy's arrays.

    Raise `SceneError`, which names the controller, if it does anything else.
    """
    if controller.reads != "observation":
        refuse("controller", f"{name!r}, which reads the {controller.reads}", ALLOWED)
    env = MovingMassVectorEnv(scene.replace(**ENDLESS), LANES)
    env.reset(seed=0)
    try:
        policy, kept = _followed(controller, env)
    except (TypeError, ValueError, LookupError, AttributeError) as error:
        msg = f"controller: got {name!r}; allowed for an export: {ALLOWED} ({error})"
        raise SceneError(msg) from error
    share = _unlike(controller, policy, kept, env, min(STEPS, scene.control.steps))
    if share > 0.0:
        told = f"{name!r}, which acts otherwise than its arithmetic in {share:.3g} of steps"
        refuse("controller", f"{told}, {OTHERWISE}", ALLOWED)
    return policy


def _followed(controller: Controller, env: MovingMassVectorEnv) -> tuple[Policy, list[str]]:
    """Return what a controller computes in a step, noted while it does so, and what it remembers.

    What it remembers is told from what an episode begins with, so that it is 0 there; what its
    actions never depend on is left out.
    """
    begun = {key: 1.0 * array[:1] for key, array in controller.begin(env).items()}
    widths = {key: prod(array.shape[1:]) for key, array in begun.items()}
    observed, kept = env.single_observation_space.shape[0], list(begun)
    while True:
        graph, memory = Graph(), dict[str, Any](begun)
        seen: Any = graph.input("observation", observed)
        known = graph.input("memory", sum(widths[key] for key in kept))
        parts: dict[str, Signal] = {}
        for key in kept:
            first = sum(one.made_by.width for one in parts.values())
            parts[key] = graph.add("slice", [known], widths[key], first)
            memory[key] = parts[key].reshape(-1, *begun[key].shape[1:]) + begun[key]
        action, after = controller.act(memory, seen, {})
        action, wanted = graph.signal(action), env.single_action_space.shape
        if action.shape[1:] != wanted:
            got = f"shape {('lanes', *action.shape[1:])}"
            refuse("actions", got, f"{('lanes', *wanted)}", TypeError)
        changes = {key: (after[key] - begun[key]).reshape(-1, widths[key]) for key in kept}
        used: list[str] = []
        while True:
            told = graph.joined([np.empty((1, 0)), *(changes[key] for key in used)])
            graph.outputs = {"action": action, "next_memory": told}
            needed = graph.needed()
            if used == (used := [key for key in kept if parts[key].made_by in needed]):
                break
        if used == kept:
            return Policy.of_graph(graph), kept
        kept = used


def _unlike(
    controller: Controller,
    policy: Policy,
    kept: list[str],
    env: MovingMassVectorEnv,
    steps: int,
) -> float:
    """Return the share of steps that are not alike, in episodes that the controller controls.

    Each begins with what the controller remembers: small differences grow where laws switch.
    """
    observation, _ = env.reset(seed=1)
    begun = memory = controller.begin(env)
    generator = np.random.default_rng(0)

    def told() -> Array:
        parts = [(1.0 * memory[key] - begun[key]).reshape(LANES, -1) for key in kept]
        return np.concatenate([np.empty((LANES, 0)), *parts], 1)

    def nudged(numbers: Array) -> Array:
        return numbers * (1.0 + NUDGE * generator.standard_normal(numbers.shape))

    def unlike(observed: Array, before: Array, wanted: Array) -> NDArray[np.bool_]:
        found = np.concatenate(policy.step(observed, before), 1)
        return ~((np.abs(found - wanted) / (1.0 + np.abs(wanted))).max(axis=1) < CLOSE)

    count = 0
    for _ in range(steps):
        before = told()
        action, memory = controller.act(memory, observation, {})
        wanted = np.concatenate([action, told()], 1)
        differ = unlike(observation, before, wanted)
        for _ in range(NUDGES if differ.any() else 0):
            differ &= unlike(nudged(observation), nudged(before), wanted)
        count += np.count_nonzero(differ)
        observation, *_ = env.step(action)
    return count / (steps * LANES)
