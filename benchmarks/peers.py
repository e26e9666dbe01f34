"""The peers of the work-precision benchmark: SciPy, CVODE and heyoka on one second of motion.

Each gets its best case: a compiled right-hand side, the end state only, nothing held or sampled in
between, free choice of its steps, and dry friction from event to event.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

import numba
import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.report import installed
from mm_gym import compile_scene
from mm_gym.scene.mechanics import GRAVITY
from mm_gym.simulation.lanes import Lanes

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from mm_gym import Scene

    State = NDArray[np.float64]
    Run = Callable[[], State]

DURATION = 1.0
"""Length of the motion [s]."""

BUDGET = 0.5
"""Time that one run may take [s]; heyoka, which cannot be interrupted, has a limit of steps."""

MOST_EVENTS = 100_000
MOST_STEPS = 10_000_000


class GaveUpError(Exception):
    """A peer failed, or took longer than `BUDGET`."""


class Family(Protocol):
    """A solver: a function that returns the run of a motion at a tolerance."""

    def __call__(self, motion: Motion, tolerance: float) -> Run:
        """Return a function that runs the motion and returns its end state."""
        ...


@dataclass(frozen=True)
class Motion:
    """One second of a scene without excitation or springs between the masses.

    The regimes of friction are 0 for stick and +1, -1 for the directions of slip; a viscous
    interface has regime 0 only. In each, the force of the interface is c w + s.
    """

    name: str
    scene: Scene

    @property
    def masses(self) -> tuple[float, float, float, float, float]:
        """m1, m2 [kg], k1 [N/m], d [N s/m] and the cubic coefficient beta [1/m^2]."""
        carriage = self.scene.carriage
        m1, k1, d = carriage.mass, carriage.stiffness, carriage.damping
        return m1, self.scene.sphere.mass, k1, d, carriage.cubic_coefficient

    @property
    def start(self) -> State:
        """x1, x2, v1, v2 at rest."""
        initial = self.scene.initial
        x1, offset = initial.carriage_displacement, initial.sphere_offset
        return np.array([x1, x1 + offset, 0.0, 0.0])

    @property
    def reference_velocity(self) -> float:
        """v_r [m/s], infinite without dry friction."""
        interface = self.scene.interface
        return interface.reference_velocity if interface.kind == "dry_friction" else np.inf

    def interface(self, regime: int) -> tuple[float, float]:
        """Return c [N s/m] and s [N] of a regime."""
        interface = self.scene.interface
        if interface.kind != "dry_friction":
            return (interface.damping if interface.kind == "viscous" else 0.0), 0.0
        normal = interface.normal_force or self.scene.sphere.mass * GRAVITY
        vr, chi = interface.reference_velocity, interface.slip_damping
        if regime == 0:
            return interface.static_coefficient * normal / vr, 0.0
        return chi, regime * (interface.kinetic_coefficient * normal - chi * vr)

    def next_regime(self, regime: int, state: State) -> int:
        """Return the regime after an event."""
        return (1 if state[3] > state[2] else -1) if regime == 0 else 0


@numba.njit
def _field(y: State, masses: tuple[float, ...], c: float, s: float, out: State) -> State:
    m1, m2, k1, d, beta = masses
    x1, v1, v2 = y[0], y[2], y[3]
    force = c * (v2 - v1) + s
    out[0], out[1] = v1, v2
    out[2] = (force - d * v1 - k1 * (1.0 + beta * x1 * x1) * x1) / m1
    out[3] = -force / m2
    return out


def mm_gym(motion: Motion, tolerance: float) -> Run:
    """Return a run with the method that `auto` picks, in one control step."""
    scene = motion.scene.replace(**{"control.time_step": DURATION, "control.steps": 1})
    plant = compile_scene(scene)
    if plant.method.option is not None and plant.method.option.name == "tolerance":
        plant = compile_scene(scene.replace(**{"solver.tolerance": tolerance}))
    lanes = Lanes(plant, 1)
    lanes.restart()
    values, start = lanes.values, lanes.values[:, 0].copy()
    propagate = plant.method.entries.propagate

    def run() -> State:
        values[:4, 0] = start[:4]
        lanes.raise_for(propagate(plant.model, values, 0, 1))
        return values[:4, 0]

    return run


def scipy(method: str, motion: Motion, tolerance: float) -> Run:
    """Return a run with a method of SciPy's `solve_ivp`."""
    masses, start, vr = motion.masses, motion.start, motion.reference_velocity
    # SciPy allows nothing below 100 machine epsilons.
    options: dict[str, Any] = {"method": method, "rtol": max(tolerance, 2.3e-14)}
    options["atol"] = 1e-3 * options["rtol"]

    def run() -> State:
        until = time.perf_counter() + BUDGET
        now, state, regime, events = 0.0, start, 0, 0
        while True:
            c, s = motion.interface(regime)

            def field(_: float, y: State, c: float = c, s: float = s) -> State:
                if time.perf_counter() > until:
                    raise GaveUpError
                return _field(y, masses, c, s, np.empty(4))

            leaving = _scipy_events(regime, vr)
            solution = solve_ivp(field, (now, DURATION), state, events=leaving, **options)
            now, state, events = solution.t[-1], solution.y[:, -1], events + 1
            if solution.status == 0:
                return state
            if solution.status < 0 or events > MOST_EVENTS:
                raise GaveUpError
            regime = motion.next_regime(regime, state)

    return run


def _scipy_events(regime: int, vr: float) -> list[Callable[..., float]] | None:
    if vr == np.inf:
        return None

    def leaving(side: int, direction: int) -> Callable[..., float]:
        def event(_: float, y: State) -> float:
            return side * (y[3] - y[2]) - vr

        event.terminal, event.direction = True, direction
        return event

    return [leaving(1, 1), leaving(-1, 1)] if regime == 0 else [leaving(regime, -1)]


def cvode(method: str, motion: Motion, tolerance: float) -> Run:
    """Return a run with SUNDIALS' CVODE."""
    solvers = {regime: _Cvode(method, motion, tolerance, regime) for regime in (-1, 0, 1)}
    start = motion.start

    def run() -> State:
        until = time.perf_counter() + BUDGET
        now, state, regime = 0.0, start, 0
        for _ in range(MOST_EVENTS):
            now, state = solvers[regime].solve(now, state, until)
            if now >= DURATION:
                return state
            regime = motion.next_regime(regime, state)
        raise GaveUpError

    return run


class _Cvode:
    """CVODE in one regime."""

    def __init__(self, method: str, motion: Motion, tolerance: float, regime: int) -> None:
        from sksundae.cvode import CVODE  # noqa: PLC0415 - an optional peer

        masses, (c, s), vr = motion.masses, motion.interface(regime), motion.reference_velocity
        self.until = np.inf

        def field(_: float, y: State, out: State) -> None:
            if time.perf_counter() > self.until:
                raise GaveUpError
            _field(y, masses, c, s, out)

        options: dict[str, Any] = {"method": method, "rtol": tolerance, "atol": 1e-3 * tolerance}
        if vr < np.inf:
            sides = (1, -1) if regime == 0 else (regime,)

            def leaving(_: float, y: State, out: State) -> None:
                for k, side in enumerate(sides):
                    out[k] = side * (y[3] - y[2]) - vr

            leaving.terminal = [True] * len(sides)
            leaving.direction = [1 if regime == 0 else -1] * len(sides)
            options |= {"eventsfn": leaving, "num_events": len(sides)}
        self.solver = CVODE(field, max_num_steps=MOST_STEPS, **options)

    def solve(self, now: float, state: State, until: float) -> tuple[float, State]:
        """Return time and state at the next event, or at the end."""
        self.until = until
        solution = self.solver.solve(np.array([now, DURATION]), state)
        if not solution.success:
            raise GaveUpError
        return float(solution.t[-1]), solution.y[-1]


def heyoka(motion: Motion, tolerance: float, number: type = float) -> Run:
    """Return a run with heyoka's adaptive Taylor series, in double or long double numbers."""
    import heyoka as hy  # noqa: PLC0415 - an optional peer

    # Converting a double to a long double is exact.
    m1, m2, k1, d, beta = (number(value) for value in motion.masses)
    vr = number(motion.reference_velocity)
    x1, x2, v1, v2 = hy.make_vars("x1", "x2", "v1", "v2")
    slip = v2 - v1
    force = hy.par[0] * slip + hy.par[1]
    spring = k1 * (x1 + beta * x1**3) if beta else k1 * x1
    system = [(x1, v1), (x2, v2), (v1, (force - d * v1 - spring) / m1), (v2, -force / m2)]
    events = [hy.t_event(slip + side * vr, fp_type=number) for side in (-1, 1)]
    start, regimes = [number(x) for x in motion.start], (-1, 0, 1)
    pars = {regime: [number(x) for x in motion.interface(regime)] for regime in regimes}
    integrator = hy.taylor_adaptive(
        system,
        start,
        pars=pars[0],
        tol=number(tolerance),
        t_events=events if np.isfinite(vr) else [],
        fp_type=number,
    )

    def run() -> State:
        integrator.time, integrator.state[:], regime = number(0.0), start, 0
        if np.isfinite(vr):
            integrator.reset_cooldowns()
        for _ in range(MOST_EVENTS):
            integrator.pars[:] = pars[regime]
            outcome = integrator.propagate_until(number(DURATION), max_steps=MOST_STEPS)[0]
            if outcome == hy.taylor_outcome.time_limit:
                return np.array(integrator.state)
            if outcome in {hy.taylor_outcome.step_limit, hy.taylor_outcome.err_nf_state}:
                break
            regime = motion.next_regime(regime, integrator.state)
        raise GaveUpError

    return run


def truth(motion: Motion) -> State:
    """Return the end state by heyoka in long doubles, or by mm_gym at its tightest tolerance."""
    run = heyoka(motion, 1e-19, np.longdouble) if installed("heyoka") else mm_gym(motion, 1e-15)
    return np.array(run(), np.float64)


def families() -> dict[str, Family]:
    """Return mm_gym and the peers that are installed."""
    found: dict[str, Family] = {"mm_gym": mm_gym}
    if installed("heyoka"):
        found["heyoka"] = heyoka
    if installed("scikit-sundae"):
        found |= {f"CVODE {method}": partial(cvode, method) for method in ("Adams", "BDF")}
    methods = ("RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA")
    return found | {f"SciPy {method}": partial(scipy, method) for method in methods}
