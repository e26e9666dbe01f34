"""Oscillators in a start's linear memory: what it remembers before training has shaped it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from agents.training.starts import Start

TURNS = 0.2, 1.2
"""Least and largest angle of an oscillator in a control step [rad]."""

LOSSES = 0.025, 0.5
"""Least and largest part that it forgets in a control step."""


def with_oscillators(start: Start, count: int, generator: np.random.Generator) -> Start:
    """Return the start with so many oscillators, which have no part in the action yet.

    An oscillator is two states that turn and decay, driven by the observation with random weights.
    """
    n, m = start.enter.shape[1] or start.pairs.shape[2], len(start.keep)
    size = m + 2 * count
    keep, enter = np.zeros((size, size)), np.zeros((size, n))
    keep[:m, :m], enter[:m] = start.keep, start.enter.reshape(m, n)
    for row in range(m, size, 2):
        loss, turn = np.exp(generator.uniform(*np.log(LOSSES))), generator.uniform(*TURNS)
        cosine, sine = np.cos(turn), np.sin(turn)
        keep[row : row + 2, row : row + 2] = (1.0 - loss) * np.array(
            [[cosine, -sine], [sine, cosine]]
        )
        enter[row : row + 2] = loss * generator.standard_normal((2, n))
    pairs = np.pad(start.pairs, ((0, 0), (0, 0), (0, 2 * count)))
    direct = np.insert(start.direct, [1 + n + m] * 2 * count, 0.0, axis=1)
    back = np.pad(start.back, ((0, size - len(start.back)), (0, 0)))
    return replace(start, pairs=pairs, direct=direct, keep=keep, enter=enter, back=back)
