"""Where the records of a scene are: relative to a folder in a file, absolute in a scene."""

from __future__ import annotations

import glob
import os
from pathlib import Path
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from collections.abc import Callable


def with_absolute_records(data: dict[str, object], folder: Path) -> dict[str, object]:
    """Return a scene's fields with the relative paths of records resolved from a folder.

    They are absolute, so that the scene is the same in another process or working directory.

    Parameters
    ----------
    data
        The fields as in a scene file, not validated, which are changed.
    folder
        The folder of the file.
    """
    place = folder.resolve()
    pattern = Path(glob.escape(str(place)))
    return _changed(
        data,
        lambda path: os.path.normpath(place / path),
        lambda path: os.path.normpath(pattern / path),
    )


def with_relative_records(data: dict[str, object], folder: Path) -> dict[str, object]:
    """Return a scene's fields with the paths of records relative to a folder.

    Parameters
    ----------
    data
        The fields of a valid scene, which are changed.
    folder
        The folder of the file that they are written to.
    """
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
