"""A linear memory that foretells a random force: the states of its linear predictor.

The force of each step follows from two frames of the observation. Its best linear prediction from
the past has few states: those combinations of the past that tell most of the future (Akaike,
*Markovian representation of stochastic processes by canonical variables*, SIAM J. Control 13,
1975). They are fitted to simulated episodes when a search begins, in a tenth of a second.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from agents.control.scene import ENDLESS
from mm_gym import MovingMassVectorEnv, Scene
from mm_gym.arrays import Array

LANES, STEPS, SEED = 64, 300, 3_000_000
"""Episodes and control steps that are simulated, apart from those of any evaluation."""

PAST, FUTURE = 32, 8  # control steps that tell, and that are foretold
LONGEST = 0.98  # largest eigenvalue of a memory: what is older than some 50 steps is forgotten


def force_memory(scene: Scene, weights: Array, states: int) -> tuple[Array, Array]:
    """Return `keep` (m, m) and `enter` (m, n) of a `LinearMemory`, of unit variance.

    Parameters
    ----------
    scene
        The scene, of random excitation.
    weights
        (n,) the force of the last step is `weights` @ observation.
    states
        m, at most `FUTURE`.
    """
    force = _forces(scene, weights)
    past = sliding_window_view(force[: len(force) - FUTURE], PAST, axis=0)
    future = sliding_window_view(force[PAST:], FUTURE, axis=0)
    predictor = np.linalg.lstsq(_flat(past), _flat(future), rcond=None)[0]
    predicted = past @ predictor
    variances, directions = np.linalg.eigh(np.cov(_flat(predicted), rowvar=False))
    best = slice(None, -states - 1, -1)
    memory = predicted @ (directions[:, best] / np.sqrt(variances[best]))
    before = np.concatenate([memory[:-1], past[1:, :, -1:]], axis=2)
    found = np.linalg.lstsq(_flat(before), _flat(memory[1:]), rcond=None)[0].T
    keep, enter = found[:, :states], found[:, states]
    keep *= min(1.0, LONGEST / np.abs(np.linalg.eigvals(keep)).max())
    return keep, np.outer(enter, weights)


def _forces(scene: Scene, weights: Array) -> Array:
    """Return forces (steps, lanes) under random actions, without those of the first frames."""
    scene = scene.replace(**ENDLESS, **{"control.steps": STEPS})
    env = MovingMassVectorEnv(scene, LANES, info="none")
    observation, _ = env.reset(seed=SEED)
    generator, forces = np.random.default_rng(SEED), []
    for _ in range(STEPS - 1):
        observation, *_ = env.step(generator.uniform(-1.0, 1.0, env.action_space.shape))
        forces.append(observation @ weights)
    return np.array(forces[2:])


def _flat(array: Array) -> Array:
    return array.reshape(-1, array.shape[-1])
