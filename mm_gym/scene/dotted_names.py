"""Access to the entries of a scene's data by dotted names, such as "excitation.0.phase"."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias, cast

import numpy as np

from mm_gym.errors import SceneError
from mm_gym.scene.part import Part

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

Data: TypeAlias = "dict[str, Data] | list[Data] | str | float | bool | None"
"""A part as plain data, as in a file."""

KIND = "kind"


def put(data: dict[str, Data], changes: Mapping[str, object]) -> None:
    """Set the entries of plain data that dotted names refer to.

    A table that is not there is made, and a name is not checked, as if a file said it. A part whose
    kind changes keeps none of its other entries.

    Raises
    ------
    SceneError
        If a list has no entry of a number.
    """
    for name, value in sorted(changes.items(), key=lambda change: not _is_kind(change[0])):
        *path, last = _words(name)
        holder = _table(data, path, name)
        if last == KIND and isinstance(holder, dict) and holder.get(KIND) != value:
            holder.clear()
        if isinstance(holder, list):
            holder[_index(holder, last, name)] = plain(value)
        else:
            holder[last] = plain(value)


def plain(value: object) -> Data:
    """Return a value as JSON and TOML have it: parts as tables, tuples and arrays as lists."""
    if isinstance(value, Part):
        return cast("Data", value.model_dump(mode="json"))
    if isinstance(value, np.ndarray | np.generic):
        return cast("Data", cast("NDArray[np.generic]", value).tolist())
    if isinstance(value, dict):
        items = cast("dict[str, object]", value).items()
        return {name: plain(entry) for name, entry in items}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in cast("list[object]", value)]
    return cast("Data", value)


def _is_kind(name: str) -> bool:
    return name.rpartition(".")[2] == KIND


def _words(name: str) -> list[str]:
    """Return the words of a dotted name; those drawn are named as a whole."""
    first, dot, rest = name.partition(".")
    return [first, rest] if dot and first == "randomization" else name.split(".")


def _table(data: dict[str, Data], path: list[str], name: str) -> dict[str, Data] | list[Data]:
    """Return the table or list at the end of a path, made if there is none."""
    holder: dict[str, Data] | list[Data] = data
    for word in path:
        if isinstance(holder, list):
            index = _index(holder, word, name)
            inner = holder[index] = _opened(holder[index])
        else:
            inner = holder[word] = _opened(holder.get(word))
        holder = inner
    return holder


def _opened(entry: Data) -> dict[str, Data] | list[Data]:
    return entry if isinstance(entry, dict | list) else {}


def _index(entries: list[Data], word: str, name: str) -> int:
    if word.isascii() and word.isdecimal() and int(word) < len(entries):
        return int(word)
    allowed = f"0 to {len(entries) - 1}" if entries else "none, the list is empty"
    msg = f"{name}: there is no entry {word!r}; allowed: {allowed}"
    raise SceneError(msg)
