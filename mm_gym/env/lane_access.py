"""Methods and attributes of single lanes, as Gymnasium's vectors of environments offer them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

from mm_gym.simulation.checks import is_array

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import numpy as np
    from numpy.typing import NDArray

SINGLE = {"action_space": "single_action_space", "observation_space": "single_observation_space"}
"""Attributes of a single environment that a vector has by another name."""


class LaneAccess:
    """A vector environment whose lanes can be asked one by one.

    As with Gymnasium's `SyncVectorEnv`, answers are tuples with an entry for each lane. All lanes
    are one environment, so what they share cannot be set for some of them.
    """

    num_envs: int
    _own: dict[str, tuple[object, ...]]
    """Attributes that `set_attr` has set: one value for each lane."""

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:  # noqa: ANN401 - Gymnasium's signature
        """Call a method of each lane, or get an attribute.

        Parameters
        ----------
        name
            ``"render"``, ``"drawn"``, ``"get_state"`` (for `MovingMassEnv.set_state`), ``"close"``,
            or the name of an attribute.
        *args, **kwargs
            Those of the method.

        Raises
        ------
        AttributeError
            If `MovingMassEnv` has nothing of this name, or a method that one lane cannot run by
            itself, such as ``"step"``.
        """
        if name in self._own:
            return self._own[name]
        value = getattr(self, SINGLE.get(name, name))
        if name == "get_state":
            return tuple(self._state_of(lane) for lane in range(self.num_envs))
        if name in {"render", "drawn", "close"}:
            value = cast("Callable[..., object]", value)(*args, **kwargs)
        elif callable(value) or name.startswith("_"):
            msg = f"{name}: a single lane cannot run it; call it on the vector environment"
            raise AttributeError(msg)
        if name in {"render", "drawn", "state"} and value is not None:
            return tuple(cast("NDArray[Any]", value))
        return (value,) * self.num_envs

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of each lane, see `call`."""
        return self.call(name)

    def set_attr(self, name: str, values: object) -> None:
        """Set an attribute of the caller's own in each lane.

        Parameters
        ----------
        name
            A name that the environment does not use.
        values
            A list or tuple with a value for each lane, or one value for all.

        Raises
        ------
        ValueError
            If the number of values is another one than that of lanes, or the environment uses the
            name: its attributes follow from the scene, and setting them would have no effect.
        """
        if not isinstance(values, list | tuple):
            values = (values,) * self.num_envs
        given = tuple(cast("tuple[object, ...]", values))
        if len(given) != self.num_envs:
            msg = f"{name}: got {len(given)} values; allowed: one, or {self.num_envs} of them"
            raise ValueError(msg)
        if hasattr(self, name):
            msg = (
                f"{name}: the environment's own, which follows from its scene; allowed: a new name"
            )
            raise ValueError(msg)
        self._own[name] = given

    def get_state(self) -> dict[str, object]:
        """Return the state of all lanes."""
        raise NotImplementedError

    def _state_of(self, lane: int) -> Mapping[str, object]:
        """Return the state of a lane as `MovingMassEnv.set_state` takes it."""
        state = self.get_state()
        finished = cast("NDArray[np.bool_]", state.pop("finished"))
        columns = {
            name: value[..., lane : lane + 1].copy() if is_array(value) else value
            for name, value in state.items()
        }
        return columns | {"running": not bool(finished[lane])}
