"""The controllers to which an agent can be added, by name or from a user's file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from agents.controllers.feedback import Feedback
from agents.controllers.lqg import LQG
from agents.controllers.matching_stretch import MatchingStretch
from agents.evaluation import baselines as tuned
from agents.training.user_code import is_path, load
from mm_gym import DesignError, SceneError
from mm_gym.errors import suggest

if TYPE_CHECKING:
    from collections.abc import Callable

    from agents.controllers.controller import Controller
    from mm_gym import Scene


def _regulator(scene: Scene) -> Controller:
    found = tuned.regulators(scene)
    if not found:
        msg = "objective.effort_weight: got 0; allowed: greater than 0, as for an LQR"
        raise DesignError(msg)
    return found[0]


def _frequency_tracking(scene: Scene) -> Controller:
    trackers = tuned.frequency_trackers(scene)
    if not trackers:
        msg = "excitation: frequency tracking needs harmonics alone"
        raise DesignError(msg)
    return next(one for one in trackers if "locked" in one.name)


def _predictive_control(scene: Scene) -> Controller:
    laws = tuned.classical_laws(scene)
    return tuned.predictive_control(scene, tuned.best_without_memory(scene, laws))


BASES: dict[str, Callable[[Scene], Controller]] = {
    "no_control": lambda scene: Feedback(scene, tuned.no_control(scene)),
    "constant": tuned.best_constant,
    "lqr": _regulator,
    "lqg": LQG,
    "velocity_feedback": tuned.best_velocity_feedback,
    "phase_law": tuned.best_phase_law,
    "clipped_lqr": tuned.best_clipped_lqr,
    "on_off_stiffness": tuned.best_on_off_stiffness,
    "resetting_stiffness": lambda scene: tuned.resetting_laws(scene)[0],
    "frequency_tracking": _frequency_tracking,
    "matching_stretch": MatchingStretch,
    "lqr_at_constant_stretch": tuned.best_lqr_at_constant_stretch,
    "lqr_with_clipped_lqr": tuned.best_lqr_with_clipped_lqr,
    "predictive_control": _predictive_control,
}
"""Names of the laws in agents/controllers, and what tunes them on the validation episodes."""


def check_base(base: str) -> None:
    """Raise `SceneError` with the nearest name unless a text names a base or a file's class."""
    if not is_path(base) and base not in BASES:
        msg = (
            f"base: got {base!r}{suggest(base, BASES)}; allowed: {', '.join(BASES)}, or file.py:Law"
        )
        raise SceneError(msg)


def base_controller(scene: Scene, base: str) -> Controller:
    """Return the controller that an agent is added to, tuned on the validation episodes.

    A class or function of a user's file is called with the scene. It returns a controller, with
    `reset` and `act`, or a law, with `begin` and `action`, which is fed the state that
    `ObservedState` estimates from the observation.

    Raises
    ------
    SceneError
        If the base cannot be made, or does not suit the scene.
    """
    check_base(base)
    try:
        if not is_path(base):
            return BASES[base](scene)
        made = load(base, "base")(scene)
    except SceneError:
        raise
    except (DesignError, ValueError) as error:
        msg = f"base: {base} cannot be designed for this scene: {error}"
        raise SceneError(msg) from error
    except Exception as error:
        msg = f"base: {base}: {type(error).__name__}: {error}"
        raise SceneError(msg) from error
    return _controller(scene, made, base)


def _controller(scene: Scene, made: object, base: str) -> Controller:
    """Return a user's controller, or a controller of a user's law."""
    if all(hasattr(made, name) for name in ("reset", "act")):
        defaults = {"name": base.rpartition(":")[2], "reads": "observation"}
    elif all(hasattr(made, name) for name in ("begin", "action")):
        defaults = {"name": base.rpartition(":")[2]}
    else:
        msg = (
            f"base: {base} makes a {type(made).__name__}; allowed: a controller, with `reset` and "
            "`act`, or a law, with `begin` and `action`"
        )
        raise SceneError(msg)
    for name, value in defaults.items():
        if not hasattr(made, name):
            setattr(made, name, value)
    return made if "reads" in defaults else Feedback(scene, made)  # pyright: ignore[reportReturnType, reportArgumentType]
