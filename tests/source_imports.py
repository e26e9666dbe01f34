"""Imports of the package's own modules, read from the sources."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import TYPE_CHECKING

import mm_gym

if TYPE_CHECKING:
    from collections.abc import Iterator

PACKAGE = Path(mm_gym.__file__).parent


def imported_by(file: Path) -> set[str]:
    """Return the modules of mm_gym that a file imports when it runs."""
    found: set[str] = set()
    for node in _running(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            modules = {name for name in inner if file_of(name).exists()}
            found |= modules or {node.module}
    return {name for name in found if name.split(".")[0] == "mm_gym"}


def file_of(module: str) -> Path:
    """Return where a module would be."""
    return PACKAGE.parent.joinpath(*module.split(".")).with_suffix(".py")


def _running(node: ast.AST) -> Iterator[ast.AST]:
    """Walk through what is not for type checkers alone."""
    yield node
    for child in ast.iter_child_nodes(node):
        if not (isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"):
            yield from _running(child)
