"""A scene as the text of a TOML file that states only what differs from the defaults."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, cast

from mm_gym.scene.part import Part
from mm_gym.scene.record_files import with_relative_records

if TYPE_CHECKING:
    from pathlib import Path

    from mm_gym.scene.scene import Scene

BARE = re.compile(r"[A-Za-z0-9_-]+")
"""Keys that need no quotes."""

Table = dict[str, object]


def toml_of(scene: Scene, folder: Path) -> str:
    """Return the text of a scene file, from which `load_scene` reads the same scene.

    Parameters
    ----------
    scene
        The scene.
    folder
        The folder of the file: records are named relative to it.
    """
    data = cast("Table", scene.model_dump(mode="json"))
    tables = _differences(scene.of(with_relative_records(data, folder)))
    blocks = [_block("", {k: v for k, v in tables.items() if not _is_table(v)})]
    for name, value in tables.items():
        if isinstance(value, dict):
            blocks += _tables(name, cast("Table", value))
        elif _is_table(value):
            blocks += [_block(f"[[{name}]]", entry) for entry in cast("list[Table]", value)]
    return "\n".join(block for block in blocks if block) or "# all defaults\n"


def _differences(part: Part) -> Table:
    """Return the fields that differ from their defaults, and the kind of a part that has kinds."""
    found: Table = {}
    for name, value in part:
        field = type(part).model_fields[name]
        default = None if field.is_required() else field.get_default(call_default_factory=True)
        if name == "kind" or value != default:
            found[name] = _plain(value)
    return {name: found[name] for name in sorted(found, key=lambda name: name != "kind")}


def _plain(value: object) -> object:
    if isinstance(value, Part):
        return _differences(value)
    if isinstance(value, tuple):
        return [_plain(entry) for entry in cast("tuple[object, ...]", value)]
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in cast("Table", value).items()}
    return value


def _is_table(value: object) -> bool:
    if isinstance(value, list):
        entries = cast("list[object]", value)
        return bool(entries) and isinstance(entries[0], dict)
    return isinstance(value, dict)


def _tables(name: str, table: Table) -> list[str]:
    """Return the blocks of a table and of those in it, such as an actuator's."""
    inner = {k: cast("Table", value) for k, value in table.items() if isinstance(value, dict)}
    own = {key: value for key, value in table.items() if key not in inner}
    blocks = [_block(f"[{name}]", own)] if own or not inner else []
    for key, value in inner.items():
        blocks += _tables(f"{name}.{_key(key)}", value)
    return blocks


def _block(title: str, table: Table) -> str:
    lines = [title] if title else []
    lines += [f"{_key(key)} = {_value(value)}" for key, value in table.items()]
    return "".join(f"{line}\n" for line in lines)


def _key(name: str) -> str:
    return name if BARE.fullmatch(name) else json.dumps(name, ensure_ascii=False)


def _value(value: object) -> str:
    """Return a value: texts as JSON, whose escapes TOML reads too, numbers with all digits."""
    if isinstance(value, list):
        return f"[{', '.join(_value(entry) for entry in cast('list[object]', value))}]"
    if isinstance(value, dict):
        entries = (f"{_key(key)} = {_value(entry)}" for key, entry in cast("Table", value).items())
        return f"{{ {', '.join(entries)} }}"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value).lower() if isinstance(value, bool) else repr(value)
