"""Registration of the tasks with Gymnasium, which imports mm_gym for "mm_gym:mm_gym/<task>"."""

from __future__ import annotations

import gymnasium

from mm_gym.tasks import ids, robust_ids


def register_envs() -> None:
    """Register every task, and every variant of one, that is not registered yet.

    By its id, not by its scene: so specifications can be written as JSON, and no scene is checked
    here. Without a number of steps: the scene ends its episodes, and Gymnasium's `TimeLimit` would
    cut those that `changes` makes longer.
    """
    for name in (*ids(), *robust_ids()):
        if name not in gymnasium.registry:
            gymnasium.register(  # pyright: ignore[reportUnknownMemberType] - its own annotation
                id=name,
                entry_point="mm_gym.env.single:MovingMassEnv",
                vector_entry_point="mm_gym.env.vector:MovingMassVectorEnv",
                kwargs={"scene": name},
            )
