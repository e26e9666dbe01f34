"""Checks of what callers pass, the same for the single and the vector environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import TypeAlias, cast

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import ArrayLike, NDArray

from mm_gym.arrays import Array, Single
from mm_gym.env.own_reward import RewardLike, rewarded
from mm_gym.errors import ActionError, SceneError, check_name, refuse
from mm_gym.scene.scene import Scene
from mm_gym.scene.toml_file import load_scene
from mm_gym.simulation.checks import array_of, checked_seed, is_array

FLOAT32 = np.dtype(np.float32)


SceneLike: TypeAlias = "Scene | str | PathLike[str]"  # A scene, a task's id, or a file's path

Seeds: TypeAlias = "int | np.integer | Sequence[int | np.integer | None] | NDArray[np.integer]"
"""A seed, or one for each lane."""

Changes: TypeAlias = "Mapping[str, object]"  # dotted name -> value


def scene_of(
    scene: SceneLike, changes: Changes | None = None, reward: RewardLike | None = None
) -> Scene:
    """Return a scene with some fields changed by dotted name, and perhaps an own reward.

    It must have an actuator.
    """
    if isinstance(scene, str | PathLike):
        scene = load_scene(scene)
    if not isinstance(scene, Scene):
        allowed = "a Scene, the id of a task or the path of a TOML file"
        refuse("scene", f"{type(scene).__name__}", allowed)
    if changes is not None:
        drawn = scene.randomization.keys()
        scene = scene.replace(**_checked_changes(changes))
        for name in sorted(drawn & scene.randomization.keys() & changes.keys()):
            allowed = f"randomization.{name}, as the scene draws this field"
            refuse(f"changes: {name}", f"{changes[name]!r}", allowed)
    if not scene.actuation.names:
        msg = (
            "actuation: an environment needs an actuator; set actuation.force, "
            "actuation.stretch, actuation.damping or actuation.voltage"
        )
        raise SceneError(msg)
    return rewarded(scene, reward)


def _checked_changes(changes: object) -> dict[str, object]:
    if isinstance(changes, Mapping):
        values = dict(cast("Mapping[str, object]", changes))
        if all(isinstance(name, str) for name in values):
            return values
    return refuse("changes", f"{changes!r}", "a dictionary of values by dotted name")


def checked_autoreset_mode(mode: str | AutoresetMode) -> AutoresetMode:
    """Return one of Gymnasium's three modes, or raise `SceneError` with the nearest."""
    name = mode.value if isinstance(mode, AutoresetMode) else mode
    check_name("autoreset_mode", name, [one.value for one in AutoresetMode])
    return AutoresetMode(mode)


def checked_options(options: object) -> dict[str, ArrayLike]:
    """Return a copy of the options of `reset`, or raise `SceneError`."""
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        refuse("options", f"{options!r}", "a dictionary of fields by dotted name")
    return dict(cast("Mapping[str, ArrayLike]", options))


def checked_mask(mask: ArrayLike | None, count: int) -> NDArray[np.bool_]:
    """Return the mask of the lanes to reset (all by default), or raise `SceneError`."""
    if mask is None:
        return np.ones(count, np.bool_)
    # A copy: the kernels would be compiled again for a read-only or strided array.
    array = array_of(mask, "reset_mask").copy()
    if array.shape != (count,) or array.dtype != np.bool_:
        refuse("reset_mask", f"{array.dtype} of shape {array.shape}", f"bool of shape ({count},)")
    return array


def python_integer(seed: int | np.integer | None) -> int | None:
    """Return an integer of NumPy as Python's; leave what is none for Gymnasium to check."""
    if isinstance(seed, int | np.integer) and seed >= 0:
        return checked_seed(seed)
    return int(seed) if isinstance(seed, np.integer) else seed


def checked_seeds(seeds: Seeds, count: int) -> list[int | None]:
    """Return a seed per lane, None for those that keep their stream, or raise `SceneError`."""
    given = seeds.tolist() if isinstance(seeds, np.ndarray) else seeds
    if isinstance(given, Sequence) and len(cast("Sequence[int | None]", given)) == count:
        own = [python_integer(seed) for seed in cast("Sequence[int | None]", given)]
        if all(seed is None or (type(seed) is int and seed >= 0) for seed in own):
            return own
    allowed = f"an integer of at least 0, or a sequence or array of {count} of them"
    return refuse("seed", f"{seeds!r}", allowed)


def checked_actions(actions: object, shape: tuple[int, ...]) -> Array | Single:
    """Return actions as an ordinary floating-point array of the shape, or raise `ActionError`."""
    if (
        type(actions) is np.ndarray
        and actions.dtype is FLOAT32
        and actions.shape == shape
        and (actions.flags.carray or actions.flags.farray)
    ):
        return actions  # the common case
    try:
        array = np.asarray(actions)
    except (ValueError, TypeError, RuntimeError) as error:  # a tensor may raise any of them
        msg = f"action: not an array: {error}"
        raise ActionError(msg) from None
    if isinstance(actions, np.ma.MaskedArray):
        refuse("action", "a masked array", "a number for every lane", ActionError)
    if array.dtype.kind not in "fiu":
        refuse("action", f"type {array.dtype}", "numbers", ActionError)
    if array.shape != shape:
        refuse("action", f"shape {array.shape}", f"{shape}", ActionError)
    # The kernels would be compiled again for a read-only or strided array.
    return np.require(
        array, np.float32 if array.dtype == np.float32 else np.float64, ["C", "W", "A"]
    )


def _entry_of(state: object, name: str) -> object:
    if not isinstance(state, Mapping):
        refuse("state", f"{type(state).__name__}", "what get_state returned")
    return cast("Mapping[str, object]", state).get(name)


def flag_of(state: Mapping[str, object], name: str) -> bool:
    """Return a flag of what `get_state` returned, or raise `SceneError`."""
    flag = _entry_of(state, name)
    if type(flag) is not bool:
        refuse(f"state.{name}", f"{flag!r}", "true or false, from get_state")
    return flag


def flags_of(state: Mapping[str, object], name: str, count: int) -> NDArray[np.bool_]:
    """Return a flag per lane of what `get_state` returned, or raise `SceneError`."""
    flags = _entry_of(state, name)
    if not is_array(flags) or flags.dtype != np.bool_ or flags.shape != (count,):
        msg = f"state.{name}: allowed: a boolean array of shape ({count},)"
        raise SceneError(msg)
    return flags
