"""Reading files up to a limit of size, and writing them whole.

A killed run leaves the old file or the new one, never a part of one.
"""

from __future__ import annotations

import csv
import io
import os
import stat
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import SceneError, suggest

if TYPE_CHECKING:
    from collections.abc import Sequence
    from os import PathLike

    from numpy.typing import ArrayLike


def read_bytes(path: str | PathLike[str], *, most: int) -> bytes:
    """Return the content of a file of at most `most` bytes; raise `SceneError` if that fails."""
    file = Path(path)
    content = b""
    try:
        status = file.stat()
        regular = stat.S_ISREG(status.st_mode)
        if regular and status.st_size <= most:
            content = file.read_bytes()
    except FileNotFoundError:
        nearest = suggest(file.name, [other.name for other in file.parent.glob("*")])
        msg = f"{file}: no such file{nearest}"
        raise SceneError(msg) from None
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the path
        msg = f"{file}: cannot be read: {error}"
        raise SceneError(msg) from error
    if not regular:
        msg = f"{file}: cannot be read: not a file but a directory or a device"
        raise SceneError(msg)
    if status.st_size > most:
        msg = f"{file}: cannot be read: {status.st_size} bytes; allowed: at most {most}"
        raise SceneError(msg)
    return content


def write_text(path: str | PathLike[str], text: str) -> None:
    """Write text to a temporary file and rename it to the path; missing folders are created."""
    write_bytes(path, text.encode())


def write_bytes(path: str | PathLike[str], content: bytes) -> None:
    """Write bytes as `write_text` does text."""
    file = Path(path)
    file.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}.")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
        Path(temporary).chmod(0o644)
        Path(temporary).replace(file)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def write_csv(
    path: str | PathLike[str], header: Sequence[str], columns: Sequence[ArrayLike]
) -> None:
    """Write columns with a header line; numbers keep all their digits, commas are quoted."""
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(header)
    lines.writerows(zip(*(np.asarray(column).tolist() for column in columns), strict=True))
    write_text(path, text.getvalue())
