"""The file from which a run continues, in one npz archive of arrays: reading it runs no code."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from agents.network.files import arrays_in
from agents.training.runs import RunError
from mm_gym import SceneError
from mm_gym.errors import refuse
from mm_gym.files import read_bytes, write_bytes

Arrays = dict[str, NDArray[np.generic]]

LARGEST = 4 * 2**30  # of a checkpoint [bytes]: a replay buffer of some ten million steps

COSTS = ("progress/rows", "evolution/costs")  # infinite of what asks for no number

DAMAGE = (
    *(ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError),
    RuntimeError,  # of torch
)
"""What is raised by arrays that are not what they should be."""


def save_checkpoint(path: Path, arrays: Arrays) -> None:
    """Write a checkpoint whole."""
    content = io.BytesIO()
    np.savez(content, **arrays)
    write_bytes(path, content.getvalue())


def load_checkpoint(path: Path) -> Arrays:
    """Read a checkpoint; raise `RunError` if the file is not one."""
    try:
        content = read_bytes(path, most=LARGEST)
    except SceneError as error:
        raise RunError(str(error)) from None
    with damage_named(path):
        arrays = arrays_in(content, most=LARGEST)
        for name, array in arrays.items():
            if array.dtype.kind != "f":
                continue
            if not (np.isfinite(array) | ((name in COSTS) & (array == np.inf))).all():
                refuse(name, "numbers that are not finite", "finite numbers", ValueError)
        arrays["progress/rows"]  # other archives of arrays have none
    return arrays


@contextmanager
def damage_named(path: Path) -> Iterator[None]:
    """Let errors in what a checkpoint holds name its file, as a `RunError`."""
    try:
        yield
    except DAMAGE as error:
        told = f"{error} is missing" if isinstance(error, KeyError) else error
        msg = f"{path}: not a checkpoint of a training with these settings: {told}; "
        raise RunError(msg + "choose another name") from error


def check_like(arrays: Arrays, wanted: Arrays) -> None:
    """Raise `ValueError` or `KeyError` unless arrays are like all that are wanted.

    They have the same type and shape, but any length where that of the wanted one is 0.
    """
    for name, array in wanted.items():
        got = arrays[name]
        shape = tuple(m if n == 0 else n for n, m in zip(array.shape, got.shape, strict=False))
        if got.dtype != array.dtype or got.shape != shape or got.ndim != array.ndim:
            told = (f"{one.dtype} of shape {one.shape}" for one in (got, array))
            refuse(name, *told, ValueError)
