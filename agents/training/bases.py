"""The controllers to which an agent can be added, by name or from a user's file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from agents.controllers.user_defined import user_defined
from agents.evaluation.laws import laws, not_a_law
from agents.user_code import is_path
from mm_gym import DesignError, SceneError

if TYPE_CHECKING:
    from agents.controllers.controller import Controller
    from mm_gym import Scene


def base_controller(scene: Scene, base: str) -> Controller:
    """Return the controller that an agent is added to, tuned on the validation episodes.

    A law of a user's file is fed the state that `ObservedState` estimates from the observation.

    Raises
    ------
    SceneError
        If the base cannot be made, or does not suit the scene.
    """
    if is_path(base):
        return user_defined(base, scene, "base")[-1]
    applicable = laws(scene)
    if base not in applicable:
        raise not_a_law(base, scene, "base", "or FILE.py:NAME")
    try:
        return applicable[base](scene)
    except DesignError as error:
        msg = f"base: {base} cannot be designed for this scene: {error}"
        raise SceneError(msg) from error
