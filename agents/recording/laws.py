"""Controllers by the names that commands take."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from agents.controllers.constant import no_control
from agents.controllers.controller import columns
from agents.controllers.feedback import Feedback
from agents.controllers.learned import Learned
from agents.controllers.lqg import LQG
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
    best_without_memory,
    classical_laws,
    frequency_trackers,
    predictive_control,
    regulators,
    resetting_laws,
)
from agents.policies import load_policy
from agents.training.parts import recorded_parts
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
    "predictive-control": lambda scene: predictive_control(
        scene, best_without_memory(scene, classical_laws(scene))
    ),
}
"""Laws for any actuators. Those called best are tuned on the validation episodes."""

LAWS: Mapping[tuple[str, ...], Mapping[str, Make]] = {
    ("force",): {
        "lqr": lambda scene: regulators(scene)[0],
        "lqg": LQG,
        "velocity-feedback": best_velocity_feedback,
    },
    ("stretch",): {
        "phase-law": best_phase_law,
        "clipped-lqr": best_clipped_lqr,
        "on-off-stiffness": best_on_off_stiffness,
        "resetting-stiffness-passive": lambda scene: resetting_laws(scene)[0],
        "resetting-stiffness": lambda scene: resetting_laws(scene)[1],
    },
    ("force", "stretch"): {
        "lqr": best_lqr_at_constant_stretch,
        "lqr-and-clipped-lqr": best_lqr_with_clipped_lqr,
    },
}
"""Laws for the actuators that a scene has."""

TRACKERS = ("linear-prediction", "frequency-locked-loop", "short-time-fourier")
"""Laws that look for the frequency of a harmonic force, by how they do, as `frequency_trackers`."""


def laws(scene: Scene) -> dict[str, Make]:
    """Return the laws that apply to a scene, by name."""
    found = {**ALWAYS, **LAWS[columns(scene)]}
    if scene.actuation.force is not None and scene.objective.effort_weight == 0.0:
        for name in ("lqr", "lqg", "lqr-and-clipped-lqr"):  # they need a price of the force
            found.pop(name, None)
    if columns(scene) == ("stretch",):
        if {part.kind for part in scene.excitation} == {"harmonic"}:
            found |= {name: partial(_tracker, number) for number, name in enumerate(TRACKERS)}
        if FREQUENCY in scene.randomization:
            found["matching-stretch"] = MatchingStretch
    return found


def _tracker(number: int, scene: Scene) -> Controller:
    return frequency_trackers(scene)[number]


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
        If the policy cannot be read, or the run has a base or a reward in a file of the user's.
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
    parts = recorded_parts(scene, run.read()["settings"], trust=False)
    return parts.controller(load_policy(run.policy), name)
