"""Spaces and action checks, the same for the single and the vector environment."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from typing import TYPE_CHECKING, cast

import numpy as np
from gymnasium.spaces import Box

from mm_gym.errors import ActionError, SceneError
from mm_gym.kernels import layout as at
from mm_gym.scene.scene import Scene
from mm_gym.scene.toml_file import load_scene

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from mm_gym.plant.plant import Plant

FLOAT32 = np.dtype(np.float32)


def scene_of(scene: Scene | str | PathLike[str]) -> Scene:
    """Return a scene by itself, a task's id or a file's path; it must have an actuator."""
    if isinstance(scene, str | PathLike):
        scene = load_scene(scene)
    if not isinstance(scene, Scene):
        msg = (
            f"scene: got {type(scene).__name__}; allowed: a Scene, a task's id or the path of a "
            "TOML file"
        )
        raise SceneError(msg)
    if scene.actuation.force is None and scene.actuation.stretch is None:
        msg = (
            "actuation: an environment needs an actuator; set actuation.force or actuation.stretch"
        )
        raise SceneError(msg)
    return scene


def action_space(plant: Plant) -> Box:
    """Return one number in [-1, 1] per actuator."""
    return Box(-1.0, 1.0, (len(plant.actuators),), np.float32)


def observation_space(plant: Plant) -> Box:
    """Return the scaled channels of each observed frame, oldest frame first."""
    size = plant.history * len(plant.channels)
    return Box(-at.OBSERVATION_BOUND, at.OBSERVATION_BOUND, (size,), np.float32)


def checked_options(options: object) -> dict[str, ArrayLike]:
    """Return a copy of the options of `reset`, or raise `SceneError`."""
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        msg = f"options: got {options!r}; allowed: a dictionary of fields by dotted name"
        raise SceneError(msg)
    return dict(cast("Mapping[str, ArrayLike]", options))


def checked_actions(
    actions: object, shape: tuple[int, ...]
) -> NDArray[np.float64] | NDArray[np.float32]:
    """Return actions as an ordinary floating-point array of the shape, or raise `ActionError`."""
    if (
        type(actions) is np.ndarray
        and actions.dtype is FLOAT32
        and actions.shape == shape
        and (actions.flags.carray or actions.flags.farray)
    ):
        return actions  # what is usual, at once
    try:
        array = np.asarray(actions)
    except (ValueError, TypeError, RuntimeError) as error:  # tensors raise what they like
        msg = f"action: not an array: {error}"
        raise ActionError(msg) from None
    if isinstance(actions, np.ma.MaskedArray):
        msg = "action: got a masked array; allowed: a number for every lane"
        raise ActionError(msg)
    if array.dtype.kind not in "fiu":
        msg = f"action: got type {array.dtype}; allowed: numbers"
        raise ActionError(msg)
    if array.shape != shape:
        msg = f"action: got shape {array.shape}; allowed: {shape}"
        raise ActionError(msg)
    # Read-only and strided arrays are types of their own, for which every kernel would be compiled
    # anew.
    return np.require(
        array, np.float32 if array.dtype == np.float32 else np.float64, ["C", "W", "A"]
    )
