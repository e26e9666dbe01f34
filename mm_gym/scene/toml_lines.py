"""Line numbers of the names in a TOML file; the standard parser keeps no positions."""

from __future__ import annotations

import tomllib
from typing import TYPE_CHECKING, TypeAlias, cast

from mm_gym.scene.part import dotted_name

if TYPE_CHECKING:
    from collections.abc import Iterator

Path: TypeAlias = tuple[str, ...]

MOST_WORK = 1_000_000
"""Characters parsed again for statements of several lines; later statements get no line."""

DEEPEST = 10
"""Levels of nested names that get a line; a scene has fewer."""


def lines_of(text: str) -> dict[str, int]:
    """Return dotted name -> line of the statement that sets it, for text that is valid TOML.

    The parser itself finds the statements: each is the smallest number of lines that is TOML on its
    own. Names within a value get the line on which the value begins; in a list over several lines,
    the line on which their entry ends.
    """
    lines: dict[str, int] = {}
    table: Path = ()
    counts: dict[Path, int] = {}  # entries so far of each array of tables
    for number, statement, data in _statements(text):
        if data and statement.startswith("["):
            *above, last = _header(data)
            table = (*_resolved(above, counts), last)
            if statement.startswith("[["):
                counts[table] = counts.get(table, 0) + 1
            table = _resolved([last], counts, table[:-1])
            names = [()]
        else:
            names = _names(data)
        for name in names:
            path = (*table, *name)
            for depth in range(1, len(path) + 1):
                lines.setdefault(dotted_name(path[:depth]), number)
    return lines


def _statements(text: str) -> Iterator[tuple[int, str, dict[str, object]]]:
    """Yield line, text and data of each statement; a list of several lines entry by entry first."""
    lines = text.replace("\r\n", "\n").split("\n")
    first, work = 0, 0
    while first < len(lines) and work < MOST_WORK:
        for end in range(first + 1, len(lines) + 1):
            statement = "\n".join(lines[first:end]).lstrip()
            if (data := _parsed(statement)) is not None:
                yield first + 1, statement, data
                first = end
                break
            work += 2 * len(statement)
            if work > MOST_WORK:
                break
            yield end, statement, _parsed(f"{statement}\n]") or {}


def _parsed(text: str) -> dict[str, object] | None:
    """Return the data of a text, or None if it is not TOML."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return None


def _header(data: object) -> list[str]:
    """Return the names in ``[a.b]`` or ``[[a.b]]`` from its data."""
    names: list[str] = []
    while data:
        if isinstance(data, list):
            data = cast("list[object]", data)[0]
        else:
            ((name, data),) = cast("dict[str, object]", data).items()
            names.append(name)
    return names


def _resolved(names: list[str], counts: dict[Path, int], path: Path = ()) -> Path:
    """Return the path of a table; in an array of tables, the path in its last entry."""
    for name in names:
        path = (*path, name)
        if path in counts:
            path = (*path, str(counts[path] - 1))
    return path


def _names(value: object, depth: int = 0) -> Iterator[Path]:
    """Yield the paths of a value and of everything in it."""
    yield ()
    if depth == DEEPEST:
        return
    items: dict[str, object] = {}
    if isinstance(value, dict):
        items = cast("dict[str, object]", value)
    elif isinstance(value, list):
        items = {str(i): entry for i, entry in enumerate(cast("list[object]", value))}
    for name, entry in items.items():
        for path in _names(entry, depth + 1):
            yield (name, *path)
