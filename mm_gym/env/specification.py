"""Specifications of environments, by which Gymnasium makes them again, as plain data."""

from __future__ import annotations

import copy
from enum import Enum
from os import PathLike, fspath
from typing import TYPE_CHECKING, cast

from gymnasium.envs import registration

from mm_gym.scene.dotted_names import plain

if TYPE_CHECKING:
    from gymnasium.envs.registration import EnvSpec

    from mm_gym.scene.scene import Scene


class Specified:
    """An environment whose specification can be written as JSON, whatever it was made from."""

    scene: Scene
    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """What `gymnasium.make` or `make_vec` makes this environment from, or None."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = None if spec is None else written(spec, self.scene.control.steps)


def written(spec: EnvSpec, steps: int) -> EnvSpec:
    """Return a specification with plain arguments and this number of control steps."""
    own = copy.copy(spec)
    own.kwargs = {
        name: _plain(value) for name, value in spec.kwargs.items() if name != "max_episode_steps"
    }
    own.max_episode_steps = steps
    task = registration.registry.get(spec.id)
    if task is None or steps != task.max_episode_steps:
        return own
    if own.kwargs.get("scene") != task.kwargs.get("scene"):  # it may say another number
        own.kwargs["changes"] = (own.kwargs.get("changes") or {}) | {"control.steps": steps}
    return own


def _plain(value: object) -> object:
    if isinstance(value, Enum):
        return cast("object", value.value)
    if isinstance(value, PathLike):
        return fspath(cast("PathLike[str]", value))
    return plain(value)
