"""The linear-quadratic-Gaussian regulator (LQG): an LQR on a Kalman filter's estimate."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import control
import numpy as np

from agents.control.actuators import Actuators, Command
from agents.control.controller import (
    Acted,
    Controller,
    Info,
    Memory,
    Observation,
    looked_up,
)
from agents.control.kalman_filter import (
    UNMODELLED,
    KalmanFilter,
    design_filter,
    excited_system,
    solvable,
    state_units,
)
from agents.control.observed_actuators import Frame
from agents.control.scene import STATES, drawn_but, force_weight, plant_of, require_number
from agents.controllers.constant import uncontrolled
from agents.controllers.lqr import Quadratic, motion_weight, reaction_weights, require_weight
from agents.controllers.registry import (
    Entry,
    Free,
    Tunable,
    regulator_entry,
    unless,
    without_weight,
)
from agents.controllers.searched import Designed, cheapest, cheapest_of
from agents.scoring import validation_cost
from mm_gym import DesignError, LinearSystem, MovingMassVectorEnv, Plant, Scene
from mm_gym.arrays import Array

ROUND_OFF = 1e-12
"""Of a pole: a mode without decay that the force does not reach has one this near to 1."""

EFFORTS = np.linspace(-1.0, 4.0, 6)  # exponents of what multiplies the weight of the force

LEAST = 1e-3
"""Least weight of the force that these factors are of, over the mean penalty without control: where
a scene states none or hardly any, the force is at its limits throughout, and noise and delay decide
how much of it is best."""

GROWN = 1e4
"""Mean penalty without control, and growth of the motion in an episode, beyond which no weight
follows from that penalty: it is as large as the episode is long."""

DISTURBANCES = UNMODELLED, 1e-2, 0.1, 1.0
"""Sizes of what is unmodelled that are tried: with more the stationary filter is quicker, as an
episode's first steps need it, and shows more noise."""

REACTIONS = ("carriage_acceleration", "sphere_acceleration")  # what `reaction_weights` weighs


class Regulator(NamedTuple):
    """u = held - gain (x - rest) of a system's n states: of the least quadratic cost of k of them.

    Held at `rest`, the force costs least against what pushes all the time, as impulses of one
    direction do on average; both are 0 without.
    """

    states: tuple[int, ...]  # the k that the cost depends on
    cost: Quadratic  # of these at a step's end, and of the force in it
    gain: Array  # (n,) [N per unit]; zero for all other states
    riccati: Array  # (k, k): P, the cost to go
    curvature: float  # of the cost to go over the force [1/N^2]
    rest: Array  # (n,)
    held: float  # [N]
    slope: Array  # (k,): half the slope of the cost to go at x = 0


@dataclass(frozen=True, eq=False)
class LQGDesign(KalmanFilter):
    """A regulator of a filter's estimate."""

    regulator: Regulator
    cost: float  # expected mean of -reward per step [-], in the long run and without limits


def design_lqg(
    scene: Scene, *, at: dict[str, float] | None = None, unmodelled: float = UNMODELLED
) -> LQGDesign:
    """Solve both Riccati equations for a scene's reward, sensors and random excitation.

    The phase of a harmonic wanders: no force stills a harmonic for ever, so neither equation has a
    solution without.

    Raise `DesignError` if there is no force, it is commanded by its rate or costs nothing, the
    sensors do not show a mode that does not decay, or an equation has no stabilising solution.

    Parameters
    ----------
    at
        What the other actuators hold, by the dotted names of `Plant.state_space`.
    unmodelled
        As of `design_filter`.
    """
    force_weight(scene, at or ())
    require_number("unmodelled", unmodelled)
    plant = plant_of(scene)
    system = excited_system(scene, ["force"], at)
    law = regulator(plant, scene, at, system)
    own = design_filter(scene, system, unmodelled, law.gain != 0.0, scene.control.steps)
    rows = np.ix_(law.states, law.states)
    fed_back = law.gain[list(law.states)]
    cost = float(np.sum(law.riccati * system.process_noise[rows]))
    cost += float(law.curvature * fed_back @ own.error[rows] @ fed_back)
    cost += law.cost.at(law.rest[list(law.states)], law.held)
    return LQGDesign(**vars(own), regulator=law, cost=cost)


def regulator(
    plant: Plant, scene: Scene, at: dict[str, float] | None, system: LinearSystem
) -> Regulator:
    """Return what regulates a system."""
    regulated, a, b, own = regulated_part(plant, scene, at, system)
    stage = own.ahead(a, b) if own.cross.any() else own
    x, limit = state_units(scene, plant, system)[list(regulated)], Command(scene, "force").high
    drift = system.drift[list(regulated)]
    scaled = stage.in_units(x, limit)
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
    gain, rest = np.zeros((2, len(system.states)))
    gain[list(regulated)] = np.asarray(found)[0] * limit / x
    at_rest, held, pull = _rest(
        a * x / x[:, None], b * limit / x[:, None], own.in_units(x, limit), drift / x
    )
    rest[list(regulated)] = at_rest * x
    riccati = np.asarray(riccati) / np.outer(x, x)
    curvature = (stage.force + b.T @ riccati @ b).item()
    if stage is not own:
        riccati = riccati + own.state
    slope = pull / x - riccati @ rest[list(regulated)]
    return Regulator(regulated, own, gain, riccati, curvature, rest, held * limit, slope)


def _rest(a: Array, b: Array, cost: Quadratic, drift: Array) -> tuple[Array, float, Array]:
    """Return the x and u of least cost with x = A x + B u + drift.

    Also half the slope of the cost to go there: from another x, the cost of all steps differs by
    that of the way to the x of least cost.
    """
    count = len(a)
    if not drift.any():
        return np.zeros(count), 0.0, np.zeros(count)
    moved = np.hstack([a - np.eye(count), b])
    weight = np.block([[cost.state, cost.cross], [cost.cross.T, cost.force]])
    # Lagrange's conditions; A - 1 and B have full rank where B reaches what does not decay.
    conditions = np.block([[weight, moved.T], [moved, np.zeros((count, count))]])
    with solvable("the equation of the force that is held"):
        found = np.linalg.solve(conditions, np.concatenate([np.zeros(count + 1), -drift]))
    rest, held, pull = np.split(found, [count, count + 1])
    return rest, held.item(), pull - cost.cross[:, 0] * held


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
    weight[-1, -1] = force_weight(scene, at or ())
    reactions = zip(REACTIONS, reaction_weights(scene), strict=True)
    squares = {name: squared for name, squared in reactions if squared > 0.0}
    if squares:
        # Of sensors without delay.
        prompt = scene.replace(sensors={}, randomization=drawn_but(scene, "sensors."))
        shown = plant_of(prompt).state_space(["force"], list(squares), sampled=True, at=at)
        rows = np.zeros((len(squares), len(every) + 1))
        for k, signal in enumerate(shown.states):
            rows[:, every.index(signal.name) if signal.name in every else -1] += shown.C[:, k]
        for row, squared in zip(rows, squares.values(), strict=True):
            weight += squared * np.outer(row, row)
    require_weight(weight[:-1, :-1])
    return weight


class LQG(Controller):
    """Feed back the Kalman filter's estimate; reads the observation alone.

    Kwakernaak and Sivan, *Linear Optimal Control Systems* (1972), section 6.5. The filter's gain
    varies at an episode's start, because where an episode begins is known as a range only.

    Weights that fit the reward are best only as long as nothing is clipped. A force that changes
    slowly comes late where it is large, and then drives what it should still. Where parameters are
    drawn, a filter that trusts its model is wrong.

    Parameters
    ----------
    effort
        Factor of the force's weight in the reward.
    unmodelled
        As of `kalman_filter.design_filter`.
    """

    name = "LQG"

    def __init__(self, scene: Scene, effort: float = 1.0, unmodelled: float = UNMODELLED) -> None:
        self.effort, self.unmodelled = effort, unmodelled
        self.designed = with_effort(scene, effort)
        self.design = design_lqg(self.designed, unmodelled=unmodelled)
        self.limit = Command(scene, "force").high
        self.frame = Frame(scene, [signal.name for signal in self.design.system.outputs])

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        estimate = np.tile(self.design.start, (env.num_envs, 1))
        return {"step": np.zeros(env.num_envs, np.int64), "estimate": estimate}

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        memory = self.corrected(memory, observation)
        estimate, law = memory["estimate"], self.design.regulator
        force = law.held + self.further_force(estimate) - (estimate - law.rest) @ law.gain
        force = np.clip(force, -self.limit, self.limit)
        return force[:, None] / self.limit, memory

    def corrected(self, memory: Memory, observation: Observation) -> Memory:
        """Return the memory with the estimate corrected by what is observed."""
        step, filters = memory["step"], self.design.filters
        gain = looked_up(filters[None], np.minimum(step, len(filters) - 1))
        change = np.einsum("lnp,lp->ln", gain, self.missed(memory, observation))
        return {**memory, "step": step + 1, "estimate": memory["estimate"] + change}

    def missed(self, memory: Memory, observation: Observation) -> Array:
        """Return what the prediction of the outputs is off by (lanes, p)."""
        return self.frame.values(observation) - memory["estimate"] @ self.design.system.C.T

    def further_force(self, estimate: Array) -> Array | float:
        """Return what is added to the regulator's force [N]."""
        return 0.0

    def note(self, memory: Memory, action: Array) -> Memory:
        return {**memory, "estimate": self.predicted(memory, self.limit * action)}

    def predicted(self, memory: Memory, force: Array) -> Array:
        """Return the estimate a control step later, of forces (lanes, 1) [N]."""
        system = self.design.system
        return memory["estimate"] @ system.A.T + force * system.B[:, 0] + system.drift


class ReachedLQG(LQG):
    """The LQG whose filter predicts with the force that its limits let the actuator reach."""

    def __init__(self, scene: Scene, effort: float, unmodelled: float) -> None:
        super().__init__(
            scene.replace(**{"actuation.force.command": "position"}), effort, unmodelled
        )
        self.actuators, self.command = Actuators(scene), Command(scene, "force")
        self.share = float(self.actuators.lag_factor[0])

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        still = np.zeros((env.num_envs, 1))
        return {**super().begin(env), "applied": still, "asked": still}

    def note(self, memory: Memory, action: Array) -> Memory:
        before = memory["applied"]
        applied, asked = self.actuators.reached(action, before, memory["asked"])
        # The command that a force without rate limit would follow to the same value.
        force = before + (applied - before) / self.share
        estimate = self.predicted(memory, force)
        return {**memory, "estimate": estimate, "applied": applied, "asked": asked}


def with_effort(scene: Scene, factor: float) -> Scene:
    """Return the scene with the force's weight in the reward times a factor."""
    if factor == 1.0:
        return scene
    return scene.replace(**{"objective.effort_weight": factor * scene.objective.effort_weight})


def weighed(scene: Scene) -> Scene:
    """Return the scene with a weight of the force that a regulator can be designed with."""
    stated = Scene.of(scene.model_dump(mode="json"))  # without a reward of one's own
    penalty = validation_cost(stated, uncontrolled(stated)) ** 2
    fastest = np.abs(np.linalg.eigvals(plant_of(stated).discrete()[0])).max()
    grows = penalty > GROWN and stated.control.steps * np.log(fastest) > np.log(GROWN)
    least = LEAST * (1.0 if grows else penalty)
    if scene.objective.effort_weight >= least:
        return scene
    return scene.replace(**{"objective.effort_weight": least})


def without_force(scene: Scene) -> str | None:
    """Return why no force can be regulated whatever it costs, or None."""
    return without_weight(scene.replace(**{"objective.effort_weight": 1.0}))


def best_detuned(
    scene: Scene, make: Callable[[Scene, float, float], Designed], sizes: Iterable[float]
) -> Designed:
    """Search the controller of a scene, a factor of the force's weight and the best of sizes."""
    own = weighed(scene)

    def best(size: float) -> Designed:
        return cheapest(scene, lambda e: make(own, 10.0**e, size), EFFORTS)

    return cheapest_of(scene, map(best, sizes))


def best_detuned_lqg(scene: Scene) -> LQG:
    """Search a factor of the force's weight over five decades, for each size of the unmodelled."""
    found = best_detuned(scene, LQG, DISTURBANCES)
    effort, unmodelled = found.effort, found.unmodelled
    found.name = f"LQG, effort weight times {effort:.2g}, unmodelled {unmodelled:.2g}"
    return found


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
