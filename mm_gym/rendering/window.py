"""A window in which episodes are watched at the pace that a picture states, and keys to play."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from mm_gym.rendering.canvas import load_pygame

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray


class Window:
    """A window on the screen; pygame has one for all.

    Parameters
    ----------
    size
        Width and height [px].
    frames
        Pictures per second.
    """

    def __init__(self, size: tuple[int, int], frames: int) -> None:
        self._pygame = load_pygame()
        self._size, self._frames = size, frames
        self._clock = self._pygame.time.Clock()
        self._is_open = self._is_dismissed = False

    def show(self, picture: Any, *, paced: bool = True) -> None:  # noqa: ANN401 - a surface
        """Show a picture and wait until it is the next one's turn.

        Nothing is shown any more once the user has closed the window.
        """
        if self._is_dismissed:
            return
        display = self._pygame.display
        if not display.get_init():
            display.init()
        screen = display.get_surface()
        if screen is None or screen.get_size() != self._size:
            screen = display.set_mode(self._size)
            display.set_caption("mm_gym")
        self._is_open = True
        screen.blit(picture, (0, 0))
        display.flip()
        if paced:
            self._clock.tick(self._frames)
        if self._pygame.event.get(self._pygame.QUIT, pump=True):
            self._is_dismissed = True
            self.close()

    def close(self) -> None:
        """Close the window, if it is open."""
        if self._is_open and self._pygame.display.get_init():
            self._pygame.display.quit()
        self._is_open = False


def keys_to_action(actuators: Sequence[str]) -> dict[tuple[int, ...], NDArray[np.float32]]:
    """Return keys -> action, which command -1 and 1 in `gymnasium.utils.play`.

    Left and right are those of the first actuator, down and up of a second one, page down and up of
    a third; the keys of different actuators go together.
    """
    pygame = load_pygame()
    pairs = [
        (pygame.K_LEFT, pygame.K_RIGHT),
        (pygame.K_DOWN, pygame.K_UP),
        (pygame.K_PAGEDOWN, pygame.K_PAGEUP),
    ][: len(actuators)]
    choices = [((None, 0.0), (low, -1.0), (high, 1.0)) for low, high in pairs]
    actions: dict[tuple[int, ...], NDArray[np.float32]] = {}
    for chosen in product(*choices):
        keys = tuple(key for key, _ in chosen if key is not None)
        if keys:  # no key is what `play` calls noop
            actions[keys] = np.array([value for _, value in chosen], np.float32)
    return actions
