"""What the environments have in common to be drawn: modes, pace, and the renderer's making."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mm_gym.errors import SceneError, suggest

if TYPE_CHECKING:
    from mm_gym.rendering.renderer import Renderer
    from mm_gym.scene.scene import Scene
    from mm_gym.simulation.lanes import Lanes

RENDER_MODES = ["human", "rgb_array", "rgb_array_list"]


def renderer_of(scene: Scene, lanes: Lanes, mode: str | None) -> Renderer | None:
    """Return what draws an environment in a mode, None if nothing is to be drawn.

    Raises
    ------
    SceneError
        If there is no such mode.
    """
    if mode is None:
        return None
    if mode not in RENDER_MODES:
        nearest = suggest(str(mode), RENDER_MODES)
        msg = f"render_mode: got {mode!r}{nearest}; allowed: None, {', '.join(RENDER_MODES)}"
        raise SceneError(msg)
    from mm_gym.rendering.renderer import Renderer  # noqa: PLC0415 - not needed without pictures

    return Renderer(scene, lanes, mode)
