"""Policies as files of numbers: nothing in them can run code.

A file ``policy.npz`` is NumPy's archive of arrays, read with ``allow_pickle=False``: the weight and
the bias of each layer, the arrays named in `OPTIONAL` where there are any, and ``description``, a
JSON text of the rest. It takes NumPy alone to act.
A recurrent policy has the three arrays of its cell besides, ``cell_0`` to ``cell_2``; one that is
exported with the law to which it is added has ``base``. Value iteration's has a table in the place
of layers, see `agents.value_table.policy`.
"""

from __future__ import annotations

import io
import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import Field, Strict

from agents.arrays import arrays_in, described, numbers
from agents.policy_file import LARGEST, PolicyError
from agents.value_table.policy import TablePolicy, is_table, table_policy
from mm_gym import SceneError
from mm_gym.files import read_bytes, write_bytes
from mm_gym.scene import Document

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from agents.arrays import Arrays

    Values = NDArray[np.float64]


def _relu(values: Values) -> Values:
    return np.maximum(values, 0.0)


def _sigmoid(values: Values) -> Values:
    return 0.5 + 0.5 * np.tanh(0.5 * values)


def _rational(values: Values) -> Values:
    values = np.clip(values, -3.0, 3.0)
    return values * (27.0 + values**2) / (27.0 + 9.0 * values**2)


ACTIVATIONS: dict[str, Callable[[Values], Values]] = {
    "tanh": np.tanh,
    "relu": _relu,
    "rational": _rational,
}
"""What follows a layer; "rational" is a tanh of four operations, smooth, and 1 from 3 on."""

UNIT = ("memory", "floor", "offset", "scale")
"""The numbers of a correlation unit, see `Policy`."""


def _empty(*shape: int) -> Callable[[], NDArray[np.float32]]:
    return lambda: np.zeros(shape, np.float32)


@dataclass(frozen=True, eq=False)
class Policy:
    """A network of dense layers, whose output is clipped: the mean action of a trained agent.

    Its inputs are the observation y (n,), a linear memory (m,) that begins at zero::

        memory = keep @ memory + enter @ y

    and r correlation units, of which each compares two combinations of both, z = [y, memory],
    a = pairs[q, 0] @ z and b = pairs[q, 1] @ z, with sums that begin at zero::

        products = memory * products + 2 a b
        squares = memory * squares + a^2 + b^2
        unit = (products / (floor + squares) - offset) * scale

    Without memory it is a switching function, +1 where a = b and -1 where a = -b, however small the
    motion; with memory, of one signal at two instants, the cosine of its phase between them.

    A recurrent one has a long short-term memory cell before the layers (Hochreiter and Schmidhuber,
    1997), of gates i, f, g and o::

        i, f, g, o = cell[0] @ observation + cell[1] @ output + cell[2]
        state = sigmoid(f) * state + sigmoid(i) * tanh(g)
        output = sigmoid(o) * tanh(state)

    One with a base is added to a linear law, whose action it observes besides::

        proposed = clip(base[:, :-1] @ observation + base[:, -1], -1, 1)
        action = clip(proposed + authority * action, -1, 1)

    Attributes
    ----------
    weights, biases
        Of each layer (outputs, inputs) and (outputs,).
    activation
        A name of `ACTIVATIONS`; it follows all layers but the last.
    low, high
        (k,) bounds of the action [-].
    direct
        (k, n + m + r) weights from the inputs to the action, past the layers; (0, 0) for none.
    keep, enter
        (m, m), (m, n).
    pairs, units
        (r, 2, n + m); (r, 4) the numbers named in `UNIT`.
    squashed
        Whether a tanh follows the last layer.
    cell
        Empty, or (4 h, n), (4 h, h) and (4 h,), the gates one after the other.
    base
        (k, n + 1) gains of the law and its constants; (0, 0) for none. Then n above counts the k
        actions of the law too.
    authority
        Most that is added to the law's action.
    """

    weights: tuple[NDArray[np.float32], ...]
    biases: tuple[NDArray[np.float32], ...]
    activation: str
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    direct: NDArray[np.float32] = field(default_factory=_empty(0, 0))
    keep: NDArray[np.float32] = field(default_factory=_empty(0, 0))
    enter: NDArray[np.float32] = field(default_factory=_empty(0, 0))
    pairs: NDArray[np.float32] = field(default_factory=_empty(0, 2, 0))
    units: NDArray[np.float32] = field(default_factory=_empty(0, len(UNIT)))
    squashed: bool = False
    cell: tuple[NDArray[np.float32], ...] = ()
    base: NDArray[np.float32] = field(default_factory=_empty(0, 0))
    authority: float = 0.0

    @property
    def sizes(self) -> list[int]:
        """Numbers of an observation, of the units of each hidden layer, and of an action."""
        if self.cell:
            observed = self.cell[0].shape[1]
        else:
            observed = self.weights[0].shape[1] - len(self.keep) - len(self.units)
        return [observed - len(self.base), *(len(bias) for bias in self.biases)]

    def check(self, observation: int, action: int) -> None:
        """Raise `PolicyError` unless observation and action have so many numbers."""
        own = self.sizes[0], self.sizes[-1]
        if own != (observation, action):
            msg = (
                f"policy: got {own[0]} observed numbers and {own[1]} actions; "
                f"the scene has {observation} and {action}"
            )
            raise PolicyError(msg)

    def begin(self, lanes: int) -> Values:
        """Return the sums (2 r + m, lanes) with which an episode begins.

        They are products and squares of each correlation unit, then the linear memory. Of a
        recurrent policy they are the cell's state and output (2, lanes, h).
        """
        if self.cell:
            return np.zeros((2, lanes, self.cell[1].shape[1]))
        return np.zeros((2 * len(self.units) + len(self.keep), lanes))

    def act(self, observation: NDArray[np.float32], sums: Values | None = None) -> Values:
        """Return the actions (lanes, k) for observations (lanes, n) as the environment has them.

        Parameters
        ----------
        observation
            (lanes, n).
        sums
            What `begin` returned at the episode's start; moved on by a step. A policy
            without memory needs none; without, an episode begins.
        """
        inputs = np.asarray(observation, np.float64)
        if not self.base.size:
            return self._added(inputs, sums)
        proposed = np.clip(inputs @ self.base[:, :-1].T + self.base[:, -1], -1.0, 1.0)
        added = self._added(np.hstack([inputs, proposed]), sums)
        return np.clip(proposed + self.authority * added, -1.0, 1.0)

    def _added(self, inputs: Values, sums: Values | None) -> Values:
        """Return the actions without those of the base, which is among the inputs."""
        if self.units.size or self.keep.size:
            inputs = self._remember(inputs, self.begin(len(inputs)) if sums is None else sums)
        if self.cell:
            inputs = self._recur(inputs, self.begin(len(inputs)) if sums is None else sums)
        values = inputs
        activate = ACTIVATIONS[self.activation]
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            values = (values if layer == 0 else activate(values)) @ weight.T + bias
        if self.direct.size:
            values = values + inputs @ self.direct.T
        return np.clip(np.tanh(values) if self.squashed else values, self.low, self.high)

    def _recur(self, values: Values, memory: Values) -> Values:
        """Move the cell's memory on by a step, and return its output (lanes, h)."""
        state, output = memory
        gates = values @ self.cell[0].T + output @ self.cell[1].T + self.cell[2]
        enter, keep, new, leave = np.split(gates, 4, axis=1)
        state[:] = _sigmoid(keep) * state + _sigmoid(enter) * np.tanh(new)
        output[:] = _sigmoid(leave) * np.tanh(state)
        return output

    def _remember(self, values: Values, sums: Values) -> Values:
        """Return the inputs (lanes, n + m + r) for observations, and move the sums on."""
        own, memory = np.split(sums, [2 * len(self.units)])
        if self.keep.size:
            memory[:] = self.keep @ memory + self.enter @ values.T
            values = np.hstack([values, memory.T])
        if self.units.size:
            units = self._correlations(values, own.reshape(len(self.units), 2, -1))
            values = np.hstack([values, units])
        return values

    def _correlations(self, values: Values, sums: Values) -> Values:
        """Return the correlation units (lanes, r), and move their sums (r, 2, lanes) on."""
        memory, floor, offset, scale = self.units.T.astype(np.float64)
        left, right = (values @ self.pairs[:, side].T.astype(np.float64) for side in (0, 1))
        sums *= memory[:, None, None]
        sums[:, 0] += (2.0 * left * right).T
        sums[:, 1] += (left**2 + right**2).T
        return (sums[:, 0].T / (floor + sums[:, 1].T) - offset) * scale

    def save(self, path: str | Path) -> None:
        """Write the policy whole: a kill leaves the old file or the new one."""
        write_bytes(path, self.to_bytes())

    def to_bytes(self) -> bytes:
        """Return the content of the policy's file."""
        description = {
            "format": 2,
            "activation": self.activation,
            "sizes": self.sizes,
            "low": self.low.tolist(),
            "high": self.high.tolist(),
            "squashed": self.squashed,
        }
        if self.base.size or self.keep.size:
            description |= {"format": 3, "authority": self.authority}
        arrays: dict[str, NDArray[Any]] = {"description": np.array(json.dumps(description))}
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            arrays |= {f"weight_{layer}": weight, f"bias_{layer}": bias}
        arrays |= {name: getattr(self, name) for name in OPTIONAL if getattr(self, name).size}
        arrays |= {f"cell_{i}": array for i, array in enumerate(self.cell)}
        content = io.BytesIO()
        np.savez(content, **arrays)
        return content.getvalue()


AnyPolicy: TypeAlias = Policy | TablePolicy
"""What acts: a network, or a table of value iteration."""

OPTIONAL = ("direct", "keep", "enter", "pairs", "units", "base")
"""Arrays of a policy that a file may leave out."""


class Description(Document):
    """What the file of a network says in JSON."""

    format: Literal[1, 2, 3]
    """1 had layers alone, 3 has a base or a linear memory also; a policy without them is
    written in format 2"""
    activation: Literal["tanh", "relu", "rational"]
    """a name of `ACTIVATIONS`"""
    sizes: Annotated[tuple[Annotated[int, Field(ge=1)], ...], Strict(False), Field(min_length=2)]
    """see `Policy.sizes`"""
    low: Annotated[tuple[float, ...], Strict(False)]
    """bounds of the action [-]"""
    high: Annotated[tuple[float, ...], Strict(False)]
    """bounds of the action [-]"""
    squashed: bool = False
    """whether a tanh follows the last layer"""
    authority: Annotated[float, Field(ge=0)] = 0.0
    """most that is added to the action of the base"""


def load_policy(path: str | Path) -> AnyPolicy:
    """Read a policy that `save` of either kind wrote; nothing in the file is run.

    Raises
    ------
    PolicyError
        If the file is missing, too large, damaged, or no policy.
    """
    try:
        content = read_bytes(path, most=LARGEST)
    except SceneError as error:
        raise PolicyError(str(error)) from None
    try:
        return policy_in(content)
    except ValueError as error:
        told = "; ".join(str(error).splitlines())
        msg = f"{path}: not a policy that agents.train wrote: {told}"
        raise PolicyError(msg) from None


def policy_in(content: bytes) -> AnyPolicy:
    """Return the policy in the content of a file; raise `ValueError` if it is none."""
    arrays = arrays_in(content, most=LARGEST)
    return table_policy(arrays) if is_table(arrays) else _policy(arrays)


def _policy(arrays: dict[str, NDArray[Any]]) -> Policy:
    """Return the network in arrays; raise `ValueError` where they are wrong."""
    described_as = Description.of(described(arrays))
    sizes = described_as.sizes
    layers = range(len(sizes) - 1)
    r, m = (len(np.atleast_1d(arrays.get(name, ()))) for name in ("units", "keep"))
    memory = np.atleast_1d(arrays["cell_1"]).shape[-1] if "cell_1" in arrays else 0
    read = sizes[0] + (sizes[-1] if "base" in arrays else 0)
    cell = [(4 * memory, read), (4 * memory, memory), (4 * memory,)] if memory else []
    inputs = [memory or read + m + r, *sizes[1:]]
    shapes = {
        "direct": (sizes[-1], inputs[0]),
        "keep": (m, m),
        "enter": (m, read),
        "pairs": (r, 2, read + m),
        "units": (r, len(UNIT)),
        "base": (sizes[-1], sizes[0] + 1),
    }
    needed = {"pairs": r, "enter": m}
    given = [name for name in shapes if name in arrays or needed.get(name)]
    policy = Policy(
        weights=tuple(_single(arrays, f"weight_{i}", (sizes[i + 1], inputs[i])) for i in layers),
        biases=tuple(_single(arrays, f"bias_{i}", (sizes[i + 1],)) for i in layers),
        activation=described_as.activation,
        low=_single({"low": np.array(described_as.low)}, "low", (sizes[-1],)),
        high=_single({"high": np.array(described_as.high)}, "high", (sizes[-1],)),
        squashed=described_as.squashed,
        authority=described_as.authority if "base" in arrays else 0.0,
        cell=tuple(_single(arrays, f"cell_{i}", shape) for i, shape in enumerate(cell)),
        **{name: _single(arrays, name, shapes[name]) for name in given},
    )
    _check(policy, arrays)
    return policy


def _check(policy: Policy, arrays: dict[str, NDArray[Any]]) -> None:
    """Raise `ValueError` for bounds in the wrong order, and for arrays that have no place."""
    if not (policy.low < policy.high).all():
        msg = f"low, high: got {policy.low} and {policy.high}; allowed: low < high"
        raise ValueError(msg)
    if not (policy.units[:, UNIT.index("floor")] > 0.0).all():
        msg = f"units: got floor {policy.units[:, UNIT.index('floor')]}; allowed: more than 0"
        raise ValueError(msg)
    layers = [f"{kind}_{i}" for i in range(len(policy.weights)) for kind in ("weight", "bias")]
    known = ["description", *layers, *OPTIONAL, *(f"cell_{i}" for i in range(len(policy.cell)))]
    unknown = sorted(set(arrays) - set(known))
    if unknown:
        msg = f"{unknown[0]}: unknown; allowed: {', '.join(known)}"
        raise ValueError(msg)


def _single(source: Arrays, name: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
    return numbers(source, name, shape, np.float32)
