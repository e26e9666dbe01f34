"""The scene's actuators as a controller knows them: limits, rates, lags, commands, dampers."""

from typing import Literal, TypeAlias, get_args

import numpy as np
from scipy.linalg import expm

from agents.control.controller import looked_up
from agents.control.scene import nominal, plant_of, require_actuator, require_number
from mm_gym import DesignError, Scene
from mm_gym.analysis import spring_stiffness
from mm_gym.arrays import Array

FIELD = "carriage.linear_coefficient"


class Actuators:
    """Limits, rate limits and lags of force [N] and stretch [-], in the order of the action.

    A controller knows the middle of what is drawn.

    Attributes
    ----------
    low, high
        (k,) limits [N, -].
    travel
        (k,) most that an actuator moves in a control step [N, -], infinite without a rate limit.
    lag_factor
        (k,) fraction of the way to its command that it goes in a control step [-].
    is_rate
        (k,) whether an action commands a rate.
    at_once
        Whether all actuators reach their commands within the step.
    """

    def __init__(self, scene: Scene) -> None:
        parts = [getattr(scene.actuation, name) for name in scene.actuation.names]
        step = scene.control.time_step
        limits = [
            (-part.limit, part.limit) if name == "force" else (part.minimum, part.maximum)
            for name, part in zip(scene.actuation.names, parts, strict=True)
        ]
        self.low, self.high = np.array(limits).T
        travel, lags = (
            [nominal(scene, f"actuation.{name}.{field}") for name in scene.actuation.names]
            for field in ("rate_limit", "lag")
        )
        self.travel = step * np.array(travel)
        self.lag_factor = np.array([1.0 if lag == 0.0 else -np.expm1(-step / lag) for lag in lags])
        self.is_rate = np.array([part.command == "rate" for part in parts])
        self.at_once = bool(
            np.isinf(self.travel).all()
            and (self.lag_factor == 1.0).all()
            and not self.is_rate.any()
        )
        self.middle, self.half = 0.5 * (self.high + self.low), 0.5 * (self.high - self.low)

    def reached(self, actions: Array, applied: Array, asked: Array) -> tuple[Array, Array]:
        """Return what the actuators reach and the values commanded so far, (lanes, k) both.

        Parameters
        ----------
        actions
            (lanes, k) [-], clipped to [-1, 1].
        applied, asked
            (lanes, k): what they have, and the values commanded so far, which only rates change.
        """
        actions = np.minimum(np.maximum(actions, -1.0), 1.0)
        commanded = self.middle + self.half * actions
        if self.at_once:
            return commanded, commanded
        wanted = commanded
        if self.is_rate.any():
            with np.errstate(invalid="ignore"):  # no rate, but 0 times infinity
                rated = np.clip(asked + self.travel * actions, self.low, self.high)
            wanted = np.where(self.is_rate, rated, commanded)
        aim = applied + self.lag_factor * (wanted - applied)
        aim = np.minimum(np.maximum(aim, applied - self.travel), applied + self.travel)
        return np.minimum(np.maximum(aim, self.low), self.high), wanted


class Command:
    """Turn a wanted value into the action towards it, whether position or rate is commanded.

    Parameters
    ----------
    name
        "force", "stretch", "damping" or "voltage".

    Attributes
    ----------
    low, high
        Limits of the value [N, -, N s/m, V].
    column
        Place of the actuator among all.
    """

    def __init__(self, scene: Scene, name: str) -> None:
        require_actuator(scene, name)
        actuators, self.name = Actuators(scene), name
        self.column = k = scene.actuation.names.index(name)
        self.low, self.high = float(actuators.low[k]), float(actuators.high[k])
        self.travel, self.is_rate = float(actuators.travel[k]), bool(actuators.is_rate[k])

    def present(self, applied: Array) -> Array:
        """Return the values (lanes,) among what the actuators have (lanes, k)."""
        return applied[:, self.column]

    def __call__(self, wanted: Array, present: Array) -> Array:
        """Return actions (lanes, 1) towards values (lanes,) from the present ones (lanes,).

        A wanted value beyond the actuator's range stands for the end of the range.
        """
        wanted = np.clip(wanted, self.low, self.high)
        if self.is_rate:
            action = (wanted - present) / self.travel
        else:
            action = (wanted - 0.5 * (self.high + self.low)) / (0.5 * (self.high - self.low))
        return np.clip(action, -1.0, 1.0)[:, None]


def require_stable_rest(scene: Scene, law: str) -> None:
    """Raise `DesignError` for a law that leaves the carriage to its spring, if that drives it off.

    Such laws tune the springs of the sphere, which cannot hold the carriage at x1 = 0.
    """
    if min(scene.randomization.get(FIELD, (scene.carriage.linear_coefficient,))) < 0.0:
        got = scene.randomization.get(FIELD, scene.carriage.linear_coefficient)
        msg = (
            f"{FIELD}: got {got}; allowed for the {law}: at least 0; it tunes the springs about "
            "x1 = 0, which is unstable here"
        )
        raise DesignError(msg)


GRID = 41
"""Number of stretches or dampings at which the transition is computed; the nearest is used."""


class Lead:
    """Move a state ahead by half the time in which an actuator crosses its range, and by its lag.

    The present stretch or damping is taken to stay, and no force to act. Without it, a switch comes
    a quarter of a period late where springs need half a period to cross. Springs that need more
    than the fastest period of the sphere do not switch within it; a damper switches four times a
    period of the plant, and does not if it needs more than a quarter. For such there is no lead but
    the lag. The name is what is switched, "stretch" or "damping"; the factor is of that time.
    """

    def __init__(self, scene: Scene, name: str = "stretch", factor: float = 1.0) -> None:
        command = Command(scene, name)
        self.low, self.range = command.low, command.high - command.low
        crossing = self.range / command.travel * scene.control.time_step
        at = self.low + self.range * np.linspace(0.0, 1.0, GRID)
        if name == "stretch":
            stiffness = nominal(scene, "springs.stiffness")
            stiffest = spring_stiffness(self.low, stiffness)
            longest = 2.0 * np.pi * np.sqrt(nominal(scene, "sphere.mass") / stiffest)
            first, last = (plant_of(scene).linear(s)[0] for s in (at[0], at[-1]))
            k2 = spring_stiffness(at, stiffness)
            share = (k2 - k2[-1]) / (k2[0] - k2[-1])  # A is affine in k2
        else:
            damped, plant = str(scene.actuation.damped), plant_of(scene)
            systems = (plant.state_space([], [], at={damped: value}) for value in (at[0], at[-1]))
            first, last = (system.A[:4, :4] for system in systems)
            fastest = np.abs(np.linalg.eigvals(first).imag).max()
            longest = 0.5 * np.pi / fastest if fastest > 0.0 else np.inf
            share = np.linspace(1.0, 0.0, GRID)  # A is affine in the damping
        self.time = factor * (
            nominal(scene, f"actuation.{name}.lag")
            + (0.5 * crossing if crossing < longest else 0.0)
        )
        self.transitions = expm((last + share[:, None, None] * (first - last)) * self.time)

    def __call__(self, state: Array, present: Array) -> Array:
        """Return the states (lanes, 4) ahead, from those now and the stretches or dampings now."""
        if self.time == 0.0:
            return state
        share = np.clip((present - self.low) / self.range, 0.0, 1.0)
        nearest = np.rint(share * (GRID - 1)).astype(np.intp)
        return np.einsum("nij,nj->ni", looked_up(self.transitions[None], nearest), state)


Switching: TypeAlias = Literal["on-off", "continuous"]

SWITCHINGS: tuple[Switching, ...] = get_args(Switching)
"""Ways in which a semi-active damper follows a wanted force."""


class Damper:
    """A semi-active damper as a device for a wanted force.

    Its force is c r, against the relative velocity r of its ends: v2 - v1 of the interface's
    damper, v1 of the carriage's. The force on the carriage is +c r and on the sphere -c r, or -c r
    on the carriage. It only takes energy out, so a wanted force of the other sign than r gets the
    least damping. Raise `DesignError` if no damping is actuated, or `on` is beyond its limits.

    Parameters
    ----------
    switching
        "continuous" has the damping whose force is nearest to the wanted one, c = F / r within the
        limits. "on-off" has one damping wherever F and r agree in sign.
    on
        That one [N s/m]; by default the greatest.
    """

    def __init__(self, scene: Scene, switching: Switching, on: float | None = None) -> None:
        self.command, self.is_on_off = Command(scene, "damping"), switching == "on-off"
        self.on = self.command.high if on is None else on
        require_number("on", self.on, self.command.low, self.command.high)
        self.present = self.command.present
        self.of_interface = scene.actuation.damped == "interface.damping"

    def velocity(self, state: Array) -> Array:
        """Return the relative velocities (lanes,) [m/s] of the damper's ends."""
        return state[:, 3] - state[:, 2] if self.of_interface else state[:, 2]

    def stroke(self, state: Array) -> Array:
        """Return the relative displacements (lanes,) [m] of the damper's ends."""
        return state[:, 1] - state[:, 0] if self.of_interface else state[:, 0]

    def towards(self, force: Array, velocity: Array, present: Array) -> Array:
        """Return actions (lanes, 1) towards forces (lanes,) [N], positive as the velocities are."""
        low, high = self.command.low, self.command.high
        nearest = self.on
        if not self.is_on_off:
            with np.errstate(divide="ignore", invalid="ignore"):  # no damping is the nearest there
                nearest = np.clip(force / velocity, low, high)
        return self.command(np.where(force * velocity > 0.0, nearest, low), present)


class MagnetorheologicalDamper:
    """A magnetorheological damper as a device for a wanted force, by its voltage.

    Its states y and z are not observed. Its force f is taken to be that of (4c) of docs/model.md at
    a z that has settled, with the spring k0 relaxed: slow slip all goes into c1, as in the linear
    plant; faster slip shears the hysteresis at its yield, z = sqrt(A / (gamma + beta)). Of
    parameters that are drawn the middle is known. Raise `DesignError` if no voltage is actuated.
    """

    def __init__(self, scene: Scene) -> None:
        self.command = Command(scene, "voltage")
        self.present = self.command.present
        interface = scene.interface
        assert interface.kind == "magnetorheological"  # noqa: S101 - as the scene demands
        self.values = {
            name: nominal(scene, f"interface.{name}")
            for name in type(interface).model_fields
            if name != "kind"
        }
        bend = self.values["gamma"] + self.values["beta"]  # 0: never yields
        self.bound = np.sqrt(self.values["gain"] / max(bend, np.finfo(np.float64).tiny))

    def force(self, state: Array, voltage: Array) -> Array:
        offset, slip = state[:, 1] - state[:, 0], state[:, 3] - state[:, 2]
        parallel, series, hysteresis = (
            self.values[name] + self.values[f"{name}_per_volt"] * voltage
            for name in ("damping", "series_damping", "hysteresis")
        )
        yielded = (hysteresis * self.bound + parallel * np.abs(slip)) / (parallel + series)
        flow = np.sign(slip) * np.minimum(np.abs(slip), yielded)
        pressed = offset - self.values["accumulator_offset"]
        return series * flow + self.values["accumulator_stiffness"] * pressed

    def towards(self, force: Array, state: Array, present: Array) -> Array:
        """Return actions (lanes, 1) towards forces (lanes,) [N] on the carriage.

        The voltage is the greatest where the damper's force has the sign of the wanted one and is
        the smaller of the two, else the least.
        """
        given = self.force(state, present)
        more = (force - given) * given > 0.0
        return self.command(np.where(more, self.command.high, self.command.low), present)
