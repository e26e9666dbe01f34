"""Packages that are optional: mm_gym's extras install them."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from gymnasium.error import DependencyNotInstalled


def optional(module: str, remedy: str) -> Any:  # noqa: ANN401 - a module
    """Return a module; raise `DependencyNotInstalled` with a remedy if there is none."""
    try:
        return import_module(module)
    except ImportError as error:
        raise DependencyNotInstalled(remedy) from error
