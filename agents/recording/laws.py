"""Controllers by the names that commands take."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from agents.controllers.constant import no_control
from agents.controllers.controller import columns
from agents.controllers.feedback import Feedback
from agents.controllers.learned import Learned
from agents.controllers.matching_stretch import FREQUENCY, MatchingStretch
from agents.controllers.random_actions import RandomActions
from agents.evaluation.baselines import (
    best_clipped_lqr,
    best_constant,
    best_lqr_at_constant_stretch,
    best_lqr_with_clipped_lqr,
    best_on_off_stiffness,
    best_phase_law,
    best_velocity_feedback,
    regulators,
)
from agents.policies import load_policy
from agents.training.runs import Run, RunError
from mm_gym import SceneError
from mm_gym.errors import suggest

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import numpy as np

    from agents.controllers.controller import Controller
    from mm_gym import Scene

    Make = Callable[[Scene], Controller]

RANDOM = "random"

ALWAYS: Mapping[str, Make] = {
    RANDOM: RandomActions,
    "no-control": lambda scene: Feedback(scene, no_control(scene)),
    "best-constant": best_constant,
}
"""Laws for any actuators. Those called best are tuned on the validation episodes."""

LAWS: Mapping[tuple[str, ...], Mapping[str, Make]] = {
    ("force",): {
        "lqr": lambda scene: regulators(scene)[0],
        "velocity-feedback": best_velocity_feedback,
    },
    ("stretch",): {
        "phase-law": best_phase_law,
        "clipped-lqr": best_clipped_lqr,
        "on-off-stiffness": best_on_off_stiffness,
    },
    ("force", "stretch"): {
        "lqr": best_lqr_at_constant_stretch,
        "lqr-and-clipped-lqr": best_lqr_with_clipped_lqr,
    },
}
"""Laws for the actuators that a scene has."""


def laws(scene: Scene) -> dict[str, Make]:
    """Return the laws that apply to a scene, by name."""
    found = {**ALWAYS, **LAWS[columns(scene)]}
    if scene.actuation.force is not None and scene.objective.effort_weight == 0.0:
        found.pop("lqr", None)
        found.pop("lqr-and-clipped-lqr", None)
    if FREQUENCY in scene.randomization and columns(scene) == ("stretch",):
        found["matching-stretch"] = MatchingStretch
    return found


def law_of(name: str, scene: Scene, generator: np.random.Generator) -> Controller:
    """Return a controller by its name, or the policy of a run's folder or of a ``.npz`` file.

    The generator is where random actions are drawn from.

    Raises
    ------
    SceneError
        If the name is not one that applies to the scene, nor a path.
    RunError
        If the training of the run is not over.
    PolicyError
        If the policy cannot be read.
    """
    applicable, path = laws(scene), Path(name)
    if name == RANDOM:
        return RandomActions(scene, generator)
    if name in applicable:
        return applicable[name](scene)
    if path.suffix == ".npz":
        return Learned(load_policy(path), name)
    run = Run(path.name, path.parent)
    if not run.record.exists():
        msg = (
            f"controller: got {name!r}{suggest(name, applicable)}; allowed for this scene: "
            f"{', '.join(applicable)}, the folder of a run, or a policy's .npz file"
        )
        raise SceneError(msg)
    if not run.finished:
        msg = f"{run.folder}: training is not over; continue it: python -m agents.train"
        raise RunError(msg)
    return Learned(load_policy(run.policy), name)
