"""Settings of reinforcement learning that follow from a scene of one's own.

A task's own scale, time step and base were chosen when its settings were found. Of another scene
nothing is known, so that they are measured: rewards of any size make the value function useless,
exploration at a third of the force drowns a controller that uses a twentieth of it, and a discount
of 0.97 forgets within a sixth of a period where a period has two hundred control steps.
"""

import os

import numpy as np

from agents.control.scene import periods
from agents.training.algorithm_settings import PPOSettings
from agents.training.best import best_controller
from agents.training.config import TrainSettings
from agents.training.parts import NO_BASE, base_controller
from agents.training.runs import Run
from agents.training.scales import LEAST, size_of_actions
from mm_gym import Scene

PERIODS = 2.0  # of the slowest mode that are looked ahead
DISCOUNTS = 0.9, 0.998  # least and largest
EXPLORED = 0.5  # exploration's size over that of the base's actions
QUIET, LOUD = 0.01, 0.6  # least and largest standard deviation of the exploration


def for_own_scene(settings: TrainSettings, run: Run) -> TrainSettings:
    """Return settings with what is not asked for measured, if the scene is one's own.

    A run that goes on keeps the base of its record.
    """
    if settings.scene is None:
        return settings
    scene, chosen, base = settings.rewarded_scene(), settings.chosen, settings.base
    if base is None and os.path.lexists(run.record):
        base = run.read()["settings"].get("base") or NO_BASE
    base = base or best_controller(scene, plans=False).name
    changes: dict[str, object] = {}
    if "discount" not in chosen.model_fields_set:
        changes["discount"] = discount_of(scene)
    explores = isinstance(chosen, PPOSettings) and "initial_log_std" not in chosen.model_fields_set
    if explores and base != NO_BASE:
        size = max(LEAST, size_of_actions(scene, base_controller(scene, base)))
        spread = np.clip(EXPLORED * size / settings.authority, QUIET, LOUD)
        changes["initial_log_std"] = round(float(np.log(spread)), 3)
    return settings.model_copy(
        update={
            "base": base,
            "normalise_observations": True,
            "normalise_rewards": True,
            settings.algorithm: chosen.model_copy(update=changes),
        }
    )


def discount_of(scene: Scene) -> float:
    """Return the discount that looks ahead for some periods of the slowest mode."""
    steps = periods(scene)
    if not steps.size:
        return DISCOUNTS[1]
    return round(float(np.clip(1.0 - 1.0 / (PERIODS * steps.max()), *DISCOUNTS)), 4)
