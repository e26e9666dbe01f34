"""Controllers with the numbers of least cost on the validation episodes.

A few numbers are searched when the controller is made; `python -m agents tune-controllers` searches
free numbers (`registry.Tunable`).
"""

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from scipy.optimize import minimize_scalar

from agents.control.controller import Controller, Law, StateSource
from agents.control.feedback import Feedback
from agents.control.observed_state import observed_state
from agents.controllers.choices import chosen, chosen_place
from agents.controllers.registry import Tunable
from agents.scoring import VALIDATION_EPISODES, VALIDATION_SEED, validation_cost
from mm_gym import DesignError, Scene, SimulationError
from mm_gym.arrays import Array
from mm_gym.extras import optional

Designed = TypeVar("Designed", bound=Controller)
Tried = TypeVar("Tried")

DECADES = np.linspace(-2.0, 2.0, 17)  # exponents of the gains and weights that are tried

FINALISTS, FURTHER = 10, 1000
"""Designs that a search of free numbers ends with, and validation episodes that decide.

They follow those of the search. The best of all on a hundred episodes is also lucky with them.
"""

CLOSE = 0.3
"""Spread of a search from found numbers, over that of one from the first numbers of a design."""

REFUSED = 1e100  # cost of a design that cannot be made or followed, above all others


def grid(scene: Scene, actuator: str) -> Array:
    """Return values over an actuator's range [-, N s/m, V]."""
    own = getattr(scene.actuation, actuator)
    return np.linspace(own.minimum, own.maximum, 33)


def least(tried: Iterable[Tried], cost: Callable[[Tried, float], float]) -> tuple[Tried, float]:
    """Return what costs least, the first of equals, and its cost.

    The cost is told the least one so far: above it any number above it will do, as of
    `validation_cost`.
    """
    best: list[Tried] = []
    lowest = np.inf
    for one in tried:
        found = cost(one, lowest)
        if not best or found < lowest:
            best, lowest = [one], found
    return best[0], lowest


def chosen_of(tried: Sequence[Tried], cost: Callable[[Tried, float], float]) -> Tried:
    """Return the candidate of least cost, as `least` does, or the one at the known place."""
    places = range(len(tried))

    def search() -> int:
        return least(places, lambda place, most: cost(tried[place], most))[0]

    return tried[chosen_place(search, len(tried))]


def cheapest_of(scene: Scene, controllers: Iterable[Designed]) -> Designed:
    """Return the controller of least cost of some."""
    return chosen_of(list(controllers), lambda one, most: validation_cost(scene, one, most=most))


def searched(
    scene: Scene,
    make: Callable[[float], Law],
    values: Array,
    seed: int = VALIDATION_SEED,
    source: StateSource | None = None,
) -> Feedback:
    """Return the law of least cost: the best of some values, refined between its neighbours."""
    source = source or observed_state(scene)
    return cheapest(scene, lambda value: Feedback(scene, make(value), source), values, seed)


def cheapest(
    scene: Scene,
    controller: Callable[[float], Designed],
    values: Array,
    seed: int = VALIDATION_SEED,
) -> Designed:
    """Return the controller of least cost in the same way, of those that can be designed."""

    def cost(value: float, most: float = np.inf) -> float:
        return cost_of(scene, lambda: controller(float(value)), seed=seed, most=most)

    def search() -> float:
        best, lowest = least(range(len(values)), lambda k, most: cost(values[k], most))
        around = values[max(best - 1, 0)], values[min(best + 1, len(values) - 1)]
        refined = minimize_scalar(cost, bounds=around, method="bounded", options={"xatol": 1e-3})
        return float(refined.x) if refined.fun < lowest else float(values[best])

    return controller(chosen(search))


def over_decades(
    make: Callable[[Scene, float], Law], exponents: Array = DECADES
) -> Callable[[Scene], Feedback]:
    """Return what searches the gain or weight of a law over some decades of it."""
    return lambda scene: searched(scene, lambda exponent: make(scene, 10.0**exponent), exponents)


def searched_pair(
    scene: Scene, make: Callable[[float, float], Law], first: Array | None = None
) -> Feedback:
    """Search a first value on a coarse grid, by default a stretch, and a second over four decades.

    Then search the second finely.
    """
    source = observed_state(scene)
    coarse = grid(scene, "stretch")[4::4] if first is None else first
    pairs = [(value, 10.0**e) for value in coarse for e in DECADES[::4]]

    def cost(pair: tuple[float, float], most: float) -> float:
        return cost_of(scene, lambda: Feedback(scene, make(*pair), source), most=most)

    best, _ = chosen_of(pairs, cost)
    return searched(scene, lambda exponent: make(best, 10.0**exponent), DECADES)


def trials(
    scene: Scene,
    tunable: Tunable,
    count: int,
    seed: int,
    *,
    start: Mapping[str, float] | None = None,
    known: Sequence[float] = (),
) -> Iterator[tuple[Array, float]]:
    """Search a controller's free numbers by CMA-ES; yield coordinates and cost of each trial.

    The first trial is the design with the numbers to start from. Hansen and Ostermeier, *Completely
    derandomized self-adaptation in evolution strategies*, Evol. Comput. 9 (2001). Raise
    `gymnasium.error.DependencyNotInstalled` without pycma (extra: evolve).

    Parameters
    ----------
    scene, tunable
        What is controlled, and by what.
    count
        Number of trials, each of the validation episodes.
    seed
        Of the search.
    start
        Numbers to start from, by default the design's first ones.
    known
        Costs of the first trials, from an earlier search of the same seed: it goes on from there.
    """
    first = np.zeros(len(tunable.free(scene)))
    strategy = cma_strategy(first, 1.0 if start is None else CLOSE, np.random.default_rng(seed))
    costs = iter(known)

    def cost(coordinates: Array) -> float:
        found = next(costs, None)
        if found is not None:
            return found
        numbers = tunable.at(scene, coordinates, start)
        return cost_of(scene, lambda: tunable.design(scene, numbers))

    yield first, cost(first)
    done = 1
    while done < count:
        generation = strategy.ask()
        results: list[float] = []
        for coordinates in generation[: count - done]:
            results.append(cost(coordinates))
            yield coordinates, results[-1]
        done += len(results)
        if len(results) == len(generation):
            strategy.tell(generation, results)


def cma_strategy(
    mean: Array, spread: float, generator: np.random.Generator, **options: object
) -> Any:  # noqa: ANN401 - pycma has no types
    """Return the search of pycma from a mean on, by random numbers of a generator.

    Raise `gymnasium.error.DependencyNotInstalled` without pycma (extra: evolve).
    """
    cma = optional("cma", "pycma is missing: install the extra `evolve`")
    fixed = {
        "randn": lambda *shape: generator.standard_normal(shape),
        "seed": np.nan,  # NumPy's global generator is left alone
        "verbose": -9,
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a single number
        return cma.CMAEvolutionStrategy(mean, spread, options | fixed)


def finalists(costs: Sequence[float]) -> list[int]:
    """Return the trials that stand for a search: the best of each of `FINALISTS` parts of it."""
    parts = np.array_split(np.arange(len(costs)), min(FINALISTS, len(costs)))
    return [int(part[np.argmin(np.take(costs, part))]) for part in parts]


def further_cost(scene: Scene, tunable: Tunable, numbers: Mapping[str, float]) -> float:
    """Return the cost of a design on the further validation episodes [-]."""
    seed = VALIDATION_SEED + VALIDATION_EPISODES
    return cost_of(scene, lambda: tunable.design(scene, numbers), seed=seed, episodes=FURTHER)


def cost_of(scene: Scene, make: Callable[[], Controller], **episodes: Any) -> float:  # noqa: ANN401 - as of `validation_cost`
    """Return a design's cost, `REFUSED` where none can be made or the motion cannot be computed."""
    try:
        found = validation_cost(scene, make(), **episodes)
    except (DesignError, SimulationError):
        return REFUSED
    return min(found, REFUSED) if np.isfinite(found) else REFUSED
