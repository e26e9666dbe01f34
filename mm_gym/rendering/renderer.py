"""The renderer of an environment: arrays, lists of them, or a window at a stated pace."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import product
from math import ceil, sqrt
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from mm_gym.arrays import Single
from mm_gym.rendering.canvas import load_pygame
from mm_gym.rendering.history import History
from mm_gym.rendering.look import SIZE
from mm_gym.rendering.picture import Picture, columns
from mm_gym.rendering.subject import Subject
from mm_gym.scene.scene import Scene
from mm_gym.simulation.lanes import Lanes

Frame = NDArray[np.uint8]


class Window:
    """A window on the screen, at so many pictures per second; pygame has one for all."""

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


def keys_to_action(actuators: Sequence[str]) -> dict[tuple[int, ...], Single]:
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
    actions: dict[tuple[int, ...], Single] = {}
    for chosen in product(*choices):
        keys = tuple(key for key, _ in chosen if key is not None)
        if keys:  # no key is what `play` calls noop
            actions[keys] = np.array([value for _, value in chosen], np.float32)
    return actions


LIST = "rgb_array_list"

MOST_TILES = 9  # lanes that a window shows at once
MOST_WIDTH, MOST_HEIGHT = 1280, 768  # largest size of a window [px]


class Renderer:
    """Draws the lanes of an environment, in one of its modes.

    pygame is imported with the first picture: programs often ask for pictures that they never look
    at, and those need no pygame.
    """

    def __init__(self, scene: Scene, lanes: Lanes, mode: str) -> None:
        self._lanes = lanes
        self._mode = mode
        self._subject = Subject(scene, lanes.plant)
        self._history = History(lanes, self._subject, columns(self._subject))
        self._collected: list[list[Frame]] = [[] for _ in range(lanes.count)]

    @cached_property
    def _picture(self) -> Picture:
        return Picture(self._subject)

    @cached_property
    def _tiles(self) -> tuple[int, int, float]:
        """Columns and rows of the lanes in the window, and the scale of their pictures."""
        shown = min(self._lanes.count, MOST_TILES)
        across = ceil(sqrt(shown))
        down = ceil(shown / across)
        scale = min(1.0, MOST_WIDTH / (across * SIZE[0]), MOST_HEIGHT / (down * SIZE[1]))
        return across, down, scale

    @cached_property
    def _window(self) -> Window:
        across, down, scale = self._tiles
        size = int(across * scale * SIZE[0]), int(down * scale * SIZE[1])
        return Window(size, self._subject.frames)

    def note(self, *, watched: bool = True) -> None:
        """Take note of the present state of all lanes: call it after each reset and each step.

        If it is watched, it is shown, or collected, if that is the mode.
        """
        self._history.note()
        if watched and self._mode == "human":
            self._show(paced=True)
        if watched and self._mode == LIST:
            for lane, frames in enumerate(self._collected):
                if self._history.starts[lane]:
                    frames.clear()
                frames.append(self._frame(lane))

    def render(self) -> list[Frame] | list[list[Frame]] | None:
        """Return each lane's picture, or the list of those since the last call, or show them."""
        if self._history.noted == 0 and self._mode != LIST:
            msg = "there is nothing to draw yet: call reset() before render()"
            raise ResetNeeded(msg)
        if self._mode == "human":
            return self._show(paced=False)
        if self._mode == LIST:
            collected = self._collected
            self._collected = [[] for _ in collected]
            return collected
        return [self._frame(lane) for lane in range(self._lanes.count)]

    def close(self) -> None:
        """Close the window, if there is one."""
        if "_window" in vars(self):
            self._window.close()
            del self._window

    def _frame(self, lane: int) -> Frame:
        return self._picture.pixels(self._history.past(lane))

    def _show(self, *, paced: bool) -> None:
        if self._lanes.count == 1:
            self._window.show(self._picture.draw(self._history.past(0)), paced=paced)
            return
        pygame: Any = load_pygame()
        across, down, scale = self._tiles
        width, height = int(scale * SIZE[0]), int(scale * SIZE[1])
        sheet = pygame.Surface((across * width, down * height), 0, 32)
        for lane in range(min(self._lanes.count, MOST_TILES)):
            picture = self._picture.draw(self._history.past(lane))
            place = width * (lane % across), height * (lane // across)
            sheet.blit(pygame.transform.smoothscale(picture, (width, height)), place)
        self._window.show(sheet, paced=paced)
