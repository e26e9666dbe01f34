"""A layer that is any computation, such as a controller's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any, ClassVar

import numpy as np

from agents.network.graph import CHOICE, FUNCTIONS, TABLE, TURNED, Graph, Signal
from agents.network.layers import Layer, Numbers
from mm_gym.arrays import Array


def _row(index: Numbers, rows: Array) -> Numbers:
    place = np.clip(index, 0.0, len(rows) - 1.0).astype(np.intp)
    return np.take_along_axis(rows[None], place[:, 0][:, None, None], axis=1)[:, 0]


def _turned(matrix: Numbers, vector: Numbers) -> Numbers:
    columns = vector.shape[1]
    rows = matrix.reshape(-1, matrix.shape[1] // columns, columns)
    return np.einsum("nij,nj->ni", rows, vector)


MADE: dict[str, Callable[..., Numbers]] = {
    **{name: getattr(np, name) for name in FUNCTIONS},
    CHOICE: np.where,
    TABLE: _row,
    TURNED: _turned,
    "slice": lambda signal, first, count: signal[:, first : first + count],
    "concatenate": lambda *inputs: np.concatenate(inputs, 1),
    "product": lambda signal, weight, bias=0.0: signal @ weight.T + bias,
}
"""By the name of an operation: what makes its numbers (lanes, width)."""


@dataclass(frozen=True, eq=False)
class Arithmetic(Layer):
    """A computation from the values and what is remembered to the outputs and what then is.

    An operation is a list: its name, and its inputs. An input is the number of an earlier
    operation, or of a constant a list: the place of its first number among `constants`, and the
    numbers of its rows and columns. Operation 0 is the values, 1 what is remembered, and the last
    one the outputs and what is remembered then. A slice has its beginning and its length instead of
    further inputs.
    """

    operations: list[Any]
    constants: Array
    remembered: int
    fixed: ClassVar[tuple[str, ...]] = ("constants",)

    @classmethod
    def of(cls, graph: Graph) -> Arithmetic:
        """Return the computation from "observation" and "memory" to "action" and "next_memory"."""
        parts: Any = [graph.outputs[name] for name in ("action", "next_memory")]
        graph.outputs = {"whole": graph.joined(parts)}
        inputs = [graph.inputs[name].made_by for name in ("observation", "memory")]
        numbers = {one: k for k, one in enumerate([*inputs, *graph.needed()])}
        constants = [0.0]  # a file has no empty arrays

        def told(one: Signal | Array) -> int | list[int]:
            if isinstance(one, Signal):
                return numbers[one.made_by]
            rows = np.atleast_2d(one)
            constants.extend(rows.ravel().tolist())
            return [len(constants) - rows.size, *rows.shape]

        operations: list[Any] = []
        for one in list(numbers)[2:]:
            span = [one.first, one.width] if one.name == "slice" else []
            operations.append([one.name, *map(told, one.inputs), *span])
        # A limit that there is not is the largest number, as files have finite ones.
        return cls(operations, np.nan_to_num(constants), inputs[1].width)

    @property
    def remembers(self) -> int:
        return self.remembered

    def outputs(self, inputs: int) -> int:
        graph = Graph()
        given = graph.input("observation", inputs), graph.input("memory", self.remembered)
        try:
            width = self._whole(*given).made_by.width
        except (TypeError, ValueError, LookupError, AttributeError) as error:
            msg = f"arithmetic: its operations do not fit each other: {error}"
            raise ValueError(msg) from error
        return width - self.remembered

    def forward(self, xp: ModuleType, values: Numbers, memory: Numbers) -> tuple[Numbers, Numbers]:
        if xp is not np:
            msg = "arithmetic: has no gradient; train an agent around the controller instead"
            raise TypeError(msg)
        with np.errstate(all="ignore"):  # of a quotient that is then not chosen
            whole = self._whole(values, memory)
        count = whole.shape[1] - self.remembered
        return whole[:, :count], whole[:, count:]

    def _whole(self, values: Numbers, memory: Numbers) -> Numbers:
        found = [values, memory]
        for name, *inputs in self.operations:
            whole = inputs[:1] if name == "slice" else inputs
            given = [self._input(one, found) for one in whole]
            found.append(MADE[name](*given, *inputs[len(whole) :]).astype(np.float64))
        return found[-1]

    def _input(self, one: int | list[int], found: list[Numbers]) -> Numbers:
        if isinstance(one, int):
            return found[range(len(found))[one]]
        first, *shape = one
        return self.constants[first:][: shape[0] * shape[1]].reshape(shape)
