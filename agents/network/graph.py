"""NumPy code as a list of operations, from which C and ONNX are written, and which a file can hold.

A `Signal` stands for numbers of each lane. Given one in the place of an array, NumPy's functions
and operators note what they would have computed: so what is exported is the code that acts, and not
a second description of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import prod
from typing import Any, NoReturn

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from mm_gym.arrays import Array

COMPARISONS = {
    "greater": (">", "Greater"),
    "greater_equal": (">=", "GreaterOrEqual"),
    "less": ("<", "Less"),
    "less_equal": ("<=", "LessOrEqual"),
    "equal": ("==", "Equal"),
    "not_equal": ("!=", "Equal"),
}
"""They make 1 or 0."""

CALLS = {
    "sqrt": ("sqrt", "Sqrt"),
    "absolute": ("fabs", "Abs"),
    "rint": ("rint", "Round"),
    "sin": ("sin", "Sin"),
    "cos": ("cos", "Cos"),
    "arccos": ("acos", "Acos"),
    "exp": ("exp", "Exp"),
    "log": ("log", "Log"),
}

FUNCTIONS = {
    **{name: (f"(REAL)({{}} {c} {{}})", onnx) for name, (c, onnx) in COMPARISONS.items()},
    **{name: (f"(REAL){c}((double){{}})", onnx) for name, (c, onnx) in CALLS.items()},
    "tanh": ("hyperbolic({})", "Tanh"),
    "negative": ("-{}", "Neg"),
    "sign": ("sign({})", "Sign"),
    "add": ("{} + {}", "Add"),
    "subtract": ("{} - {}", "Sub"),
    "multiply": ("{} * {}", "Mul"),
    "divide": ("{} / {}", "Div"),
    "minimum": ("least({}, {})", "Min"),
    "maximum": ("most({}, {})", "Max"),
    "power": ("(REAL)pow((double){}, (double){})", "Pow"),
}
"""NumPy's functions that are followed, number by number, with what they are in C and in ONNX."""

NEUTRAL = {"add": 0.0, "subtract": 0.0, "multiply": 1.0, "divide": 1.0}
"""By name: the second input that leaves the first as it is."""

CHOICE, TABLE, TURNED = "where", "take", "turned"
"""The number of one of two signals; the row of a constant (rows, m) that a number tells, or the
last one beyond them; the product of a signal (i, j), row after row, and a signal (j,)."""


@dataclass(eq=False)
class Operation:
    """One of the steps of a computation."""

    # "input", "slice", "concatenate", "product" (x @ W.T, + bias), `CHOICE`, `TABLE`, `TURNED`, or
    # one of `FUNCTIONS`.
    name: str
    # Signals, or constants: arrays (n,) or (1,), or (m, n) of a product or a table.
    inputs: list[Signal | Array]
    width: int  # how many numbers it makes in each lane
    first: int = 0  # of a slice, the number of its input with which it begins


@dataclass(eq=False)
class Signal(NDArrayOperatorsMixin):
    """What an operation makes: an array (lanes, *inner)."""

    graph: Graph
    made_by: Operation
    inner: tuple[int, ...]

    @property
    def shape(self) -> tuple[int | None, ...]:
        """The number of lanes is open."""
        return None, *self.inner

    @property
    def ndim(self) -> int:
        """The number of its dimensions."""
        return 1 + len(self.inner)

    @property
    def T(self) -> tuple[Signal, ...]:  # noqa: N802 - NumPy's
        """The columns."""
        return tuple(self[:, k] for k in range(self.inner[0]))

    def __len__(self) -> int:
        """Return 1: arrays of so many lanes fit any number of lanes."""
        return 1

    def __bool__(self) -> bool:
        raise TypeError(REFUSED.format("a choice between statements by a number", "np.where"))

    def any(self) -> bool:
        """Some lane may be: both are computed, and each lane chooses."""
        return True

    def astype(self, *_: object, **__: object) -> Signal:
        """Return the same: all numbers are of one type."""
        return self

    copy = astype

    def reshape(self, lanes: int | None, *inner: int) -> Signal:
        """Return the same numbers in another shape (-1, *inner), or (None, *inner)."""
        if lanes not in {-1, None} or prod(inner) != self.made_by.width:
            _refuse(f"array.reshape({lanes}, {inner})", f"-1, and {self.made_by.width} numbers")
        return Signal(self.graph, self.made_by, inner)

    def __getattr__(self, name: str) -> NoReturn:
        raise AttributeError(REFUSED.format(f"array.{name}", ALLOWED))

    def __array__(self, *_: object) -> Array:
        _refuse("array as what other code reads, or as a part of an array of numbers", ALLOWED)

    def __getitem__(self, key: Any) -> Signal:  # noqa: ANN401 - NumPy's
        """Return some columns."""
        lanes, *rest = key if isinstance(key, tuple) else (key,)
        if not isinstance(lanes, slice) or lanes != slice(None):
            _refuse("array[lanes]", "array[:, columns]")
        if all(one is None for one in rest):
            return self.reshape(-1, *[1] * len(rest), *self.inner)
        if len(rest) != 1:
            _refuse(f"array[:, {rest}]", "array[:, columns]")
        (columns,) = rest
        size, *further = self.inner
        if isinstance(columns, int | np.integer):
            return self._slice(range(size)[columns], 1).reshape(-1, *further)
        if isinstance(columns, slice) and columns.step in (None, 1):
            first, last, _ = columns.indices(size)
            return self._slice(first, max(last - first, 0))
        chosen = np.arange(size)[columns if isinstance(columns, slice) else list(columns)]
        if not chosen.size:
            return self.graph.add("concatenate", [], 0)
        if (np.diff(chosen) == 1).all():
            return self._slice(int(chosen[0]), len(chosen))
        return np.concatenate([self._slice(int(k), 1) for k in chosen], 1)

    def _slice(self, first: int, count: int) -> Signal:
        size, *further = self.inner
        unit = prod(further)
        if count == size:
            return self
        made = self.graph.add("slice", [self], count * unit, first * unit)
        return made.reshape(-1, count, *further)

    def __array_ufunc__(self, function: np.ufunc, method: str, *given: Any, **other: Any) -> Signal:  # noqa: ANN401 - NumPy's
        name = function.__name__
        if method != "__call__" or other:
            changed = " in place" if "out" in other else f", {', '.join([method, *other])}"
            _refuse(f"np.{name}{changed}", ALLOWED)
        if name == "matmul" and isinstance(given[0], Signal):
            signal, matrix = given[0], np.asarray(given[1], np.float64)
            if signal.inner != matrix.shape[:1]:
                shapes = f"{('lanes', *signal.inner)} and {matrix.shape}"
                _refuse(f"@ of shapes {shapes}", "(lanes, m) and (m, k)")
            made = self.graph.add("product", [signal, np.atleast_2d(matrix.T)], matrix[0].size)
            return made if matrix.ndim > 1 else made.reshape(-1)
        if name in REWRITTEN:
            return REWRITTEN[name](*given)
        if name == "power" and not isinstance(given[1], Signal) and np.all(given[1] == 2):  # noqa: PLR2004 - as NumPy
            return given[0] * given[0]
        if name not in FUNCTIONS:
            _refuse(f"np.{name}", ALLOWED)
        return self.graph.each(name, *given)

    def __array_function__(
        self, function: Callable[..., Any], _: object, given: tuple[Any, ...], other: dict[str, Any]
    ) -> Any:  # noqa: ANN401 - NumPy's
        if function not in FOLLOWED:
            _refuse(f"np.{function.__name__}", ALLOWED)
        return FOLLOWED[function](self.graph, *given, **other)


REFUSED = "{}: cannot be exported; allowed: {}"


def _refuse(what: str, allowed: str) -> NoReturn:
    raise TypeError(REFUSED.format(what, allowed))


REWRITTEN: dict[str, Callable[..., Any]] = {
    "bitwise_and": lambda one, other: one * other,
    "bitwise_or": np.maximum,
    "invert": lambda one: 1.0 - one,
    "isnan": lambda one: np.not_equal(one, one),
    "square": lambda one: one * one,
}
"""By NumPy's function: the same by others. Those of truth values have 1 and 0."""


def _concatenate(graph: Graph, given: Sequence[Signal | Array], axis: int = 0) -> Signal:
    if axis != 1:
        _refuse("np.concatenate of lanes", "that of columns, 1")
    parts = [graph.signal(one) for one in given if one.shape[1] != 0]
    if not parts:
        return graph.add("concatenate", [], 0)
    inner = sum(one.inner[0] for one in parts), *parts[0].inner[1:]
    return graph.add("concatenate", [*parts], prod(inner)).reshape(-1, *inner)


def _columns(graph: Graph, given: Sequence[Signal | Array]) -> Signal:
    wide = [one if one.ndim > 1 else one.reshape(-1, 1) for one in given]
    return _concatenate(graph, wide, 1)


def _clip(_: Graph, given: Signal, low: Any, high: Any) -> Signal:  # noqa: ANN401 - NumPy's
    given = given if low is None else np.maximum(given, low)
    return given if high is None else np.minimum(given, high)


def _without_nan(_: Graph, given: Signal, nan: float = 0.0) -> Signal:
    ends = np.finfo(np.float64)
    return np.where(given == given, np.clip(given, ends.min, ends.max), nan)  # noqa: PLR0124 - not of NaN


def _row(graph: Graph, table: Signal | Array, place: Signal, axis: int) -> Signal:
    count, width = table.shape[1:]
    if axis != 1 or place.shape[1:] != (1, 1) or len(table) != 1:
        _refuse("np.take_along_axis", "that of agents.control.controller.looked_up")
    if isinstance(table, Signal):
        found = table[:, 0]
        for k in range(1, count):
            found = np.where(place[:, 0] == k, table[:, k], found)
        return found[:, None]
    rows = table[0]
    changes = (rows.astype(np.float32) != rows[-1].astype(np.float32)).any(axis=1)
    rows = rows[: len(rows) - np.argmax([*changes[::-1], True]) + 1]  # the others are as the last
    return graph.add(TABLE, [place, rows], width).reshape(-1, 1, width)


def _between(_: Graph, at: Signal, points: Array, values: Array) -> Signal:
    """Return what a polyline has: its first value, and in each piece the slope times the way."""
    way = np.clip(at[:, None], points[:-1], points[1:]) - points[:-1]
    return way @ (np.diff(values) / np.diff(points)) + values[0]


def _einsum(graph: Graph, pattern: str, matrix: Signal, vector: Signal) -> Signal:
    """Return the product of a matrix (n, i, j) and a vector (n, j) of each lane."""
    (one, other), made = (part.split(",") if "," in part else part for part in pattern.split("->"))
    if len(one) != 3 or other != one[0] + one[2] or made != one[:2]:  # noqa: PLR2004 - indices
        _refuse(f"np.einsum({pattern!r})", "nij,nj->ni")
    if not isinstance(matrix, Signal):
        return vector @ matrix[0].T
    return graph.add(TURNED, [matrix, vector], matrix.inner[0])


FOLLOWED: dict[Callable[..., Any], Callable[..., Any]] = {
    np.concatenate: _concatenate,
    np.column_stack: _columns,
    np.hstack: _columns,
    np.clip: _clip,
    np.zeros_like: lambda _, signal: np.zeros((1, *signal.inner)),
    np.ones_like: lambda _, signal: np.ones((1, *signal.inner)),
    np.full_like: lambda _, signal, value: np.full((1, *signal.inner), value),
    np.where: lambda graph, which, one, other: graph.each(CHOICE, which, one, other),
    np.nan_to_num: _without_nan,
    np.take_along_axis: _row,
    np.interp: _between,
    np.einsum: _einsum,
}

ALLOWED = (
    "operators that make new arrays, @ with a constant on its right, array[:, columns], and np."
    + ", ".join(sorted({*FUNCTIONS, *REWRITTEN, *(one.__name__ for one in FOLLOWED)}))
)
"""What is followed, for messages."""


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
        """Append an operation; return what it makes, (lanes, width)."""
        before = inputs[0].made_by if inputs and isinstance(inputs[0], Signal) else None
        if name == "add" and before and (before.name, before.width) == ("product", width):
            bias = inputs[1]
            if not isinstance(bias, Signal) and len(before.inputs) == 2:  # noqa: PLR2004 - without bias
                name, inputs = "product", [*before.inputs, np.broadcast_to(bias, width)]
        self.operations.append(Operation(name, inputs, width, first))
        return Signal(self, self.operations[-1], (width,))

    def each(self, name: str, *given: Any) -> Signal:  # noqa: ANN401 - what NumPy takes
        """Append an operation number by number, of signals and constants that fit each other."""
        given = tuple(
            one if isinstance(one, Signal) else np.asarray(one, np.float64) for one in given
        )
        given = tuple(
            one if isinstance(one, Signal) or not np.isnan(one).any() else self._no_number(one)
            for one in given
        )
        shapes = [(1, *one.inner) if isinstance(one, Signal) else one.shape for one in given]
        lanes, *inner = np.broadcast_shapes(*shapes)
        width = prod(inner)
        widths = {one.made_by.width for one in given if isinstance(one, Signal)}
        if lanes != 1 or not widths <= {1, width}:
            _refuse(f"np.{name} of shapes {shapes}", "one number, or as many as the others have")
        kept, last = given[0], given[-1]
        is_neutral = not isinstance(last, Signal) and (last == NEUTRAL.get(name)).all()
        if is_neutral and isinstance(kept, Signal) and kept.inner == (*inner,):
            return kept
        inputs = [
            one
            if isinstance(one, Signal)
            else one.reshape(-1)
            if one.size == 1
            else np.broadcast_to(one, (1, *inner)).reshape(-1)
            for one in given
        ]
        return self.add(name, inputs, width).reshape(-1, *inner)

    def signal(self, given: Signal | Array) -> Signal:
        """Return a signal, or a constant (1, *inner) as one."""
        if isinstance(given, Signal):
            return given
        flat = np.asarray(given, np.float64).reshape(1, -1)
        any_number = self.inputs["observation"][:, :1]
        made = self.each(CHOICE, any_number, flat, flat)
        return made.reshape(-1, *np.shape(given)[1:])

    def _no_number(self, given: Array) -> Signal:
        """Return NaN, which is no constant of a file."""
        if given.size > 1:
            _refuse("NaN among numbers", "a single NaN")
        return self.inputs["observation"][:, 0] * 0.0 / 0.0

    def joined(self, parts: Sequence[Signal | Array]) -> Signal:
        """Return signals (lanes, n) and constants (1, n) side by side."""
        return _concatenate(self, parts, 1)

    def needed(self) -> list[Operation]:
        """Return the operations that the outputs follow from, in order."""
        found = {signal.made_by for signal in self.outputs.values()}
        for operation in reversed(self.operations):
            if operation in found:
                found |= {one.made_by for one in operation.inputs if isinstance(one, Signal)}
        return [one for one in self.operations if one in found and one.name != "input"]
