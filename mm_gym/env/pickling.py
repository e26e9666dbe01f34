"""What pickle and copy take of an environment: its scene and its present."""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import deepcopy
from typing import TYPE_CHECKING, Any, ClassVar, Self

from mm_gym.errors import SceneError

if TYPE_CHECKING:
    from collections.abc import Mapping


def flag_of(state: Mapping[str, object], name: str) -> bool:
    """Return a flag of what `get_state` returned, or raise `SceneError`."""
    flag = state.get(name)
    if type(flag) is not bool:
        msg = f"state.{name}: got {flag!r}; allowed: true or false, from get_state"
        raise SceneError(msg)
    return flag


class Picklable(ABC):
    """An environment that can be pickled and copied.

    Its lanes, the views of them and the compiled kernels that work on them belong together; taken
    one by one, the copy's kernels would go on in the memory of the original.
    """

    _prepared: ClassVar[frozenset[str]]
    """Names of the attributes that `_prepare` makes."""

    @abstractmethod
    def _prepare(self) -> None:
        """Make what follows from the scene."""

    @abstractmethod
    def get_state(self) -> dict[str, object]:
        """Return the present."""

    @abstractmethod
    def set_state(self, state: Mapping[str, object]) -> None:
        """Continue from there."""

    def __getstate__(self) -> dict[str, Any]:
        """Return all attributes but those that `_prepare` makes, and the present."""
        kept = {name: value for name, value in vars(self).items() if name not in self._prepared}
        return kept | {"present": self.get_state()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Be where the other one was."""
        present = state.pop("present")
        vars(self).update(state)
        self._prepare()
        self.set_state(present)

    def __copy__(self) -> Self:
        """Return a deep copy: half a copy would not be an environment."""
        return deepcopy(self)
