"""Compilation ahead of use: what a scene needs, kept on disk for the processes to come."""

from __future__ import annotations

import time
import warnings
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.compiler.jit import OBSTACLE
from mm_gym.compiler.notice import NOT_KEPT
from mm_gym.plant.compile import compile_scene
from mm_gym.simulation.lanes import Lanes
from mm_gym.simulation.simulate import simulate

if TYPE_CHECKING:
    from mm_gym.scene.scene import Scene


def warm(scene: Scene) -> float:
    """Compile the kernels that environments of a scene need, and `simulate`; return the seconds.

    Raises
    ------
    OSError
        If the compiled code cannot be kept.
    """
    if OBSTACLE is not None:
        message = f"nothing can be kept: {OBSTACLE}"
        raise OSError(message)
    start = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RuntimeWarning)
        plant = compile_scene(scene)
        if plant.actuators:
            lanes = Lanes(plant, 1)
            lanes.advance_of(np.dtype(np.float32))
            lanes.seed(0)
            lanes.restart()
            lanes.observations()
        simulate(plant, duration=scene.control.time_step, seed=0)
    for warning in caught:
        message = str(warning.message)
        if message.startswith(NOT_KEPT):
            raise OSError(message)
        warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)
    return time.perf_counter() - start
