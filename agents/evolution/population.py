"""The lanes of a whole population: every candidate runs through the same episodes."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np

from agents.evaluation.episodes import limit_penalty
from agents.evolution.network_kernel import forward
from mm_gym import MovingMassVectorEnv

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from agents.evolution.network import Network
    from mm_gym import Scene

    Single = NDArray[np.float32]
    Values = NDArray[np.float64]


class Population:
    """Costs of candidates, found in threads that have an environment each.

    Parameters
    ----------
    scene, network
        What they control, and how their parameters are read.
    candidates, episodes
        Numbers of them; a candidate's episodes are lanes side by side.
    threads
        Number of parts into which the candidates are divided.
    """

    def __init__(
        self, scene: Scene, network: Network, candidates: int, episodes: int, threads: int
    ) -> None:
        self.episodes = episodes
        self.bounds = np.linspace(0, candidates, min(threads, candidates) + 1).astype(int)
        counts = np.diff(self.bounds)
        self.parts = [_Part(scene, network, int(count), episodes) for count in counts]
        self.frames = candidates * episodes * scene.control.steps
        self.threads = ThreadPoolExecutor(len(counts))

    def costs(self, vectors: Values, seeds: Sequence[int]) -> Values:
        """Return the mean penalty (candidates,) of each vector (candidates, N), as `evaluate` has.

        A seed is that of an episode of every candidate.
        """
        parameters = np.ascontiguousarray(vectors, np.float32)
        chunks = np.split(parameters, self.bounds[1:-1])
        found = self.threads.map(lambda part, chunk: part.costs(chunk, seeds), self.parts, chunks)
        return np.concatenate(list(found))

    def close(self) -> None:
        """End the threads."""
        self.threads.shutdown()


class _Part:
    """Some of the candidates, in one environment."""

    def __init__(self, scene: Scene, network: Network, candidates: int, episodes: int) -> None:
        self.network, self.candidates, self.steps = network, candidates, scene.control.steps
        self.first = MovingMassVectorEnv(scene, episodes, info="none")
        self.env = MovingMassVectorEnv(scene, candidates * episodes, copy=False, info="none")
        self.env.reset()
        objective = scene.objective
        self.may_end = bool(objective.displacement_limit or objective.rail_half_length)
        self.limit = limit_penalty(scene)
        start, lanes = network.start, self.env.num_envs
        self.fixed = tuple(
            np.ascontiguousarray(array, np.float32)
            for array in (start.units, start.keep, start.enter)
        )
        self.observed = np.empty((network.sizes[0], lanes), np.float32)
        self.sums = np.empty((2 * len(start.units) + len(start.keep), lanes), np.float32)
        self.actions = np.empty((self.env.action_space.shape[1], lanes), np.float32)

    def costs(self, parameters: Single, seeds: Sequence[int]) -> Values:
        lanes = self.env.num_envs
        observation = self._begin(seeds)
        self.sums[:] = 0.0
        total, alive = np.zeros(lanes), np.ones(lanes, np.bool_)
        sizes = self.network.sizes
        for left in range(self.steps, 0, -1):
            np.copyto(self.observed, observation.T)  # the kernel reads whole rows faster
            forward(
                parameters,
                self.fixed,
                self.observed,
                self.sums,
                self.actions,
                sizes,
                0,
                self.candidates,
            )
            observation, reward, terminated, *_ = self.env.step(self.actions.T)
            if not self.may_end:
                total -= reward
                continue
            # An early end costs as in `evaluate`; its lane runs on, and is not looked at.
            total[alive] -= reward[alive]
            ended = terminated & alive
            total[ended] += (left - 1 + self.steps) * np.maximum(self.limit, -reward[ended])
            alive &= ~ended
        return total.reshape(self.candidates, -1).mean(axis=1) / self.steps

    def _begin(self, seeds: Sequence[int]) -> NDArray[np.float32]:
        """Begin the episodes once, and copy them to every candidate; return what they show."""
        observation, _ = self.first.reset(seed=list(seeds))
        state = self.first.get_state()
        arrays = {name: value for name, value in state.items() if isinstance(value, np.ndarray)}
        copies = {name: np.tile(array, self.candidates) for name, array in arrays.items()}
        self.env.set_state(state | copies)
        return np.tile(observation, (self.candidates, 1))
