"""Access to the entries of a scene's data by dotted names, such as "excitation.0.phase"."""

from __future__ import annotations

from typing import TypeAlias, cast

from mm_gym.errors import SceneError, suggest
from mm_gym.scene.part import Part

Data: TypeAlias = "dict[str, Data] | list[Data] | str | float | bool | None"
"""A part as plain data, as in a file."""


def put(data: dict[str, Data], name: str, value: object) -> None:
    """Set the entry of plain data that a dotted name refers to."""
    *path, last = name.split(".")
    if path and path[0] == "randomization":  # its keys are dotted names, and may be new
        path, last = ["randomization"], name.removeprefix("randomization.")
        data["randomization"] = {last: None, **cast("dict[str, Data]", data["randomization"])}
    holder: Data = data
    for word in path:
        holder = _entry(holder, word, name)
    _entry(holder, last, name)
    plain = cast("Data", value.model_dump(mode="json") if isinstance(value, Part) else value)
    if isinstance(holder, dict):
        holder[last] = plain
    elif isinstance(holder, list):
        holder[int(last)] = plain


def _entry(holder: Data, word: str, name: str) -> Data:
    if isinstance(holder, dict) and word in holder:
        return holder[word]
    if isinstance(holder, list) and word.isdecimal() and int(word) < len(holder):
        return holder[int(word)]
    nearest = suggest(word, holder) if isinstance(holder, dict) else ""
    msg = f"{name}: there is no {word!r}{nearest}"
    raise SceneError(msg)
