"""The layers of a policy: the only place that says what one computes.

A layer's `forward` is written once, over `xp`, which is NumPy or torch: on arrays it acts, on
tensors torch differentiates it, and on the signals of `agents.network.graph` it becomes C and ONNX.
To add a layer, write its class here. It takes functions and operators that NumPy and torch have in
common; arrays are constants or trained, see `Layer.fixed`.
"""

from __future__ import annotations  # the types of fields as text, which reading a file checks

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from types import ModuleType
from typing import Any, ClassVar, TypeAlias

from mm_gym.arrays import Single
from mm_gym.errors import check_name, refuse

Numbers: TypeAlias = Any  # arrays of NumPy, tensors of torch, or signals

KINDS: dict[str, type[Layer]] = {}  # all layers by their name in files


class Layer:
    """A part of a policy."""

    kind: ClassVar[str]  # its name in files, as of its class
    fixed: ClassVar[tuple[str, ...]] = ()  # names of the arrays that training leaves alone

    def __init_subclass__(cls) -> None:
        if not cls.__name__.startswith("_"):
            cls.kind = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", cls.__name__).lower()
            KINDS[cls.kind] = cls

    @property
    def remembers(self) -> int:
        """How many numbers it remembers from step to step, zeros at first."""
        return 0

    def outputs(self, inputs: int) -> int:
        """Return how many numbers it makes of so many; raise `ValueError` if it cannot."""
        raise NotImplementedError

    def forward(self, xp: ModuleType, values: Numbers, memory: Numbers) -> tuple[Numbers, Numbers]:
        """Return the outputs (lanes, m) of values (lanes, n), and what is remembered after them."""
        raise NotImplementedError

    @property
    def arrays(self) -> dict[str, Single]:
        """Arrays by name, without those of inner layers."""
        found = {field.name: getattr(self, field.name) for field in fields(self)}  # pyright: ignore[reportArgumentType] - a dataclass
        return {name: array for name, array in found.items() if hasattr(array, "shape")}

    def require(self, **shapes: tuple[int, ...]) -> None:
        """Raise `ValueError` unless arrays have these shapes."""
        for name, shape in shapes.items():
            got = tuple(getattr(self, name).shape)
            if got != shape:
                allowed = f"finite numbers of shape {shape}"
                refuse(f"{self.kind}, {name}", f"shape {got}", allowed, ValueError)


@dataclass(frozen=True, eq=False)
class LinearMemory(Layer):
    """Append a linear memory s (m,) to the values y: s = keep @ s + enter @ y."""

    keep: Single
    enter: Single

    @property
    def remembers(self) -> int:
        return len(self.keep)

    def outputs(self, inputs: int) -> int:
        m = len(self.keep)
        self.require(keep=(m, m), enter=(m, inputs))
        return inputs + m

    def forward(self, xp: ModuleType, values: Numbers, memory: Numbers) -> tuple[Numbers, Numbers]:
        memory = memory @ self.keep.T + values @ self.enter.T
        return xp.concatenate([values, memory], 1), memory


@dataclass(frozen=True, eq=False)
class Correlation(Layer):
    """Append r correlation units, each of two combinations of the values z.

    With a = pairs[q, 0] @ z and b = pairs[q, 1] @ z, and sums that forget::

        products = memory * products + 2 a b
        squares = memory * squares + a^2 + b^2
        unit = (products / (floor + squares) - offset) * scale

    Without memory it is a switching function, +1 where a = b and -1 where a = -b, however small the
    motion; with memory, of one signal at two instants, the cosine of its phase between them.
    """

    pairs: Single  # (r, 2, n)
    units: Single  # (r, 4): memory, floor, offset and scale of each, see `UNIT`
    fixed: ClassVar[tuple[str, ...]] = ("units",)

    @property
    def remembers(self) -> int:
        return 2 * len(self.pairs)

    def outputs(self, inputs: int) -> int:
        r = len(self.pairs)
        self.require(pairs=(r, 2, inputs), units=(r, len(UNIT)))
        floor = self.units[:, UNIT.index("floor")]
        if not (floor > 0.0).all():
            refuse("units", f"floor {floor}", "more than 0", ValueError)
        return inputs + r

    def forward(self, xp: ModuleType, values: Numbers, memory: Numbers) -> tuple[Numbers, Numbers]:
        r = len(self.pairs)
        kept, floor, offset, scale = self.units.T
        a, b = values @ self.pairs[:, 0].T, values @ self.pairs[:, 1].T
        products = kept * memory[:, :r] + 2.0 * a * b
        squares = kept * memory[:, r:] + (a * a + b * b)
        units = (products / (floor + squares) - offset) * scale
        return xp.concatenate([values, units], 1), xp.concatenate([products, squares], 1)


UNIT = ("memory", "floor", "offset", "scale")  # the numbers of a correlation unit


@dataclass(frozen=True, eq=False)
class LSTM(Layer):
    """A long short-term memory cell of h units (Hochreiter and Schmidhuber, 1997).

    Of gates i, f, g and o, one after the other::

        i, f, g, o = enter @ values + recur @ output + bias
        state = sigmoid(f) * state + sigmoid(i) * tanh(g)
        output = sigmoid(o) * tanh(state)
    """

    # enter, recur, bias: (4 h, n), (4 h, h) and (4 h,).
    enter: Single
    recur: Single
    bias: Single

    @property
    def remembers(self) -> int:
        return len(self.bias) // 2

    def outputs(self, inputs: int) -> int:
        h = len(self.bias) // 4
        self.require(enter=(4 * h, inputs), recur=(4 * h, h), bias=(4 * h,))
        return h

    def forward(self, xp: ModuleType, values: Numbers, memory: Numbers) -> tuple[Numbers, Numbers]:
        h = len(self.bias) // 4
        state, output = memory[:, :h], memory[:, h:]
        gates = values @ self.enter.T + output @ self.recur.T + self.bias
        enter, keep, new, leave = (gates[:, i * h : (i + 1) * h] for i in range(4))
        state = _sigmoid(xp, keep) * state + _sigmoid(xp, enter) * xp.tanh(new)
        output = _sigmoid(xp, leave) * xp.tanh(state)
        return output, xp.concatenate([state, output], 1)


@dataclass(frozen=True, eq=False)
class GRU(Layer):
    """A gated recurrent unit of h units (Cho and others, EMNLP 2014), as torch has it.

    Of gates r and z and the candidate c, one after the other::

        r, z = sigmoid((enter @ values + recur @ output + bias)[: 2 h])
        c = tanh(enter @ values + bias + r * (recur @ output + bias of the memory))
        output = (1 - z) * c + z * output
    """

    # enter, recur, bias: (3 h, n), (3 h, h) and (4 h,), where the bias of the memory is the last.
    enter: Single
    recur: Single
    bias: Single

    @property
    def remembers(self) -> int:
        return len(self.bias) // 4

    def outputs(self, inputs: int) -> int:
        h = len(self.bias) // 4
        self.require(enter=(3 * h, inputs), recur=(3 * h, h), bias=(4 * h,))
        return h

    def forward(self, xp: ModuleType, values: Numbers, memory: Numbers) -> tuple[Numbers, Numbers]:
        h = len(self.bias) // 4
        new = values @ self.enter.T + self.bias[: 3 * h]
        old = memory @ self.recur.T
        gates = _sigmoid(xp, new[:, : 2 * h] + old[:, : 2 * h])
        reset, kept = gates[:, :h], gates[:, h:]
        candidate = xp.tanh(new[:, 2 * h :] + reset * (old[:, 2 * h :] + self.bias[3 * h :]))
        memory = candidate + kept * (memory - candidate)
        return memory, memory


@dataclass(frozen=True, eq=False)
class Dense(Layer):
    """weight @ values + bias."""

    weight: Single
    bias: Single

    def outputs(self, inputs: int) -> int:
        self.require(weight=(len(self.bias), inputs), bias=(len(self.bias),))
        return len(self.bias)

    def forward(self, xp: ModuleType, values: Numbers, memory: Numbers) -> tuple[Numbers, Numbers]:
        return values @ self.weight.T + self.bias, memory


@dataclass(frozen=True, eq=False)
class Activation(Layer):
    """A function of each value, named in `FUNCTIONS`."""

    function: str

    def outputs(self, inputs: int) -> int:
        check_name("activation, function", self.function, FUNCTIONS, ValueError)
        return inputs

    def forward(self, xp: ModuleType, values: Numbers, memory: Numbers) -> tuple[Numbers, Numbers]:
        return FUNCTIONS[self.function](xp, values), memory


def _rational(xp: ModuleType, values: Numbers) -> Numbers:
    values = xp.clip(values, -3.0, 3.0)
    square = values * values
    return values * (27.0 + square) / (27.0 + 9.0 * square)


def _sigmoid(xp: ModuleType, values: Numbers) -> Numbers:
    return 0.5 + 0.5 * xp.tanh(0.5 * values)


FUNCTIONS = {
    "tanh": lambda xp, values: xp.tanh(values),
    "relu": lambda xp, values: xp.clip(values, 0.0, None),
    "rational": _rational,
}
"""Activations; "rational" is a tanh of four operations, smooth, and 1 from 3 on."""


@dataclass(frozen=True, eq=False)
class Clip(Layer):
    """The values within bounds (n,)."""

    low: Single
    high: Single
    fixed: ClassVar[tuple[str, ...]] = ("low", "high")

    def outputs(self, inputs: int) -> int:
        self.require(low=(inputs,), high=(inputs,))
        if not (self.low < self.high).all():
            refuse("low, high", f"{self.low} and {self.high}", "low < high", ValueError)
        return inputs

    def forward(self, xp: ModuleType, values: Numbers, memory: Numbers) -> tuple[Numbers, Numbers]:
        return xp.clip(values, self.low, self.high), memory


@dataclass(frozen=True, eq=False)
class _Around(Layer):
    """A layer around others."""

    layers: tuple[Layer, ...]

    @property
    def remembers(self) -> int:
        return sum(layer.remembers for layer in self.layers)


@dataclass(frozen=True, eq=False)
class Skip(_Around):
    """Add direct @ values to what inner layers make of the values."""

    direct: Single

    def outputs(self, inputs: int) -> int:
        made = outputs_of(self.layers, inputs)
        self.require(direct=(made, inputs))
        return made

    def forward(self, xp: ModuleType, values: Numbers, memory: Numbers) -> tuple[Numbers, Numbers]:
        made, memory = run(self.layers, xp, values, memory)
        return made + values @ self.direct.T, memory


@dataclass(frozen=True, eq=False)
class Append(_Around):
    """Append what inner layers make of the values to them."""

    def outputs(self, inputs: int) -> int:
        return inputs + outputs_of(self.layers, inputs)

    def forward(self, xp: ModuleType, values: Numbers, memory: Numbers) -> tuple[Numbers, Numbers]:
        made, memory = run(self.layers, xp, values, memory)
        return xp.concatenate([values, made], 1), memory


@dataclass(frozen=True, eq=False)
class Observer(_Around):
    """Append a linear memory s (m,) that knows the action a to the values y that inner layers read.

    That is s = keep @ s + enter @ y + back @ a, with the action of the step before: a Kalman
    filter whose estimate holds although the action is clipped, and whatever else acts.
    """

    # keep, enter, back: (m, m), (m, n) and (m, k).
    keep: Single
    enter: Single
    back: Single

    @property
    def remembers(self) -> int:
        return sum(self.back.shape) + super().remembers

    def outputs(self, inputs: int) -> int:
        m = len(self.keep)
        made = outputs_of(self.layers, inputs + m)
        self.require(keep=(m, m), enter=(m, inputs), back=(m, made))
        return made

    def forward(self, xp: ModuleType, values: Numbers, memory: Numbers) -> tuple[Numbers, Numbers]:
        own, state = sum(self.back.shape), self.state(xp, values, memory)
        shown = xp.concatenate([values, state], 1)
        action, inner = run(self.layers, xp, shown, memory[:, own:])
        after = [state, action, inner] if super().remembers else [state, action]
        return action, xp.concatenate(after, 1)

    def state(self, _xp: ModuleType, values: Numbers, memory: Numbers) -> Numbers:
        """Return s of this step."""
        m, own = len(self.keep), sum(self.back.shape)
        before, action = memory[:, :m], memory[:, m:own]
        return before @ self.keep.T + values @ self.enter.T + action @ self.back.T


@dataclass(frozen=True, eq=False)
class SettlingObserver(Observer):
    """An observer with other weights at first: in step t [keep enter back] + fade^t early.

    A Kalman filter's gain so settles from what an episode's start needs to the stationary one.
    """

    # early, fade: (m, m + n + k) and (1,).
    early: Single
    fade: Single
    fixed: ClassVar[tuple[str, ...]] = ("fade",)

    @property
    def remembers(self) -> int:
        return super().remembers + 1

    def outputs(self, inputs: int) -> int:
        made, (m, k) = super().outputs(inputs), self.back.shape
        self.require(early=(m, m + inputs + k), fade=(1,))
        return made

    def forward(self, xp: ModuleType, values: Numbers, memory: Numbers) -> tuple[Numbers, Numbers]:
        action, after = super().forward(xp, values, memory)
        passed = 1.0 - self.fade * (1.0 - memory[:, -1:])  # 1 - fade^t, which is 0 at first
        return action, xp.concatenate([after, passed], 1)

    def state(self, xp: ModuleType, values: Numbers, memory: Numbers) -> Numbers:
        m, own = len(self.keep), sum(self.back.shape)
        known = xp.concatenate([memory[:, :m], values, memory[:, m:own]], 1)
        early = (1.0 - memory[:, -1:]) * (known @ self.early.T)
        return super().state(xp, values, memory) + early


@dataclass(frozen=True, eq=False)
class Residual(_Around):
    """Add what inner layers make to a linear controller's action, which they read too.

    That is::

        proposed = clip(base[:, :-1] @ values + base[:, -1], -1, 1)
        action = clip(proposed + authority * made, -1, 1)
    """

    base: Single
    authority: float

    def outputs(self, inputs: int) -> int:
        k = len(self.base)
        self.require(base=(k, inputs + 1))
        made = outputs_of(self.layers, inputs + k)
        if made != k:
            refuse("residual", f"{made} outputs of the inner layers", f"{k}", ValueError)
        return made

    def forward(self, xp: ModuleType, values: Numbers, memory: Numbers) -> tuple[Numbers, Numbers]:
        proposed = xp.clip(values @ self.base[:, :-1].T + self.base[:, -1], -1.0, 1.0)
        made, memory = run(self.layers, xp, xp.concatenate([values, proposed], 1), memory)
        return xp.clip(proposed + self.authority * made, -1.0, 1.0), memory


def run(
    layers: Sequence[Layer], xp: ModuleType, values: Numbers, memory: Numbers
) -> tuple[Numbers, Numbers]:
    """Return what layers make of values one after the other, and what they remember after it."""
    remembered: list[Numbers] = []
    first = 0
    for layer in layers:
        last = first + layer.remembers
        values, own = layer.forward(xp, values, memory[:, first:last])
        if last > first:
            remembered.append(own)
        first = last
    return values, xp.concatenate(remembered, 1) if remembered else memory


def outputs_of(layers: Sequence[Layer], inputs: int) -> int:
    """Return how many numbers layers make of so many; raise `ValueError` if they do not fit."""
    for layer in layers:
        inputs = layer.outputs(inputs)
    return inputs


def every(layers: Sequence[Layer]) -> Iterator[Layer]:
    """Yield layers, and those in them."""
    for layer in layers:
        yield layer
        yield from every(getattr(layer, "layers", ()))
