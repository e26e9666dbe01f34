"""Sizes of what a network reads and does on a scene, as they are under its start."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from agents.control.controller import Acted, Controller, Info, Memory, Observation
from agents.controllers.learned import Learned, observed
from agents.rollout import Rollout, Step
from agents.training.start import Start
from mm_gym import ActionError, MovingMassVectorEnv, Scene
from mm_gym.arrays import Array

LANES, SEED = 32, 5_000_000
"""Episodes in which sizes are measured, apart from those of any evaluation."""

LEAST = 0.05
"""Least size of an action: a start that hardly acts, as no control, is changed by this much."""


@dataclass(frozen=True, eq=False)
class Scales:
    """Root mean squares, or 1 throughout where a scene states them well."""

    inputs: Array  # (n + m + r,) of observation, linear memory and correlation units
    outputs: Array  # (k,) of the actions
    updates: Array  # (m,) of the change of each state of the linear memory in a step

    @classmethod
    def stated(cls, start: Start) -> Scales:
        """Return those of a scene whose own scales are right."""
        k, count = start.direct.shape
        return cls(np.ones(count - 1), np.ones(k), np.ones(len(start.keep)))

    @classmethod
    def measured(cls, scene: Scene, start: Start) -> Scales:
        """Return those under a start, in episodes of the scene."""
        watched = _Watched(start)
        try:
            sizes = sizes_under(scene, watched, lambda _: watched.seen)
        except ActionError:  # a start that is not stable
            return cls.stated(start)
        return cls._of(start, *sizes)

    @classmethod
    def around(cls, scene: Scene, base: Controller, start: Start) -> Scales:
        """Return those of what is added to a base, in episodes under it alone."""
        (sizes,) = sizes_under(scene, base, lambda one: (observed(one.observation, one.action),))
        return cls._of(start, sizes, sizes[-len(start.direct) :], np.ones(0))

    @classmethod
    def _of(cls, start: Start, inputs: Array, outputs: Array, updates: Array) -> Scales:
        inputs = np.concatenate([inputs, np.ones(len(start.units))])  # units are of order one
        inputs, updates = (
            np.where(np.isfinite(sizes) & (sizes > 0.0), sizes, 1.0) for sizes in (inputs, updates)
        )
        return cls(inputs, np.clip(outputs, LEAST, 1.0), updates)


def sizes_under(
    scene: Scene, controller: Controller, read: Callable[[Step], Sequence[Array]]
) -> list[Array]:
    """Return the root mean squares under a controller of what is read of each step.

    Of an array (lanes, n) it is (n,).
    """
    env = MovingMassVectorEnv(scene, LANES, autoreset_mode="Disabled")
    squares = [
        [np.mean(one**2, axis=0) for one in read(step)]
        for step in Rollout(env, controller, seed=SEED)
    ]
    return [np.sqrt(sum(rows) / len(rows)) for rows in zip(*squares, strict=True)]


class _Watched(Learned):
    """A start's policy, which notes what it read and did, and how its memory changed."""

    def __init__(self, start: Start) -> None:
        super().__init__(start.policy())
        self.states, self.seen = len(start.keep), tuple[Array, ...]()

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        action, after = super().propose(memory, observation, info)
        before, now = (one["policy"][:, : self.states] for one in (memory, after))
        self.seen = np.hstack([observation, now]), action, now - before
        return action, after
