"""Specifications of environments, by which Gymnasium makes them again, as plain data."""

from __future__ import annotations

import copy
from enum import Enum
from os import PathLike, fspath
from typing import TYPE_CHECKING, cast

from gymnasium.envs import registration

from mm_gym.scene.dotted_names import plain
from mm_gym.scene.scene import Scene
from mm_gym.tasks import ids

if TYPE_CHECKING:
    from gymnasium.envs.registration import EnvSpec


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
        self._spec = None if spec is None else written(spec, self.scene)


def written(spec: EnvSpec, scene: Scene) -> EnvSpec:
    """Return a specification with plain arguments that make an environment of the scene.

    A `Scene` that was given becomes changes of a task's.
    """
    own = copy.copy(spec)
    given = {name: value for name, value in spec.kwargs.items() if name != "max_episode_steps"}
    own.max_episode_steps = scene.control.steps
    task = registration.registry.get(spec.id)
    name = None if task is None else task.kwargs.get("scene")
    if isinstance(given.get("scene"), Scene):
        given |= {"scene": name if isinstance(name, str) else ids()[0], "changes": dict(scene)}
    if scene.own_reward is not None:
        given["reward"] = scene.own_reward.given
    own.kwargs = {key: _plain(value) for key, value in given.items()}
    return own


def _plain(value: object) -> object:
    if isinstance(value, Enum):
        return cast("object", value.value)
    if isinstance(value, PathLike):
        return fspath(cast("PathLike[str]", value))
    return plain(value)
