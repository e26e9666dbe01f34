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
from mm_gym.errors import refuse


def _row(index: Numbers, rows: Array) -> Numbers:
    # Also of NaN, which no comparison holds of, a row.
    place = np.where(index > 0.0, np.minimum(index, len(rows) - 1.0), 0.0).astype(np.intp)
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

INPUTS = {CHOICE: 3, **{name: form.count("{}") for name, (form, _) in FUNCTIONS.items()}}
"""By the name of an operation number by number: how many inputs it has."""

MOST = 2**16
"""Numbers that all operations make in a lane, at most."""

SHOWN = 80  # characters of an operation in a message
NONE = -1, -1


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
        self.require(constants=(len(self.constants),))
        widths, left = [inputs, self.remembered], MOST
        for operation in self.operations:
            widths.append(self._width(operation, widths) if isinstance(operation, list) else 0)
            left -= widths[-1]
            if left < 0 or not widths[-1]:
                got = f"{str(operation)[:SHOWN]} as number {len(widths) - 1}"
                allowed = f"an operation with inputs that fit; all make at most {MOST:,} numbers"
                refuse("arithmetic, operations", got, allowed, ValueError)
        if not 0 <= self.remembered < widths[-1]:
            allowed = f"0 to {widths[-1] - 1}, as the last operation has {widths[-1]} numbers"
            refuse("arithmetic, remembered", f"{self.remembered}", allowed, ValueError)
        return widths[-1] - self.remembered

    def _width(self, operation: list[Any], widths: list[int]) -> int:
        """Return how many numbers an operation makes in each lane, or 0 if it is none."""
        width, (name, *inputs) = 0, operation or [""]
        given = [self._shape(one, widths) for one in inputs]
        match [name, *given]:
            case ["slice", (0, n), _, _]:
                _, first, count = inputs
                fits = type(first) is type(count) is int and min(first, count) >= 0
                width = count if fits and first + count <= n else 0
            case ["product", (0, n), (rows, columns), *bias] if rows > 0 and columns == n:
                width = rows if bias in ([], [(1, rows)]) else 0
            case ["take", (0, 1), (rows, columns)] if rows > 0:
                width = columns
            case ["turned", (0, n), (0, columns)] if columns > 0 and n % columns == 0:
                width = n // columns
            case ["concatenate", *_] if all(rows == 0 for rows, _ in given):
                width = sum(columns for _, columns in given)
            case [str(), *_] if given and len(given) == INPUTS.get(name):
                most = max(columns for _, columns in given)
                lanes, columns = map(set, zip(*given, strict=True))
                width = most if 0 in lanes and lanes <= {0, 1} and columns <= {1, most} else 0
        return width

    def _shape(self, one: object, widths: list[int]) -> tuple[int, int]:
        """Return the rows and columns of a constant; 0 rows are those of an operation, -1 none."""
        match one:
            case [int(first), int(rows), int(columns)] if min(first, rows - 1, columns - 1) >= 0:
                return (rows, columns) if first + rows * columns <= len(self.constants) else NONE
            case int(number) if 0 <= number < len(widths):
                return 0, widths[number]
        return NONE

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
            return found[one]
        first, *shape = one
        return self.constants[first:][: shape[0] * shape[1]].reshape(shape)
