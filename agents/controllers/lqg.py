"""The linear-quadratic-Gaussian regulator (LQG): an LQR on a Kalman filter's estimate."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import control
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov

from agents.control.actuators import Command
from agents.control.controller import Acted, Controller, Info, Memory, Observation
from agents.control.model import state_scales
from agents.control.observed_state import Frame
from agents.control.scene import STATES, drawn_but, force_weight, plant_of, require_number
from agents.controllers.constant import uncontrolled
from agents.controllers.lqr import (
    Quadratic,
    hidden_mode,
    motion_weight,
    reaction_weights,
    solvable,
    state_weight,
    told_by,
)
from agents.controllers.registry import (
    Entry,
    Free,
    Tunable,
    regulator_entry,
    unless,
    without_weight,
)
from agents.controllers.searched import cheapest
from agents.scoring import validation_cost
from mm_gym import DesignError, LinearSystem, MovingMassVectorEnv, Plant, Scene
from mm_gym.arrays import Array

UNMODELLED = 1e-3
"""Of what else disturbs the motion in a step over the objective's scales [-], by default."""

FLOOR = 1e-4
"""Standard deviation that is added to every scaled observation: an equation for sensors without
noise has no digits left."""

SETTLED = 1e-10
"""Relative change of the filter's gain in a step below which it is the stationary one."""

ROUND_OFF = 1e-12
"""Of a pole: a mode without decay that the force does not reach has one this near to 1."""

MOST_NUMBERS = 500_000  # numbers of gains that are kept for an episode's start

EFFORTS = np.linspace(-1.0, 4.0, 6)  # exponents of what multiplies the weight of the force

LEAST = 1e-3
"""Least weight of the force that these factors are of, over the mean penalty without control: where
a scene states none or hardly any, the force is at its limits throughout, and noise and delay decide
how much of it is best."""

DISTURBANCES = UNMODELLED, 1e-2, 0.1, 1.0
"""Sizes of what is unmodelled that are tried: with more the stationary filter is quicker, as an
episode's first steps need it, and shows more noise."""

OF_ACTUATORS = "stretch", "damping", "voltage", "applied_force"
"""Channels that show an actuator, and not the motion."""

REACTIONS = ("carriage_acceleration", "sphere_acceleration")  # what `reaction_weights` weighs


@dataclass(frozen=True, eq=False)
class LQGDesign:
    """A regulator u = -gain x and a filter x += filters[n] (y - C x), both of `system`."""

    # The sampled plant with lag, delay and the noise's filters among its states.
    system: LinearSystem
    gain: Array  # (n,) [N per unit]; zero for all other states
    filters: Array  # (steps, n, p): the gain in each step, of which the last is the stationary one
    start: Array  # (n,): mean of the state when an episode begins
    error: Array  # (n, n): stationary covariance of the estimate's error
    innovation: Array  # (p, p): stationary covariance of y - C x, before x is corrected
    cost: float  # expected mean of -reward per step [-], in the long run and without limits


def design_lqg(
    scene: Scene,
    *,
    stretch: float | None = None,
    unmodelled: float = UNMODELLED,
) -> LQGDesign:
    """Solve both Riccati equations for a scene's reward, sensors and random excitation.

    The phase of a harmonic wanders within an episode, and faster where its frequency is drawn: no
    force stills a harmonic for ever, so neither equation has a solution without.

    Raise `DesignError` if there is no force, it is commanded by its rate or costs nothing, the
    sensors do not show a mode that does not decay, or an equation has no stabilising solution.

    Parameters
    ----------
    stretch
        That of tuned springs, which is held.
    unmodelled
        Standard deviation of what else disturbs each displacement and velocity in a step, over the
        objective's scales: it keeps the filter awake.
    """
    force_weight(scene)
    require_number("unmodelled", unmodelled)
    plant = plant_of(scene)
    channels = tuple(channel for channel in plant.channels if channel != "stretch")
    at = None if stretch is None else {"initial.stretch": stretch}
    system = plant.state_space(["force"], channels, sampled=True, at=at)
    system = _with_wandering_phases(scene, system)
    regulated, gain, riccati, curvature = regulator(plant, scene, at, system)
    noise = system.process_noise + np.diag(_unmodelled(scene, unmodelled, len(system.A)))
    shown = [channel for channel in plant.observed if channel.name in channels]
    floor = [(FLOOR / channel.factor) ** 2 for channel in shown]
    sensors = system.sensor_noise + np.diag(floor)
    units = state_units(scene, plant, system), np.array([1.0 / channel.factor for channel in shown])
    start, spread = _initial(scene, system)
    covariances, steps = (noise, sensors, spread), scene.control.steps
    filters, error, innovation = _filter(system, gain != 0.0, covariances, units=units, steps=steps)
    rows = np.ix_(regulated, regulated)
    own = gain[list(regulated)]
    cost = float(np.sum(riccati * system.process_noise[rows]))
    cost += float(curvature * own @ error[rows] @ own)
    return LQGDesign(system, gain, filters, start, error, innovation, cost)


def design_filter(
    scene: Scene, at: dict[str, float] | None, unmodelled: float
) -> tuple[LinearSystem, Array]:
    """Return the plant that nothing actuates, and the stationary gain (n, p) of its Kalman filter.

    Fields can be changed, by dotted name, as a stretch; phases of harmonics wander. Raise
    `DesignError` if the sensors do not show a mode that does not decay, or nothing of the motion.
    """
    plant = plant_of(scene)
    channels = tuple(name for name in plant.channels if name not in OF_ACTUATORS)
    if not channels:
        msg = f"sensors.channels: {', '.join(plant.channels)} show nothing of the motion"
        raise DesignError(msg)
    system = plant.state_space([], channels, sampled=True, at=at)
    system = _with_wandering_phases(scene, system)
    noise = system.process_noise + np.diag(_unmodelled(scene, unmodelled, len(system.A)))
    sizes = Frame(scene, channels).unit
    sensors = system.sensor_noise + np.diag((FLOOR * sizes) ** 2)
    units = state_units(scene, plant, system), sizes
    needed = np.array([signal.name in STATES for signal in system.states])
    if scene.interface.kind == "none" and scene.springs.kind == "none":
        needed[[1, 3]] = False
    covariances = noise, sensors, np.zeros_like(system.A)
    return system, _filter(system, needed, covariances, units=units, steps=1)[0][-1]


def regulator(
    plant: Plant, scene: Scene, at: dict[str, float] | None, system: LinearSystem
) -> tuple[tuple[int, ...], Array, Array, float]:
    """Return what regulates a system.

    That are the states that the cost depends on, the gain on all states, P, and the curvature of
    the cost over the force [1/N^2].
    """
    regulated, a, b, own = regulated_part(plant, scene, at, system)
    stage = own.ahead(a, b) if own.cross.any() else own
    x, limit = state_units(scene, plant, system)[list(regulated)], Command(scene, "force").high
    scaled = Quadratic(
        stage.state * np.outer(x, x), stage.cross * x[:, None] * limit, stage.force * limit**2
    )
    with solvable("the regulator's Riccati equation"):
        found, riccati, poles = control.dlqr(
            a * x / x[:, None], b * limit / x[:, None], *scaled.weights, method="scipy"
        )
    if not np.abs(poles).max() < 1.0 - ROUND_OFF:
        msg = (
            "the regulator has no stabilising solution: the force does not reach a motion that "
            f"the cost contains and that does not decay ({np.abs(poles).max():.9f} in a step)"
        )
        raise DesignError(msg)
    gain = np.zeros(len(system.states))
    gain[list(regulated)] = np.asarray(found)[0] * limit / x
    riccati = np.asarray(riccati) / np.outer(x, x)
    curvature = (stage.force + b.T @ riccati @ b).item()
    if stage is not own:
        riccati = riccati + own.state
    return regulated, gain, riccati, curvature


def regulated_part(
    plant: Plant, scene: Scene, at: dict[str, float] | None, system: LinearSystem
) -> tuple[tuple[int, ...], Array, Array, Quadratic]:
    """Return the states of a system that the cost depends on, their A and B, and the cost."""
    every = [signal.name for signal in system.states]
    weight = _weight(scene, at, every)
    seen = [name for name in STATES if weight[every.index(name)].any()]
    part = plant.state_space(["force"], seen, sampled=True, at=at)
    names = [signal.name for signal in part.observable().states]
    if not set(names) <= set(every):  # combinations of states
        names = [signal.name for signal in part.states]
    names += [name for k, name in enumerate(every) if weight[k, k] > 0.0 and name not in names]
    regulated = tuple(every.index(name) for name in names)
    whole = Quadratic(weight[:-1, :-1], weight[:-1, -1:], weight[-1:, -1:])
    rows = np.ix_(regulated, regulated)
    return regulated, system.A[rows], system.B[list(regulated)], whole.of(regulated)


def _weight(scene: Scene, at: dict[str, float] | None, every: list[str]) -> Array:
    """Return the weight (n + 1, n + 1) of the states named, at a step's end, and of the force.

    A force with a lag is one of the states, and its acceleration is of what it then is.
    """
    weight = np.zeros((len(every) + 1, len(every) + 1))
    motion = [every.index(name) for name in STATES]
    weight[np.ix_(motion, motion)] = motion_weight(scene)
    weight[-1, -1] = force_weight(scene)
    reactions = reaction_weights(scene)
    names = [name for name, squared in zip(REACTIONS, reactions, strict=True) if squared > 0.0]
    if names:
        instant = plant_of(
            scene.replace(sensors={}, randomization=drawn_but(scene, "sensors."))
        )  # of sensors without delay
        shown = instant.state_space(["force"], names, sampled=True, at=at)
        rows = np.zeros((len(names), len(every) + 1))
        for k, signal in enumerate(shown.states):
            rows[:, every.index(signal.name) if signal.name in every else -1] += shown.C[:, k]
        squares = [squared for squared in reactions if squared > 0.0]
        for row, squared in zip(rows, squares, strict=True):
            weight += squared * np.outer(row, row)
    if not weight[:-1, :-1].any():
        state_weight(scene)  # tells which weights there are
    return weight


def _with_wandering_phases(scene: Scene, system: LinearSystem) -> LinearSystem:
    """Return a system whose harmonics are noise of their amplitude in a narrow band."""
    a, noise, control = system.A.copy(), system.process_noise.copy(), scene.control
    for k, signal in enumerate(system.states):
        if signal.name.endswith((".cosine", ".sine")):
            name = f"{signal.name.rpartition('.')[0]}.frequency"
            low, high = scene.randomization.get(name, (0.0, 0.0))
            kept = np.exp(-0.5 * (high - low) * control.time_step - 1.0 / control.steps)
            a[k] *= kept
            noise[k, k] += 0.5 * (1.0 - kept**2)
    return replace(system, A=a, process_noise=noise)


def _unmodelled(scene: Scene, part: float, size: int) -> Array:
    return np.pad((part * state_scales(scene)) ** 2, (0, size - len(STATES)))


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
    for k in [k for k, name in enumerate(names) if name.endswith((".cosine", ".sine"))]:
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


def _filter(
    system: LinearSystem,
    regulated: NDArray[np.bool_],
    covariances: tuple[Array, Array, Array],
    *,
    units: tuple[Array, Array],
    steps: int,
) -> tuple[Array, Array, Array]:
    """Return the filter's gains in an episode's first steps; its stationary error and innovation.

    States that neither an output nor a motion in the cost depends on, as those of a sphere without
    interface and springs, are not estimated.
    """
    x, y = units
    outer, sensors = np.outer(x, x), covariances[1] / np.outer(y, y)
    kept = np.flatnonzero(told_by(system.A, regulated | (system.C != 0.0).any(axis=0)))
    rows = np.ix_(kept, kept)
    a, c = (system.A * x / x[:, None])[rows], (system.C * x / y[:, None])[:, kept]
    noise, covariance = (covariances[k][rows] / outer[rows] for k in (0, 2))
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
    filters, spread = np.zeros((len(gains) + 1, len(x), len(y))), np.zeros_like(outer)
    filters[:, kept], spread[rows] = [*gains, last], error
    innovation = c @ stationary @ c.T + sensors
    return filters * x[:, None] / y, spread * outer, innovation * np.outer(y, y)


def require_detectable(a: Array, c: Array) -> None:
    """Raise `DesignError` if the outputs do not show a mode that does not decay."""
    eigenvalue = hidden_mode(a, c)
    if eigenvalue is not None:
        msg = (
            f"sensors.channels: they do not show the mode {eigenvalue:.6g}, which does not "
            "decay: the state is not detectable; observe another channel"
        )
        raise DesignError(msg)


class LQG(Controller):
    """Feed back the Kalman filter's estimate; reads the observation alone.

    Kwakernaak and Sivan, *Linear Optimal Control Systems* (1972), section 6.5. The filter's gain
    varies at an episode's start, because where an episode begins is known as a range only.
    """

    name = "LQG"

    def __init__(self, scene: Scene, unmodelled: float = UNMODELLED) -> None:
        self.design = design_lqg(scene, unmodelled=unmodelled)
        self.limit = Command(scene, "force").high
        self.frame = Frame(scene, [signal.name for signal in self.design.system.outputs])

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        estimate = np.tile(self.design.start, (env.num_envs, 1))
        return {"step": np.zeros(env.num_envs, np.int64), "estimate": estimate}

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        memory = self.corrected(memory, observation)
        estimate = memory["estimate"]
        force = self.further_force(estimate) - estimate @ self.design.gain
        force = np.clip(force, -self.limit, self.limit)
        return force[:, None] / self.limit, memory

    def corrected(self, memory: Memory, observation: Observation) -> Memory:
        """Return the memory with the estimate corrected by what is observed."""
        step, filters = memory["step"], self.design.filters
        gain = filters[np.minimum(step, len(filters) - 1)]
        change = np.einsum("lnp,lp->ln", gain, self.missed(memory, observation))
        return {**memory, "step": step + 1, "estimate": memory["estimate"] + change}

    def missed(self, memory: Memory, observation: Observation) -> Array:
        """Return what the prediction of the outputs is off by (lanes, p)."""
        return self.frame.values(observation) - memory["estimate"] @ self.design.system.C.T

    def further_force(self, estimate: Array) -> Array | float:
        """Return what is added to the regulator's force [N]."""
        return 0.0

    def note(self, memory: Memory, action: Array) -> Memory:
        system = self.design.system
        estimate = memory["estimate"] @ system.A.T + self.limit * action * system.B[:, 0]
        return {**memory, "estimate": estimate}


class DetunedLQG(LQG):
    """The LQG of other sizes of the force's weight and of what is unmodelled.

    Weights that fit the reward are best only as long as nothing is clipped. A force that changes
    slowly comes late where it is large, and then drives what it should still. Where parameters are
    drawn, a filter that trusts its model is wrong.
    """

    def __init__(self, scene: Scene, factor: float, unmodelled: float = UNMODELLED) -> None:
        weight = factor * scene.objective.effort_weight
        super().__init__(scene.replace(**{"objective.effort_weight": weight}), unmodelled)
        self.name = f"LQG, effort weight times {factor:.2g}, unmodelled {unmodelled:.2g}"


def weighed(scene: Scene) -> Scene:
    """Return the scene with a weight of the force that a regulator can be designed with."""
    stated = Scene.of(scene.model_dump(mode="json"))  # without a reward of one's own
    least = LEAST * validation_cost(stated, uncontrolled(stated)) ** 2
    if scene.objective.effort_weight >= least:
        return scene
    return scene.replace(**{"objective.effort_weight": least})


def without_force(scene: Scene) -> str | None:
    """Return why no force can be regulated whatever it costs, or None."""
    return without_weight(scene.replace(**{"objective.effort_weight": 1.0}))


def best_detuned_lqg(scene: Scene) -> DetunedLQG:
    """Search a factor of the force's weight over five decades, for each size of the unmodelled."""
    own = weighed(scene)

    def best(unmodelled: float) -> DetunedLQG:
        return cheapest(scene, lambda e: DetunedLQG(own, 10.0**e, unmodelled), EFFORTS)

    return min(map(best, DISTURBANCES), key=lambda one: validation_cost(scene, one))


class WeightedLQG(LQG):
    """The LQG of other weights than the reward's, with a spring where the rail ends.

    Weights that fit the reward are best only as long as nothing is clipped and no episode ends.
    Close to the end of a rail a further force pushes the masses together, in proportion to how far
    x2 - x1 will soon be beyond a distance.
    """

    name = "LQG, free weights"

    def __init__(self, scene: Scene, numbers: Mapping[str, float]) -> None:
        objective = {
            f"objective.{name}_weight": numbers[name]
            for name in ("effort", "velocity", "stroke")
            if name in numbers
        }
        super().__init__(scene.replace(**objective), unmodelled=numbers["unmodelled"])
        names = [signal.name for signal in self.design.system.states]
        self.motion = [names.index(name) for name in STATES]
        self.numbers, self.rail = dict(numbers), scene.objective.rail_half_length or np.inf

    def further_force(self, estimate: Array) -> Array:
        """Return the force (lanes,) that keeps off the ends of the rail [N]."""
        x1, x2, v1, v2 = estimate[:, self.motion].T
        soon, numbers = x2 - x1 + self.numbers["ahead"] * (v2 - v1), self.numbers
        free = numbers["free"] * self.rail
        beyond = soon - np.clip(soon, -free, free)
        return numbers["bumper"] * self.limit / self.rail * beyond


def free_numbers(scene: Scene) -> dict[str, Free]:
    """Return the weights of `Objective`, what is unmodelled, and the spring at the rail's ends.

    The spring begins at "free" of the rail, acts on the stroke "ahead" [s] later, and "bumper" is
    its stiffness over the force limit per rail.
    """
    objective, numbers = scene.objective, {"effort": Free(scene.objective.effort_weight, 1.0)}
    numbers["velocity"] = Free(objective.velocity_weight or 0.1, 1.0)
    if scene.springs.kind != "none":
        numbers["stroke"] = Free(objective.stroke_weight or 0.1, 1.0)
    numbers["unmodelled"] = Free(UNMODELLED, 1.5)
    numbers["free"] = Free(0.6, 0.2, ratio=False, low=0.0, high=1.0)
    numbers["ahead"] = Free(2.0 * scene.control.time_step, 0.7)
    numbers["bumper"] = Free(3.0, 1.0)
    return numbers


_without_rail = unless(
    lambda scene: scene.objective.rail_half_length is not None,
    "which keeps off the ends of a rail; objective.rail_half_length: missing",
)

ENTRIES = (
    regulator_entry("lqg", ("force",), LQG, 50, "filter", label=LQG.name),
    Entry("detuned-lqg", ("force",), best_detuned_lqg, 51, "filter", "detuned LQG", without_force),
    Tunable("weighted-lqg", free_numbers, WeightedLQG).entry(
        ("force",),
        53,
        "filter",
        WeightedLQG.name,
        lambda scene: _without_rail(scene) or without_weight(scene),
    ),
)
