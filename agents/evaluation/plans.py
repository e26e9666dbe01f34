"""Plans: the best found of each episode, knowing what is to come, and those made in every step."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.control.controller import Acted, Controller, Info, Memory, Observation, Reads
from agents.control.scene import ENDLESS
from agents.control.trajectories import Indices, Trajectories, Trajectory
from agents.controllers.noise import correlated
from mm_gym import MovingMassVectorEnv, Scene
from mm_gym.arrays import Array

CHILDREN = 48
"""Changed plans of each episode in a generation, of which the best is kept if it costs less."""

LEAST, MOST = 10.0**-2.5, 2.0  # sizes of changes [-]; their logarithms are equally probable

LONGEST = 0.25
"""Longest part of an episode that is changed; the logarithms of lengths are equally probable."""

FURTHEST = 3  # control steps by which a part is moved at most


class Part(NamedTuple):
    """Some steps in a row of one actuator's plan, in each lane."""

    inside: NDArray[np.bool_]  # (steps, k, lanes): which actions are of it
    # elapsed, length: (steps, 1, lanes), (lanes,): steps since it began, and how many it has.
    elapsed: NDArray[np.int64]
    length: NDArray[np.int64]


class LocalSearch:
    """Change parts of plans at random, and keep what costs less.

    An evolution strategy of one parent in each episode (Rechenberg 1973), whose mutations keep to a
    random part of one actuator's plan.

    Parameters
    ----------
    scene, start
        The scene, and a snapshot of its episodes at their start, from
        `MovingMassVectorEnv.get_state`.
    generator
        Of the changes.
    """

    def __init__(
        self, scene: Scene, start: Mapping[str, Any], generator: np.random.Generator
    ) -> None:
        self.count, self.noise = start["values"].shape[1], generator
        self.env = MovingMassVectorEnv(
            scene, CHILDREN * self.count, autoreset_mode="Disabled", copy=False
        )
        self.env.reset(seed=0)
        self.start = {
            name: np.tile(value, CHILDREN) if isinstance(value, np.ndarray) else value
            for name, value in start.items()
        }

    def improve(self, plans: Array, generations: int) -> Array:
        """Return what better plans apply (steps, episodes, k), given actions (steps, k, episodes).

        Plans that end their episode early cost more than any that lasts.
        """
        changes = self._bumped, self._scattered, self._held, self._moved, self._of_another
        best, rows = plans, np.arange(self.count)
        costs = np.full(self.count, np.inf)
        for _ in range(generations):
            parents = np.tile(best, CHILDREN)
            change, part = changes[self.noise.integers(len(changes))], self._part(parents)
            changed = np.clip(change(parents, part), -1.0, 1.0)
            children = np.where(part.inside, changed, parents)
            children[..., : self.count] = best
            found = self._costs(children).reshape(CHILDREN, -1)
            least = found.argmin(axis=0)
            better = found[least, rows] < costs
            costs = np.where(better, found[least, rows], costs)
            best = np.where(better, children[..., least * self.count + rows], best)
        steps = self._steps(np.tile(best, CHILDREN))
        return np.array([info["applied"][: self.count].copy() for _, _, info in steps])

    def _costs(self, plans: Array) -> Array:
        """Return the sum of -reward of each plan, infinite where the episode ends early."""
        costs = np.zeros(plans.shape[2])
        for reward, terminated, _ in self._steps(plans):
            costs -= reward
            costs[terminated] = np.inf
        return costs

    def _steps(self, plans: Array) -> Iterator[tuple[Array, NDArray[np.bool_], dict[str, Any]]]:
        """Yield reward, ends and info of each step; lanes that end are begun again."""
        self.env.set_state(self.start)
        for action in plans:
            _, reward, terminated, _, info = self.env.step(action.T)
            yield reward, terminated, info
            if terminated.any():
                self.env.reset(options={"reset_mask": terminated})

    def _part(self, plans: Array) -> Part:
        steps, columns, lanes = plans.shape
        longest = np.log(max(2.0, LONGEST * steps))
        length = np.exp(self.noise.uniform(0.0, longest, lanes)).astype(np.int64)
        first = (self.noise.random(lanes) * (steps - length + 1)).astype(np.int64)
        elapsed = np.arange(steps)[:, None, None] - first
        column = np.arange(columns)[:, None] == self.noise.integers(columns, size=lanes)
        return Part((elapsed >= 0) & (elapsed < length) & column, elapsed, length)

    def _sizes(self, lanes: int) -> Array:
        return np.exp(self.noise.uniform(np.log(LEAST), np.log(MOST), lanes))

    def _bumped(self, plans: Array, part: Part) -> Array:
        """Return plans with half a wave of the part's length added."""
        lanes = plans.shape[2]
        size = self._sizes(lanes) * self.noise.choice((-1.0, 1.0), lanes)
        return plans + size * np.sin(np.pi * (part.elapsed + 0.5) / part.length)

    def _scattered(self, plans: Array, part: Part) -> Array:
        return plans + self._sizes(plans.shape[2]) * self.noise.standard_normal(plans.shape)

    def _held(self, plans: Array, part: Part) -> Array:
        """Return plans that hold one value, in half of the cases that of a limit."""
        lanes = plans.shape[2]
        value = self.noise.uniform(-1.0, 1.0, lanes)
        at_limit = self.noise.random(lanes) < 0.5  # noqa: PLR2004 - a half
        return np.broadcast_to(np.where(at_limit, np.sign(value), value), plans.shape)

    def _moved(self, plans: Array, part: Part) -> Array:
        steps, _, lanes = plans.shape
        by = self.noise.integers(1, FURTHEST + 1, lanes) * self.noise.choice((-1, 1), lanes)
        return np.take_along_axis(plans, (np.arange(steps)[:, None, None] - by) % steps, axis=0)

    def _of_another(self, plans: Array, part: Part) -> Array:
        """Return plans between their own and that of another episode."""
        lanes = plans.shape[2]
        others = np.roll(plans, self.noise.integers(lanes), axis=2)
        return plans + self.noise.random(lanes) * (others - plans)


CORRELATIONS = (0.0, 0.6, 0.9)
"""Correlation of successive controls' noise: white noise hardly moves the carriage."""

SPREADS = (0.3, 1.0, 2.0)
"""Standard deviations of random plans [-]; those above 1 are mostly at the limits."""

LITTLE, MORE = 0.1, 0.3  # standard deviations of the noise that is added to the best plans
CHANGES = (0.0, 0.0), (0.02, 0.0), (0.1, 0.8), (0.1, 0.95), (0.3, 0.9)
"""Of the plans that descend: standard deviation of the noise that is added, and its correlation."""

AT_LIMIT = 10.0  # what a step at a limit costs in the search of a start that keeps off it

AHEAD, FIRST, ROUNDS = 40, 30, 3
"""Steps that are planned, and steps of Gauss and Newton at an episode's start and in each step."""


@dataclass(frozen=True)
class Effort:
    """How long plans are searched."""

    # Random plans to start from, in addition to the given ones and no control at all.
    random: int = 9
    # kept, first, second: the starts of which each episode keeps the best so many, after a first
    # number of steps of Gauss and Newton; they go on for a second number
    kept: int = 3
    first: int = 12
    second: int = 40
    # rounds, steps: rounds in which the best plans are changed at random, or taken from the next
    # episode, and the steps that each such plan has
    rounds: int = 6
    steps: int = 20
    # searches, generations, descent: searches that go on from the best plans: each of so many
    # generations without derivatives, then of so many rounds of descent; Gauss-Newton steps follow
    searches: int = 3
    generations: int = 500
    descent: int = 200
    last: int = 60  # steps of the best plan at the end
    seed: int = 0  # of the random numbers


class Planner(Controller):
    """Search the best plan of each episode by itself, and carry it out.

    It knows the disturbance to come, which no agent can. Plans are improved by Gauss-Newton steps
    on the exact Jacobians, within the actuators' limits; Li and Todorov, *Iterative linear
    quadratic regulator design*, ICINCO 2004. They are local optima, and the best is the best known:
    better may exist.

    Parameters
    ----------
    starts
        Name -> what was applied (steps, lanes, k) in these very episodes, such as
        `Evaluation.applied`. No plan is worse than them.

    Attributes
    ----------
    origins
        Of each lane, the start of its best plan.
    """

    name = "clairvoyant optimum (best found)"
    reads: Reads = "episode"

    def __init__(
        self, scene: Scene, starts: Mapping[str, Array], effort: Effort | None = None
    ) -> None:
        self.scene, self.starts, self.effort = scene, starts, effort or Effort()
        self.origins: list[str] = []

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        self.noise = np.random.default_rng(self.effort.seed)
        start = env.get_state()
        self.problem = Trajectories(self.scene, env.plant, start)
        self.careful = Trajectories(_careful(self.scene), env.plant, start)
        self.cost = np.full(env.num_envs, np.inf)
        self.origins = [""] * env.num_envs
        columns = env.single_action_space.shape[0]
        self.controls = self.actions = np.zeros((self.problem.steps, columns, env.num_envs))
        self._begin()
        for k in range(self.effort.rounds):
            self._vary(k)
        search = LocalSearch(self.scene, start, self.noise)
        for _ in range(self.effort.searches):
            applied = search.improve(self.actions, self.effort.generations)
            plans = {"changed without derivatives": self.problem.controls_of(applied)}
            self._go_on(plans, self.effort.steps)
            if self.effort.descent:
                self._descend()
        self._go_on({"": self.controls}, self.effort.last)
        plan = np.moveaxis(self.actions, 2, 0)
        return {"step": np.zeros(env.num_envs, np.int64), "plan": plan}

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        step, plan = memory["step"], memory["plan"]
        return plan[np.arange(len(plan)), step], {"step": step + 1, "plan": plan}

    def _begin(self) -> None:
        """Improve all starts for a while, then the best of each episode."""
        starts = dict(self._starts())
        found = self._improved(starts.values(), self.effort.first)
        costs = found.cost.reshape(len(starts), -1)
        order = np.argsort(costs, axis=0)[: self.effort.kept]
        names, rows = list(starts), np.arange(costs.shape[1])
        shape = (*found.controls.shape[:2], *costs.shape)
        controls = found.controls.reshape(shape)
        for place in order:
            best = self._improved([controls[:, :, place, rows]], self.effort.second)
            self._take(best, slice(None), [names[k] for k in place])

    def _starts(self) -> Iterator[tuple[str, Array]]:
        for name, applied in self.starts.items():
            yield name, self.problem.controls_of(applied)
        still = np.zeros(self.controls.shape)
        yield "no control", still
        if self.problem.ends:
            lanes = np.arange(self.controls.shape[2])
            found = self.careful.improve(lanes, still, self.effort.first)
            yield "far from the limits", found.controls
        for k in range(self.effort.random):
            correlation = CORRELATIONS[k % len(CORRELATIONS)]
            spread = SPREADS[k // len(CORRELATIONS) % len(SPREADS)]
            yield f"random plan {k + 1}", np.clip(spread * self._drawn(correlation), -1.0, 1.0)

    def _vary(self, k: int) -> None:
        """Try changes of the best plans: everywhere, in a part of the episode, of the next lane."""
        correlation = CORRELATIONS[k % len(CORRELATIONS)]
        everywhere = self.controls + LITTLE * self._drawn(0.0)
        part = self.controls + self._window()[:, None] * self._drawn(correlation)
        other = np.roll(self.controls, k // 2 + 1, axis=2)
        mixed = other if k % 2 else self.controls + MORE * self._drawn(correlation)
        plans = {
            f"changed a little in round {k + 1}": everywhere,
            f"changed for a while in round {k + 1}": part,
            f"{'of another episode' if k % 2 else 'changed'} in round {k + 1}": mixed,
        }
        self._go_on({n: np.clip(plan, -1.0, 1.0) for n, plan in plans.items()}, self.effort.steps)

    def _descend(self) -> None:
        """Let changed plans descend, then improve them."""
        changed = [
            np.clip(self.controls + size * self._drawn(correlation), -1.0, 1.0)
            for size, correlation in CHANGES
        ]
        found = self.problem.descend(*self._together(changed), self.effort.descent).controls
        names = [f"changed by {size:g}, and by gradients" for size, _ in CHANGES]
        plans = np.split(found, len(CHANGES), axis=2)
        self._go_on(dict(zip(names, plans, strict=True)), self.effort.steps)

    def _go_on(self, plans: Mapping[str, Array], steps: int) -> None:
        found, count = self._improved(plans.values(), steps), len(self.cost)
        for k, name in enumerate(plans):
            origins = [f"{origin}, {name}" if name else origin for origin in self.origins]
            self._take(found, slice(k * count, (k + 1) * count), origins)

    def _take(self, found: Trajectory, lanes: slice, origins: list[str]) -> None:
        """Keep plans, one for each episode, where they are better than the best."""
        better = found.cost[lanes] < self.cost
        self.controls = np.where(better, found.controls[..., lanes], self.controls)
        self.actions = np.where(better, found.actions[..., lanes], self.actions)
        self.cost = np.where(better, found.cost[lanes], self.cost)
        pairs = zip(better, origins, self.origins, strict=True)
        self.origins = [new if is_better else old for is_better, new, old in pairs]

    def _improved(self, plans: Iterable[Array], steps: int) -> Trajectory:
        return self.problem.improve(*self._together(plans), steps)

    def _together(self, plans: Iterable[Array]) -> tuple[Indices, Array]:
        """Return the episodes of plans side by side, and the plans."""
        side_by_side = np.concatenate(list(plans), axis=2)
        count = len(self.cost)
        return np.tile(np.arange(count), side_by_side.shape[2] // count), side_by_side

    def _drawn(self, correlation: float) -> Array:
        return correlated(self.noise, self.controls.shape, correlation)

    def _window(self) -> Array:
        """Return 1 in a random part of each episode, from a twentieth to a third of it, else 0."""
        steps, lanes = self.controls.shape[0], self.controls.shape[2]
        length = self.noise.integers(max(1, steps // 20), max(2, steps // 3), lanes)
        first = (self.noise.random(lanes) * (steps - length)).astype(np.int64)
        k = np.arange(steps)[:, None]
        return ((first <= k) & (k < first + length)).astype(np.float64)


class Replanner(Controller):
    """In every step take the first action of the best plan found for the steps to come.

    It knows the true state, and those of the filters that shape the noise. One that does not
    foresee plans for the mean of what is to come: no random impulse, and noise that dies out as its
    filters do. Both are alike in all else, so that the difference of their costs is what preview
    is worth to this controller. Neither is a bound: plans are local optima, and where the problem
    is not linear and quadratic the best plan for the mean is not the best on average.
    """

    def __init__(self, scene: Scene, *, foresees: bool) -> None:
        self.scene, self.foresees = scene, foresees
        self.name = f"replanning, {AHEAD} steps ahead" + (", foresees them" if foresees else "")
        self.reads = "episode" if foresees else "full state"

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        self.env = env
        lanes, columns = env.num_envs, env.single_action_space.shape[0]
        return {"begun": np.zeros(lanes, np.bool_), "plan": np.zeros((lanes, AHEAD, columns))}

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        start, lanes = self.env.get_state(), np.arange(self.env.num_envs)
        problem = Trajectories(self.scene, self.env.plant, start, AHEAD, foresees=self.foresees)
        rounds = ROUNDS if memory["begun"].all() else FIRST
        found = problem.improve(lanes, np.moveaxis(memory["plan"], 0, 2), rounds)
        plan = np.concatenate([found.controls[1:], np.zeros_like(found.controls[:1])])
        begun = np.ones_like(memory["begun"])
        return found.actions[0].T, {"begun": begun, "plan": np.moveaxis(plan, 2, 0)}


def _careful(scene: Scene) -> Scene:
    """Return a scene without limits, in which the cost of being near them is high."""
    o, weights = scene.objective, {}
    if o.displacement_limit is not None:
        near = (o.displacement_scale / o.displacement_limit) ** 2
        weights["objective.displacement_weight"] = o.displacement_weight + AT_LIMIT * near
    if o.rail_half_length is not None:
        near = (o.stroke_scale / o.rail_half_length) ** 2
        weights["objective.stroke_weight"] = o.stroke_weight + AT_LIMIT * near
    return scene.replace(**weights, **ENDLESS)
