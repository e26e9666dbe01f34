"""Controllers as policies, which C, ONNX and NumPy files are written from."""

from math import prod
from typing import Any

import numpy as np

from agents.control.controller import Controller
from agents.control.scene import ENDLESS
from agents.network.graph import Graph, Signal
from agents.network.policy import Policy
from mm_gym import MovingMassVectorEnv, Scene, SceneError
from mm_gym.arrays import Array
from mm_gym.errors import refuse

LANES, STEPS = 20, 200  # of the episodes on which a policy is compared with its controller

CLOSE, ALIKE = 1e-6, 0.99
"""Largest difference of numbers that are the same, and the least share of steps with such alone:
rounding may turn a switch round."""

ALLOWED = (
    "one that makes its action of observations and of what it remembers by NumPy's arithmetic, "
    "with no choice, search or compiled code between"
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
    share = _alike(controller, policy, kept, env, min(STEPS, scene.control.steps))
    if share < ALIKE:
        told = f"{name!r}, which acts otherwise than its arithmetic in {1.0 - share:.0%} of steps"
        refuse("controller", told, ALLOWED)
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
        changes = {key: (after[key] - begun[key]).reshape(-1, widths[key]) for key in kept}
        used: list[str] = []
        while True:
            told = graph.joined([np.empty((1, 0)), *(changes[key] for key in used)])
            graph.outputs = {"action": graph.signal(action), "next_memory": told}
            needed = graph.needed()
            if used == (used := [key for key in kept if parts[key].made_by in needed]):
                break
        if used == kept:
            return Policy.of_graph(graph), kept
        kept = used


def _alike(
    controller: Controller,
    policy: Policy,
    kept: list[str],
    env: MovingMassVectorEnv,
    steps: int,
) -> float:
    """Return the share of steps that are alike, in episodes that the controller controls.

    Each begins with what the controller remembers: small differences grow where laws switch.
    """
    observation, _ = env.reset(seed=1)
    begun = memory = controller.begin(env)

    def told() -> Array:
        parts = [(1.0 * memory[key] - begun[key]).reshape(LANES, -1) for key in kept]
        return np.concatenate([np.empty((LANES, 0)), *parts], 1)

    differences: list[Array] = []
    for _ in range(steps):
        found = np.concatenate(policy.step(observation, told()), 1)
        action, memory = controller.act(memory, observation, {})
        wanted = np.concatenate([action, told()], 1)
        differences.append((np.abs(found - wanted) / (1.0 + np.abs(wanted))).max(axis=1))
        observation, *_ = env.step(action)
    return float(np.mean(np.array(differences) < CLOSE))
