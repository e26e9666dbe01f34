"""The search: CMA-ES of pycma over whole populations, which any kill leaves resumable.

Hansen and Ostermeier, *Completely derandomized self-adaptation in evolution strategies*, Evol.
Comput. 9 (2001). The checkpoint holds the costs of all generations so far. With them and the seed
the search is repeated without a single episode, in milliseconds a generation: so the file is made
of numbers alone, whatever pycma's own state is.
"""

from __future__ import annotations

import time
import warnings
from contextlib import closing
from typing import TYPE_CHECKING

import numpy as np
from gymnasium.error import DependencyNotInstalled
from tqdm import tqdm

from agents.controllers.learned import Learned
from agents.evaluation.episodes import VALIDATION_SEED, evaluate
from agents.evolution.network import Network
from agents.evolution.population import Population
from agents.evolution.starts import start_of
from agents.training.arrays import load_checkpoint, save_checkpoint
from agents.training.progress import Progress
from agents.training.seeds import training_seeds

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from agents.evolution.settings import EvolveSettings
    from agents.policies import Policy
    from agents.training.runs import Run
    from mm_gym import Scene

    Values = NDArray[np.float64]


BETWEEN_SAVES = 5.0
"""Time between checkpoints [s]."""


def evolve(settings: EvolveSettings, run: Run, *, bar: bool = True) -> None:
    """Search until generations or time are used up, and write the best policy to the run's folder.

    An interrupted run continues from its last checkpoint; Ctrl-C writes one. A finished run goes on
    where the settings differ in that they have more generations or time.

    Raises
    ------
    SceneError, CompileError, DesignError
        If there is nothing to search on, or the law does not apply. No folder is made.
    RunError
        If the folder holds another run, or another process uses it.
    """
    search = Search(settings, settings.load_scene())
    with closing(search.population), run.locked():
        run.open(settings)
        if not run.finished:
            if run.checkpoint.exists():
                search.repeat(run)
            search.to_the_end(run, bar=bar)


class Search:
    """A search of parameters around their first values.

    Attributes
    ----------
    costs
        Of all candidates, an array (candidates,) for each generation so far.
    progress
        The validations, of the mean of the distribution.
    """

    def __init__(self, settings: EvolveSettings, scene: Scene) -> None:
        self.settings, self.scene = settings, scene
        generator = np.random.default_rng(settings.seed)
        start = start_of(scene, settings, generator)
        self.network = Network(start, settings.hidden, odd=scene.actuation.stretch is None)
        self.first, self.generator = self.network.first(generator), generator
        self.free = self.network.free
        tolerance = max(settings.tolerance, scene.solver.tolerance)
        coarse = scene.replace(**{"solver.tolerance": tolerance})
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the tolerance is of no use to exact plants
            self.population = Population(
                coarse, self.network, settings.candidates, settings.episodes, settings.threads
            )
        self.strategy = self._strategy(self.first[self.free])
        self.costs: list[Values] = []
        self.progress = Progress()
        self._note()

    def _strategy(self, mean: Values):  # noqa: ANN202 - pycma has no types
        try:
            import cma  # noqa: PLC0415 - an extra
        except ImportError as error:
            msg = 'pycma is missing: pip install "mm-gym[evolve]"'
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

    def repeat(self, run: Run) -> None:
        """Repeat the search up to the checkpoint, with the costs that it holds."""
        arrays = load_checkpoint(run.checkpoint)
        self.progress = Progress.of(arrays)
        for costs in arrays["evolution/costs"]:
            self._tell(self._asked(), costs)
        self._note()

    def to_the_end(self, run: Run, *, bar: bool) -> None:
        """Search on, validate, and write the best policy; draw a progress bar if asked to."""
        settings, progress = self.settings, self.progress
        every = -(-settings.generations // settings.evaluations)
        began = time.perf_counter() - progress.seconds
        saved, done = progress.seconds, len(self.costs) >= settings.generations
        total, initial = settings.generations, len(self.costs)
        with tqdm(total=total, initial=initial, unit="generation", disable=not bar) as shown:
            try:
                while not done:
                    self._advance()
                    shown.update()
                    progress.seconds = time.perf_counter() - began
                    late = progress.seconds >= settings.time_budget
                    done = late or len(self.costs) == settings.generations
                    if done or len(self.costs) % every == 0:
                        self._validate()
                        shown.set_postfix(cost=f"{progress.least_cost:.4f}")
                    self._note()
                    if done or progress.seconds > saved + BETWEEN_SAVES:
                        self._save(run)
                        saved = progress.seconds
            except KeyboardInterrupt:
                self._save(run)
                raise
        self.policy().save(run.policy)

    def policy(self) -> Policy:
        """Return the best policy of the validations."""
        return self.network.policy(self.progress.best["vector"])

    def _asked(self) -> Values:
        return np.array(self.strategy.ask())

    def _whole(self, vectors: Values) -> Values:
        """Return the networks' vectors (candidates, N) of those that are searched."""
        whole = np.tile(self.first, (len(vectors), 1))
        whole[:, self.free] = vectors
        return whole

    def _tell(self, vectors: Values, costs: Values) -> None:
        self.strategy.tell(list(vectors), costs.tolist())
        self.costs.append(costs)

    def _advance(self) -> None:
        settings, vectors = self.settings, self._asked()
        first = len(self.costs) * settings.episodes
        seeds = training_seeds(settings.seed, settings.episodes, first)
        self._tell(vectors, self.population.costs(self._whole(vectors), seeds))

    def _validate(self) -> None:
        (vector,) = self._whole(np.asarray(self.strategy.mean)[None])
        learned = Learned(self.network.policy(vector))
        cost = evaluate(self.scene, learned, seed=VALIDATION_SEED, episodes=100).cost
        if cost < self.progress.least_cost:
            self.progress.best = {"vector": vector}
        self.progress.add(len(self.costs) * self.population.frames, cost)

    def _note(self) -> None:
        """Note where an interrupted search begins again: between two generations."""
        self.state, self.count = self.progress.arrays(), len(self.costs)

    def _save(self, run: Run) -> None:
        costs = np.array(self.costs[: self.count]).reshape(-1, self.settings.candidates)
        save_checkpoint(run.checkpoint, self.state | {"evolution/costs": costs})
        self.progress.write_metrics(run)
