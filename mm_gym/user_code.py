"""Functions and classes of a user's own file, named as "FILE.py:NAME"."""

from __future__ import annotations

import hashlib
import importlib.util
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from mm_gym.errors import SceneError, refuse, suggest
from mm_gym.files import read_text


def is_path(text: str) -> bool:
    """Tell whether a text names something in a file."""
    return ".py:" in text or text.endswith(".py")


def load(text: str, what: str) -> Callable[..., Any]:
    """Return the class or function that a text "FILE.py:NAME" names; the file is run.

    Parameters
    ----------
    what
        The setting, for messages.

    Raises
    ------
    SceneError
        If there is no such file or name, it cannot be called, or the file raises an error.
    """
    path, name = split(text, what)
    own = vars(_module(path, what))
    found = own.get(name)
    if not callable(found):
        names = [key for key, value in own.items() if callable(value) and key[0] != "_"]
        msg = f"{what}: {path}: it has no class or function {name!r}{suggest(name, names)}"
        raise SceneError(msg)
    return found


def split(text: str, what: str) -> tuple[Path, str]:
    """Return the path and the name of "FILE.py:NAME"; raise `SceneError` for other texts."""
    path, _, name = text.rpartition(":")
    if not path.endswith(".py") or not name.isidentifier():
        refuse(what, f"{text!r}", "FILE.py:NAME")
    return Path(path), name


def source(path: Path, what: str) -> str:
    """Return the text of a user's file."""
    try:
        return read_text(path)
    except SceneError as error:
        msg = f"{what}: {error}"
        raise SceneError(msg) from None


def call(what: str, path: Path, function: Callable[..., Any], *arguments: object) -> Any:  # noqa: ANN401 - what the user wrote
    """Call what the user wrote; raise `SceneError` with the line of an exception or exit in it."""
    try:
        return function(*arguments)
    except (Exception, SystemExit) as error:  # a script that ends itself would end the program
        frames = traceback.extract_tb(error.__traceback__)
        own = [frame for frame in frames if Path(frame.filename) == path.absolute()]
        where = f", line {own[-1].lineno}" if own else ""
        msg = f"{what}: {path}{where}: {type(error).__name__}: {error}"
        raise SceneError(msg) from error


def _module(path: Path, what: str) -> ModuleType:
    text = source(path, what)
    name = f"mm_gym_user_{path.stem}_{hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:8]}"
    specification = importlib.util.spec_from_file_location(name, path)
    assert specification is not None  # noqa: S101 - the path ends in .py
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module  # numba's cache and dataclasses look here
    # Python's own loader may run a cached version of a file that was changed within a second.
    call(what, path, lambda: exec(compile(text, path.absolute(), "exec"), vars(module)))  # noqa: S102 - the user's own file
    return module
