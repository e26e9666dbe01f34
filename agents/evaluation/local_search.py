"""Plans of whole episodes, improved without derivatives: parts of them are changed at random.

Steps of Gauss and Newton end where every small change costs more. Other switching times, or a part
of the plan of another episode, can cost less all the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

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
        return self._applied(best)

    def _costs(self, plans: Array) -> Array:
        """Return the sum of -reward of each plan, infinite where the episode ends early."""
        costs = np.zeros(plans.shape[2])
        for reward, terminated, _ in self._steps(plans):
            costs -= reward
            costs[terminated] = np.inf
        return costs

    def _applied(self, plans: Array) -> Array:
        steps = self._steps(np.tile(plans, CHILDREN))
        return np.array([info["applied"][: self.count].copy() for _, _, info in steps])

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
