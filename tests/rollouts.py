"""Random actions, and what an environment returns for them."""

import numpy as np

from mm_gym import MovingMassEnv

LANES = 4  # lanes of the vector environment that the fixture `make` of tests/env makes


def random_actions(env, steps, seed=0):
    """Return actions (steps, ...) of an environment, within its bounds."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, (steps, *env.action_space.shape)).astype(np.float32)


def rollout(env, actions):
    """Step, and reset where an episode ends; return all results."""
    seen = []
    for action in actions:
        result = env.step(action)
        seen.append(result)
        if isinstance(env, MovingMassEnv) and (result[2] or result[3]):
            seen.append(env.reset())
    return seen


PUSHING = """
import numpy as np

class Law:
    def __init__(self, scene):
        pass

    def action(self, memory, state, applied):
        return np.sign(state[:, 2:3]), memory
"""
"""A file with a controller that pushes the way that the carriage goes."""
