"""The file from which a run continues, in one npz archive of arrays: reading it runs no code."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

from agents.policies import DAMAGE
from agents.training.runs import RunError
from mm_gym.files import write_bytes

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    Arrays = dict[str, NDArray[np.generic]]


def save_checkpoint(path: Path, arrays: Arrays) -> None:
    """Write a checkpoint whole."""
    content = io.BytesIO()
    np.savez(content, **arrays)
    write_bytes(path, content.getvalue())


def load_checkpoint(path: Path) -> Arrays:
    """Read a checkpoint; raise `RunError` if the file is not one."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = dict(archive)
        arrays["progress/rows"]  # other archives of arrays have none
    except DAMAGE as error:
        msg = f"{path}: not a checkpoint of a training: {error}; choose another name"
        raise RunError(msg) from error
    return arrays


def part_of(arrays: Arrays, part: str) -> Arrays:
    """Return the arrays whose names begin with a part's name, without it."""
    begin = f"{part}/"
    return {key.removeprefix(begin): arrays[key] for key in arrays if key.startswith(begin)}
