"""A lock on a file: of several processes that need the same machine code, one compiles it."""

from __future__ import annotations

import os
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from mm_gym.compiler.trust import open_in_place

try:
    import fcntl
except ImportError:  # Windows: every process compiles for itself
    fcntl = None

PAUSE = 0.05
"""Time between two attempts [s]."""

PATIENCE = 600.0
"""Time after which a process goes on without the lock [s]: the one that has it may be stopped."""


@contextmanager
def locked(path: Path, patience: float = PATIENCE) -> Generator[bool]:
    """Hold the lock on a file; the value says whether it is held.

    It is not where no such file can be made or locked, or when another process keeps the lock for
    longer than `patience` [s]. The system releases the lock of a process that ends, however it
    ends. Threads of one process are not kept apart: the compiler's own lock does that.
    """
    descriptor = _acquired(path, patience)
    try:
        yield descriptor is not None
    finally:
        if descriptor is not None:
            path.unlink(missing_ok=True)  # before it is released: see `_is_current`
            os.close(descriptor)


def _acquired(path: Path, patience: float) -> int | None:
    """Return the descriptor of the locked file, or None."""
    end = time.monotonic() + patience
    while fcntl is not None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            descriptor = open_in_place(path, os.O_RDWR | os.O_CREAT)
        except OSError:
            return None
        try:
            # Not inherited by a forked process, as `flock`'s would be.
            fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, PermissionError):
            os.close(descriptor)
            if time.monotonic() > end:
                return None
            time.sleep(PAUSE)
            continue
        except OSError:  # a file system without locks
            os.close(descriptor)
            return None
        if _is_current(descriptor, path):
            return descriptor
        os.close(descriptor)
    return None


def _is_current(descriptor: int, path: Path) -> bool:
    """Tell whether a path still leads to a file: the lock of one that was removed is no lock."""
    try:
        there = path.stat()
    except OSError:
        return False
    own = os.fstat(descriptor)
    return (own.st_dev, own.st_ino) == (there.st_dev, there.st_ino)
