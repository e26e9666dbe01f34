"""The values that a scene's parameters can take, and bounds of how fast it can move."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.errors import SceneError, suggest
from mm_gym.excitation.kinds import FIRST, SIZE
from mm_gym.lanes import layout
from mm_gym.law import INTERFACES, bounds, dry_friction, springs
from mm_gym.law.hardening_springs import LINES, with_hardening_springs
from mm_gym.law.interface import LINE, Interface, Law, law_of

LINEAR = "linear"
PARAMETRIC_LINEAR = "parametric linear"
SWITCHED_LINEAR = "switched linear"
PARAMETRIC_SWITCHED_LINEAR = "parametric switched linear"
SMOOTH_NONLINEAR = "smooth nonlinear"
SWITCHED_NONLINEAR = "switched nonlinear"
GENERAL = "general nonlinear"
MASSLESS = "massless carriage"
KINDS = (
    LINEAR,
    PARAMETRIC_LINEAR,
    SWITCHED_LINEAR,
    PARAMETRIC_SWITCHED_LINEAR,
    SMOOTH_NONLINEAR,
    SWITCHED_NONLINEAR,
    GENERAL,
    MASSLESS,
)
"""The kinds of plants. Parametric: parameters differ between lanes or change between steps.
General: the interface is one of `mm_gym.law.INTERFACES`."""

PHYSICAL = range(layout.M1, layout.HARMONICS)
"""Rows of the physical parameters; before them stretch and damping alone enter the dynamics."""


def interface_of(kind: str, *, hardens: bool) -> Interface:
    """Return the one interface of a kind as methods take it: with springs that harden, by value."""
    return (
        with_hardening_springs((LINES | INTERFACES)[kind])
        if hardens
        else INTERFACES.get(kind, LINE)
    )


@dataclass(frozen=True)
class Support:
    """All values that the rows of a lane can take."""

    # (rows,) bounds of each row when an episode begins
    start_low: Array
    start_high: Array
    # (rows,) bounds of each parameter at any time; an actuated stretch moves
    low: Array
    high: Array
    names: dict[str, int] = field(default_factory=dict[str, int])  # of drawn fields -> their rows
    ground: tuple[bool, ...] = ()  # for each harmonic, whether it shakes the ground
    # what one propagation advances by [s]; a control step, unless excitation is sampled
    sample_interval: float = 0.0
    intervals_per_step: int = 1
    # rows that stay between `low` and `high`: all but the state and what follows from other rows
    parameters: tuple[int, ...] = ()
    # (row, row of the ratio, row of the other field) of each field that follows from a ratio
    products: tuple[tuple[int, int, int], ...] = ()
    jets: int = 0  # row of the first jet
    terms: int = 0  # of a jet
    # all but the harmonics, see `mm_gym.excitation.kinds`
    excitation: Array = field(default_factory=lambda: np.zeros(1))
    # row -> stated value of each parameter of dry friction that is left out because nothing slips
    idle: dict[int, float] = field(default_factory=dict[int, float])
    interface: Interface = LINE  # if it is in value form
    interface_row: int = 0  # of its first parameter; the rows before are its own states
    is_between: bool = False  # whether the control force acts between the masses
    # dotted name of each set of records -> its files, in the order of their numbers
    records: dict[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    # of the damping or voltage that is actuated, 0 if none is: C, D or one of the interface's; its
    # name has row DAMPING
    damped_row: int = 0
    device: str = ""  # the actuator's name, "damping" or "voltage"
    sensors_row: int = 0  # first of the sensors that each lane has for itself, 0 if all are alike
    # first row of each actuator whose lag or rate limit is drawn
    actuator_rows: dict[str, int] = field(default_factory=dict[str, int])

    # An interface is told by its identity, and its kernels belong to a process.

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields, with the kind of the interface in its place."""
        hardens = self.interface not in (LINE, *INTERFACES.values())
        return vars(self) | {"interface": {"kind": self.interface.kind, "hardens": hardens}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the fields, with the interface of this process."""
        vars(self).update(state, interface=interface_of(**state["interface"]))

    @property
    def idle_velocity(self) -> float:
        """Reference velocity [m/s] of friction that is left out; infinite without it."""
        return self.idle.get(layout.VR, math.inf)

    @property
    def middle(self) -> Array:
        """The lane (rows,) in the middle of all ranges that an episode begins with."""
        row = 0.5 * (self.start_low + self.start_high)
        if self.damped_row:
            row[self.damped_row] = row[layout.DAMPING]
        return row

    @property
    def held_rows(self) -> list[int]:
        """Row that an actuated damping or voltage goes on to."""
        return [self.damped_row] if self.damped_row else []

    @property
    def frequencies(self) -> Array:
        """Highest frequency of each harmonic [rad/s]."""
        return self.high[self._frequency_rows]

    @property
    def lowest_frequencies(self) -> Array:
        """Lowest frequency of each harmonic [rad/s]."""
        return self.low[self._frequency_rows]

    @property
    def _frequency_rows(self) -> slice:
        rows = self.harmonic_rows
        return slice(rows.start + layout.FREQUENCY, rows.stop + layout.FREQUENCY, rows.step)

    @property
    def harmonic_rows(self) -> range:
        """First row of each harmonic."""
        first, size = layout.HARMONICS, layout.HARMONIC_ROWS
        return range(first, first + size * len(self.ground), size)

    @property
    def sources(self) -> Array:
        """(k, SIZE) slots of each part of the excitation but the harmonics."""
        return self.excitation[FIRST : FIRST + SIZE * int(self.excitation[0])].reshape(-1, SIZE)

    @property
    def sampled(self) -> bool:
        """Whether there is excitation other than harmonics."""
        return bool(self.excitation[0] > 0.0)

    def fixed(self, row: int) -> bool:
        """Tell whether a row has one value only."""
        return bool(self.low[row] == self.high[row])

    @property
    def varying(self) -> list[str]:
        """Dotted names of what enters the dynamics and has more than one value."""
        return [
            name
            for name, row in self.names.items()
            if row in self._dynamic_rows and not self.fixed(row)
        ]

    @property
    def _dynamic_rows(self) -> set[int]:
        """Rows of the physical parameters, the stretch and the harmonics' frequencies."""
        frequencies = range(*self._frequency_rows.indices(len(self.low)))
        return {layout.STRETCH, layout.DAMPING, *PHYSICAL, *frequencies, *self.interface_rows}

    @property
    def varying_parameters(self) -> list[str]:
        """Dotted names of those that are neither the stretch nor a harmonic's frequency."""
        rows = (layout.DAMPING, *range(layout.M1, layout.HARMONICS))
        return [name for name in self.varying if self.names[name] in rows]

    @property
    def interface_rows(self) -> range:
        """Rows of the parameters of an interface in value form."""
        count = len(self.interface.parameters) if self.is_general else 0
        return range(self.interface_row, self.interface_row + count)

    @property
    def is_general(self) -> bool:
        """Whether the interface is known by its value only."""
        return self.interface is not LINE

    @property
    def law(self) -> Law:
        """The law of motion that kernels may be compiled for: each interface but a line has one."""
        return law_of(
            self.interface,
            has_friction=self.slips,
            is_finite=bool(self.is_general or self.high[layout.L0] > 0.0),
            is_excited=bool(self.is_general or self.terms or self.ground),
        )

    @property
    def general_because(self) -> str:
        """What makes the interface known by its value only."""
        cubic = self.names.get("springs.cubic_coefficient")
        if cubic is None:
            return f"interface.kind: got {self.interface.kind!r}"
        return f"springs.cubic_coefficient: got up to {self.high[cubic]:g} 1/m^2"

    @property
    def own_rows(self) -> list[int]:
        """Rows of the interface's own states."""
        return list(range(self.interface_row - len(self.interface.states), self.interface_row))

    @property
    def number_rows(self) -> dict[str, int]:
        """Dotted name of each set of records -> the row of the number of an episode's record."""
        return {name: self.names[f"{name}.record"] for name in self.records}

    @property
    def whole_rows(self) -> dict[str, int]:
        """Dotted name -> row of each field that only has whole numbers."""
        numbers = {f"{name}.record": row for name, row in self.number_rows.items()}
        return numbers | {n: row for n, row in self.names.items() if n == "sensors.delay"}

    @property
    def age_row(self) -> int:
        """Row of the age of the newest frame observed [control steps]; 0 if it is the delay."""
        return self.sensors_row + layout.AGE if self.sensors_row else 0

    @property
    def state_rows(self) -> list[int]:
        """Rows of x1, x2, v1, v2, and of those."""
        return [layout.X1, layout.X2, layout.V1, layout.V2, *self.own_rows]

    @property
    def interface_slopes(self) -> tuple[float, float]:
        """Bounds of the interface's slopes over slip velocity [N s/m] and offset [N/m]."""
        if not self.is_general:
            return 0.0, 0.0
        one = self.interface
        p = [
            float((self.high if name in one.rising else self.low)[row])
            for name, row in zip(one.parameters, self.interface_rows, strict=True)
        ]
        return one.damping(p), one.stiffness(p)

    @property
    def slips(self) -> bool:
        """Whether there is dry friction."""
        return bool(self.high[layout.VR] > 0.0)

    @property
    def is_cubic(self) -> bool:
        """Whether the carriage's spring is not linear."""
        return bool(self.low[layout.BETA] < 0.0 or self.high[layout.BETA] > 0.0)

    @property
    def is_nonlinear(self) -> bool:
        """Whether a spring is not linear."""
        return self.is_cubic or bool(self.high[layout.L0] > 0.0)

    @property
    def kind(self) -> str:
        """One of `KINDS`: the simplest plant that covers all values."""
        if self.is_general:
            return GENERAL
        if self.low[layout.M1] == 0.0:
            return MASSLESS
        if self.is_nonlinear:
            return SWITCHED_NONLINEAR if self.slips else SMOOTH_NONLINEAR
        if self.slips:
            several = self.varying or self.terms
            return PARAMETRIC_SWITCHED_LINEAR if several else SWITCHED_LINEAR
        return PARAMETRIC_LINEAR if self.varying else LINEAR

    @property
    def stiffest(self) -> float:
        """The largest k2 [N/m], the interface's in: it falls with stretch, and is at most 6 k0."""
        k2 = float(plain(springs.stiffness)(self.high[layout.K0], self.low[layout.STRETCH]))
        return k2 + self.interface_slopes[1]

    @property
    def outer_stiffness(self) -> float:
        """The largest magnitude of the carriage's stiffness at rest, k1 alpha [N/m]."""
        return float(self.high[layout.K1] * max(-self.low[layout.ALPHA], self.high[layout.ALPHA]))

    @property
    def growth_rate(self) -> float:
        """A bound of the rate [1/s] at which motions leave one another about an unstable place.

        Where the carriage's spring has a slope of -k, a motion exp(s t) of growing size, real s,
        obeys m1 s^2 <= k and d s <= k, since all other forces only resist (the Rayleigh quotients
        of its shape); without d, either c s or m2 s^2 is at most 2 k. The slope is the least in the
        middle, k1 alpha, or with beta < 0 at the barrier, -2 k1 alpha.
        """
        low, high = self.low, self.high
        softening = 2.0 * high[layout.ALPHA] if low[layout.BETA] < 0.0 else 0.0
        k = float(high[layout.K1] * max(-low[layout.ALPHA], softening, 0.0))
        if k == 0.0:
            return 0.0
        m1, m2, c, d = (float(low[row]) for row in (layout.M1, layout.M2, layout.C, layout.D))
        dragged = max(2.0 * k / c, math.sqrt(2.0 * k / m2)) if c > 0.0 else math.inf
        inert = math.sqrt(k / m1) if m1 > 0.0 else math.inf
        return min(inert, k / d if d > 0.0 else math.inf, dragged)

    @property
    def steepest(self) -> float:
        """The largest slope of the interface's force [N s/m], in stick or slip."""
        high, vr = self.high, float(self.low[layout.VR])
        if self.is_general:
            return self.interface_slopes[0]
        if vr == 0.0:
            return float(high[layout.C])
        stick = plain(dry_friction.stick_slope)(float(high[layout.MU1]), float(high[layout.FN]), vr)
        return float(max(stick, high[layout.CHI]))

    def row_of(self, name: str) -> int:
        """Return the row of a dotted name, or raise `SceneError` with the nearest name."""
        try:
            return self.names[name]
        except KeyError:
            near = suggest(str(name), self.names)
            msg = f"{name}: not a field of this scene that can be set{near}"
            raise SceneError(msg) from None


def fastest_oscillation(support: Support, amplitude: float = 0.0) -> float:
    """Return the fastest undamped frequency about rest that the support reaches [rad/s].

    A stiffening spring is taken for the linear one of an oscillation's first harmonic, of an
    amplitude [m].
    """
    m1, m2, k1 = _fastest(support)
    stiffening = float(support.high[layout.K1] * max(support.high[layout.BETA], 0.0))
    k1 += 0.75 * stiffening * amplitude * amplitude
    return math.sqrt(plain(bounds.largest_eigenvalue)(m1, m2, k1, support.stiffest))


def fastest_rate(support: Support) -> float:
    """Return a bound of the excitation's frequencies and of the norm of A [1/s].

    See `mm_gym.law.bounds.fastest_rate`: it rises with stiffness and damping and falls with the
    masses.
    """
    m1, m2, k1 = _fastest(support)
    d, harmonics = float(support.high[layout.D]), support.frequencies.max(initial=0.0)
    rate = plain(bounds.fastest_rate)(m1, m2, k1, support.stiffest, support.steepest, d)
    return float(max(rate, harmonics))


def fastest_decay(support: Support, slope: float | None = None) -> float:
    """Return the fastest rate [1/s] at which dampers and friction alone slow the masses down.

    The slope [N s/m] is that of the interface, by default the steepest.
    """
    m1, m2, _ = _fastest(support)
    d, steepest = float(support.high[layout.D]), support.steepest if slope is None else slope
    return float(plain(bounds.largest_eigenvalue)(m1, m2, d, steepest))


def _fastest(support: Support) -> tuple[float, float, float]:
    """Return the least masses, and the largest stiffness of the carriage's spring."""
    return float(support.low[layout.M1]), float(support.low[layout.M2]), support.outer_stiffness
