"""The peers of the work-precision benchmark: SciPy, CVODE and heyoka on one second of motion.

Each gets its best case: a compiled right-hand side, the end state only, nothing held or sampled in
between, free choice of its steps, and dry friction from event to event where it has events. CVODE
runs without Python, heyoka from event to event; SciPy takes Python's callables only.
"""

from __future__ import annotations

import signal
import time
import warnings
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from typing import TYPE_CHECKING, NoReturn, Protocol

import numba
import numpy as np
from scipy.integrate import ode, odeint, solve_ivp

from benchmarks.cvode import ADAMS, BDF, FIXED_POINT, NEWTON, REGIMES, Cvode
from benchmarks.report import installed
from benchmarks.timing import side_by_side
from mm_gym import compile_scene
from mm_gym.scene.mechanics import GRAVITY
from mm_gym.simulation.lanes import Lanes

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from mm_gym import Scene

    State = NDArray[np.float64]
    Run = Callable[[], State]
    Interface = tuple[float, float]
    Field = Callable[[float, State], State]

DURATION = 1.0  # length of the motion [s]
BUDGET = 2.0  # time that a run of SciPy may take [s]

MOST_EVENTS = 100_000
MOST_STEPS = 10_000_000
MOST_STEPS_OF_SCIPY = 200_000
"""Steps of one of SciPy's compiled integrators, which nothing interrupts."""


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

    def interface(self, regime: int) -> Interface:
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


@cache
def _field(masses: tuple[float, ...], inner: Interface, outer: Interface, vr: float) -> Field:
    """Return the compiled right-hand side with its constants; slip beyond vr follows `outer`.

    It is what SciPy calls, with nothing of Python's between.
    """
    (c, s), (chi, kinetic), (m1, m2, k1, d, beta) = inner, outer, masses

    # Implicit methods hand over columns of a matrix, which are strided.
    @numba.njit(
        ["float64[::1](float64, float64[::1])", "float64[::1](float64, float64[:])"],
        error_model="numpy",
    )
    def field(_: float, y: State) -> State:
        x1, v1, v2 = y[0], y[2], y[3]
        slip = v2 - v1
        force = c * slip + s
        if abs(slip) > vr:
            force = chi * slip + np.copysign(kinetic, slip)
        spring = k1 * (1.0 + beta * x1 * x1) * x1
        return np.array((v1, v2, (force - d * v1 - spring) / m1, -force / m2))

    return field


@cache
def _jacobian(masses: tuple[float, ...], c: float) -> Callable[[float, State], State]:
    """Return the compiled derivative of a regime's right-hand side, for implicit methods."""
    m1, m2, k1, d, beta = masses

    @numba.njit("float64[:, ::1](float64, float64[::1])", error_model="numpy")
    def jacobian(_: float, y: State) -> State:
        out = np.zeros((4, 4))
        out[0, 2], out[1, 3] = 1.0, 1.0
        out[2, 0] = -k1 * (1.0 + 3.0 * beta * y[0] * y[0]) / m1
        out[2, 2], out[2, 3] = -(c + d) / m1, c / m1
        out[3, 2], out[3, 3] = c / m2, -c / m2
        return out

    return jacobian


@cache
def _leaving(side: int, direction: int, vr: float) -> Callable[..., float]:
    """Return the compiled event where a regime ends, as `solve_ivp` takes it."""

    @numba.njit("float64(float64, float64[:])")
    def event(_: float, y: State) -> float:
        return side * (y[3] - y[2]) - vr

    event.terminal, event.direction = True, direction
    return event


@contextmanager
def within_budget() -> Iterator[None]:
    """Raise GaveUpError after `BUDGET`, or when compiled code that runs then has returned."""

    def give_up(*_: object) -> NoReturn:
        raise GaveUpError

    before = signal.signal(signal.SIGALRM, give_up)
    signal.setitimer(signal.ITIMER_REAL, BUDGET)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def mm_gym(motion: Motion, tolerance: float, count: int = 1) -> Run:
    """Return a run with the method that `auto` picks, in one control step; `count` 0 moves none."""
    scene = motion.scene.replace(**{"control.time_step": DURATION, "control.steps": 1})
    plant = compile_scene(scene)
    if plant.method.option is not None and plant.method.option.name == "tolerance":
        plant = compile_scene(scene.replace(**{"solver.tolerance": tolerance}))
    lanes = Lanes(plant, 1)
    lanes.restart()
    values, start = lanes.values, lanes.values[:, 0].copy()
    propagate = plant.entries.propagate

    def run() -> State:
        values[:4, 0] = start[:4]
        lanes.raise_for(propagate(plant.model, values, 0, count))
        return values[:4, 0]

    return run


def scipy(method: str, motion: Motion, tolerance: float) -> Run:
    """Return a run with a method of SciPy's `solve_ivp`, from event to event."""
    start, vr = motion.start, motion.reference_velocity
    options = {"method": method, **_tolerances(tolerance)}
    # A regime's own force goes on beyond its end, until the event is found.
    own = {regime: motion.interface(regime) for regime in REGIMES}
    fields = {r: _field(motion.masses, force, force, np.inf) for r, force in own.items()}
    events = {regime: _events(regime, vr) for regime in REGIMES}
    jacobians: dict[int, dict[str, object]] = {regime: {} for regime in REGIMES}
    if method in {"Radau", "BDF"}:
        jacobians = {r: {"jac": _jacobian(motion.masses, own[r][0])} for r in REGIMES}

    def run() -> State:
        now, state, regime = 0.0, start, 0
        for _ in range(MOST_EVENTS):
            found = {"events": events[regime], **jacobians[regime], **options}
            solution = solve_ivp(fields[regime], (now, DURATION), state, **found)
            now, state = solution.t[-1], solution.y[:, -1].copy()
            if solution.status == 0:
                return state
            if solution.status < 0:
                break
            regime = motion.next_regime(regime, state)
        raise GaveUpError

    return run


def _tolerances(tolerance: float) -> dict[str, float]:
    relative = max(tolerance, 2.3e-14)  # SciPy allows nothing below 100 machine epsilons
    return {"rtol": relative, "atol": 1e-3 * relative}


def _events(regime: int, vr: float) -> list[Callable[..., float]] | None:
    if vr == np.inf:
        return None
    if regime == 0:
        return [_leaving(1, 1, vr), _leaving(-1, 1, vr)]
    return [_leaving(regime, -1, vr)]


def compiled_scipy(method: str, motion: Motion, tolerance: float) -> Run:
    """Return a run with one of SciPy's compiled integrators: `odeint`, or one of `ode`.

    Their steps are compiled as well, not only the right-hand side. They have no events.
    """
    own = motion.interface(0), motion.interface(1)
    field, start = _field(motion.masses, *own, motion.reference_velocity), motion.start
    options = _tolerances(tolerance)

    def with_odeint() -> tuple[State, bool]:
        times = (0.0, DURATION)
        states, found = odeint(
            field,
            start,
            times,
            tfirst=True,
            full_output=True,
            mxstep=MOST_STEPS_OF_SCIPY,
            **options,
        )
        return states[-1], found["message"] == "Integration successful."

    def with_ode() -> tuple[State, bool]:
        name, _, kind = method.partition(" ")
        kinds = {"method": kind} if kind else {}
        solver = ode(field).set_integrator(name, nsteps=MOST_STEPS_OF_SCIPY, **kinds, **options)
        solver.set_initial_value(start, 0.0)
        return solver.integrate(DURATION), solver.successful()

    def run() -> State:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a failure is returned
            state, succeeded = with_odeint() if method == "odeint" else with_ode()
        if not succeeded:
            raise GaveUpError
        return state

    return run


def cvode(method: int, iteration: str, motion: Motion, tolerance: float) -> Run:
    """Return a run with SUNDIALS' CVODE, all of it compiled."""
    interfaces, vr = [motion.interface(regime) for regime in REGIMES], motion.reference_velocity
    solver = Cvode(
        method,
        iteration,
        tolerance,
        masses=motion.masses,
        interfaces=interfaces,
        reference_velocity=vr,
    )
    start = motion.start

    def run() -> State:
        if not solver.run(start, DURATION, MOST_EVENTS):
            raise GaveUpError
        return solver.state

    return run


def heyoka(
    motion: Motion, tolerance: float, number: type = float, duration: float = DURATION
) -> Run:
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
    start = np.array(motion.start, number)
    own = {regime: np.array(motion.interface(regime), number) for regime in REGIMES}
    has_events = bool(np.isfinite(vr))
    integrator = hy.taylor_adaptive(
        system,
        list(start),
        pars=list(own[0]),
        tol=number(tolerance),
        t_events=events if has_events else [],
        fp_type=number,
    )
    # What Python need not do in a run is done here.
    state, pars, propagate = integrator.state, integrator.pars, integrator.propagate_until
    begin, end, reached = number(0.0), number(duration), hy.taylor_outcome.time_limit
    failures = {hy.taylor_outcome.step_limit, hy.taylor_outcome.err_nf_state}

    def run() -> State:
        integrator.time, state[:], regime = begin, start, 0
        if has_events:
            integrator.reset_cooldowns()
        for _ in range(MOST_EVENTS):
            pars[:] = own[regime]
            outcome = propagate(end, max_steps=MOST_STEPS)[0]
            if outcome == reached:
                return state
            if outcome in failures:
                break
            regime = motion.next_regime(regime, state)
        raise GaveUpError

    return run


def truth(motion: Motion) -> State:
    """Return the end state by heyoka in long doubles, or by mm_gym at its tightest tolerance."""
    run = heyoka(motion, 1e-19, np.longdouble) if installed("heyoka") else mm_gym(motion, 1e-15)
    return np.array(run(), np.float64)


def times_of_calls(motion: Motion) -> dict[str, float]:
    """Return what calls take [µs]: a right-hand side by Python and by compiled code, and solvers.

    The solvers are mm_gym and, if it is installed, heyoka, with nothing to do.
    """
    count = 1000
    start, own = motion.start, motion.interface(0)
    field = _field(motion.masses, own, own, np.inf)

    @numba.njit
    def compiled(y: State) -> State:
        for _ in range(count):
            y = field(0.0, y)  # the next needs the last
        return y

    called: dict[str, Callable[[], object]] = {
        "python": lambda: field(0.0, start),
        "compiled": lambda: compiled(start),
        "mm_gym": mm_gym(motion, 1e-9, count=0),
    }
    if installed("heyoka"):
        called["heyoka"] = heyoka(motion, 1e-9, duration=0.0)
    timings = side_by_side(called, work={"compiled": count}, clock=time.process_time)
    return {name: 1e6 * timing.fastest for name, timing in timings.items()}


def families() -> dict[str, Family]:
    """Return mm_gym and the peers that are installed."""
    found: dict[str, Family] = {"mm_gym": mm_gym}
    if installed("heyoka"):
        found["heyoka"] = heyoka
    if installed("scikit-sundae"):
        found["CVODE Adams"] = partial(cvode, ADAMS, FIXED_POINT)
        found["CVODE Adams, Newton"] = partial(cvode, ADAMS, NEWTON)
        found["CVODE BDF"] = partial(cvode, BDF, NEWTON)
    methods = ("odeint", "dopri5", "dop853", "vode adams", "vode bdf")
    found |= {f"SciPy {method}": partial(compiled_scipy, method) for method in methods}
    methods = ("RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA")
    return found | {f"SciPy {method}": partial(scipy, method) for method in methods}
