"""The oracle, a slow and simple reference: SciPy's integrators on the equations of docs/model.md.

Dry friction is integrated from event to event. The oracle has no code in common with the kernels.
Tests, benchmarks and `mm_gym.work_precision` measure errors against it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp  # pyright: ignore[reportUnknownVariableType] - untyped

from mm_gym.arrays import Array
from mm_gym.errors import SimulationError
from mm_gym.scene.mechanics import GRAVITY

if TYPE_CHECKING:
    from mm_gym.scene.scene import Scene

State = Array

STICK = 0  # regime of dry friction; +1 and -1 are the directions of slip w


@dataclass(frozen=True)
class Oracle:
    """A scene with one value for every field, integrated by SciPy."""

    scene: Scene  # without ranges; those of `initial` may stay if `solve` is given a start
    method: str = "DOP853"  # of `scipy.integrate.solve_ivp`; "Radau" for stiff scenes
    rtol: float = 1e-13
    max_step: float = np.inf  # [s]: SciPy sees an event only if its sign differs between two steps
    # of time [s] and target, force [N] or ground's acceleration [m/s^2]; by default the harmonics
    disturbance: Callable[[float, str], float] | None = None
    most_evaluations: int = 100_000_000  # of the forces, over its life, before it gives up
    _spent: list[int] = field(default_factory=lambda: [0], init=False, repr=False)

    @property
    def spent(self) -> int:
        """Evaluations of the forces until now."""
        return self._spent[0]

    def solve(
        self,
        times: ArrayLike,
        *,
        forces: ArrayLike | None = None,
        stretches: ArrayLike | None = None,
        start: ArrayLike | None = None,
        begin: float = 0.0,
    ) -> State:
        """Return the states (n, 4) at increasing times (n,) [s], from a start (4,) at `begin` [s].

        Forces [N] and stretches [-] have one value per control step, held over it; by default they
        are 0 N and the scene's. States are x1, x2 [m], v1, v2 [m/s]; the start is by default the
        scene's. `SimulationError` says that SciPy fails, or the budget of evaluations is used up.
        """
        instants = np.atleast_1d(np.asarray(times, np.float64))
        state = self.initial_state() if start is None else np.array(start, np.float64)
        step, now, states = self.scene.control.time_step, begin, np.empty((len(instants), 4))
        for k, instant in enumerate(instants):
            while now < instant:
                n = int(np.floor(now / step * (1 + 1e-12)))
                held = forces is not None or stretches is not None
                until = min(instant, (n + 1) * step) if held else instant
                force = 0.0 if forces is None else float(np.asarray(forces)[n])
                stretch = self._stretch() if stretches is None else float(np.asarray(stretches)[n])
                state, now = self._integrate(now, until, state, force, stretch), until
            states[k] = state
        return states

    def initial_state(self) -> State:
        """Return x1, x2, v1, v2 as the scene states them."""
        start = self.scene.initial
        x1, offset = float(start.carriage_displacement), float(start.sphere_offset)  # pyright: ignore[reportArgumentType]
        v1, v2 = float(start.carriage_velocity), float(start.sphere_velocity)  # pyright: ignore[reportArgumentType]
        return np.array([x1, x1 + offset, v1, v2])

    def _stretch(self) -> float:
        return getattr(self.scene.springs, "stretch", 1.0)

    def _integrate(
        self, start: float, end: float, state: State, force: float, stretch: float
    ) -> State:
        """Integrate with force and stretch held, from event to event."""
        regime = self._regime(state)
        if self.scene.carriage.mass == 0.0:
            return self._integrate_massless(start, end, state, force, stretch)
        while start < end:
            solution = self._segment(
                self._field(regime, force, stretch), start, end, state, self._events(regime)
            )
            start, state = float(solution.t[-1]), solution.y[:, -1]
            if solution.status == 1:
                regime = self._direction(state) if regime == STICK else STICK
        return state

    def _segment(
        self,
        field: Callable[..., State],
        start: float,
        end: float,
        state: State,
        events: list[Callable[..., float]],
    ) -> Any:  # noqa: ANN401 - SciPy does not name it
        # The absolute tolerance is far below any state of interest, so that the relative one
        # holds for each component.
        solution = cast(
            "Any",
            solve_ivp(
                self._counted(field),
                (start, end),
                state,
                self.method,
                events=events,
                rtol=self.rtol,
                atol=1e-17,
                max_step=self.max_step,
            ),
        )
        if solution.status < 0:
            msg = f"reference: {solution.message}"
            raise SimulationError(msg)
        return solution

    def _counted(self, forces: Callable[..., State]) -> Callable[..., State]:
        def counted(t: float, y: State) -> State:
            self._spent[0] += 1
            if self._spent[0] > self.most_evaluations:
                msg = f"reference: gave up after {self.most_evaluations} evaluations"
                raise SimulationError(msg)
            return forces(t, y)

        return counted

    def _regime(self, state: State) -> int:
        interface = self.scene.interface
        if interface.kind != "dry_friction":
            return STICK
        slips = abs(state[3] - state[2]) > interface.reference_velocity
        return self._direction(state) if slips else STICK

    def _direction(self, state: State) -> int:
        return 1 if state[3] > state[2] else -1

    def _events(self, regime: int) -> list[Callable[..., float]]:
        """Return the exits from a regime as terminal events."""
        interface = self.scene.interface
        if interface.kind != "dry_friction":
            return []
        vr = interface.reference_velocity

        def leaving(side: int, direction: int) -> Callable[..., float]:
            def event(_: float, y: State) -> float:
                return side * (y[3] - y[2]) - vr

            event.terminal, event.direction = True, direction  # pyright: ignore[reportFunctionMemberAccess]
            return event

        return [leaving(1, 1), leaving(-1, 1)] if regime == STICK else [leaving(regime, -1)]

    def _interface(self, w: float, regime: int) -> float:
        """Return the interface's force on the carriage (eq. 9 of the paper for dry friction)."""
        interface = self.scene.interface
        if interface.kind == "none":
            return 0.0
        if interface.kind == "viscous":
            return interface.damping * w
        if interface.kind != "dry_friction":
            msg = f"reference: got interface.kind = {interface.kind!r}; it is not known here"
            raise SimulationError(msg)
        normal = interface.normal_force or self.scene.sphere.mass * GRAVITY
        vr = interface.reference_velocity
        if regime == STICK:
            return interface.static_coefficient * normal / vr * w
        faster = interface.slip_damping * (regime * w - vr)
        return regime * (interface.kinetic_coefficient * normal + faster)

    def _springs(self, offset: float, stretch: float) -> float:
        """Return the springs' force on the carriage: eq. 15 of the paper, or neo-Hookean ones."""
        springs = self.scene.springs
        if springs.kind == "none":
            return 0.0
        if springs.kind == "linear":
            return springs.stiffness * (1 + springs.cubic_coefficient * offset**2) * offset
        if springs.kind == "small_on_large":
            return 2 * springs.stiffness * (1 + 2 / stretch**3) * offset
        one, other = stretch + offset / springs.rest_length, stretch - offset / springs.rest_length
        return springs.stiffness * springs.rest_length * ((one - one**-2) - (other - other**-2))

    def _excitation(self, time: float, target: str) -> float:
        if self.disturbance is not None:
            return self.disturbance(time, target)
        total = 0.0
        for harmonic in self.scene.excitation:
            if harmonic.kind != "harmonic":
                msg = f"reference: got excitation of kind {harmonic.kind!r}; set disturbance"
                raise SimulationError(msg)
            if harmonic.target == target:
                total += harmonic.amplitude * np.sin(harmonic.frequency * time + harmonic.phase)
        return total

    def _field(self, regime: int, force: float, stretch: float) -> Callable[..., State]:
        carriage, m2 = self.scene.carriage, self.scene.sphere.mass
        pair, held = (force, 0.0) if self.scene.actuation.is_between else (0.0, force)

        def field(t: float, y: State) -> State:
            x1, x2, v1, v2 = y
            inner = self._interface(v2 - v1, regime) + self._springs(x2 - x1, stretch) + pair
            stiffening = carriage.linear_coefficient + carriage.cubic_coefficient * x1**2
            spring, ground = carriage.stiffness * stiffening * x1, self._excitation(t, "ground")
            outer = held + self._excitation(t, "force") - carriage.damping * v1 - spring
            a1, a2 = (inner + outer) / carriage.mass, -inner / m2
            return np.array([v1, v2, a1 - ground, a2 - ground])

        return field

    def _integrate_massless(
        self, start: float, end: float, state: State, force: float, stretch: float
    ) -> State:
        """Integrate x1, x2, v2; v1 balances the forces on the carriage (viscous interface)."""
        carriage, m2 = self.scene.carriage, self.scene.sphere.mass
        c = self._interface(1.0, STICK)
        pair = force if self.scene.actuation.is_between else 0.0

        def velocity(t: float, x1: float, x2: float, v2: float) -> float:
            push = c * v2 + self._springs(x2 - x1, stretch) + force + self._excitation(t, "force")
            push -= carriage.stiffness * carriage.linear_coefficient * x1
            return push / (c + carriage.damping)

        def field(t: float, y: State) -> State:
            x1, x2, v2 = y
            v1 = velocity(t, x1, x2, v2)
            inner = c * (v2 - v1) + self._springs(x2 - x1, stretch) + pair
            return np.array([v1, v2, -inner / m2 - self._excitation(t, "ground")])

        x1, x2, v2 = self._segment(field, start, end, state[[0, 1, 3]], []).y[:, -1]
        return np.array([x1, x2, velocity(end, x1, x2, v2), v2])
