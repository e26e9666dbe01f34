"""Keys that control an environment in `gymnasium.utils.play`."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.rendering.canvas import load_pygame

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray


def keys_to_action(actuators: Sequence[str]) -> dict[tuple[int, ...], NDArray[np.float32]]:
    """Return keys -> action: left and right for the first actuator, down and up for a second one.

    They command -1 and 1; both keys of a second actuator go with those of the first.
    """
    pygame = load_pygame()
    pairs = [(pygame.K_LEFT, pygame.K_RIGHT), (pygame.K_DOWN, pygame.K_UP)][: len(actuators)]
    choices = [((None, 0.0), (low, -1.0), (high, 1.0)) for low, high in pairs]
    actions: dict[tuple[int, ...], NDArray[np.float32]] = {}
    for chosen in product(*choices):
        keys = tuple(key for key, _ in chosen if key is not None)
        if keys:  # no key is what `play` calls noop
            actions[keys] = np.array([value for _, value in chosen], np.float32)
    return actions
