"""Scene files in TOML, which state only what differs from the defaults."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, cast

from mm_gym.errors import SceneError
from mm_gym.files import read_bytes
from mm_gym.scene.scene import Scene
from mm_gym.scene.toml_lines import lines_of
from mm_gym.task_files import is_id, path_of

if TYPE_CHECKING:
    from os import PathLike

MOST_BYTES = 2**16
"""Largest file; a scene takes one or two thousand bytes."""

LONGEST_LINE = 2**11
"""Most characters of a line: the parser's time grows with the square of a dotted key's length."""


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
    file = path_of(path) if isinstance(path, str) and is_id(path) else Path(path)
    text = _read_text(file)
    data = _parse(file, text)
    try:
        return Scene.of(_rooted(data, file.parent))
    except SceneError as error:
        raise SceneError(_with_lines(file, text, str(error))) from None


def _read_text(file: Path) -> str:
    content = read_bytes(file, most=MOST_BYTES)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        msg = f"{file}:{line}: got the byte {content[error.start]:#04x}; allowed: UTF-8"
        raise SceneError(msg) from None


def _parse(file: Path, text: str) -> dict[str, object]:
    for number, line in enumerate(text.split("\n"), 1):
        if len(line) > LONGEST_LINE:
            msg = f"{file}:{number}: got {len(line)} characters; allowed: at most {LONGEST_LINE}"
            raise SceneError(msg)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        words = str(error)
        place = re.search(r" \(at line (\d+), column (\d+)\)$", words)
        if place:
            msg = f"{file}:{place[1]}:{place[2]}: not valid TOML: {words[: place.start()]}"
        else:
            msg = f"{file}: not valid TOML: {words}"
    except ValueError as error:  # an integer with more digits than Python reads
        msg = f"{file}: not valid TOML: {error}"
    except RecursionError:
        msg = f"{file}: not valid TOML: nested too deeply"
    raise SceneError(msg)


def _rooted(data: dict[str, object], folder: Path) -> dict[str, object]:
    """Resolve the relative paths of records from the scene's folder."""
    sources = data.get("excitation")
    for source in cast("list[object]", sources) if isinstance(sources, list) else ():
        if isinstance(source, dict):
            entry = cast("dict[str, object]", source)
            if isinstance(entry.get("file"), str) and entry["file"]:
                entry["file"] = str(folder / cast("str", entry["file"]))
    return data


def _with_lines(file: Path, text: str, findings: str) -> str:
    """Put file and line before each finding."""
    lines = lines_of(text)
    return "\n".join(
        f"{file}{_place(finding, lines)}: {finding}" for finding in findings.splitlines()
    )


def _place(finding: str, lines: dict[str, int]) -> str:
    """Return the line of the longest name that a finding begins with; a missing field has none."""
    ends = [match.start() for match in re.finditer(r"[.:]", finding)]
    numbers = [lines[finding[:end]] for end in ends if finding[:end] in lines]
    return f":{numbers[-1]}" if numbers else ""
