"""Plans of whole episodes over many lanes, improved by Gauss-Newton steps on exact Jacobians."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mm_gym import DesignError, Plant, Scene
from mm_gym.arrays import Array
from mm_gym.plant import central_differences, difference_steps
from mm_gym.scene import Objective
from mm_gym.sensitivity import TOLERANCE, Actuator, Sensitivities, expected, sweep

Indices = NDArray[np.intp]

EASIER, HARDER = 1.0 / 3.0, 4.0
"""What the stiffness is multiplied by after a step that is an improvement, and after another."""

GAIN, PATIENCE, AT_ENDS = 1e-9, 4, 8
"""A search ends when in so many steps no lane has gained this part of its cost.

Where episodes can end early there are more: at the edge of a limit's cost, steps have to become
shorter before they are any good."""

LEAST, MOST = 1e-8, 1e8  # bounds of the stiffness
STIFFEST = 1e14  # a stiffness next to which no curvature counts
FIRST, SECOND = 0.9, 0.99  # what Adam keeps of the means of slopes and of squares in a round
LONGEST, LEVEL = 0.05, 1e-3  # first step of a descent [-]; slopes that count as none, over the rms
TINY = 1e-300  # added to what is divided by

MARGIN = 0.02
"""Fraction of a limit that plans keep off it.

What is within the margin costs its square: 1 a step at the limit. So plans that touch the margin go
into it a little. A narrower margin is a steeper cost, in which searches find less."""

ENDED = 1e6  # what a plan that ends its episode early costs on top: more than any that lasts


class Trajectory(NamedTuple):
    """What a plan does in each lane."""

    motion: Array  # (steps, s, s + k, lanes): derivatives of the motion after a step
    # (steps + 1, s + k, lanes): x1, x2 [m], v1, v2 [m/s], z [-] if the interface has a state of its
    # own, and what is applied [N, -].
    states: Array
    # (steps, m, 1 + s + k, lanes): what else is squared after a step, and its derivatives with
    # respect to the state then. It is what the objective weighs of what follows from the motion
    # (`Plant.scored_reactions`), and how far the motion is within the margin of its limits; m is 0
    # where there is neither.
    reactions: Array
    # controls, actions: (steps, k, lanes) [-]: see `Trajectories`; and what the environment is
    # given.
    controls: Array
    actions: Array
    # (5, k, lanes): the least and the most that is applied [N, -], what is kept of it [-], what a
    # control adds [N, -], and the share of the way to its limits that it goes at most [-].
    reach: Array
    cost: Array  # (lanes,) sum of -reward [-], and the cost of what is near or beyond a limit

    def take_better(self, other: "Trajectory") -> NDArray[np.bool_]:
        """Take another's lanes where they cost less; return which (lanes,) did."""
        better = other.cost < self.cost
        for mine, its in zip(self, other, strict=True):
            mine[..., better] = its[..., better]
        return better


class Trajectories:
    """Episodes that have begun, with their disturbance to come.

    A control in [-1, 1] is the action, or, for an actuator that is commanded by value with a rate
    limit, the change of what is applied over the largest change: there most actions ask for more
    than can be reached, and have no derivative. Plans keep `MARGIN` off the limits at which an
    episode ends.

    Parameters
    ----------
    scene, plant
        The scene, and what it compiles to.
    start
        A snapshot of the episodes at their start, from `MovingMassVectorEnv.get_state`.
    ahead
        Steps that are planned; by default an episode's.
    foresees
        Whether noise and random impulses to come are known, or their mean is expected.
    tolerance
        Of motion and derivatives, where an interface is followed by Runge-Kutta steps.

    Attributes
    ----------
    pushes
        (steps, 4, episodes) what is added to x1, x2 [m], v1, v2 [m/s] after each step, or None:
        what a disturbance that the plant does not have would do.
    """

    def __init__(
        self,
        scene: Scene,
        plant: Plant,
        start: Mapping[str, Any],
        ahead: int | None = None,
        *,
        foresees: bool = True,
        tolerance: float = TOLERANCE,
    ) -> None:
        if scene.own_reward is not None:
            msg = (
                f"reward: got {scene.own_reward.name}; allowed for plans by Gauss-Newton: the "
                "scene's objective, a sum of squares"
            )
            raise DesignError(msg)
        objective, self._tolerance = scene.objective, tolerance
        self.ends = ends_of(objective)
        self.start = start["values"], start["streams"]
        self.support, self.constants = plant.support, (plant.model, plant.task)
        self.plant = plant
        if not foresees:
            self.support, model, values = expected(plant.support, plant.model, start["values"])
            self.start, self.constants = (values, start["streams"]), (model, plant.task)
        self.count, self.steps = start["values"].shape[1], ahead or scene.control.steps
        first = self._lanes(np.zeros(1, np.intp))
        self.actuators, self._motion = first.actuators, len(first.state_rows)
        for actuator in self.actuators:
            _require_plannable(actuator, objective.effort_weight)
        low, high, rate, share = np.empty((4, len(self.actuators), self.count))
        for j, a in enumerate(self.actuators):
            low[j], high[j], (rate[j], share[j]) = a.low, a.high, a.reach(start["values"])
        at_once = ~np.isfinite(rate)
        self.middle, self.half = 0.5 * (high + low)[:, :1], 0.5 * (high - low)[:, :1]
        kept, step = np.where(at_once, 1.0 - share, 1.0), np.where(at_once, share * self.half, rate)
        self._by_change = ~at_once & np.array([[not a.is_rate] for a in self.actuators])
        # What follows a value has no bounds but those of its control.
        low, high = np.where(at_once, -np.inf, low), np.where(at_once, np.inf, high)
        self._reach = np.stack([low, high, kept, step, share])
        self._at_rest = np.where(at_once, share * self.middle, 0.0)
        self.weights = np.array(
            [
                objective.displacement_weight / objective.displacement_scale**2,
                objective.velocity_weight / objective.velocity_scale**2,
                objective.stroke_weight / objective.stroke_scale**2,
            ]
        )
        self.effort = objective.effort_weight
        self.pushes: Array | None = None
        self._differences = difference_steps(scene, first)

    def controls_of(self, applied: Array) -> Array:
        """Return the controls (steps, k, episodes) by which (steps, episodes, k) was applied."""
        values = np.moveaxis(applied, 1, 2)
        kept, step = self._reach[2:4]
        first = self._lanes(np.arange(self.count)).state[None, self._motion :]
        before = np.concatenate([first, values[:-1]])
        return np.clip((values - kept * before - self._at_rest) / step, -1.0, 1.0)

    def follow(
        self,
        episodes: Indices,
        controls: Array,
        around: Trajectory | None = None,
        gain: Array | None = None,
    ) -> Trajectory:
        """Return what controls (steps, k, lanes) do, lane by lane in one of the episodes.

        With the trajectory that they were made for, the gains correct them for how far the states
        are from it.
        """
        lanes, count, columns = self._lanes(episodes), len(episodes), len(self.actuators)
        s, n = self._motion, self._motion + columns
        squared = 2 * self.plant.scores_reactions + len(self.ends)
        found = Trajectory(
            np.empty((self.steps, s, n, count)),
            np.empty((self.steps + 1, n, count)),
            np.empty((self.steps, squared, 1 + n, count)),
            np.empty((self.steps, columns, count)),
            np.empty((self.steps, columns, count)),
            self._reach[..., episodes],
            np.zeros(count),
        )
        state = found.states[0] = lanes.state
        for k in range(self.steps):
            u = controls[k]
            if around is not None and gain is not None:
                u = u + np.einsum("kil,il->kl", gain[k], state - around.states[k])
            u = found.controls[k] = _bounded(u, state[s:], found.reach)
            found.actions[k] = self._action(u, state[s:], found.reach)
            found.motion[k] = lanes.step(found.actions[k])[1][:, :n]
            if self.pushes is not None:
                lanes.lanes[:4] += self.pushes[k][:, episodes]
            state = found.states[k + 1] = lanes.state
            if self.plant.scores_reactions:
                found.reactions[k, :2] = self._reactions(lanes.lanes)
        self._near_limits(found)
        found.cost[:] += (found.reactions[:, :, 0] ** 2).sum(axis=(0, 1))
        x1, x2, v1 = np.moveaxis(found.states[1:, :3], 1, 0)
        for weight, value in zip(self.weights, (x1, v1, x2 - x1), strict=True):
            found.cost[:] += weight * (value**2).sum(axis=0)
        found.cost[:] += self.effort * (found.controls**2).sum(axis=(0, 1))
        return found

    def improve(
        self, episodes: Indices, controls: Array, rounds: int, stiffness: float = 1e-2
    ) -> Trajectory:
        """Return locally better plans: Gauss-Newton with Levenberg's stiffness, lane by lane."""
        best = self.follow(episodes, controls)
        extra = np.full(len(episodes), stiffness)
        idle, patience = 0, AT_ENDS if self.ends else PATIENCE
        for _ in range(rounds):
            if idle == patience:
                break
            change, gain = self._step(best, extra)
            trial = self.follow(episodes, best.controls + change, best, gain)
            idle = 0 if (trial.cost < (1.0 - GAIN) * best.cost).any() else idle + 1
            better = best.take_better(trial)
            extra = np.clip(np.where(better, EASIER, HARDER) * extra, LEAST, MOST)
        return best

    def descend(self, episodes: Indices, controls: Array, rounds: int) -> Trajectory:
        """Return better plans by gradient descent with momentum, lane by lane.

        Its first steps are so long that they leave optima in which those of Gauss and Newton end;
        they shrink to nothing in the rounds. Adam, Kingma and Ba, ICLR 2015.
        """
        best = self.follow(episodes, controls)
        mean, square = np.zeros((2, *controls.shape))
        u = controls
        for k in range(rounds):
            best.take_better(trial := self.follow(episodes, u))
            slope = self._slope(trial)
            slope /= np.sqrt((slope**2).mean(axis=(0, 1))) + TINY
            kept, spread = moved_means(slope, mean, square, k + 1)
            size = 0.5 * LONGEST * (1.0 + np.cos(np.pi * k / rounds))
            u = np.clip(trial.controls - size * (mean / kept) / (spread + LEVEL), -1.0, 1.0)
        return best

    def _slope(self, trajectory: Trajectory) -> Array:
        """Return the cost's slope over each control, 0 where a bound keeps it from falling.

        Where the stiffness outweighs all curvature, a step of Gauss and Newton is along it.
        """
        change, _ = self._step(trajectory, np.full(len(trajectory.cost), STIFFEST))
        return -STIFFEST * change

    def _step(self, trajectory: Trajectory, stiffness: Array) -> tuple[Array, Array]:
        """Return a step of Gauss and Newton, its change of the controls and its gains."""
        motion, states, reactions, controls, _, reach, _ = trajectory
        change = np.empty_like(controls)
        gain = np.empty((*controls.shape[:2], *states.shape[1:]))
        parts = motion, states, controls, reactions
        sweep(parts, reach, self.weights, self.effort, stiffness, change, gain)
        return change, gain

    def _reactions(self, lanes: Array) -> Array:
        def squared(lanes: Array) -> Array:
            return self.plant.scored_reactions(lanes, self.constants[0])

        rows = [*self.support.state_rows, *(actuator.row for actuator in self.actuators)]
        slopes = central_differences(squared, lanes, rows, self._differences)
        return np.concatenate([squared(lanes)[:, None], slopes], axis=1)

    def _near_limits(self, found: Trajectory) -> None:
        """Write how far each step's end is within the margin of a limit; add the cost of ends."""
        beyond = np.zeros(len(found.cost), np.bool_)
        rows = found.reactions[:, found.reactions.shape[1] - len(self.ends) :]
        rows[:] = 0.0
        for j, (limit, (by_x1, by_x2)) in enumerate(self.ends):
            x = by_x1 * found.states[1:, 0] + by_x2 * found.states[1:, 1]
            unit = MARGIN * limit
            over = np.maximum(np.abs(x) - (1.0 - MARGIN) * limit, 0.0)
            slope = np.where(over > 0.0, np.sign(x), 0.0) / unit
            rows[:, j, 0], rows[:, j, 1], rows[:, j, 2] = over / unit, by_x1 * slope, by_x2 * slope
            beyond |= (np.abs(x) > limit).any(axis=0)
        found.cost[:] += ENDED * beyond

    def _lanes(self, episodes: Indices) -> Sensitivities:
        values, streams = self.start
        lanes = values[:, episodes], streams[:, episodes]
        return Sensitivities(self.support, self.constants, lanes, tolerance=self._tolerance)

    def _action(self, controls: Array, applied: Array, reach: Array) -> Array:
        if not self._by_change.any():
            return controls
        asked = applied + reach[3] * controls / reach[4]
        asked = np.clip((asked - self.middle) / self.half, -1.0, 1.0)
        return np.where(self._by_change[:, :1], asked, controls)


def _bounded(controls: Array, applied: Array, reach: Array) -> Array:
    """Return the controls (k, lanes) that keep what is applied within its limits."""
    low, high, _, step, share = reach
    least = np.maximum(-1.0, share * (low - applied) / step)
    most = np.minimum(1.0, share * (high - applied) / step)
    return np.minimum(np.maximum(controls, least), most)


def moved_means(slope: Array, mean: Array, square: Array, count: int) -> tuple[float, Array]:
    """Move Adam's means of slopes and of their squares on, in place, in the round of this number.

    Return what the first is to be divided by, and the root of the second: both means begin at 0.
    """
    mean += (1.0 - FIRST) * (slope - mean)
    square += (1.0 - SECOND) * (slope**2 - square)
    return 1.0 - FIRST**count, np.sqrt(square / (1.0 - SECOND**count))


def ends_of(objective: Objective) -> list[tuple[float, tuple[float, float]]]:
    """Return the limits [m] at which episodes end, each with what it limits, in x1 and x2."""
    stated = ((objective.displacement_limit, (1.0, 0.0)), (objective.rail_half_length, (-1.0, 1.0)))
    return [(limit, of) for limit, of in stated if limit is not None]


def _require_plannable(actuator: Actuator, effort: float) -> None:
    """Refuse an actuator whose control is not a smooth function of what it applies."""
    weighed = effort > 0.0 and np.isfinite(actuator.rate) and not actuator.is_rate
    if actuator.has_memory_of_command or weighed:
        msg = (
            f"actuation.{actuator.name}: the planner accepts no lag of an actuator that is "
            "commanded by its rate, and no objective.effort_weight together with a rate limit of "
            "one that is commanded by its value"
        )
        raise DesignError(msg)
