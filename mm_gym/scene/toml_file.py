"""Scene files in TOML, read and written; they state only what differs from the defaults."""

from __future__ import annotations

import glob
import json
import os
import re
import tomllib
from collections.abc import Callable, Iterator, Sequence
from os import PathLike
from pathlib import Path
from typing import TypeAlias, cast

from mm_gym.errors import SceneError, refuse, suggest
from mm_gym.files import as_path, parse_toml, read_text
from mm_gym.scene.findings import draft_of
from mm_gym.scene.part import KIND, Data, Part, dotted_name, is_known, put
from mm_gym.scene.scene import ERRORS, Scene
from mm_gym.tasks import is_id, path_of, task_called


def with_absolute_records(data: dict[str, object], folder: Path) -> dict[str, object]:
    """Return a scene's fields with the relative paths of records resolved from a folder.

    The data, as in a scene file and not validated, are changed. Absolute paths keep the scene the
    same in another process or working directory.
    """
    place = folder.resolve()
    pattern = Path(glob.escape(str(place)))
    return _changed(
        data,
        lambda path: os.path.normpath(place / path),
        lambda path: os.path.normpath(pattern / path),
    )


def with_relative_records(data: dict[str, object], folder: Path) -> dict[str, object]:
    """Return a valid scene's fields, which are changed, with records named relative to a folder."""
    place = folder.resolve()
    here, pattern = glob.escape(str(Path.cwd())), glob.escape(str(place))
    return _changed(
        data,
        lambda path: Path(os.path.relpath(Path(path).resolve(), place)).as_posix(),
        lambda path: Path(os.path.relpath(Path(here) / path, pattern)).as_posix(),
    )


def _changed(
    data: dict[str, object], file: Callable[[str], str], pattern: Callable[[str], str]
) -> dict[str, object]:
    """Change the paths of files, and of patterns, which are texts in the field "files"."""
    sources = data.get("excitation")
    for source in cast("list[object]", sources) if isinstance(sources, list) else ():
        if isinstance(source, dict):
            entry = cast("dict[str, object]", source)
            one, several = entry.get("file"), entry.get("files")
            if isinstance(one, str) and one:
                entry["file"] = file(one)
            if isinstance(several, str) and several:
                entry["files"] = pattern(several)
            elif isinstance(several, list):
                entry["files"] = [
                    file(path) if isinstance(path, str) and path else path
                    for path in cast("list[object]", several)
                ]
    return data


BASE, DRAWN = "base", "randomization"


def with_base(data: dict[str, object], load: Callable[[str], Scene]) -> dict[str, object]:
    """Return a scene's fields as in a file, those of its base included if it names one.

    Tables go over those of the base field by field, lists and parts of another kind as a whole.
    What the file states is no longer drawn, unless the file draws it too. Channels that a list of
    the file leaves out keep no errors. `load` returns the scene of a task; tasks have no base, so
    there are no cycles.
    """
    for name in data:
        if name != BASE and suggest(name, [BASE]):
            msg = f"{name}: unknown key{suggest(name, [BASE])}"
            raise SceneError(msg)
    if BASE not in data:
        return data
    own = {name: value for name, value in data.items() if name != BASE}
    base = load(_task(data[BASE]))
    stated = {
        name: value
        for name, value in _leaves(own)
        if value != {} or not isinstance(base.value_of(name), Part | dict)
    }
    found = cast("dict[str, Data]", base.model_dump(mode="json"))
    gone = [name for name in stated if not name.startswith(DRAWN)]
    for name, value in stated.items():
        part, _, last = name.rpartition(".")
        if last == KIND and base.value_of(name) != value:
            gone.append(part)
    channels = stated.get("sensors.channels")
    for channel in base.sensors.channels if isinstance(channels, list) else ():
        for what in ERRORS if channel not in cast("list[object]", channels) else ():
            cast("dict[str, dict[str, float]]", found["sensors"])[what].pop(channel, None)
            gone.append(f"sensors.{what}.{channel}")
    follows = {ratio: field for ratio, (field, _) in base.drawn_ratios.items()}
    found[DRAWN] = {
        name: ends
        for name, ends in cast("dict[str, Data]", found[DRAWN]).items()
        if is_known([name, follows.get(name, name)], frozenset(gone))
    }
    put(found, stated)
    return cast("dict[str, object]", found)


def _task(name: object) -> str:
    if not isinstance(name, str):
        refuse("base", f"{name!r}", "the name of a task, in quotes")
    try:
        return task_called(name)
    except SceneError as error:
        msg = f"base: {str(error).removeprefix('task: ')}"
        raise SceneError(msg) from None


def _leaves(table: dict[str, object], prefix: str = "") -> Iterator[tuple[str, object]]:
    """Yield what a file states by dotted name: numbers, texts, whole lists and empty tables."""
    for name, value in table.items():
        if isinstance(value, dict) and value and prefix != f"{DRAWN}.":
            yield from _leaves(cast("dict[str, object]", value), f"{prefix}{name}.")
        else:
            yield prefix + name, value


Names: TypeAlias = tuple[str, ...]

MOST_WORK = 500_000
"""Characters parsed again, of headers and of statements of several lines; later statements get no
line."""

DEEPEST = 10  # levels of nested names that get a line; a scene has fewer


def lines_of(text: str) -> dict[str, int]:
    """Return dotted name -> line of the statement that sets it, for text that is valid TOML.

    The parser itself finds the statements: each is the smallest number of lines that is TOML behind
    the headers of tables before it. Names within a value get the line on which the value begins; in
    a list over several lines, the line on which their entry ends.
    """
    found: dict[str, int] = {}
    lines = text.replace("\r\n", "\n").split("\n")
    headers, first, work = "", 0, 0
    while first < len(lines) and work < MOST_WORK:
        for end in range(first + 1, len(lines) + 1):
            statement = "\n".join(lines[first:end]).lstrip()
            number, data = first + 1, _parsed(headers + statement)
            is_whole = data is not None
            if data is None:  # perhaps a list, entry by entry
                number, data = end, _parsed(f"{headers}{statement}\n]") or {}
            for names in _names(data):
                found.setdefault(dotted_name(names), number)
            work += len(headers) + (0 if is_whole else 2 * len(statement))
            if is_whole:
                headers += f"{statement}\n" if statement.startswith("[") else ""
                first = end
            if is_whole or work > MOST_WORK:
                break
    return found


def _parsed(text: str) -> dict[str, object] | None:
    """Return the data of a text, or None if it is not TOML."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return None


def _names(value: object, outer: Names = ()) -> Iterator[Names]:
    """Yield the names that lead to everything in a value."""
    items: dict[str, object] = {}
    if isinstance(value, dict):
        items = cast("dict[str, object]", value)
    elif isinstance(value, list):
        items = {str(i): entry for i, entry in enumerate(cast("list[object]", value))}
    for name, entry in items.items() if len(outer) < DEEPEST else ():
        yield (*outer, name)
        yield from _names(entry, (*outer, name))


def load_scene(path: str | PathLike[str]) -> Scene:
    """Read a scene from a TOML file.

    Parameters
    ----------
    path
        The file's path, or the id of a registered task, such as "mm_gym/PreStretch-v0".

    Raises
    ------
    SceneError
        If there is no such task, or the file is missing or unreadable, is not TOML, or says
        something that is not allowed. The message lists every finding, each with the path and,
        where it is known, the line.
    """
    return check_scene(path, lambda _scene, _wrong: [])


def check_scene(
    path: str | PathLike[str], further: Callable[[Scene, frozenset[str]], list[str]]
) -> Scene:
    """Read a scene as `load_scene` does, and raise further findings together with its own.

    `further` returns findings, each as "field: text", of a scene, and of a draft of one together
    with the dotted names of what is wrong in it.
    """
    task = path_of(path) if isinstance(path, str) and is_id(path) else None
    file = as_path(path) if task is None else task
    text = read_text(file)
    data = with_absolute_records(parse_toml(file, text), file.parent)
    if task is None:
        try:
            data = with_base(data, load_scene)
        except SceneError as error:
            raise SceneError(_with_lines(file, text, str(error).splitlines())) from None
    try:
        scene, wrong, lines = Scene.of(data), frozenset[str](), list[str]()
    except SceneError as error:
        lines, draft = str(error).splitlines(), draft_of(Scene, data)
        if draft is None:
            raise SceneError(_with_lines(file, text, lines)) from None
        scene, wrong = draft
        wrong |= {line.partition(": ")[0] for line in lines}
    lines += further(scene, wrong)
    if lines:
        raise SceneError(_with_lines(file, text, lines)) from None
    return scene


def _with_lines(file: Path, text: str, findings: list[str]) -> str:
    """Put file and line before each finding."""
    lines = lines_of(text)
    return "\n".join(f"{file}{_place(finding, lines)}: {finding}" for finding in findings)


def _place(finding: str, lines: dict[str, int]) -> str:
    """Return the line of the longest name that a finding begins with; a missing field has none."""
    ends = [match.start() for match in re.finditer(r"[.:]", finding)]
    numbers = [lines[finding[:end]] for end in ends if finding[:end] in lines]
    return f":{numbers[-1]}" if numbers else ""


BARE = re.compile(r"[A-Za-z0-9_-]+")  # keys that need no quotes

Table = dict[str, object]


def toml_of(scene: Scene, folder: Path) -> str:
    """Return the text of a scene file in a folder, from which `load_scene` reads the same scene."""
    data = cast("Table", scene.model_dump(mode="json"))
    tables = _differences(scene.of(with_relative_records(data, folder)))
    blocks = [toml_block("", {k: v for k, v in tables.items() if not _is_table(v)})]
    for name, value in tables.items():
        if isinstance(value, dict):
            blocks += _tables(name, cast("Table", value))
        elif _is_table(value):
            blocks += [toml_block(f"[[{name}]]", entry) for entry in cast("list[Table]", value)]
    return "\n".join(text for text in blocks if text) or "# all defaults\n"


def _differences(part: Part) -> Table:
    """Return the fields that differ from their defaults, and the kind of a part that has kinds."""
    found: Table = {}
    for name, value in part:
        field = type(part).model_fields[name]
        default = None if field.is_required() else field.get_default(call_default_factory=True)
        if name == "kind" or repr(value) != repr(default):  # -0.0 is not 0.0
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
    blocks = [toml_block(f"[{name}]", own)] if own or not inner else []
    for key, value in inner.items():
        blocks += _tables(f"{name}.{_key(key)}", value)
    return blocks


def toml_block(title: str, table: Table) -> str:
    """Return the text of a table behind its title; tables in it are written within a line."""
    lines = [title] if title else []
    lines += [f"{_key(key)} = {_value(value)}" for key, value in table.items()]
    return "".join(f"{line}\n" for line in lines)


def _key(name: str) -> str:
    return name if BARE.fullmatch(name) else json.dumps(name, ensure_ascii=False)


def _value(value: object) -> str:
    """Return a value: texts as JSON, whose escapes TOML reads too, numbers with all digits."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(entry) for entry in cast('Sequence[object]', value))}]"
    if isinstance(value, dict):
        entries = (f"{_key(key)} = {_value(entry)}" for key, entry in cast("Table", value).items())
        return f"{{ {', '.join(entries)} }}"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value).lower() if isinstance(value, bool) else repr(value)
