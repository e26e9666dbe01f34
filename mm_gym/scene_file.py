"""Scenes in files, holding only what differs from the defaults.

TOML has typed numbers and refuses duplicate keys.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

from mm_gym.errors import SceneError, suggest
from mm_gym.scene import Scene

if TYPE_CHECKING:
    from os import PathLike


def load_scene(path: str | PathLike[str]) -> Scene:
    """Read a scene from a TOML file.

    Raises
    ------
    SceneError
        If the file is missing or unreadable, is not TOML, or says something that is not allowed.
        The message begins with the path and lists every finding.
    """
    file = Path(path)
    try:
        data = tomllib.loads(file.read_text(encoding="utf-8"))
        return Scene(**data)
    except FileNotFoundError:
        siblings = [other.name for other in file.parent.glob("*.toml")]
        msg = f"{file}: no such file{suggest(file.name, siblings)}"
        raise SceneError(msg) from None
    except (OSError, UnicodeDecodeError) as error:
        msg = f"{file}: cannot be read: {error}"
        raise SceneError(msg) from error
    except tomllib.TOMLDecodeError as error:
        msg = f"{file}: not valid TOML: {error}"
        raise SceneError(msg) from error
    except SceneError as error:
        msg = "\n".join(f"{file}: {line}" for line in str(error).splitlines())
        raise SceneError(msg) from None
