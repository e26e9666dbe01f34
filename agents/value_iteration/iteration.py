"""The iteration: sweeps over the grid, with the impulses to come in expectation.

The law is the best for an endless episode: values are those of the mean cost a step, relative to
that of rest, so there is no discount. White, *Dynamic programming, Markov chains, and the method of
successive approximations*, J. Math. Anal. Appl. 6 (1963); on a grid with interpolation: Falcone and
Ferretti, *Semi-Lagrangian approximation schemes for linear and Hamilton-Jacobi equations* (2013).
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Annotated, Any, ClassVar, NamedTuple, Self

import numpy as np
import tyro
from pydantic import Field, model_validator

from agents.control.actuators import Actuators, require_stable_rest
from agents.control.scene import require_actuator
from agents.controllers.lqr import state_weight
from agents.network.files import LARGEST, Arrays
from agents.training.config import SEED_BITS, Count, TimedSettings
from agents.training.runs import Run
from agents.training.search import Search
from agents.training.shown import Shown
from agents.value_table.kernel import NODES, expect, sweep
from agents.value_table.policy import ARRAYS, NUMBERS, TablePolicy
from mm_gym import DesignError, Scene, compile_scene
from mm_gym.analysis import spring_stiffness
from mm_gym.arrays import Array, Single
from mm_gym.errors import refuse
from mm_gym.scene import Part

Table = Single


class IterateSettings(TimedSettings):
    """The grid, and how long its values are iterated."""

    task: str = "mm_gym/PreStretchShock-v0"
    """a registered id"""
    seed: Annotated[int, Field(ge=0, lt=1 << SEED_BITS)] = 0
    """has no effect, because nothing is drawn; it exists for sweeps over seeds"""
    reward: Annotated[str | None, tyro.conf.Suppress] = None
    """no cost of one's own grows with the square of the motion for certain, as the grid needs"""
    evaluations: Count = 5
    """validations during the run; the best policy is kept"""
    points: Annotated[int, Field(ge=NODES, le=101)] = 25
    """grid points along each of the three directions of a motion"""
    stretches: Annotated[int, Field(ge=2, le=1001)] = 33
    """grid points over the range of the stretch"""
    sizes: Annotated[int, Field(ge=2, le=101)] = 7
    """grid points over the size of a motion; unused without random impulses"""
    sweeps: Count = 160
    """sweeps of the whole run"""
    threads: Count = 2
    """threads that share a sweep; results do not depend on it"""

    growing: ClassVar[tuple[str, ...]] = ("sweeps", "time_budget")
    suffix: ClassVar[str] = "-values"

    @model_validator(mode="after")
    def _fits_a_file(self) -> Self:
        size = 16 * self.stretches * self.points**3 * self.sizes  # four faces of four bytes
        if size > 0.99 * LARGEST:
            got, allowed = f"a table of {size / 2**20:.0f} MiB", f"{LARGEST / 2**20:.0f} MiB"
            refuse("points, stretches, sizes", got, f"less than {allowed}", ValueError)
        return self


RELATIVE = np.array([[1.0, 0, 0, 0], [-1, 1, 0, 0], [0, 0, 1, 0], [0, 0, -1, 1]])
"""From x1, x2, v1, v2 to x1, x2 - x1, v1, v2 - v1."""

WIDEST = 2.2  # largest size of the grid, over that of the largest impulse
RARE = 0.1  # most impulses in a control step, on average: that there are two of them is left out
SIZES_DRAWN = 4  # nodes of Gauss and Legendre over the range of an impulse's sizes


class Problem(NamedTuple):
    """What value iteration takes from a scene.

    A motion y (4,) is x1, x2 - x1, v1 and v2 - v1, each times the root of the stiffness or mass
    that goes with it, so that squares are energies [2 J] and like in size. The offset's stiffness
    k2 is the geometric mean of its ends, the carriage's at least that.
    """

    stretches: Array  # (m,) of the grid [-]
    squares: Array  # (sizes,) s^2 of the grid [J]; without random impulses 0 and 1, which is exact
    moves: Array  # (m, 4, 4) transition of the motion in a control step with each stretch
    cost: Array  # (4,) weights of the squares at a step's end: -reward
    # jumps, chances: (m, impulses, 4), (impulses,): what an impulse in the middle of a step adds at
    # its end, and how probable it is.
    jumps: Array
    chances: Array
    travel: float  # most that the stretch moves in a control step, in distances between stretches
    reads: Array  # (5, 1 + n) constants and weights of an observation: motion and stretch [-]
    is_rate: bool  # whether an action commands a rate


def problem_of(scene: Scene, stretches: int, sizes: int) -> Problem:
    """Return the problem of a scene on a grid of so many stretches and sizes.

    Raise `DesignError` with all that value iteration cannot solve in the scene.
    """
    require_actuator(scene, "stretch")
    require_stable_rest(scene, "value iteration")
    shown = Shown(scene)
    obstacles = [*_obstacles(scene, shown), *_obstacles_of_excitation(scene)]
    if obstacles:
        lines = (f"{got} allowed for value iteration: {allowed}" for got, allowed in obstacles)
        raise DesignError("\n".join(lines))
    actuators = Actuators(scene)
    low, high = actuators.low[-1], actuators.high[-1]
    grid = np.linspace(low, high, stretches)
    ends = spring_stiffness([low, high], scene.springs.stiffness)
    carriage, k2 = scene.carriage, np.sqrt(ends.prod())
    k1 = max(carriage.stiffness * carriage.linear_coefficient, k2)
    scales = np.sqrt([k1, k2, carriage.mass, scene.sphere.mass])
    into = scales[:, None] * RELATIVE
    impulses, chances = _impulses(scene)
    impulses = impulses @ into.T
    jumps = np.einsum("mij,aj->mai", _moves(scene, grid, 0.5, into), impulses)
    largest = WIDEST * np.abs(impulses).max(initial=0.0)
    stretch = shown.stretch()
    assert stretch is not None  # noqa: S101 - else there is an obstacle
    back = np.linalg.inv(into)
    return Problem(
        stretches=grid,
        squares=(largest * np.linspace(0.0, 1.0, sizes) ** 2) ** 2
        if largest > 0.0
        else np.array([0.0, 1.0]),
        moves=_moves(scene, grid, 1.0, into),
        cost=np.diagonal(back.T @ state_weight(scene) @ back),
        jumps=jumps,
        chances=chances if largest > 0.0 else chances[:0],
        travel=float(min(actuators.travel[-1], high - low) / (grid[1] - grid[0])),
        reads=np.vstack([np.pad(into @ shown.state, ((0, 0), (1, 0))), stretch]),
        is_rate=bool(actuators.is_rate[-1]),
    )


def _moves(scene: Scene, grid: Array, part: float, into: Array) -> Array:
    """Return the exact transitions (m, 4, 4) over a part of a control step."""
    plant = compile_scene(
        scene.replace(**{"control.time_step": part * scene.control.time_step, "excitation": []})
    )
    back = np.linalg.inv(into)
    return np.stack([into @ plant.discrete(stretch)[0] @ back for stretch in grid])


def _impulses(scene: Scene) -> tuple[Array, Array]:
    """Return the jumps (impulses, 4) of the state, and their chances in a control step."""
    nodes, weights = np.polynomial.legendre.leggauss(SIZES_DRAWN)
    jumps, chances = [np.empty((0, 4))], [np.empty(0)]
    for part in _random_impulses(scene):
        push = [0.0, 0.0, 1.0 / scene.carriage.mass, 0.0]
        unit = push if part.target == "force" else [0.0, 0.0, -1.0, -1.0]
        chance = -np.expm1(-part.rate * scene.control.time_step)
        jumps.append(np.outer(part.size[1] * nodes, unit))
        chances.append(0.5 * chance * weights)
    return np.concatenate(jumps), np.concatenate(chances)


def _random_impulses(scene: Scene) -> list[Part]:
    return [part for part in scene.excitation if part.kind == "impulse" and part.rate > 0.0]


def _obstacles(scene: Scene, shown: Shown) -> Iterator[tuple[str, str]]:
    """Yield what keeps value iteration from solving a scene, with what is allowed there."""
    plant, objective, actuator = compile_scene(scene), scene.objective, scene.actuation.stretch
    if scene.actuation.force is not None:
        yield "actuation.force:", "none; it tunes the stretch alone"
    if scene.randomization:
        yield f"randomization: got {', '.join(scene.randomization)};", "none"
    elif plant.kind != "parametric linear":
        yield f"scene: got a {plant.kind} plant;", "linear at every stretch"
    if scene.own_reward is not None:
        quadratic = "its grid needs a cost that grows with the square of the motion"
        yield f"reward: got {scene.own_reward.name};", f"the scene's objective; {quadratic}"
    limits = objective.displacement_limit, objective.rail_half_length
    if objective.effort_weight > 0.0 or any(limits):
        none = "no effort_weight, displacement_limit and rail_half_length"
        yield "objective:", f"{none}; the cost is a quadratic form of the state"
    if actuator.lag > 0.0:
        yield f"actuation.stretch.lag: got {actuator.lag:g} s;", "0"
    exact = shown.stretch() is not None and np.linalg.matrix_rank(shown.state) == len(RELATIVE)
    wrong = any(channel.noise for channel in plant.observed) or any(scene.sensors.bias.values())
    if not exact or wrong or plant.delay or scene.sensors.dropout:
        shows = "channels that show the whole state and the stretch"
        yield "sensors:", f"{shows}, without noise, bias, delay and dropout"


def _obstacles_of_excitation(scene: Scene) -> Iterator[tuple[str, str]]:
    others = sorted({part.kind for part in scene.excitation} - {"impulse"})
    if others:
        yield f"excitation: got {', '.join(others)};", "impulse, or none"
    times = [part.time for part in scene.excitation if part.kind == "impulse" and part.time]
    if times:
        allowed = "at random times or at 0; its law does not know the time"
        yield f"excitation: got an impulse at {times[0]:g} s;", allowed
    often = sum(part.rate for part in _random_impulses(scene)) * scene.control.time_step
    if often > RARE:
        got = f"excitation: got {often:.3g} impulses in a control step on average;"
        yield got, f"at most {RARE:g}"
    sizes = [part.size for part in _random_impulses(scene)]
    lopsided = [size for size in sizes if np.sum(size) != 0.0]
    if lopsided:
        got = f"excitation: got random impulses of size {lopsided[0]};"
        yield got, "[-x, x], so that the mirrored motion costs the same"


BETWEEN = 20
"""Sweeps from one expectation to the next; an impulse is rare, and what it adds changes slowly."""


def iterate(settings: IterateSettings, run: Run, *, bar: bool = True) -> None:
    """Iterate until sweeps or time are used up, and write the best policy to the run's folder.

    Raise as `Search.finish` does, and, before a folder is made, `SceneError`, `CompileError` or
    `DesignError` if the scene is not one that it solves.
    """
    ValueIteration(settings, settings.rewarded_scene()).finish(run, bar=bar)


class ValueIteration(Search):
    """Values on a grid, swept from the end of a control step to its start.

    Attributes
    ----------
    problem
        What is solved.
    values, expected
        Tables of the cost to come before a step, relative to rest, and of what impulses add.
    mean
        Cost of a step on average, as of the last sweep that followed an expectation [-].
    residual
        By how much that sweep raised some values more than others, over the largest value [-].
    """

    unit = "sweep"
    began_as = "the best action for the present step"

    def __init__(self, settings: IterateSettings, scene: Scene) -> None:
        super().__init__(settings, scene)
        self.settings: IterateSettings = settings
        self.total = settings.sweeps  # it converges, however much time there is
        self.problem = problem_of(scene, settings.stretches, settings.sizes)
        n = settings.points
        shape = (settings.stretches, 4, n, n, n, len(self.problem.squares))
        self.values, self.expected = np.zeros((2, *shape), np.float32)
        self.mean, self.residual = 0.0, np.inf
        self.frames = self.values.size

    def _advance(self) -> None:
        fresh = self.rounds % BETWEEN == BETWEEN - 1
        problem, rules = self.problem, (self.problem.cost, self.problem.squares)
        if fresh and problem.chances.size:
            self.expected = np.empty_like(self.expected)
            self._share(expect, self.values, self.expected, problem.jumps, problem.chances, *rules)
        swept = np.empty_like(self.values)
        self._share(sweep, self._after(), swept, problem.moves, *rules, problem.travel)
        rest = swept[0, 0, 0, 0, 0, 0]
        if fresh:
            raised = swept - self.values
            self.mean, spread = float(rest), float(raised.max() - raised.min())
            self.residual = spread / float(swept.max())
        self.values = swept - rest

    def _share(self, kernel: Callable[..., None], *arguments: object) -> None:
        """Run a kernel over all lines of the grid, divided among threads."""
        lines = 4 * self.settings.points**2
        bounds = np.linspace(0, lines, self.settings.threads + 1).astype(int)
        with ThreadPoolExecutor(self.settings.threads) as threads:
            list(threads.map(partial(kernel, *arguments), bounds[:-1], bounds[1:]))

    def _after(self) -> Table:
        """Return the table at the end of a step, its cost apart, with the impulses in it."""
        stays = np.float32(1.0 - self.problem.chances.sum())
        return stays * self.values + self.expected

    def _told(self) -> dict[str, float]:
        """Return the mean cost of a step and the residual, once they are known."""
        known = np.isfinite(self.residual)
        return {"search/mean": self.mean, "search/residual": self.residual} if known else {}

    def _present(self) -> Arrays:
        return {"after": self._after()}

    def _policy(self, parameters: Arrays) -> TablePolicy:
        after: Any = parameters["after"]
        own = {name: getattr(self.problem, name) for name in (*ARRAYS, *NUMBERS)}
        return TablePolicy(after=after, **own)

    def _state(self) -> Arrays:
        return {
            "values/rounds": np.asarray(self.rounds),
            "values/values": self.values,
            "values/expected": self.expected,
        }

    def _restore(self, arrays: Arrays) -> None:
        self.rounds = int(arrays["values/rounds"])
        self.values, self.expected = arrays["values/values"], arrays["values/expected"]
