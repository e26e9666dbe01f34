"""The Kalman filter of a scene: of its plant, sensors and excitation."""

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import control
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov

from agents.control.model import state_scales
from agents.control.observed_actuators import Frame
from agents.control.scene import STATES, plant_of
from mm_gym import DesignError, LinearSystem, Plant, Scene
from mm_gym.arrays import Array

UNMODELLED = 1e-3
"""Of what else disturbs the motion in a step over the objective's scales [-], by default."""

FLOOR = 1e-4
"""Standard deviation that is added to every scaled observation: an equation for sensors without
noise has no digits left."""

SETTLED = 1e-10
"""Relative change of the filter's gain in a step below which it is the stationary one."""

MOST_NUMBERS = 500_000  # numbers of gains that are kept for an episode's start

OF_ACTUATORS = "stretch", "damping", "voltage", "applied_force"
"""Channels that show an actuator, and not the motion."""

HARMONIC = ".cosine", ".sine"
"""Ends of the names of a harmonic's states."""

HIDDEN = 1e-9
"""Singular value of a mode's pencil below which sensors do not show it, or the force reach it.

It is well above the round-off of entries of order one, and far below a usable input.
"""


@dataclass(frozen=True, eq=False)
class KalmanFilter:
    """A filter x += filters[n] (y - C x) of `system`, n steps after an episode begins."""

    # The sampled plant with lag, delay and the noise's filters among its states.
    system: LinearSystem
    filters: Array  # (steps, n, p): the gain in each step, of which the last is the stationary one
    start: Array  # (n,): mean of the state when an episode begins
    error: Array  # (n, n): stationary covariance of the estimate's error
    innovation: Array  # (p, p): stationary covariance of y - C x, before x is corrected


def excited_system(
    scene: Scene, inputs: Sequence[str] = (), at: dict[str, float] | None = None
) -> LinearSystem:
    """Return the sampled plant with its excitation, seen by all channels that show the motion.

    Fields can be changed, by dotted name, as a stretch. Harmonics are noise of their amplitude in a
    narrow band: their phase wanders within an episode, and faster where a frequency is drawn. Raise
    `DesignError` if the sensors show nothing of the motion.
    """
    plant, control = plant_of(scene), scene.control
    other = set(OF_ACTUATORS) - ({"applied_force"} if "force" in inputs else set())
    channels = [name for name in plant.channels if name not in other]
    if not channels:
        msg = f"sensors.channels: {', '.join(plant.channels)} show nothing of the motion"
        raise DesignError(msg)
    system = plant.state_space(inputs, channels, sampled=True, at=at)
    a, noise = system.A.copy(), system.process_noise.copy()
    for k, signal in enumerate(system.states):
        if signal.name.endswith(HARMONIC):
            name = f"{signal.name.rpartition('.')[0]}.frequency"
            low, high = scene.randomization.get(name, (0.0, 0.0))
            kept = np.exp(-0.5 * (high - low) * control.time_step - 1.0 / control.steps)
            a[k] *= kept
            noise[k, k] += 0.5 * (1.0 - kept**2)
    return replace(system, A=a, process_noise=noise)


def design_filter(
    scene: Scene,
    system: LinearSystem,
    unmodelled: float,
    needed: NDArray[np.bool_] | None = None,
    steps: int = 1,
) -> KalmanFilter:
    """Solve the filter's Riccati equation, and its recursion in an episode's first steps.

    Raise `DesignError` if the sensors do not show a mode that does not decay, or the equation has
    no stabilising solution.

    Parameters
    ----------
    system
        As `excited_system` returns it.
    unmodelled
        Standard deviation of what else disturbs each displacement and velocity in a step, over the
        objective's scales: it keeps the filter awake.
    needed
        (n,) states that are estimated, by default the motion; with those that they depend on, and
        those that are shown.
    steps
        Most steps of the recursion.
    """
    if needed is None:
        needed = np.array([signal.name in STATES for signal in system.states])
        if scene.interface.kind == "none" and scene.springs.kind == "none":
            needed[[1, 3]] = False
    disturbed = np.pad((unmodelled * state_scales(scene)) ** 2, (0, len(needed) - len(STATES)))
    sizes = Frame(scene, [signal.name for signal in system.outputs]).unit
    start, spread = _initial(scene, system)
    filters, error, innovation = _solved(
        replace(system, process_noise=system.process_noise + np.diag(disturbed)),
        system.sensor_noise + np.diag((FLOOR * sizes) ** 2),
        spread,
        needed,
        units=(state_units(scene, plant_of(scene), system), sizes),
        steps=steps,
    )
    return KalmanFilter(system, filters, start, error, innovation)


def state_units(scene: Scene, plant: Plant, system: LinearSystem) -> Array:
    """Return the size of each state: without it the equations lose their digits."""
    objective, actuator = scene.objective, scene.actuation.force
    sizes = {"x": objective.displacement_scale, "v": objective.velocity_scale}
    units = {channel.name: 1.0 / channel.factor for channel in plant.observed}
    if actuator is not None:
        units["force"] = actuator.limit
    return np.array(
        [
            sizes[signal.name[0]]
            if signal.name in STATES
            else units.get(signal.name.partition("[")[0], 1.0)
            for signal in system.states
        ]
    )


def _initial(scene: Scene, system: LinearSystem) -> tuple[Array, Array]:
    """Return the mean and the covariance of the state when an episode begins."""
    ranges = scene.initial
    values = (
        ranges.carriage_displacement,
        ranges.sphere_offset,
        ranges.carriage_velocity,
        ranges.sphere_velocity,
    )
    spreads = [
        (value[1] - value[0]) ** 2 / 12.0 if isinstance(value, tuple) else 0.0 for value in values
    ]
    names = [signal.name for signal in system.states]
    mean = np.zeros(len(names))
    mean[:4] = [np.mean(value) for value in values]
    mean[1] += mean[0]  # x2 is x1 and the offset
    covariance = np.zeros_like(system.A)
    covariance[:4, :4] = np.diag(spreads)
    covariance[1, :2] = spreads[0], spreads[0] + spreads[1]
    covariance[0, 1] = spreads[0]
    for k in [k for k, name in enumerate(names) if name.endswith(HARMONIC)]:
        covariance[k, k] = 0.5
    noisy = [k for k, name in enumerate(names) if ".filter" in name]
    if noisy:
        rows = np.ix_(noisy, noisy)
        covariance[rows] = solve_discrete_lyapunov(system.A[rows], system.process_noise[rows])
    # Before the first frame stand copies of it: the late channels are those of the first state.
    late = [k for k, name in enumerate(names) if name.endswith("]")]
    first = [k for k in late if names[k].endswith("[-1]")]
    copies = np.eye(len(names))
    for k in late:
        channel = names[k].partition("[")[0]
        own = next(row for row in first if names[row].partition("[")[0] == channel)
        copies[k] = 0.0
        copies[k, : late[0]] = system.A[own, : late[0]]
    return copies @ mean, copies @ covariance @ copies.T


def _solved(
    system: LinearSystem,
    sensors: Array,
    spread: Array,
    needed: NDArray[np.bool_],
    *,
    units: tuple[Array, Array],
    steps: int,
) -> tuple[Array, Array, Array]:
    """Return the filter's gains in an episode's first steps; its stationary error and innovation.

    States that neither an output nor a motion in the cost depends on, as those of a sphere without
    interface and springs, are not estimated.
    """
    x, y = units
    outer, sensors = np.outer(x, x), sensors / np.outer(y, y)
    kept = np.flatnonzero(told_by(system.A, needed | (system.C != 0.0).any(axis=0)))
    rows = np.ix_(kept, kept)
    a, c = (system.A * x / x[:, None])[rows], (system.C * x / y[:, None])[:, kept]
    noise, covariance = system.process_noise[rows] / outer[rows], spread[rows] / outer[rows]
    require_detectable(a, c)
    with solvable("the filter's Riccati equation"):
        _, stationary, poles = control.dlqe(a, np.eye(len(a)), c, noise, sensors, method="scipy")
    if not np.abs(poles).max() < 1.0:
        msg = "the filter has no stabilising solution: no noise moves a mode that does not decay"
        raise DesignError(msg)

    def updated(before: Array) -> tuple[Array, Array]:
        gain = np.linalg.solve(c @ before @ c.T + sensors, c @ before).T
        left = np.eye(len(a)) - gain @ c
        return gain, left @ before @ left.T + gain @ sensors @ gain.T  # Joseph's form

    last, error = updated(np.asarray(stationary))
    gains: list[Array] = []
    for _ in range(min(steps, MOST_NUMBERS // last.size)):
        gain, after = updated(covariance)
        gains.append(gain)
        covariance = a @ after @ a.T + noise
        if np.abs(gain - last).max() <= SETTLED * np.abs(last).max():
            break
    filters, errors = np.zeros((len(gains) + 1, len(x), len(y))), np.zeros_like(outer)
    filters[:, kept], errors[rows] = [*gains, last], error
    innovation = c @ stationary @ c.T + sensors
    return filters * x[:, None] / y, errors * outer, innovation * np.outer(y, y)


def require_detectable(a: Array, c: Array) -> None:
    """Raise `DesignError` if the outputs do not show a mode that does not decay."""
    eigenvalue = hidden_mode(a, c)
    if eigenvalue is not None:
        msg = (
            f"sensors.channels: they do not show the mode {eigenvalue:.6g}, which does not "
            "decay: the state is not detectable; observe another channel"
        )
        raise DesignError(msg)


def hidden_mode(a: Array, c: Array) -> complex | None:
    """Apply the test of Popov, Belevitch and Hautus to every eigenvalue that does not decay.

    Return the first that C does not show; with A' and B' the first that B does not reach.
    """
    rows = c / np.maximum(np.linalg.norm(c, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    for eigenvalue in np.linalg.eigvals(a):
        if abs(eigenvalue) >= 1.0 - 1e-9:
            pencil = np.vstack([a - eigenvalue * np.eye(len(a)), rows])
            if np.linalg.svd(pencil, compute_uv=False)[-1] < HIDDEN:
                return complex(eigenvalue)
    return None


def told_by(a: Array, outputs: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which states (n,) some outputs depend on, of those (n,) that are in them at once."""
    for _ in outputs:
        outputs = outputs | (a[outputs] != 0.0).any(axis=0)
    return outputs


@contextmanager
def solvable(equation: str) -> Generator[None]:
    """Turn what a solver raises into a `DesignError` that names the equation."""
    try:
        yield
    except (np.linalg.LinAlgError, control.ControlArgument, ValueError) as error:
        msg = f"{equation} has no stabilising solution: {error}"
        raise DesignError(msg) from error
