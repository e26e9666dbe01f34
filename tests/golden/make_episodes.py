"""Records an episode of every task: ``python tests/golden/make_episodes.py > FILE``.

Not a reference from elsewhere: it shows that a change of the code changed no number.
"""

import json
import sys

import gymnasium
import numpy as np

from mm_gym.tasks import ids

LANES = 4


def episode(name):
    """Return states and sum of rewards of each lane at the end, under random actions."""
    env = gymnasium.make_vec(name, num_envs=LANES, vectorization_mode="vector_entry_point")
    env.reset(seed=3)
    rng, rewards = np.random.default_rng(0), np.zeros(LANES)
    for _ in range(env.unwrapped.scene.control.steps):
        actions = rng.uniform(-1.2, 1.2, env.action_space.shape).astype(np.float32)
        observations, reward, *_, info = env.step(actions)
        rewards += reward
    return {
        "state": info["state"].tolist(),
        "rewards": rewards.tolist(),
        "observation": observations.tolist(),
    }


if __name__ == "__main__":
    json.dump({name: episode(name) for name in ids()}, sys.stdout, indent=1)
