"""What the single and the vector environment have in common."""

from __future__ import annotations

import copy
import warnings
from abc import ABC, abstractmethod
from collections.abc import Mapping
from enum import Enum
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any, ClassVar, Self, cast

import numpy as np
from gymnasium.envs import registration
from gymnasium.envs.registration import EnvSpec

from mm_gym.env.outputs import Terms
from mm_gym.errors import SceneError, refuse, suggest
from mm_gym.plant.compile import compile_scene
from mm_gym.plant.plant import Plant
from mm_gym.scene.part import plain
from mm_gym.scene.scene import Scene
from mm_gym.simulation.lanes import Lanes
from mm_gym.tasks import ids

if TYPE_CHECKING:
    from mm_gym.rendering.renderer import Renderer


SEEDS = 2**63  # number of seeds to choose from where none is given

SINGLE_MODES = ["human", "rgb_array"]
"""Modes that a single environment declares: for ``"rgb_array_list"``, which it knows too,
`gymnasium.make` puts a wrapper of its own around it."""

RENDER_MODES = [*SINGLE_MODES, "rgb_array_list"]


class Environment(ABC):
    """Lanes of a scene's plant that can be seeded, drawn, pickled, and made again from plain data.

    Episodes draw from streams of their own. The generator gives the stream of the first reset
    without a seed its seed, and that of the first one after the generator was set.
    """

    scene: Scene
    plant: Plant
    render_mode: str | None
    _lanes: Lanes
    _terms: Terms
    _renderer: Renderer | None
    _prepared: ClassVar[frozenset[str]]
    """Names of the attributes that `_prepare` makes."""
    _spec: EnvSpec | None = None
    _np_random: np.random.Generator | None = None
    _np_random_seed: int | None = None
    _draws_seed = True
    """Whether the next reset draws a seed, if it is not given one."""

    @abstractmethod
    def _prepare(self) -> None:
        """Make the attributes that follow from the scene."""

    @abstractmethod
    def get_state(self) -> dict[str, object]:
        """Return the current state."""

    @abstractmethod
    def set_state(self, state: Mapping[str, object]) -> None:
        """Restore a state."""

    def _compile(self, lanes: int, threads: int = 1) -> None:
        """Compile the scene, and make its lanes and what draws them."""
        own = self.scene.own_reward
        self.plant = compile_scene(self.scene)
        self._lanes = Lanes(self.plant, lanes, threads, own)
        self._terms = Terms(self.plant, own=own is not None)
        self._renderer = None
        if self.render_mode in RENDER_MODES:
            from mm_gym.rendering.renderer import Renderer  # noqa: PLC0415 - for pictures only

            self._renderer = Renderer(self.scene, self._lanes, self.render_mode)
        elif self.render_mode is not None:  # Gymnasium warns too, and makes the environment
            warnings.warn(_unknown(self.render_mode), UserWarning, stacklevel=2)

    def _frames(self) -> list[Any] | None:
        """Return each lane's picture or list of them, None if nothing is to be drawn."""
        if self._renderer is None and self.render_mode is not None:
            raise SceneError(_unknown(self.render_mode))
        return None if self._renderer is None else self._renderer.render()

    @property
    def spec(self) -> EnvSpec | None:
        """What `gymnasium.make` or `make_vec` makes this environment from, or None."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = None if spec is None else written(spec, self.scene)

    @property
    def np_random(self) -> np.random.Generator:
        """The generator from which seeds are drawn.

        It can be set; all but a generator of NumPy raises `SceneError`.
        """
        return super().np_random  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType, reportAttributeAccessIssue] - of Gymnasium's class

    @np_random.setter
    def np_random(self, value: np.random.Generator) -> None:
        if not isinstance(value, np.random.Generator):  # pyright: ignore[reportUnnecessaryIsInstance] - callers may not check types
            refuse("np_random", f"{value!r}", "a numpy.random.Generator")
        self._np_random, self._np_random_seed = value, -1  # as Gymnasium
        self._draws_seed = True

    def _drawn_seed(self) -> int:
        self._draws_seed = False
        return int(self.np_random.integers(SEEDS))

    # The lanes, the views of them and the compiled kernels bound to them belong together: if each
    # attribute were copied by itself, the copy's kernels would write to the original's memory.

    def __getstate__(self) -> dict[str, Any]:
        """Return the current state, and all attributes but those that `_prepare` makes."""
        kept = {name: value for name, value in vars(self).items() if name not in self._prepared}
        return kept | {"current state": self.get_state()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the pickled state."""
        current = state.pop("current state")
        vars(self).update(state)
        self._prepare()
        self.set_state(current)

    def __copy__(self) -> Self:
        """Return a deep copy: with the same lanes, two environments would disturb each other."""
        return copy.deepcopy(self)


def _unknown(mode: str) -> str:
    nearest = suggest(str(mode), RENDER_MODES)
    return f"render_mode: got {mode!r}{nearest}; allowed: None, {', '.join(RENDER_MODES)}"


def written(spec: EnvSpec, scene: Scene) -> EnvSpec:
    """Return a specification with plain arguments, as for JSON, that make the scene's environment.

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
