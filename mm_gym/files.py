"""Reading files up to a limit of size, TOML among them, and writing them whole.

A killed run leaves the old file or the new one, never a part of one.
"""

from __future__ import annotations

import csv
import io
import os
import re
import stat
import tempfile
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import SceneError, suggest

if TYPE_CHECKING:
    from collections.abc import Sequence
    from os import PathLike

    from numpy.typing import ArrayLike


MOST_BYTES = 2**16
"""Largest text file; a scene takes one or two thousand bytes."""

LONGEST_LINE = 2**11
"""Most characters of a line: the parser's time grows with the square of a dotted key's length."""


def read_bytes(path: str | PathLike[str], *, most: int) -> bytes:
    """Return the content of a regular file of at most `most` bytes, without ever waiting for it.

    Raises
    ------
    SceneError
        If there is no such file, or it cannot be read, is too large, or is not a regular file but
        a directory, a device, a pipe, or a file that the system makes up when it is read.
    """
    file = Path(path)
    try:
        _check_regular(file, file.stat(), most)
        with _opened(file) as stream:
            size = _check_regular(file, os.fstat(stream.fileno()), most)
            content = stream.read(size + 1)
    except SceneError:
        raise
    except FileNotFoundError:
        nearest = suggest(file.name, [other.name for other in file.parent.glob("*")])
        msg = f"{file}: no such file{nearest}"
        raise SceneError(msg) from None
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the path
        msg = f"{file}: cannot be read: {error}"
        raise SceneError(msg) from error
    if content is None or len(content) > size:  # pyright: ignore[reportUnnecessaryComparison] - None: nothing to read yet
        msg = f"{file}: cannot be read: not a regular file: it states {size} bytes and holds more"
        raise SceneError(msg)
    return content


def _opened(file: Path) -> io.BufferedReader:
    """Open a file whose reads do not wait, and take no more from it than they are asked for."""
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    return io.BufferedReader(io.FileIO(os.open(file, flags), "rb"), buffer_size=1)


def _check_regular(file: Path, status: os.stat_result, most: int) -> int:
    """Return the size of a regular file [bytes], or refuse it."""
    if not stat.S_ISREG(status.st_mode):
        msg = f"{file}: cannot be read: not a file but a directory or a device"
        raise SceneError(msg)
    if status.st_size > most:
        msg = f"{file}: cannot be read: {status.st_size} bytes; allowed: at most {most}"
        raise SceneError(msg)
    return status.st_size


def read_toml(path: str | PathLike[str]) -> dict[str, object]:
    """Return the data of a TOML file; raise `SceneError` if it is not one, with the line."""
    return parse_toml(path, read_text(path))


def read_text(path: str | PathLike[str], *, most: int = MOST_BYTES) -> str:
    """Return the text of a file in UTF-8, of at most `most` bytes; see `read_bytes`."""
    content = read_bytes(path, most=most)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        msg = f"{path}:{line}: got the byte {content[error.start]:#04x}; allowed: UTF-8"
        raise SceneError(msg) from None


def parse_toml(path: str | PathLike[str], text: str) -> dict[str, object]:
    """Return the data of a TOML file's text; raise `SceneError` if it is not TOML."""
    for number, line in enumerate(text.split("\n"), 1):
        if len(line) > LONGEST_LINE:
            msg = f"{path}:{number}: got {len(line)} characters; allowed: at most {LONGEST_LINE}"
            raise SceneError(msg)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        words = str(error)
        place = re.search(r" \(at line (\d+), column (\d+)\)$", words)
        if place:
            msg = f"{path}:{place[1]}:{place[2]}: not valid TOML: {words[: place.start()]}"
        else:
            msg = f"{path}: not valid TOML: {words}"
    except ValueError as error:  # an integer with more digits than Python reads
        msg = f"{path}: not valid TOML: {error}"
    except RecursionError:
        msg = f"{path}: not valid TOML: nested too deeply"
    raise SceneError(msg)


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
