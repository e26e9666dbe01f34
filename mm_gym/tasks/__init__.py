"""The registered tasks: one scene file each in this folder, whose name gives the task's id.

``pre_stretch.toml`` is "mm_gym/PreStretch-v0", and ``pre_stretch_v1.toml`` would be its version 1.
Such a file is all that a new task needs. Files in ``robust`` are variants of tasks, on rigs that
differ, see ``docs/robustness.md``; their ids are no part of the list of tasks.
"""

from __future__ import annotations

import re
from pathlib import Path

from mm_gym.errors import SceneError, suggest

FOLDER = Path(__file__).parent

_VERSION = re.compile(r"_v(\d+)$")
_ID = re.compile(r"mm_gym/[^/.]+|.*-v\d+")


def ids() -> list[str]:
    """Return the ids of all tasks, in the order of their files."""
    return list(_files(FOLDER))


def robust_ids() -> list[str]:
    """Return the ids of the tasks' variants on rigs that differ."""
    return list(_files(FOLDER / "robust"))


def is_id(text: str) -> bool:
    """Tell whether a text has the form of an id, misspelt ones included, and not that of a path."""
    return _ID.fullmatch(text) is not None


def short_name(task: str) -> str:
    """Return a task's id without what all have in common."""
    return task.removeprefix("mm_gym/").removesuffix("-v0")


def task_called(name: str, file: str = "", where: str = "") -> str:
    """Return the id of a task by its whole name or a short one.

    Parameters
    ----------
    name
        The name.
    file, where
        What file can be in its place, if any, and where it is looked for, for the message.

    Raises
    ------
    SceneError
        If there is no such task; the message has the nearest name.
    """
    tasks = {short_name(task): task for task in (*ids(), *robust_ids())}
    if short_name(name) not in tasks:
        what = f"task or {file}" if file else "task"
        also = f", or a path that ends in .toml{where}" if file else ""
        msg = (
            f"{what}: got {name!r}{suggest(short_name(name), tasks)}; allowed: "
            f"{', '.join(map(short_name, ids()))}, each with Robust behind it too{also}"
        )
        raise SceneError(msg)
    return tasks[short_name(name)]


def task_or_scene(text: str) -> str:
    """Return the id of a task, whose name may be short, or the path of a scene file as it is.

    Raises
    ------
    SceneError
        If a name without a path's ending is that of no task.
    """
    if "/" in text or Path(text).suffix:
        whole = f"{text}-v0"
        return whole if whole in (*ids(), *robust_ids()) else text
    return task_called(text, "scene file")


def path_of(task: str) -> Path:
    """Return the scene file of a task, or raise `SceneError` with the nearest id."""
    files = _files(FOLDER) | _files(FOLDER / "robust")
    if task not in files:
        nearest = suggest(task, files)
        msg = (
            f"task: {task!r} is not a task of mm_gym{nearest}; allowed: {', '.join(ids())}, each "
            "with Robust before its version too"
        )
        raise SceneError(msg)
    return files[task]


def _files(folder: Path) -> dict[str, Path]:
    files = sorted(folder.glob("*.toml"), key=lambda file: file.stem)
    return {_id_of(file.stem): file for file in files}


def _id_of(stem: str) -> str:
    version = _VERSION.search(stem)
    words = stem[: version.start()] if version else stem
    name = "".join(word.capitalize() for word in words.split("_"))
    return f"mm_gym/{name}-v{version[1] if version else 0}"
