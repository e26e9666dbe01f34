"""A ground motion that is given as an array, as a part of a scene's excitation."""

from __future__ import annotations

import warnings
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import SimulationError
from mm_gym.files import write_csv
from mm_gym.plant.compile import compile_scene
from mm_gym.scene.excitation import Recorded

if TYPE_CHECKING:
    from collections.abc import Generator

    from numpy.typing import ArrayLike, NDArray

    from mm_gym.plant.plant import Plant
    from mm_gym.scene.scene import Scene


def shaken(scene: Scene, motion: ArrayLike) -> Plant:
    """Return the plant of a scene whose ground moves also as an array says.

    Parameters
    ----------
    scene
        The scene; its own excitation stays.
    motion
        (k, 2) times [s], which increase from 0 or later, and accelerations [m/s^2].

    Raises
    ------
    SimulationError
        If the array has another shape or is not finite.
    SceneError
        If the times do not increase.
    """
    with record_of(motion) as record:
        return compile_scene(scene.replace(excitation=[*scene.excitation, record]))


@contextmanager
def record_of(motion: ArrayLike) -> Generator[Recorded]:
    """Write a ground motion to a file of its own for a while; raise as `shaken` does."""
    samples = checked_motion(motion)
    with TemporaryDirectory() as folder, _without_warning_of_the_rest():
        file = Path(folder) / "ground.csv"  # the way of every record, all digits are kept
        write_csv(file, ["time [s]", "acceleration [m/s^2]"], list(samples.T))
        yield Recorded(target="ground", file=str(file), unit="m/s^2")


def checked_motion(motion: ArrayLike) -> NDArray[np.float64]:
    """Return a ground motion (k, 2) as numbers.

    Raises
    ------
    SimulationError
        If it has another shape or is not finite.
    """
    samples = np.asarray(motion)
    shape = samples.shape
    if samples.dtype.kind not in "fiu" or samples.ndim != 2 or shape[1] != 2 or shape[0] < 2:  # noqa: PLR2004
        msg = f"ground: got shape {shape}; allowed: (k, 2) times [s] and accelerations [m/s^2]"
        raise SimulationError(msg)
    if not np.isfinite(samples).all():
        msg = "ground: got NaN or infinity; allowed: finite numbers"
        raise SimulationError(msg)
    return samples.astype(np.float64)


@contextmanager
def _without_warning_of_the_rest() -> Generator[None]:
    """Let a simulation be shorter than the ground's motion."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=r"excitation\.\d+: the record lasts")
        yield
