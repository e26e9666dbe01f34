"""Scene files in TOML, which state only what differs from the defaults."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from mm_gym.errors import SceneError
from mm_gym.files import parse_toml, read_text
from mm_gym.scene.base import with_base
from mm_gym.scene.draft import draft_of
from mm_gym.scene.record_files import with_absolute_records
from mm_gym.scene.scene import Scene
from mm_gym.scene.toml_lines import lines_of
from mm_gym.tasks import is_id, path_of

if TYPE_CHECKING:
    from collections.abc import Callable
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
    return check_scene(path, _nothing_further)


def _nothing_further(_scene: Scene, _wrong: frozenset[str]) -> list[str]:
    return []


def check_scene(
    path: str | PathLike[str], further: Callable[[Scene, frozenset[str]], list[str]]
) -> Scene:
    """Read a scene as `load_scene` does, and raise further findings together with its own.

    Parameters
    ----------
    path
        As for `load_scene`.
    further
        Returns findings, each as "field: text", of a scene, and of a draft of one together with the
        dotted names of what is wrong in it.
    """
    task = path_of(path) if isinstance(path, str) and is_id(path) else None
    file = Path(path) if task is None else task
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
