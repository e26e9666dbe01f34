"""The search: CMA-ES of pycma over whole populations, which any kill leaves resumable.

Hansen and Ostermeier, *Completely derandomized self-adaptation in evolution strategies*, Evol.
Comput. 9 (2001). The checkpoint holds the costs of all generations so far. With them and the seed
the search is repeated without a single episode, in milliseconds a generation: so the file is made
of numbers alone, whatever pycma's own state is.
"""

from __future__ import annotations

import warnings
from contextlib import closing

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from agents.evolution.population import Candidates, Population
from agents.evolution.settings import EvolveSettings
from agents.network.arrays import Arrays
from agents.policies import Policy
from agents.scoring import VALIDATION_EPISODES, VALIDATION_SEED, spread_frequency
from agents.training.config import training_seeds
from agents.training.network import Network
from agents.training.runs import Run
from agents.training.scales import Scales
from agents.training.search import Search
from agents.training.starts import IN_WORDS, start_of
from mm_gym import Scene

Values = NDArray[np.float64]


def evolve(settings: EvolveSettings, run: Run, *, bar: bool = True) -> None:
    """Search until generations or time are used up, and write the best policy to the run's folder.

    An interrupted run continues from its last checkpoint; Ctrl-C writes one. A finished run goes on
    where the settings differ in that they have more generations or time. Raise `SceneError`,
    `CompileError` or `DesignError` if there is nothing to search on, or the law does not apply. No
    folder is made. Raise `RunError` if the folder holds another run, or another process uses it.
    """
    search = Evolution(settings, settings.rewarded_scene())
    with closing(search.population):
        search.finish(run, bar=bar)


class Evolution(Search):
    """A search of parameters around their first values.

    Attributes
    ----------
    costs
        (generations, candidates): of all candidates, of the generations so far.
    """

    unit = "generation"

    def __init__(self, settings: EvolveSettings, scene: Scene) -> None:
        super().__init__(settings, scene)
        self.settings: EvolveSettings = settings
        generator = np.random.default_rng(settings.seed)
        start = start_of(scene, settings, generator)
        odd, own = scene.actuation.names == ("force",), settings.scene is not None
        scales = Scales.measured(scene, start) if own else None
        self.network = Network(start, settings.hidden, odd, scales)
        self.began_as = IN_WORDS[start.law]
        self.first, self.generator = self.network.first(generator), generator
        self.free = self.network.free
        tolerance = max(settings.tolerance, scene.solver.tolerance)
        coarse = scene.replace(**{"solver.tolerance": tolerance})
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the tolerance is of no use to exact plants
            self.population = Population(
                coarse,
                self.network,
                settings.candidates,
                settings.episodes,
                settings.threads,
                worst=settings.worst,
            )
        self.worst = settings.worst
        self.validation = Candidates(scene, self.network, 1, VALIDATION_EPISODES, self.worst)
        self.frames = self.population.frames
        self.strategy = self._strategy(self.first[self.free])
        self.costs: Values = np.empty((self.total, settings.candidates))

    @property
    def total(self) -> int:
        """Number of generations."""
        return self.settings.generations

    def _strategy(self, mean: Values):  # noqa: ANN202 - pycma has no types
        try:
            import cma  # noqa: PLC0415 - an extra
        except ImportError as error:
            msg = "pycma is missing: install the extra `evolve`"
            raise DependencyNotInstalled(msg) from error
        options = {
            "popsize": self.settings.candidates,
            "CMA_stds": self.network.spreads()[self.free],
            "CMA_diagonal": self.settings.separable,
            "randn": lambda *shape: self.generator.standard_normal(shape),
            "seed": np.nan,  # NumPy's global generator is left alone
            "verbose": -9,
        }
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return cma.CMAEvolutionStrategy(mean, self.settings.spread, options)

    def _restore(self, arrays: Arrays) -> None:
        """Repeat the search, with the costs of the checkpoint."""
        found = np.asarray(arrays["evolution/costs"], np.float64)
        if len(found) > self.total:
            msg = f"evolution/costs: got {len(found)} generations; allowed: at most {self.total}"
            raise ValueError(msg)
        for costs in found:
            self._tell(self._asked(), costs)
            self.rounds += 1

    def _state(self) -> Arrays:
        return {"evolution/costs": self.costs[: self.rounds]}

    def _asked(self) -> Values:
        return np.array(self.strategy.ask())

    def _whole(self, vectors: Values) -> Values:
        """Return the networks' vectors (candidates, N) of those that are searched."""
        whole = np.tile(self.first, (len(vectors), 1))
        whole[:, self.free] = vectors
        return whole

    def _tell(self, vectors: Values, costs: Values) -> None:
        self.strategy.tell(list(vectors), costs.tolist())
        self.costs[self.rounds] = costs

    def _advance(self) -> None:
        settings, vectors = self.settings, self._asked()
        first = self.rounds * settings.episodes
        seeds = training_seeds(settings.seed, settings.episodes, first)
        self._tell(vectors, self.population.costs(self._whole(vectors), seeds))

    def _told(self) -> dict[str, float]:
        """Return the least and the median cost of the candidates on their training episodes."""
        costs = np.sqrt(
            np.maximum(self.costs[self.rounds - 1], 0.0)
        )  # an own reward's sign is free
        return {"search/least": float(costs.min()), "search/median": float(np.median(costs))}

    def _present(self) -> Arrays:
        (vector,) = self._whole(np.asarray(self.strategy.mean)[None])
        return {"vector": vector}

    def _cost(self, parameters: Arrays) -> float:
        """Return what `evaluate` does, from the compiled network: single precision, less time."""
        seeds = range(VALIDATION_SEED, VALIDATION_SEED + VALIDATION_EPISODES)
        options = spread_frequency(self.scene, VALIDATION_EPISODES)
        (penalty,) = self.validation.costs(parameters["vector"][None], seeds, options)
        return float(np.sqrt(penalty))

    def _policy(self, parameters: Arrays) -> Policy:
        return self.network.policy(np.asarray(parameters["vector"], np.float64))
