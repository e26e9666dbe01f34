"""Pickling and copying of environments by scene and state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import deepcopy
from typing import TYPE_CHECKING, Any, ClassVar, Self

if TYPE_CHECKING:
    from collections.abc import Mapping


class Picklable(ABC):
    """An environment that can be pickled and copied.

    Its lanes, the views of them and the compiled kernels bound to them belong together: if each
    attribute were copied by itself, the copy's kernels would write to the memory of the original.
    """

    _prepared: ClassVar[frozenset[str]]
    """Names of the attributes that `_prepare` makes."""

    @abstractmethod
    def _prepare(self) -> None:
        """Make the attributes that follow from the scene."""

    @abstractmethod
    def get_state(self) -> dict[str, object]:
        """Return the current state."""

    @abstractmethod
    def set_state(self, state: Mapping[str, object]) -> None:
        """Restore a state."""

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
        return deepcopy(self)
