"""Controllers on rigs that differ: the variants of the tasks, and the tasks with late sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from agents.controllers.constant import ConstantAction, best_constant
from agents.controllers.controller import Controller
from agents.controllers.tuned import designed, makers
from agents.evaluation.headroom import interval
from agents.scoring import HELD_OUT_SEED, evaluate, tail_mean
from mm_gym import Scene, load_scene
from mm_gym.tasks import short_name

Row = dict[str, Any]

EPISODES = 200
DELAYS = (0, 1, 2)  # control steps by which the sensors of the task itself are late
WORST = 0.1  # share of the episodes that cost most


def task_of(variant: str) -> str:
    """Return the id of the task that a variant is of."""
    return f"mm_gym/{short_name(variant).removesuffix('Robust')}-v0"


def rigs_of(variant: str) -> dict[str, Scene]:
    """Return the scenes to score on: over the rigs, then the task with each delay."""
    task = load_scene(task_of(variant))
    late = {f"late {n}": task.replace(**{"sensors.delay": n}) for n in DELAYS}
    return {"rigs": load_scene(variant), **late}


def controllers_of(scene: Scene) -> list[tuple[str, Controller]]:
    """Return the controllers that are tuned over the rigs and read the observation, by role."""
    found, _ = designed(scene, makers(scene, "law", "filter"))
    return [
        ("zero", ConstantAction(scene)),
        ("constant", best_constant(scene, HELD_OUT_SEED)),
        *(("controller", one) for one in found),
    ]


def scores_of(variant: str, agents: Mapping[str, Sequence[Controller]]) -> list[Row]:
    """Return a row for each controller of a variant, and for each agent.

    Parameters
    ----------
    variant
        Its id.
    agents
        Id of a task or a variant -> the agents that were trained on it.
    """
    scenes = rigs_of(variant)
    trained = {"specialist": task_of(variant), "over the rigs": variant}
    rows = controllers_of(scenes["rigs"])
    rows += [(role, one) for role, task in trained.items() for one in agents.get(task, ())]
    return [_row(role, one, scenes) for role, one in rows]


def _row(role: str, controller: Controller, scenes: Mapping[str, Scene]) -> Row:
    found = {name: evaluate(s, controller, episodes=EPISODES) for name, s in scenes.items()}
    over = found["rigs"]
    low, high = interval(over.penalties)
    costs = {name: one.cost for name, one in found.items()}
    costs |= {"low": low, "high": high, "worst": float(np.sqrt(tail_mean(over.penalties, WORST)))}
    short = {name: float(f"{cost:.6g}") for name, cost in costs.items()}
    return {"role": role, "controller": controller.name, **short}
