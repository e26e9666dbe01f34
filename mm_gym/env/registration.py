"""Registers the tasks with Gymnasium, which imports this package for "mm_gym:mm_gym/<task>"."""

from __future__ import annotations

import gymnasium

from mm_gym.env.tasks import TASKS


def register_envs() -> None:
    """Register every task that is not registered yet."""
    for name, scene in TASKS.items():
        if name not in gymnasium.registry:
            gymnasium.register(  # pyright: ignore[reportUnknownMemberType] - its own annotation
                id=name,
                entry_point="mm_gym.env.single:MovingMassEnv",
                vector_entry_point="mm_gym.env.vector:MovingMassVectorEnv",
                kwargs={"scene": scene},
            )
