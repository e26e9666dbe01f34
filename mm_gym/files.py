"""Reading regular files up to a limit of size, TOML and JSON among them, and writing them whole.

A killed run leaves the old file or the new one, never a part of one.
"""

from __future__ import annotations

import csv
import errno
import io
import json
import math
import os
import re
import secrets
import stat
import sys
import tomllib
from collections.abc import Generator, Sequence
from contextlib import contextmanager, suppress
from os import PathLike
from pathlib import Path
from typing import NoReturn, cast

import numpy as np
from numpy.typing import ArrayLike

from mm_gym.arrays import Array
from mm_gym.errors import SceneError, refuse, suggest

MOST_BYTES = 2**16  # largest text file; a scene takes one or two thousand bytes

LONGEST_LINE = 2**11
"""Most characters of a line: the parser's time grows with the square of a dotted key's length."""

DEEPEST = 64  # levels of lists and tables in each other, so that code may recurse through them


def as_path(path: object) -> Path:
    """Return a path; refuse what is none, such as None."""
    if not isinstance(path, str | PathLike):
        refuse("path", f"{path!r:.60}", "the path of a file, as text or pathlib.Path")
    return Path(cast("str | PathLike[str]", path))


def read_bytes(path: str | PathLike[str], *, most: int) -> bytes:
    """Return the content of a regular file of at most `most` bytes, without ever waiting for it.

    Raises
    ------
    SceneError
        If there is no such file, or it cannot be read, is too large, or is not a regular file but
        a directory, a device, a pipe, or a file that the system makes up when it is read.
    """
    with _regular(path, most) as (stream, size):
        content = stream.read(size + 1)
    if content is None or len(content) > size:  # pyright: ignore[reportUnnecessaryComparison] - None: nothing to read yet
        msg = f"{path}: cannot be read: not a regular file: it states {size} bytes and holds more"
        raise SceneError(msg)
    return content


def read_beginning(path: str | PathLike[str], count: int) -> bytes:
    """Return the first bytes of a regular file of any size; raise as `read_bytes` does."""
    with _regular(path, sys.maxsize) as (stream, _):
        return stream.read(count) or b""


@contextmanager
def _regular(path: str | PathLike[str], most: int) -> Generator[tuple[io.BufferedReader, int]]:
    """Open a regular file of at most `most` bytes, and state its size [bytes]."""
    file = as_path(path)
    try:
        _check_regular(file, file.stat(), most)
        with _opened(file) as stream:
            yield stream, _check_regular(file, os.fstat(stream.fileno()), most)
    except SceneError:
        raise
    except FileNotFoundError:
        others = {other.name for other in file.parent.glob("*")} - {file.name}  # a link to nothing
        nearest = suggest(file.name, others)
        msg = f"{file}: no such file{nearest}"
        raise SceneError(msg) from None
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the path
        msg = f"{file}: cannot be read: {error}"
        raise SceneError(msg) from error


_BINARY = getattr(os, "O_BINARY", 0)  # where the system would else rewrite the ends of lines
_AT_ONCE = getattr(os, "O_NONBLOCK", 0)  # without waiting


def _opened(file: Path) -> io.BufferedReader:
    """Open a file whose reads do not wait, and take no more from it than they are asked for."""
    flags = os.O_RDONLY | _AT_ONCE | _BINARY
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
            refuse(f"{path}:{number}", f"{len(line)} characters", f"at most {LONGEST_LINE}")
    try:
        data = tomllib.loads(text)
        _check_depth(data)
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
        msg = f"{path}: not valid TOML: {_TOO_DEEP}"
    else:
        return data
    raise SceneError(msg)


_TOO_DEEP = f"nested too deeply; allowed: at most {DEEPEST} levels"


def _check_depth(data: object) -> None:
    """Raise `RecursionError` for data that is nested too deeply, without any recursion."""
    level: list[object] = [data]
    for _ in range(DEEPEST):
        inner: list[object] = []
        for value in level:
            if isinstance(value, dict):
                inner += cast("dict[str, object]", value).values()
            elif isinstance(value, list):
                inner += cast("list[object]", value)
        if not inner:
            return
        level = inner
    raise RecursionError


def read_json(path: str | PathLike[str], *, most: int) -> object:
    """Return the data of a JSON file of at most `most` bytes.

    Raises
    ------
    SceneError
        If the file cannot be read, see `read_bytes`, or is not JSON in UTF-8 of finite numbers and
        of at most `DEEPEST` levels.
    """
    text = read_text(path, most=most)
    try:
        return parse_json(text)
    except ValueError as error:
        msg = f"{path}: not valid JSON: {error}"
        raise SceneError(msg) from None


def parse_json(text: str) -> object:
    """Return the data of a JSON text; raise `ValueError` for what `read_json` refuses."""
    try:
        data = json.loads(text, parse_constant=_refuse_constant, parse_float=_finite)
        _check_depth(data)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    return data


def _refuse_constant(text: str) -> NoReturn:
    msg = f"got {text}; allowed: finite numbers"
    raise ValueError(msg)


def _finite(text: str) -> float:
    value = float(text)
    return value if math.isfinite(value) else _refuse_constant(text[:40])


def read_columns(
    path: str | PathLike[str], header: Sequence[str], *, infinite: bool = False
) -> Array:
    """Return the columns (columns, rows) of numbers that `write_csv` wrote.

    They are finite, or infinite where that is allowed too, but not NaN.

    Raises
    ------
    SceneError
        If the file cannot be read, see `read_bytes`, has another header or no row, or for the first
        line that does not fit.
    """
    first, *lines = read_text(path, most=2**24).splitlines() or [""]
    if first != ",".join(header):
        refuse(f"{path}:1", f"{first[:80]!r}", f"{','.join(header)!r}")
    allowed = "numbers" if infinite else "finite numbers"
    rows: list[list[float]] = []
    for number, line in enumerate(lines, 2):
        try:
            row = [float(cell) for cell in line.split(",")]
        except ValueError:
            row = []
        fits = (math.isfinite(value) or (infinite and value == math.inf) for value in row)
        if len(row) != len(header) or not all(fits):
            refuse(f"{path}:{number}", f"{line[:80]!r}", f"{len(header)} {allowed}")
        rows.append(row)
    if not rows:
        refuse(f"{path}", "no rows", "one or more below the header")
    return np.array(rows).T


def open_lock(path: str | PathLike[str]) -> int:
    """Open a file that serves as a lock, and make it if need be; return its descriptor.

    Nothing that a link leads to is opened or made: a holder writes its name into a lock.

    Raises
    ------
    SceneError
        If there is a link, or anything else that is no regular file.
    OSError
        If the file cannot be opened or made.
    """
    flags = os.O_RDWR | os.O_CREAT | _AT_ONCE | getattr(os, "O_NOFOLLOW", 0)
    file = Path(path)
    if file.is_symlink() or (file.exists() and not file.is_file()):
        msg = f"{path}: cannot be a lock: not a regular file; remove it"
        raise SceneError(msg)
    descriptor = os.open(file, flags, 0o666)  # O_NOFOLLOW: a link may have been made meanwhile
    try:
        _check_regular(file, os.fstat(descriptor), MOST_BYTES)
    except SceneError:
        os.close(descriptor)
        raise
    return descriptor


def delete_partial(path: str | PathLike[str]) -> None:
    """Delete what a process left that was killed while `write_bytes` wrote a file, if it did."""
    file = Path(path)
    pattern = re.compile(re.escape(_partial(file)) + rf"[0-9a-f]{{{2 * _RANDOM_BYTES}}}")
    for other in file.parent.iterdir():
        if pattern.fullmatch(other.name) and stat.S_ISREG(other.lstat().st_mode):
            other.unlink()


def _partial(file: Path) -> str:
    """Return how the names of a file's temporary ones begin."""
    return f".{file.name[:50]}."


_RANDOM_BYTES = 8  # in the name of a temporary file


def write_text(path: str | PathLike[str], text: str) -> None:
    """Write text in UTF-8 as `write_bytes` does bytes."""
    write_bytes(path, text.encode())


def write_bytes(path: str | PathLike[str], content: bytes) -> None:
    """Write a file whole, or write to a device or pipe.

    A file is written next to its path and renamed, with the mode and owner of the one that it
    replaces; missing folders are created. A link stays, and what it leads to is written.

    Raises
    ------
    SceneError
        If it is no path, or an empty one, or that of a folder, a socket or a block device.
    OSError
        If the path cannot be written to; a file that was there is then unchanged.
    """
    target = _target(path)
    with _named(path):
        if isinstance(target, Path) and (not target.exists() or target.is_file()):
            _replace(target, content)
        else:
            _write_through(target, content)


def check_outputs(
    outputs: Sequence[str | PathLike[str]], inputs: Sequence[str | PathLike[str]] = ()
) -> None:
    """Raise, before anything is computed, if an output could not be written or would do harm.

    Raises
    ------
    SceneError
        If an output is also an input or another output, or what `write_bytes` refuses.
    OSError
        If an output cannot be written to.
    """
    targets = [_target(output) for output in outputs]
    for output, target in zip(outputs, targets, strict=True):
        if any(_same(target, Path(file)) for file in inputs):
            msg = f"{output}: cannot be written: it is an input of this command"
            raise SceneError(msg)
        once = isinstance(target, int) or (target.exists() and not target.is_file())
        if not once and targets.count(target) > 1:
            msg = f"{output}: cannot be written: it is named for two outputs"
            raise SceneError(msg)


def _target(path: str | PathLike[str]) -> Path | int:
    """Return the path that links lead to, or the number of an open file, such as standard output.

    Raise if it cannot be written to.
    """
    as_path(path)
    if not os.fspath(path):
        msg = "cannot be written: the path is empty; allowed: the path of a file"
        raise SceneError(msg)
    with _named(path):
        target = _followed(Path(path))
        status = os.fstat(target) if isinstance(target, int) else _status(target)
    kind = stat.S_IFMT(status.st_mode) if status else stat.S_IFREG
    if isinstance(target, int):
        return target
    if kind in _REFUSED or os.fspath(path).endswith("/"):
        msg = f"{path}: cannot be written: it is {_REFUSED.get(kind, 'the path of a folder')}"
        raise SceneError(msg)
    with _named(path):
        _check_permission(target, kind)
    return target


_REFUSED = {stat.S_IFDIR: "a folder", stat.S_IFSOCK: "a socket", stat.S_IFBLK: "a block device"}
"""Kinds of files that nobody means to write a table or a figure to."""

_DESCRIPTORS = re.compile(r"/dev/fd|/proc/(\d+)(/task/\d+)?/fd")
"""Folders of open files. To open one anew would write from its beginning, over what it holds."""

_MOST_LINKS = 40  # as in Linux


def _followed(path: Path) -> Path | int:
    for _ in range(_MOST_LINKS):
        path = Path(os.path.realpath(path.parent)) / path.name
        place = _DESCRIPTORS.fullmatch(str(path.parent))
        if place and place[1] in {None, str(os.getpid())} and path.name.isdecimal():
            return int(path.name)
        if not path.is_symlink():
            return path
        path = path.parent / path.readlink()
    raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))


def _status(path: Path) -> os.stat_result | None:
    try:
        return path.lstat()
    except FileNotFoundError:
        return None


def _check_permission(target: Path, kind: int) -> None:
    """Raise if what exists of a path, a file or the folders above it, cannot be written to."""
    folder = target.parent
    while not folder.exists():
        folder = folder.parent
    if not folder.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
    places = [target] if target.exists() else []
    if kind == stat.S_IFREG:
        places.append(folder)
    if not all(os.access(place, os.W_OK) for place in places):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


def _same(target: Path | int, file: Path) -> bool:
    try:
        return os.path.samestat(os.stat(target), file.stat())  # noqa: PTH116 - numbers too
    except (OSError, ValueError):  # one of them does not exist
        return False


@contextmanager
def _named(path: str | PathLike[str]) -> Generator[None]:
    """Let the system's errors name the path that was asked for."""
    try:
        yield
    except OSError as error:
        msg = f"{path}: cannot be written: {error.strerror or error}"
        raise type(error)(msg) from error
    except ValueError as error:  # a zero byte in the path
        msg = f"{path!r}: cannot be written: {error}"
        raise SceneError(msg) from error


def _replace(target: Path, content: bytes) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    old = _status(target)
    mode = stat.S_IMODE(old.st_mode) if old else 0o666  # less the umask
    temporary = target.with_name(_partial(target) + secrets.token_hex(_RANDOM_BYTES))
    handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _BINARY, mode & 0o777)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(handle)
        if old:
            new = temporary.stat()
            if (new.st_uid, new.st_gid) != (old.st_uid, old.st_gid):
                with suppress(OSError):  # only root gives files away
                    os.chown(temporary, old.st_uid, old.st_gid)
            temporary.chmod(mode)
        temporary.replace(target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def _write_through(target: Path | int, content: bytes) -> None:
    for printed in (sys.stdout, sys.stderr):
        printed.flush()  # what was printed before comes before
    number = isinstance(target, int)
    handle = os.dup(target) if number else os.open(target, os.O_WRONLY | _BINARY)
    with os.fdopen(handle, "wb") as stream:
        stream.write(content)


def aligned(rows: Sequence[Sequence[str]], names: int = 1) -> list[str]:
    """Return the lines of a table: the first columns, names, to the left, all others to the right.

    The rows have the same number of cells.
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if k < names else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def write_csv(
    path: str | PathLike[str], header: Sequence[str], columns: Sequence[ArrayLike]
) -> None:
    """Write columns with a header line; numbers keep all their digits, commas are quoted."""
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(header)
    lines.writerows(zip(*(np.asarray(column).tolist() for column in columns), strict=True))
    write_text(path, text.getvalue())
