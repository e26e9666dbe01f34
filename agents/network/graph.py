"""NumPy code as a list of operations, from which C and ONNX are written.

A `Signal` stands for numbers (lanes, n). Given one in the place of an array, NumPy's functions and
operators note what they would have computed: so what is exported is the code that acts, and not a
second description of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from mm_gym.arrays import Array

UNARY = ("tanh", "negative", "absolute", "sqrt")
BINARY = ("add", "subtract", "multiply", "divide", "minimum", "maximum")
"""Names of NumPy's functions that are followed, number by number."""


@dataclass(eq=False)
class Operation:
    """One of the steps of a computation."""

    # "input", "slice", "concatenate", "product" (x @ W.T, + bias), or one of `UNARY` or `BINARY`.
    name: str
    inputs: list[Signal | Array]  # signals, or constants: arrays (n,), or (m, n) of a product
    width: int  # how many numbers it makes in each lane
    first: int = 0  # of a slice, the number of its input with which it begins


@dataclass(eq=False)
class Signal(NDArrayOperatorsMixin):
    """What an operation makes."""

    graph: Graph
    made_by: Operation

    @property
    def shape(self) -> tuple[None, int]:
        """The number of lanes is open."""
        return None, self.made_by.width

    def __getitem__(self, key: tuple[slice, slice]) -> Signal:
        """Return some neighbouring columns."""
        lanes, columns = key if isinstance(key, tuple) else (key, slice(None))
        if lanes != slice(None) or not isinstance(columns, slice) or columns.step not in (None, 1):
            msg = f"signal[{lanes}, {columns}]: cannot be exported; allowed: [:, first:last]"
            raise TypeError(msg)
        first, last, _ = columns.indices(self.made_by.width)
        return self.graph.add("slice", [self], max(last - first, 0), first)

    def __array_ufunc__(self, function: np.ufunc, method: str, *given: Any, **other: Any) -> Signal:  # noqa: ANN401 - NumPy's
        name = function.__name__
        if method == "__call__" and not other and name == "matmul" and isinstance(given[0], Signal):
            signal, matrix = given
            weight = np.asarray(matrix, np.float64).T
            return self.graph.add("product", [signal, weight], len(weight))
        if method != "__call__" or other or name not in (*UNARY, *BINARY):
            return NotImplemented
        inputs = [
            one if isinstance(one, Signal) else np.asarray(one, np.float64).reshape(-1)
            for one in given
        ]
        width = max(one.shape[-1] for one in inputs)
        return self.graph.add(name, inputs, width)

    def __array_function__(
        self, function: Callable[..., Any], _: object, given: tuple[Any, ...], other: dict[str, Any]
    ) -> Signal:
        if function is np.concatenate and not other and given[1:] == (1,):
            inputs = [one for one in given[0] if one.shape[1]]
            return self.graph.add("concatenate", inputs, sum(one.shape[1] for one in inputs))
        if function is np.clip and not other:
            signal, low, high = given
            signal = signal if low is None else np.maximum(signal, low)
            return signal if high is None else np.minimum(signal, high)
        return NotImplemented


@dataclass(eq=False)
class Graph:
    """A computation over lanes."""

    operations: list[Operation] = field(default_factory=list)
    # inputs, outputs: by name
    inputs: dict[str, Signal] = field(default_factory=dict)
    outputs: dict[str, Signal] = field(default_factory=dict)

    def input(self, name: str, width: int) -> Signal:
        """Return an input of so many numbers."""
        self.inputs[name] = self.add("input", [], width)
        return self.inputs[name]

    def add(self, name: str, inputs: list[Signal | Array], width: int, first: int = 0) -> Signal:
        """Append an operation."""
        before = inputs[0].made_by if inputs and isinstance(inputs[0], Signal) else None
        if name == "add" and before is not None and before.name == "product":
            bias = inputs[1]
            if not isinstance(bias, Signal) and len(before.inputs) == 2:  # noqa: PLR2004 - without bias
                name, inputs = "product", [*before.inputs, np.broadcast_to(bias, width)]
        self.operations.append(Operation(name, inputs, width, first))
        return Signal(self, self.operations[-1])

    def needed(self) -> list[Operation]:
        """Return the operations that the outputs follow from, in order."""
        found = [signal.made_by for signal in self.outputs.values()]
        for operation in reversed(self.operations):
            if operation in found:
                found += [one.made_by for one in operation.inputs if isinstance(one, Signal)]
        return [one for one in self.operations if one in found and one.name != "input"]
