"""Functions and classes of a user's own file, named as "file.py:name"."""

from __future__ import annotations

import hashlib
import importlib.util
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mm_gym import SceneError
from mm_gym.errors import suggest
from mm_gym.files import read_text

if TYPE_CHECKING:
    from types import ModuleType


def is_path(text: str) -> bool:
    """Tell whether a text names something in a file."""
    return ".py:" in text or text.endswith(".py")


def load(text: str, what: str) -> Any:  # noqa: ANN401 - what the user wrote
    """Return what a text "file.py:name" names; the file is run.

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
    module = _module(path, what)
    if not hasattr(module, name):
        own = [word for word in vars(module) if not word.startswith("_")]
        msg = f"{what}: {path} has no {name!r}{suggest(name, own)}"
        raise SceneError(msg)
    found = getattr(module, name)
    if not callable(found):
        msg = f"{what}: {name!r} of {path} is a {type(found).__name__}; allowed: what can be called"
        raise SceneError(msg)
    return found


def split(text: str, what: str) -> tuple[Path, str]:
    """Return the path and the name of "file.py:name"; raise `SceneError` for other texts."""
    path, _, name = text.rpartition(":")
    if not path.endswith(".py") or not name.isidentifier():
        msg = f"{what}: got {text!r}; allowed: file.py:name"
        raise SceneError(msg)
    return Path(path), name


def source(path: Path, what: str) -> str:
    """Return the text of a user's file."""
    try:
        return read_text(path)
    except SceneError as error:
        msg = f"{what}: {error}"
        raise SceneError(msg) from None


def _module(path: Path, what: str) -> ModuleType:
    source(path, what)  # a file that cannot be read is named by the setting
    name = f"mm_gym_user_{path.stem}_{hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:8]}"
    specification = importlib.util.spec_from_file_location(name, path)
    assert specification is not None  # noqa: S101 - the path ends in .py
    assert specification.loader is not None  # noqa: S101 - the same
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module  # numba's cache and dataclasses look here
    try:
        specification.loader.exec_module(module)
    except Exception as error:
        msg = f"{what}: {path} cannot be run: {type(error).__name__}: {error}"
        raise SceneError(msg) from error
    return module
