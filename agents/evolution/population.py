"""The lanes of a whole population: every candidate runs through the same episodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from agents.evolution.network_kernel import forward
from agents.scoring import limit_penalty, tail_mean
from agents.training.network import Network
from mm_gym import Episodes, MovingMassVectorEnv, Scene

Single = NDArray[np.float32]
Values = NDArray[np.float64]

LANES = 384
"""Those that a thread takes at a time: they stay in its cache, and no thread waits for long."""


class Population:
    """Costs of candidates, found in threads.

    Parameters
    ----------
    scene, network
        What they control, and how their parameters are read.
    candidates, episodes
        Numbers of them; a candidate's episodes are lanes side by side.
    threads
        Number of threads.
    worst
        Share of a candidate's episodes, those that cost most, whose mean is its cost.
    """

    def __init__(
        self,
        scene: Scene,
        network: Network,
        candidates: int,
        episodes: int,
        threads: int,
        *,
        worst: float = 1.0,
    ) -> None:
        self.bounds = [*range(0, candidates, max(1, LANES // episodes)), candidates]
        counts = np.diff(self.bounds).tolist()
        self.parts = [Candidates(scene, network, count, episodes, worst) for count in counts]
        self.frames = candidates * episodes * scene.control.steps
        self.threads = ThreadPoolExecutor(threads)

    def costs(self, vectors: Values, seeds: Sequence[int]) -> Values:
        """Return the mean penalty (candidates,) of each vector (candidates, N), as `evaluate` has.

        A seed is that of an episode of every candidate.
        """
        chunks = np.split(vectors, self.bounds[1:-1])
        found = self.threads.map(lambda part, chunk: part.costs(chunk, seeds), self.parts, chunks)
        return np.concatenate(list(found))

    def close(self) -> None:
        """End the threads."""
        self.threads.shutdown()


class Candidates:
    """Some of the candidates, in one environment.

    Parameters
    ----------
    scene, network, candidates, episodes, worst
        As for `Population`.
    """

    def __init__(
        self,
        scene: Scene,
        network: Network,
        candidates: int,
        episodes: int,
        worst: float = 1.0,
    ) -> None:
        self.worst = worst
        self.steps, self.limit = scene.control.steps, limit_penalty(scene)
        self.parameters: Single = np.empty((candidates, network.free.size), np.float32)
        lanes, start, (n, *_) = candidates * episodes, network.start, network.sizes
        self.env = MovingMassVectorEnv(scene, lanes, info="none")
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
        self, vectors: Values, seeds: Sequence[int], options: Mapping[str, Values] | None = None
    ) -> Values:
        """Return the mean penalty (candidates,) of each vector (candidates, N), as `evaluate` has.

        Parameters
        ----------
        vectors
            The candidates.
        seeds
            Those of the episodes of every candidate.
        options
            Of the reset, for each of these episodes.
        """
        self.parameters[:] = vectors
        self.sums[:] = 0.0
        count, repeated = len(vectors), dict(options or {})
        for name, values in repeated.items():
            repeated[name] = np.tile(values, count)
        self.env.reset(seed=list(seeds) * count, options=repeated)
        episodes, steps = self.run(), self.steps
        # An early end costs as in `evaluate`.
        largest = np.maximum(self.limit, -episodes.least)
        left = episodes.terminated * (2 * steps - episodes.lengths)
        penalties = left * largest - episodes.returns
        return tail_mean(penalties.reshape(count, -1), self.worst) / steps
