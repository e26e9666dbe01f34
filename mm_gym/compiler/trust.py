"""Files that nobody but the user and root can have written: compiled code runs as who loads it."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

try:
    import grp
    import pwd
except ImportError:  # Windows: a user's folders are his own by their access lists
    grp = pwd = None

OTHERS_WRITE = 0o022
"""Permission of the group and of everybody to write."""

_LINK = getattr(os, "O_NOFOLLOW", 0)
_WAITING = getattr(os, "O_NONBLOCK", 0)
"""Options of `os.open` that refuse a link, and do not wait for who writes a pipe."""


class UntrustedError(OSError):
    """A file or a folder that others can have written, or that is no regular file."""


def read_trusted(path: Path) -> bytes:
    """Return the content of a regular file that only the user and root can write.

    What is checked is what is read: the open file, whatever happens to its name meanwhile.

    Raises
    ------
    UntrustedError
        If others can write the file, or it is a link, a pipe or the like.
    OSError
        If it cannot be read.
    """
    with open(path, "rb", opener=_opened) as stream:
        found = os.fstat(stream.fileno())
        if not stat.S_ISREG(found.st_mode):
            problem = f"{path} is no regular file"
            raise UntrustedError(problem)
        _check(path, found)
        return stream.read()


def open_in_place(path: Path, flags: int) -> int:
    """Return the descriptor of a file that is no link, without waiting for anybody.

    Raises
    ------
    UntrustedError
        If it is a link.
    OSError
        If it cannot be opened.
    """
    try:
        return os.open(path, flags | _LINK | _WAITING, 0o644)
    except OSError as error:
        if error.errno in {errno.ELOOP, errno.EMLINK}:  # EMLINK: FreeBSD's word for it
            problem = f"{path} is a link"
            raise UntrustedError(problem) from None
        raise


def _opened(path: str, flags: int) -> int:
    return open_in_place(Path(path), flags)


def check_folder(folder: Path) -> None:
    """Check that only the user and root can change what an absolute path leads to.

    Raises
    ------
    UntrustedError
        If others can write the folder, or put another one in the place of it or of a parent.
    OSError
        If a part of it cannot be looked at, or it is a ring of links.
    """
    for part in (*reversed(folder.parents), folder):
        try:
            found = part.lstat()
        except FileNotFoundError:
            return
        if stat.S_ISLNK(found.st_mode):
            part.stat()  # a ring of links ends here
            _check(part, found, ignored=OTHERS_WRITE)
            check_folder(part.parent / part.readlink())
        else:
            # In a folder with the sticky bit, each removes and renames only what belongs to him.
            is_parent = part != folder
            safe = OTHERS_WRITE if is_parent and found.st_mode & stat.S_ISVTX else 0
            _check(part, found, ignored=safe)


def _check(path: Path, found: os.stat_result, ignored: int = 0) -> None:
    if pwd is None:
        return
    writers = found.st_mode & OTHERS_WRITE & ~ignored
    if writers == stat.S_IWGRP and _is_private(found.st_gid):
        writers = 0
    if writers or found.st_uid not in {0, os.geteuid()}:
        state = f"owner {found.st_uid}, mode {stat.S_IMODE(found.st_mode):04o}"
        problem = f"others than the user and root can write {path} ({state})"
        raise UntrustedError(problem)


def _is_private(group: int) -> bool:
    """Tell whether a group is the user's own, as systems make one of his name for each user."""
    try:
        name, found = pwd.getpwuid(os.geteuid()).pw_name, grp.getgrgid(group)
    except KeyError:
        return False
    return found.gr_name == name and set(found.gr_mem) <= {name}
