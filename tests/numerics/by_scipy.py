"""Motion of a scene by SciPy, from a right-hand side of its own: (1) to (6) of docs/model.md.

Every actuator is here, held over each control step. Dry friction is followed from change to change
of its regime.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

if TYPE_CHECKING:
    from collections.abc import Callable

    from mm_gym import Scene

FINE = 2e-4
"""Longest step [s] with dry friction: SciPy sees a change of regime only between two steps."""


class Held(NamedTuple):
    """What the actuators hold in a control step: u [N], stretch [-], c and d [N s/m]."""

    force: float
    stretch: float
    interface: float
    carriage: float


def motion(scene: Scene, ground: np.ndarray | None = None, **held: np.ndarray) -> np.ndarray:
    """Return the states (steps + 1, 4) at the ends of control steps.

    Parameters
    ----------
    scene
        A scene with one value for every field.
    ground
        (k, 2) times [s] and the ground's acceleration [m/s^2] at them, linear in between.
    **held
        (steps,) each, by the names in `Held`; the scene's own values in place of what is left out.
    """
    start, step = scene.initial, scene.control.time_step
    x1, v1 = start.carriage_displacement, start.carriage_velocity
    states = [np.array([x1, x1 + start.sphere_offset, v1, start.sphere_velocity])]
    own = Held(
        0.0,
        getattr(scene.springs, "stretch", 1.0),
        getattr(scene.interface, "damping", 0.0),
        scene.carriage.damping,
    )
    regime = _regime(scene, states[0])
    for n in range(len(next(iter(held.values())))):
        now = own._replace(**{name: float(values[n]) for name, values in held.items()})
        corners = [] if ground is None else ground[:, 0].tolist()
        inner = [time for time in corners if n * step < time < (n + 1) * step]
        state = states[-1]
        for begin, end in pairwise([n * step, *inner, (n + 1) * step]):
            state, regime = _integrate(scene, (now, ground), (begin, end), state, regime)
        states.append(state)
    return np.array(states)


def _regime(scene: Scene, state: np.ndarray) -> int:
    slip = state[3] - state[2]
    if scene.interface.kind != "dry_friction" or abs(slip) <= scene.interface.reference_velocity:
        return 0
    return int(np.sign(slip))


def _integrate(scene, driven, times, state, regime):
    """Return state and regime at the end."""
    (now, end), friction = times, scene.interface.kind == "dry_friction"
    while now < end:
        found = solve_ivp(
            _rates(scene, *driven, regime),
            (now, end),
            state,
            "DOP853",
            rtol=1e-13,
            atol=1e-16,
            events=_exits(scene, regime) if friction else None,
            max_step=FINE if friction else np.inf,
        )
        assert found.success
        now, state = found.t[-1], found.y[:, -1]
        if found.status == 1:
            regime = 0 if regime else int(np.sign(state[3] - state[2]))
    return state, regime


def _exits(scene: Scene, regime: int) -> list[Callable[..., float]]:
    reference = scene.interface.reference_velocity

    def leaving(side: int, direction: int) -> Callable[..., float]:
        def event(_time, y):
            return side * (y[3] - y[2]) - reference

        event.terminal, event.direction = True, direction
        return event

    return [leaving(1, 1), leaving(-1, 1)] if regime == 0 else [leaving(regime, -1)]


def _rates(scene, held, ground, regime):
    carriage, m1, m2 = scene.carriage, scene.carriage.mass, scene.sphere.mass
    between = scene.actuation.force is not None and scene.actuation.force.between == "masses"

    def excitation(time, target):
        return sum(
            part.amplitude * np.sin(part.frequency * time + part.phase)
            for part in scene.excitation
            if part.target == target
        )

    def rates(time, y):
        x1, x2, v1, v2 = y
        inner = _interface(scene, held, v2 - v1, regime) + _springs(scene, held, x2 - x1)
        spring = carriage.linear_coefficient * x1 + carriage.cubic_coefficient * x1**3
        outer = excitation(time, "force") - held.carriage * v1 - carriage.stiffness * spring
        shake = excitation(time, "ground")
        if ground is not None:
            shake += np.interp(time, *ground.T)
        on_sphere = held.force if between else 0.0
        a1 = (outer + inner + held.force) / m1 - shake
        return [v1, v2, a1, (-inner - on_sphere) / m2 - shake]

    return rates


def _interface(scene, held, slip, regime):
    interface = scene.interface
    if interface.kind in ("none", "viscous"):
        return held.interface * slip
    if interface.kind == "stribeck":
        kinetic, more = (
            interface.kinetic_coefficient,
            np.exp(-((slip / interface.stribeck_velocity) ** 2)),
        )
        coefficient = kinetic + (interface.static_coefficient - kinetic) * more
        smooth = slip / np.hypot(slip, interface.reference_velocity)
        return interface.normal_force * coefficient * smooth + interface.slip_damping * slip
    normal, reference = interface.normal_force, interface.reference_velocity
    if regime == 0:
        return interface.static_coefficient * normal * slip / reference
    beyond = interface.slip_damping * (regime * slip - reference)
    return regime * (interface.kinetic_coefficient * normal + beyond)


def _springs(scene, held, offset):
    springs = scene.springs
    if springs.kind == "none":
        return 0.0
    if springs.kind == "linear":
        return springs.stiffness * (offset + springs.cubic_coefficient * offset**3)
    if springs.kind == "small_on_large":
        return 2.0 * springs.stiffness * (1.0 + 2.0 / held.stretch**3) * offset
    sides = [held.stretch + sign * offset / springs.rest_length for sign in (1.0, -1.0)]
    forces = [side - side**-2 for side in sides]
    return springs.stiffness * springs.rest_length * (forces[0] - forces[1])
