"""What the environments have in common to be drawn: modes, pace, and the renderer's making."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

from mm_gym.errors import SceneError, suggest

if TYPE_CHECKING:
    from mm_gym.rendering.renderer import Renderer
    from mm_gym.scene.scene import Scene
    from mm_gym.simulation.lanes import Lanes

SINGLE_MODES = ["human", "rgb_array"]
"""Modes that a single environment declares: for ``"rgb_array_list"``, which it knows too,
`gymnasium.make` puts a wrapper of its own around it."""

RENDER_MODES = [*SINGLE_MODES, "rgb_array_list"]


def renderer_of(scene: Scene, lanes: Lanes, mode: str | None) -> Renderer | None:
    """Return what draws an environment in a mode, None if nothing can or is to be drawn.

    Gymnasium makes environments with modes that they do not have, and warns. So does this.
    """
    if mode is None:
        return None
    if mode not in RENDER_MODES:
        warnings.warn(_unknown(mode), UserWarning, stacklevel=2)
        return None
    from mm_gym.rendering.renderer import Renderer  # noqa: PLC0415 - not needed without pictures

    return Renderer(scene, lanes, mode)


def rendered(renderer: Renderer | None, mode: str | None) -> list[Any] | None:
    """Return each lane's picture or list of them, None if nothing is to be drawn.

    Raises
    ------
    SceneError
        If there is no such mode.
    """
    if renderer is None and mode is not None:
        raise SceneError(_unknown(mode))
    return None if renderer is None else renderer.render()


def _unknown(mode: str) -> str:
    nearest = suggest(str(mode), RENDER_MODES)
    return f"render_mode: got {mode!r}{nearest}; allowed: None, {', '.join(RENDER_MODES)}"
