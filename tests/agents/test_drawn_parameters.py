"""Does a controller know of drawn parameters the middle, whatever its scene states?"""

from collections.abc import Callable

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, CARRIAGE_FORCE_FRICTION, PRE_STRETCH, SEMI_ACTIVE_DAMPER, TASKS

from agents.control.controller import Law
from agents.control.scene import PARTS
from agents.controllers.clipped_lqr import WEIGHTED, ClippedLQR
from agents.controllers.clipped_optimal import ClippedOptimal
from agents.controllers.extremum_seeking import ExtremumSeeking
from agents.controllers.feedforward_lqr import FeedforwardClippedLQR, free_numbers
from agents.controllers.frequency_tracking import (
    FrequencyLockedLoop,
    FrequencyTracking,
    reachable_band,
)
from agents.controllers.inertial_drive import INERTIAL_DRIVE
from agents.controllers.lqr import LQR
from agents.controllers.on_off_stiffness import OnOffStiffness
from agents.controllers.resetting_stiffness import ResettingStiffness
from agents.controllers.semi_active import Hook
from mm_gym import Scene

PRE_STRETCH_NOISE = TASKS["mm_gym/PreStretchNoise-v0"]

LAWS: dict[str, tuple[Scene, Callable[[Scene], Law]]] = {
    "LQR": (CARRIAGE_FORCE, LQR),
    "inertial drive": (
        CARRIAGE_FORCE_FRICTION,
        lambda scene: INERTIAL_DRIVE.make(
            scene, {name: one.first for name, one in INERTIAL_DRIVE.free(scene).items()}
        ),
    ),
    "clipped LQR": (PRE_STRETCH_NOISE, lambda scene: ClippedLQR(scene, 1.5, 1.0)),
    "clipped LQR, free weights": (
        PRE_STRETCH_NOISE,
        lambda scene: WEIGHTED.make(
            scene, {name: one.first for name, one in WEIGHTED.free(scene).items()}
        ),
    ),
    "clipped LQR with feed-forward": (
        PRE_STRETCH_NOISE,
        lambda scene: FeedforwardClippedLQR(
            scene, {name: one.first for name, one in free_numbers(scene).items()}
        ),
    ),
    "on-off stiffness": (PRE_STRETCH_NOISE, lambda scene: OnOffStiffness(scene, 1.5)),
    "resetting stiffness": (
        PRE_STRETCH_NOISE,
        lambda scene: ResettingStiffness(scene, passive=True),
    ),
    "extremum seeking": (PRE_STRETCH_NOISE, ExtremumSeeking),
    "frequency tracking": (
        PRE_STRETCH,
        lambda scene: FrequencyTracking(
            scene, FrequencyLockedLoop(scene, reachable_band(scene)[0])
        ),
    ),
    "skyhook": (SEMI_ACTIVE_DAMPER, lambda scene: Hook(scene, "skyhook", "continuous", gain=3.0)),
    "clipped-optimal": (SEMI_ACTIVE_DAMPER, lambda scene: ClippedOptimal(scene, "continuous", 1.0)),
}


@pytest.mark.parametrize("name", LAWS)
def test_law_acts_the_same_whatever_value_the_scene_states_of_what_is_drawn(name: str) -> None:
    task, make = LAWS[name]
    actions: list[np.ndarray] = []
    for off in (0.0, 0.2):
        law = make(_drawn(task, off))
        generator, memory, acted = np.random.default_rng(1), law.begin(50), []
        scales = np.array([0.01, 0.01, 0.3, 0.3])  # m, m/s
        applied = np.full((50, 1), 2.0)
        for _ in range(4):
            state = scales * generator.standard_normal((50, 4))
            action, memory = law.action(memory, state, applied)
            acted.append(np.clip(action, -1.0, 1.0))
        actions.append(np.stack(acted))
    assert np.abs(actions[0]).max() > 0.0
    assert np.array_equal(*actions)


def _drawn(task: Scene, off: float) -> Scene:
    """Return a scene that draws all parts within 30 %, and states values off the middle."""
    names = [
        f"{part}{field}"
        for part in PARTS
        for field, value in getattr(task, part[:-1]).model_dump().items()
        if isinstance(value, float) and value > 0.0 and f"{part}{field}" not in _KEPT
    ]
    if task.actuation.damped is not None:
        names.remove(task.actuation.damped)
    values = {name: task.value_of(name) for name in names}
    drawn = {name: (0.7 * value, 1.3 * value) for name, value in values.items()}
    changes: dict[str, object] = {
        name: value * (1.0 + off * (-1) ** k) for k, (name, value) in enumerate(values.items())
    }
    if task.interface.kind == "dry_friction":
        changes["interface.normal_force"] = 0.4  # N; by default the weight of a drawn sphere
    return task.replace(**changes, randomization={**task.randomization, **drawn})


_KEPT = ("springs.stretch", "interface.kinetic_coefficient", "interface.normal_force")
