"""A base that is a linear law of the observation, found by asking it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.controllers.residual import propose, send
from mm_gym import MovingMassVectorEnv

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from agents.controllers.controller import Controller
    from mm_gym import Scene

    Values = NDArray[np.float64]

SMALL = 2.0**-14
"""Observation whose action is not clipped; a power of two, which single precision has exactly."""

ASKED, STEPS = 100, 3
"""Random observations on which a law is checked, in so many steps one after the other."""

CLOSE = 1e-9
"""Largest difference of a linear law from its gains: round-off is less, a second law more."""


def linear_base(base: Controller, scene: Scene) -> Values | None:
    """Return gains and constants (k, n + 1) of a base, or None if it is not a linear law.

    A law is linear if its clipped action is that of its gains on random observations, small and
    large, whatever went before: so one that remembers is not, nor one that switches.
    """
    if base.reads != "observation":
        return None
    observed = int(np.prod(MovingMassVectorEnv(scene, 1).single_observation_space.shape))
    env = MovingMassVectorEnv(scene, 1 + observed + ASKED)
    env.reset(seed=0)
    base.reset(env)
    generator = np.random.default_rng(0)
    gains = None
    for _ in range(STEPS):
        sizes = generator.choice([SMALL, 0.01, 1.0], (ASKED, 1))
        drawn = sizes * generator.standard_normal((ASKED, observed))
        asked = np.vstack([np.zeros(observed), SMALL * np.eye(observed), drawn]).astype(np.float32)
        proposed = propose(base, asked, {})
        if gains is None:
            constant = proposed[0]
            rows = (proposed[1 : 1 + observed] - constant) / SMALL
            gains = np.column_stack([rows.T, constant])
        wanted = np.clip(asked.astype(np.float64) @ gains[:, :-1].T + gains[:, -1], -1.0, 1.0)
        if not np.allclose(proposed, wanted, rtol=0.0, atol=CLOSE):
            return None
        send(base, proposed)
    return gains
