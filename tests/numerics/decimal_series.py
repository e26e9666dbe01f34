"""A slow and simple reference beyond double precision: Taylor series in decimal arithmetic.

It follows docs/model.md in 34 digits and uses no code of the package. Crossings of the friction's
reference velocity are searched at many points of each series, and bisected.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Context, Decimal, localcontext
from typing import TYPE_CHECKING

import mpmath as mp
import numpy as np

from mm_gym.scene.mechanics import GRAVITY

if TYPE_CHECKING:
    from collections.abc import Callable

    from mm_gym import Scene

    Terms = list[Decimal]

DIGITS = 34
ORDER = 28
CUT_OFF = Decimal("1e-20")  # size of the last terms of a series, relative to the largest velocity
SAMPLES = 64  # points of a series at which an exit from its regime is searched


@dataclass(frozen=True)
class ControlStep:
    """One control step: force [N] and stretch [-] are held from the time `begin` [s] on.

    With `rounded`, the state is rounded to doubles after each series: the minimum of round-off for
    any method that keeps its state in them.
    """

    scene: Scene
    begin: float
    force: float
    stretch: float
    rounded: bool = False

    def end(self, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the (4,) end, and the (4,) scale: the largest position and velocity on the way."""
        state, largest = self.decimal_end([Decimal(float(x)) for x in start])
        scale = np.repeat([float(max(largest[:2])), float(max(largest[2:]))], 2)
        return np.array([float(x) for x in state]), scale

    def decimal_end(self, state: Terms) -> tuple[Terms, Terms]:
        """Return the end, and the largest magnitudes on the way, in all digits."""
        with localcontext(Context(prec=DIGITS)):
            now, end = Decimal(0), +Decimal(self.scene.control.time_step)  # rounded
            regime, largest = self._regime(state), [abs(x) for x in state]
            while now < end:
                rows = self._series(state, now, regime)
                length = min(_length(rows), end - now)
                exit_at = self._exit(rows, regime, length)
                last = exit_at is None and length == end - now
                length = length if exit_at is None else exit_at
                for k in range(1, 9):
                    state = [_value(row, length * k / 8) for row in rows]
                    largest = [max(a, abs(b)) for a, b in zip(largest, state, strict=True)]
                if self.rounded:
                    state = [Decimal(float(x)) for x in state]
                now = end if last else now + length
                if exit_at is not None:
                    regime = (1 if state[3] > state[2] else -1) if regime == 0 else 0
        return state, largest

    def _regime(self, state: Terms) -> int:
        interface, w = self.scene.interface, state[3] - state[2]
        if interface.kind != "dry_friction" or abs(w) <= Decimal(interface.reference_velocity):
            return 0
        return 1 if w > 0 else -1

    def _interface(self, regime: int) -> tuple[Decimal, Decimal]:
        """Return c and s of the interface's force c w + s."""
        interface = self.scene.interface
        if interface.kind != "dry_friction":
            damping = interface.damping if interface.kind == "viscous" else 0.0
            return Decimal(damping), Decimal(0)
        normal = interface.normal_force
        weight = Decimal(self.scene.sphere.mass * GRAVITY if normal is None else normal)
        vr, chi = Decimal(interface.reference_velocity), Decimal(interface.slip_damping)
        if regime == 0:
            return Decimal(interface.static_coefficient) * weight / vr, Decimal(0)
        return chi, regime * (Decimal(interface.kinetic_coefficient) * weight - chi * vr)

    def _series(self, state: Terms, now: Decimal, regime: int) -> list[Terms]:
        """Return the terms of x1, x2, v1, v2 in the time since now."""
        carriage, m2 = self.scene.carriage, Decimal(self.scene.sphere.mass)
        m1, k1, d = (Decimal(x) for x in (carriage.mass, carriage.stiffness, carriage.damping))
        alpha, beta = (
            Decimal(x) for x in (carriage.linear_coefficient, carriage.cubic_coefficient)
        )
        c, s = self._interface(regime)
        springs = self._springs()
        push, ground = (self._excitation(now, target) for target in ("force", "ground"))
        push[0] += Decimal(self.force)
        x1, x2, v1, v2 = rows = [[x] for x in state]
        square: Terms = []
        for n in range(ORDER):
            square.append(_product(x1, x1, n))
            spring = k1 * (alpha * x1[n] + beta * _product(square, x1, n))
            inner = c * (v2[n] - v1[n]) + (s if n == 0 else 0) + springs(x2[n] - x1[n], n)
            x1.append(v1[n] / (n + 1))
            x2.append(v2[n] / (n + 1))
            v1.append(((inner + push[n] - d * v1[n] - spring) / m1 - ground[n]) / (n + 1))
            v2.append((-inner / m2 - ground[n]) / (n + 1))
        return rows

    def _springs(self) -> Callable[[Decimal, int], Decimal]:
        """Return a function of term n of the offset, and n: term n of the springs' force."""
        springs, stretch = self.scene.springs, Decimal(self.stretch)
        if springs.kind == "none":
            return lambda _offset, _n: Decimal(0)
        k0 = Decimal(springs.stiffness)
        if springs.kind == "small_on_large":
            return lambda offset, _: 2 * k0 * (1 + 2 / stretch**3) * offset
        l0 = Decimal(springs.rest_length)
        sides = [_Side(sign) for sign in (1, -1)]

        def force(offset: Decimal, n: int) -> Decimal:
            rest = stretch if n == 0 else Decimal(0)
            one, other = (side.term(rest + side.sign * offset / l0, n) for side in sides)
            return k0 * l0 * (one - other)

        return force

    def _excitation(self, now: Decimal, target: str) -> Terms:
        terms, factorial = [Decimal(0)] * (ORDER + 1), Decimal(1)
        harmonics = [harmonic for harmonic in self.scene.excitation if harmonic.target == target]
        for harmonic in harmonics:
            with mp.workdps(DIGITS):
                time = mp.mpf(self.begin) + mp.mpf(str(now))
                phase = mp.mpf(harmonic.frequency) * time + mp.mpf(harmonic.phase)
                sine, cosine = (Decimal(mp.nstr(f(phase), DIGITS)) for f in (mp.sin, mp.cos))
            gain, factorial = Decimal(harmonic.amplitude), Decimal(1)
            for n in range(ORDER + 1):
                terms[n] += gain * (sine, cosine, -sine, -cosine)[n % 4] / factorial
                gain, factorial = gain * Decimal(harmonic.frequency), factorial * (n + 1)
        return terms

    def _exit(self, rows: list[Terms], regime: int, length: Decimal) -> Decimal | None:
        """Return the first time at which the slip velocity is beyond the bound of its regime."""
        interface = self.scene.interface
        if interface.kind != "dry_friction":
            return None
        vr, slip = (
            Decimal(interface.reference_velocity),
            [b - a for a, b in zip(*rows[2:], strict=True)],
        )

        def beyond(time: Decimal) -> bool:
            w = _value(slip, time)
            return abs(w) > vr if regime == 0 else regime * w < vr

        # Not at time 0: right after a crossing, round-off may leave w on the wrong side.
        times = [length * k / SAMPLES for k in range(1, SAMPLES + 1)]
        out = next((k for k, time in enumerate(times) if beyond(time)), None)
        if out is None:
            return None
        low, high = (times[out - 1] if out else Decimal(0)), times[out]
        while high - low > high * Decimal("1e-30"):
            middle = (low + high) / 2
            low, high = (low, middle) if beyond(middle) else (middle, high)
        return high


class _Side:
    """The force l - l**-2 of one side's stretch l, term by term."""

    def __init__(self, sign: int) -> None:
        self.sign = sign
        self.stretch: Terms = []
        self.square: Terms = []
        self.inverse: Terms = []

    def term(self, stretch: Decimal, n: int) -> Decimal:
        self.stretch.append(stretch)
        self.square.append(_product(self.stretch, self.stretch, n))
        # From l**2 l**-2 = 1.
        known = sum((self.square[j] * self.inverse[n - j] for j in range(1, n + 1)), Decimal(0))
        self.inverse.append(((1 if n == 0 else 0) - known) / self.square[0])
        return stretch - self.inverse[n]


def _product(a: Terms, b: Terms, n: int) -> Decimal:
    return sum((a[j] * b[n - j] for j in range(n + 1)), Decimal(0))


def _value(terms: Terms, time: Decimal) -> Decimal:
    total = Decimal(0)
    for term in reversed(terms):
        total = total * time + term
    return total


def _length(rows: list[Terms]) -> Decimal:
    """Return the time within which the last two terms of the velocities are below the cut-off."""
    velocities = rows[2:]
    # At rest, the scale is the velocity after a microsecond, also where a force rises from zero.
    sizes = (max(abs(row[n]) for row in velocities) * Decimal(10) ** (-6 * n) for n in range(4))
    largest = next((size for size in sizes if size), Decimal(0))
    shortest = Decimal(10) ** 6
    for row in velocities:
        for n in (ORDER - 1, ORDER):
            if row[n] and largest:
                shortest = min(shortest, (CUT_OFF * largest / abs(row[n])) ** (Decimal(1) / n))
    return shortest
