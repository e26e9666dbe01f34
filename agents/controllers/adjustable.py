"""Laws whose free numbers may change in every control step."""

from abc import abstractmethod
from collections.abc import Mapping
from copy import copy
from typing import Any, Self

from agents.control.controller import Law, Memory
from agents.controllers.registry import Free
from mm_gym.arrays import Array


class Adjustable(Law):
    """A law whose free numbers may be others in each lane and in each control step.

    Attributes
    ----------
    free
        The numbers that may change, by name.
    numbers
        All its numbers by name, each a float or (lanes,).
    inputs
        How many numbers `situation` has.
    """

    inputs: int

    def __init__(self, free: Mapping[str, Free], numbers: Mapping[str, Any]) -> None:
        self.free, self.numbers = dict(free), dict(numbers)

    def at(self, coordinates: Array) -> Self:
        """Return the law at coordinates (lanes, d) of a search that begins at its own numbers."""
        law, pairs = copy(self), zip(self.free.items(), coordinates.T, strict=True)
        law.numbers = self.numbers | {
            name: one.value(along, self.numbers[name]) for (name, one), along in pairs
        }
        return law

    @abstractmethod
    def situation(self, memory: Memory, state: Array) -> Array:
        """Return what its best numbers may depend on (lanes, inputs), of order one [-]."""
