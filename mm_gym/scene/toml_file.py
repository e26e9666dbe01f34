"""Scene files in TOML, which state only what differs from the defaults."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, cast

from mm_gym.errors import SceneError
from mm_gym.files import parse_toml, read_text
from mm_gym.scene.scene import Scene
from mm_gym.scene.toml_lines import lines_of
from mm_gym.task_files import is_id, path_of

if TYPE_CHECKING:
    from os import PathLike


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
    text = read_text(file)
    data = parse_toml(file, text)
    try:
        return Scene.of(_rooted(data, file.parent))
    except SceneError as error:
        raise SceneError(_with_lines(file, text, str(error))) from None


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
