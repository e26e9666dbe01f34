"""Runge-Kutta pairs: SciPy's coefficients, in the form of Nystroem, and the sums of their stages.

Velocities are the rates of the positions, so the accelerations of the stages suffice: where a
pair's weights are A, positions take those of A squared (Hairer, Norsett and Wanner, *Solving
Ordinary Differential Equations I*, 1993, II.14). Many weights are 0, and the newest acceleration
never counts in a position: each sum is code of its own, in which only the others appear.
"""

# ruff: noqa: ANN401, ARG001 - as in `lanes.simd`

from __future__ import annotations

import itertools
import math
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload, register_jitable

from mm_gym.arrays import Array
from mm_gym.lanes.simd import LANES, NUMBERS, call
from mm_gym.lanes.tangents import TANGENTS, slopes_of, tangent, value_of, vectors_of
from mm_gym.methods.runge_kutta import layout as slots

if TYPE_CHECKING:
    from collections.abc import Sequence


_ROUND_OFF = 1e-13


class Tableau(NamedTuple):
    """A pair of methods; the last stage is the end of the step.

    Attributes
    ----------
    times
        (stages,) of each stage, in steps.
    weights
        (stages, stages) of the accelerations in a stage's velocity, times h.
    errors
        (2, stages) of two estimates of the velocity's error.
    power
        Of the step that the first estimate falls with.
    is_combined
        Whether the error is that of eighth order from both, or the first alone.
    """

    times: Array
    weights: Array
    errors: Array
    power: int
    is_combined: bool

    @property
    def stages(self) -> int:
        """Number of the stages before the end."""
        return len(self.times) - 1

    def sums(self) -> list[tuple[float, Array, Array]]:
        """Return time and weights in velocities and positions: of all later stages, of estimates.

        Estimates leave out the velocity at the step's start: their time is 0.
        """
        weights = np.concatenate([self.weights[1:], self.errors])
        places = weights @ self.weights
        places[abs(places) < _ROUND_OFF] = 0.0
        places[-1] *= self.is_combined  # else nothing reads it
        return list(zip(np.append(self.times[1:], [0.0, 0.0]), weights, places, strict=True))

    def estimates(self, phase: float) -> tuple[float, float]:
        """Return both estimates of the error on an undamped oscillation, relative to its velocity.

        Parameters
        ----------
        phase
            Angle that it turns by in the step [rad].
        """
        turn = 1j * phase
        rates = np.linalg.solve(
            np.eye(len(self.times)) - turn * self.weights, turn + 0 * self.times
        )
        first, second = np.abs(self.errors @ rates)
        if self.is_combined:
            first = first * first / abs(complex(first, 0.1 * second))
        return float(first), float(second)

    def longest(self, limit: float, part: float = 1.0) -> float:
        """Return the phase [rad] up to which the first estimate is below a limit.

        And the second below a part of what it then is.
        """
        phase = self._up_to(0, limit)
        return phase if part == 1.0 else self._up_to(1, part * self.estimates(phase)[1])

    def _up_to(self, k: int, limit: float) -> float:
        """Return the phase at which one of the estimates reaches a limit, by bisection."""
        low, high = 0.0, math.pi
        for _ in range(30):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.estimates(middle)[k] < limit else (low, middle)
        return low


@cache
def tableaus() -> tuple[Tableau, ...]:
    """Return the pairs of Bogacki and Shampine, 3(2), and Dormand and Prince, 5(4) and 8(5, 3)."""
    from scipy.integrate import DOP853, RK23, RK45  # noqa: PLC0415 - other methods need none

    return (
        _tableau(RK23, RK23.E, nodes=[0, 1, 3]),
        _tableau(RK45, RK45.E, nodes=[0, 2, 3, 6]),
        _tableau(DOP853, DOP853.E5, other=DOP853.E3),
    )


def _tableau(
    pair: type[Any],
    error: Array,
    *,
    other: Array | None = None,
    nodes: Sequence[int] = (),
) -> Tableau:
    """Return a pair; without another estimate, the difference from a quadrature of some stages."""
    weights = np.zeros((pair.n_stages + 1, pair.n_stages + 1))
    weights[:-1, : pair.A.shape[1]], weights[-1, :-1] = pair.A, pair.B
    times = np.append(pair.C, 1.0)
    if other is not None:
        return Tableau(times, weights, np.stack([error, other]), 8, is_combined=True)
    powers, second = np.arange(len(nodes)), weights[-1].copy()
    second[nodes] -= np.linalg.solve(times[nodes] ** powers[:, None], 1.0 / (powers + 1.0))
    return Tableau(times, weights, np.stack([error, second]), pair.order, is_combined=False)


@cache
def _all_sums() -> list[tuple[float, Array, Array]]:
    return [one for pair in tableaus() for one in pair.sums()]


def first_sum(pair: Tableau) -> int:
    """Return the number of a pair's first sum; those of its other stages and estimates follow."""
    before = itertools.takewhile(lambda other: other is not pair, tableaus())
    return sum(len(other.sums()) for other in before)


def summed(rows: Any, number: int, v1: Any, v2: Any) -> tuple[Any, Any, Any, Any]:
    """Return both velocities of a stage, and both ways to it from the step's start, over h.

    Parameters
    ----------
    rows
        Of `mm_gym.methods.runge_kutta.layout`; read are the accelerations times h.
    number
        Of the sum, see `first_sum`.
    v1, v2
        Velocities at the step's start.
    """
    time, velocity, place = _all_sums()[number]
    kicks = np.reshape(rows[slots.KICKS : slots.KICKS + 2 * len(velocity)], (len(velocity), 2, -1))
    first, second = np.tensordot(velocity, kicks, 1)
    way, other = np.tensordot(place, kicks, 1)
    kept = float(time > 0.0)
    return kept * v1 + first, kept * v2 + second, time * v1 + way, time * v2 + other


def estimated(rows: Any, number: int, zero: Any) -> tuple[Any, Any, Any, Any]:
    """Return the same of an estimate's errors, to which the velocities add nothing.

    Apart from `summed`: compiled, each has code for its own sums alone.
    """
    return summed(rows, number, zero, zero)


@intrinsic(prefer_literal=True)
def _summed(_context, rows, stride, first, is_stage, number, v1, v2):
    """Sum vectors that are `stride` rows apart, the first of them at row `first`: literals.

    With numbers as velocities, only the first number of each vector counts. The sum is of a stage
    or of an estimate, as the literal `is_stage` says.
    """

    def build(context, builder, signature, arguments):
        kind = context.get_value_type(signature.args[-1])  # of a vector, or a number
        rows, _, _, _, number, *starts = arguments
        apart, offset, is_stage = (kind.literal_value for kind in signature.args[1:4])
        end, nowhere = (builder.append_basic_block() for _ in range(2))
        choice, found = builder.switch(number, nowhere), []
        for k, (time, velocities, places) in enumerate(_all_sums()):
            if (time > 0.0) != is_stage:
                continue
            block = builder.append_basic_block()
            choice.add_case(k, block)
            builder.position_at_end(block)
            sums = [
                _sum(
                    builder,
                    kind,
                    [
                        (factor, starts[side]),
                        *_kicks(builder, rows, kind, (apart, offset), side, weights),
                    ],
                )
                for factor, weights in ((float(time > 0.0), velocities), (time, places))
                for side in range(2)
            ]
            found.append((block, sums))
            builder.branch(end)
        builder.position_at_end(nowhere)
        builder.unreachable()
        builder.position_at_end(end)
        results = [builder.phi(kind) for _ in range(4)]
        for block, sums in found:
            for result, value in zip(results, sums, strict=True):
                result.add_incoming(value, block)
        return context.make_tuple(builder, signature.return_type, results)

    literals = all(isinstance(given, types.Literal) for given in (stride, first, is_stage))
    kind = types.UniTuple(v1, 4)
    return (kind(rows, stride, first, is_stage, number, v1, v2), build) if literals else None


def _kicks(
    builder: Any, rows: Any, kind: Any, spacing: tuple[int, int], side: int, weights: Any
) -> list[tuple[float, Any]]:
    """Return the weights that are not 0, each with the acceleration that it is for."""
    stride, first = spacing
    found = []
    for j in np.flatnonzero(weights):
        row = ir.Constant(ir.IntType(64), stride * (slots.KICKS + 2 * int(j) + side) + first)
        place = builder.bitcast(builder.gep(rows, [row]), kind.as_pointer())
        found.append((float(weights[j]), builder.load(place, align=64)))
    return found


def _sum(builder: Any, kind: Any, terms: list[tuple[float, Any]]) -> Any:
    """Return the sum of weights times vectors or numbers, in order."""
    total, is_wide = None, kind == NUMBERS
    for weight, value in terms:
        if weight != 0.0:
            factor = ir.Constant(kind, [weight] * LANES if is_wide else weight)
            if total is None:
                total = builder.fmul(factor, value)
            elif is_wide:
                total = call(builder, "fma", factor, value, total)
            else:
                total = builder.fma(factor, value, total)
    return total or ir.Constant(kind, [0.0] * LANES if is_wide else 0.0)


@overload(summed)
def _compiled_summed(rows, number, v1, v2):
    if rows == TANGENTS:
        return lambda rows, number, v1, v2: _summed_tangents(rows, True, number, v1, v2)
    return lambda rows, number, v1, v2: _summed(rows, 1, 0, True, number, v1, v2)


@overload(estimated)
def _compiled_estimated(rows, number, zero):
    if rows == TANGENTS:
        return lambda rows, number, zero: _summed_tangents(rows, False, number, zero, zero)
    return lambda rows, number, zero: _summed(rows, 1, 0, False, number, zero, zero)


@register_jitable
def _summed_tangents(rows, is_stage, number, v1, v2):
    """Return the same of numbers with tangents: of their values, and of their slopes."""
    first, second = value_of(v1), value_of(v2)
    a, b, c, d = _summed(vectors_of(rows), 2, 0, is_stage, number, first, second)
    p, q, r, s = _summed(vectors_of(rows), 2, 1, is_stage, number, slopes_of(v1), slopes_of(v2))
    return tangent(a, p), tangent(b, q), tangent(c, r), tangent(d, s)
