"""The search: CMA-ES of pycma over whole populations, which any kill leaves resumable.

Hansen and Ostermeier, *Completely derandomized self-adaptation in evolution strategies*, Evol.
Comput. 9 (2001). The checkpoint holds the costs of all generations so far. With them and the seed
the search is repeated without a single episode, in milliseconds a generation: so the file is made
of numbers alone, whatever pycma's own state is.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from itertools import islice
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from agents.controllers.registry import not_a_law
from agents.controllers.searched import cma_strategy
from agents.evolution.network_kernel import forward
from agents.network.files import Arrays
from agents.policies import Policy
from agents.rollout import Rollout
from agents.scoring import (
    VALIDATION_EPISODES,
    VALIDATION_SEED,
    limit_penalty,
    require_root,
    spread_frequency,
    tail_mean,
)
from agents.training.config import Count, Positive, SearchSettings, training_seeds
from agents.training.network import Network
from agents.training.parts import Parts, make_parts
from agents.training.runs import Run
from agents.training.scales import Scales
from agents.training.search import Search
from agents.training.starts import IN_WORDS, added_to, start_of
from mm_gym import Episodes, MovingMassVectorEnv, Scene
from mm_gym.arrays import Array, Single


class EvolveSettings(SearchSettings):
    """How networks are evolved."""

    candidates: Annotated[int, Field(ge=4)] = 48
    """networks in a generation"""
    episodes: Count = 32
    """episodes of each network, the same for a whole generation, new ones for the next"""
    generations: Count = 200
    """generations of the whole run; for your own scene as many as a time budget allows"""
    worst: Annotated[float, Field(gt=0, le=1)] = 1.0
    """share of the episodes, those that cost most, whose mean is minimised and validated (CVaR); 1
    is the mean of all"""
    spread: Positive = 0.3
    """spread of the first generation, relative to the size of each parameter"""
    separable: bool = False
    """adapt only a variance for each parameter, and no covariances: for wide networks"""
    tolerance: Annotated[float, Field(gt=0, lt=1)] = 1e-3
    """solver.tolerance during the search, where the scene's is finer; validations keep the
    scene's"""
    threads: Count = 2
    """threads that share a generation; results do not depend on it"""
    base: str | None = None
    """controller that the network is added to, a name or "FILE.py:NAME", with its own memory; it
    observes the controller's action too and begins without influence"""
    schedules: bool = False
    """let the network set the free numbers of the base in each control step, and add nothing"""
    authority: Annotated[float, Field(gt=0, le=2)] = 1.0
    """largest action that it adds to the base's, which ranges from -1 to 1; a schedule changes a
    number, or the logarithm of a ratio, by up to so many spreads of a search's first trials"""

    growing: ClassVar[tuple[str, ...]] = ("generations", "time_budget")
    own_code: ClassVar[tuple[str, ...]] = ("base", "reward")

    @property
    def unused(self) -> dict[str, str]:
        """What the base replaces, or what is of a base alone."""
        if self.base is None:
            return dict.fromkeys(("schedules", "authority"), "with a base")
        return dict.fromkeys(("law", "memory"), "without base")

    @property
    def unasked(self) -> tuple[str, ...]:
        """Settings that are not written, as `SearchSettings.unasked`."""
        return super().unasked + (() if self.schedules else ("schedules",))


LANES = 384
"""Those that a thread takes at a time: they stay in its cache, and no thread waits for long."""


class Trial(NamedTuple):
    """What decides a candidate's cost: the scene, its networks, their episodes, and a base.

    A candidate's episodes are lanes side by side; its cost is the mean of those that cost most, the
    worst share of them.
    """

    scene: Scene
    network: Network
    episodes: int
    worst: float = 1.0
    around: Parts | None = None  # of a base, that the network is added to or schedules


class Population:
    """Costs of candidates, found in threads."""

    def __init__(self, trial: Trial, candidates: int, threads: int) -> None:
        # A base acts in NumPy, in one thread, to which more lanes at a time cost less.
        most = LANES if trial.around is None else candidates * trial.episodes
        self.bounds = [*range(0, candidates, max(1, most // trial.episodes)), candidates]
        self.parts = [Candidates(trial, count) for count in np.diff(self.bounds).tolist()]
        self.episodes = trial.episodes
        self.frames = candidates * trial.episodes * trial.scene.control.steps
        self.threads = ThreadPoolExecutor(threads)  # they end with it

    def costs(self, vectors: Array, seeds: Sequence[int]) -> Array:
        """Return the mean penalty (candidates,) of each vector (candidates, N), as `evaluate` has.

        A seed is that of an episode of every candidate.
        """
        chunks = np.split(vectors, self.bounds[1:-1])
        found = self.threads.map(lambda part, chunk: part.costs(chunk, seeds), self.parts, chunks)
        return np.concatenate(list(found))


class Candidates:
    """Some of the candidates, in one environment."""

    def __init__(self, trial: Trial, candidates: int) -> None:
        scene, network, episodes, self.worst, around = trial
        self.steps, self.limit = scene.control.steps, limit_penalty(scene)
        self.parameters: Single = np.empty((candidates, network.free.size), np.float32)
        lanes, start, (n, _, self.k) = candidates * episodes, network.start, network.sizes
        if around is None:
            self.added, self.env = None, MovingMassVectorEnv(scene, lanes, info="none")
        else:
            self.added = around.controller(self)  # pyright: ignore[reportArgumentType] - acts as a policy
            self.env = MovingMassVectorEnv(scene, lanes, autoreset_mode="Disabled")
        (known, acting), (r, _, _) = (start.keep.shape[0], start.back.shape[1]), start.pairs.shape
        self.sums: Single = np.empty((2 * r + known + acting, lanes), np.float32)
        fixed = tuple(
            np.ascontiguousarray(array, np.float32)
            for array in (start.units, start.keep, start.enter, start.back)
        )
        memory = np.empty((n + len(start.keep) + len(start.units) + 2, episodes), np.float32)
        self.arguments = self.parameters, fixed, self.sums, memory, network.sizes

    @cached_property
    def run(self) -> Callable[[], Episodes]:
        """Compiled, or read from disk, in the first generation: its time counts."""
        return self.env.closed_loop(forward, *self.arguments)

    def costs(
        self, vectors: Array, seeds: Sequence[int], options: Mapping[str, Array] | None = None
    ) -> Array:
        """Return the mean penalty (candidates,) of each vector (candidates, N), as `evaluate` has.

        Seeds and options are those of the episodes of every candidate.
        """
        self.parameters[:] = vectors
        self.sums[:] = 0.0
        count, repeated = len(vectors), dict(options or {})
        for name, values in repeated.items():
            repeated[name] = np.tile(values, count)
        drawn: dict[str, Any] = {"seed": list(seeds) * count, "options": repeated}
        if self.added is None:
            self.env.reset(**drawn)
            episodes = self.run()
        else:
            episodes = _episodes(Rollout(self.env, self.added, **drawn))
        steps = self.steps
        # An early end costs as in `evaluate`.
        largest = np.maximum(self.limit, -episodes.least)
        left = episodes.terminated * (2 * steps - episodes.lengths)
        penalties = left * largest - episodes.returns
        return tail_mean(penalties.reshape(count, -1), self.worst) / steps

    def check(self, observation: int, action: int, of: str = "") -> None:
        """Take what the environment has: the networks were made for it."""

    def begin(self, lanes: int) -> Array:
        """Return no memory, which is in the sums."""
        return np.empty((lanes, 0))

    def step(self, observation: Single, memory: Array) -> tuple[Single, Array]:
        """Return the actions (lanes, k) of the networks, each in lanes of its own."""
        actions: Single = np.empty((self.k, len(observation)), np.float32)
        forward(np.ascontiguousarray(observation.T), actions, *self.arguments)
        return actions.T, memory


def _episodes(rollout: Rollout) -> Episodes:
    """Return what became of the episodes of all lanes, as a compiled loop does."""
    lanes = rollout.env.num_envs
    found = Episodes(
        returns=np.zeros(lanes),
        least=np.zeros(lanes),
        lengths=np.zeros(lanes, np.int64),
        terminated=np.zeros(lanes, np.bool_),
    )
    for step in rollout:
        found.returns[:] += np.where(step.ran, step.reward, 0.0)
        found.lengths[:] += step.ran
        found.terminated[:] |= step.terminated & step.ran
        found.least[:] = np.minimum(found.least, np.where(step.ran, step.reward, 0.0))
    return found


def evolve(settings: EvolveSettings, run: Run, *, bar: bool = True) -> None:
    """Search until generations or time are used up, and write the best policy to the run's folder.

    Raise as `Search.finish` does, and, before a folder is made, `SceneError`, `CompileError` or
    `DesignError` if there is nothing to search on, or the law does not apply.
    """
    Evolution(settings, settings.rewarded_scene(), run).finish(run, bar=bar)


class Evolution(Search):
    """A search of parameters around their first values.

    Attributes
    ----------
    costs
        (generations, candidates): of all candidates, of the generations so far.
    """

    unit = "generation"

    def __init__(self, settings: EvolveSettings, scene: Scene, run: Run | None = None) -> None:
        super().__init__(settings, scene)
        self.settings: EvolveSettings = settings
        generator = np.random.default_rng(settings.seed)
        odd, own = scene.actuation.names == ("force",), settings.scene is not None
        around, scales = make_parts(settings, run), None
        base, law, self.numbers = around.base, around.scheduled, around.numbers
        if base is None and settings.base is not None:
            raise not_a_law(settings.base, scene, "base", "or FILE.py:NAME")
        if base is None:
            around, start = None, start_of(scene, settings, generator)
            self.began_as = IN_WORDS[start.law]
            scales = Scales.measured(scene, start) if own else None
        else:
            start, self.began_as = added_to(scene, settings, generator, law), base.name
            scales = Scales.around(scene, base, start) if own and law is None else None
            odd = odd and law is None  # the mirrored motion gets the same numbers
        self.network = Network(start, settings.hidden, odd, scales)
        self.first, self.generator = self.network.first(generator), generator
        self.free = self.network.free
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the tolerance is of no use to exact plants
            acting = settings.worst, around
            self.populations: list[Population] = []
            for one, count in settings.scenes(scene, settings.episodes):
                tolerance = max(settings.tolerance, one.solver.tolerance)
                coarse = one.replace(**{"solver.tolerance": tolerance})
                trial = Trial(coarse, self.network, count, *acting)
                self.populations.append(Population(trial, settings.candidates, settings.threads))
        self.worst = settings.worst
        validated = Trial(scene, self.network, VALIDATION_EPISODES, *acting)
        self.validation = Candidates(validated, 1)
        self.frames = sum(one.frames for one in self.populations)
        self.strategy = cma_strategy(
            self.first[self.free],
            settings.spread,
            generator,
            popsize=settings.candidates,
            CMA_stds=self.network.spreads()[self.free],
            CMA_diagonal=settings.separable,
        )
        self.costs: Array = np.empty((0, settings.candidates))

    def _restore(self, arrays: Arrays) -> None:
        """Repeat the search, with the costs of the checkpoint."""
        found = np.asarray(arrays["evolution/costs"], np.float64)
        for costs in found:
            self._tell(self._asked(), costs)
            self.rounds += 1

    def _state(self) -> Arrays:
        return {"evolution/costs": self.costs}

    def _asked(self) -> Array:
        return np.array(self.strategy.ask())

    def _whole(self, vectors: Array) -> Array:
        """Return the networks' vectors (candidates, N) of those that are searched."""
        whole = np.tile(self.first, (len(vectors), 1))
        whole[:, self.free] = vectors
        return whole

    def _tell(self, vectors: Array, costs: Array) -> None:
        self.strategy.tell(list(vectors), costs.tolist())
        self.costs = np.vstack([self.costs, costs])

    def _advance(self) -> None:
        settings, vectors = self.settings, self._asked()
        first = self.rounds * settings.episodes
        seeds = iter(training_seeds(settings.seed, settings.episodes, first))
        costs = np.zeros(len(vectors))
        for one in self.populations:
            found = one.costs(self._whole(vectors), list(islice(seeds, one.episodes)))
            costs += one.episodes / settings.episodes * found
        self._tell(vectors, costs)

    def _told(self) -> dict[str, float]:
        """Return the least and the median cost of the candidates on their training episodes."""
        costs = np.sqrt(np.maximum(self.costs[-1], 0.0))  # an own reward's sign is free
        return {"search/least": float(costs.min()), "search/median": float(np.median(costs))}

    def _present(self) -> Arrays:
        (vector,) = self._whole(np.asarray(self.strategy.mean)[None])
        return {"vector": vector}

    def _cost(self, parameters: Arrays) -> float:
        """Return what `evaluate` does, from the compiled network: single precision, less time."""
        seeds = range(VALIDATION_SEED, VALIDATION_SEED + VALIDATION_EPISODES)
        options = spread_frequency(self.scene, VALIDATION_EPISODES)
        (penalty,) = self.validation.costs(parameters["vector"][None], seeds, options)
        require_root(self.scene, penalty)
        return float(np.sqrt(penalty))

    def _policy(self, parameters: Arrays) -> Policy:
        return self.network.policy(np.asarray(parameters["vector"], np.float64))
