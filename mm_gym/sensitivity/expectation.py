"""The excitation that is to be expected by one who knows its present state, but not what is drawn.

No random impulse comes, and noise decays as the filters do that shape it: the conditional mean.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.excitation import filters as shaping
from mm_gym.excitation import impulse_process as process
from mm_gym.excitation import kinds as kernels
from mm_gym.excitation import noise
from mm_gym.lanes import layout as at

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.methods.support import Support

    Array = NDArray[np.float64]


def expected(support: Support, model: Array, values: Array) -> tuple[Support, Array, Array]:
    """Return support, model and lanes (rows, count) with nothing random to come.

    Impulses whose time is given come as they do; random ones are taken to have a mean size of 0.
    """
    described, model, values = support.excitation.copy(), model.copy(), values.copy()
    spread = slice(shaping.SPREAD, shaping.START_SPREAD)
    for k in range(int(described[0])):
        slots = described[kernels.FIRST + kernels.SIZE * k :][: kernels.SIZE]
        row, place = int(slots[kernels.ROW]), int(slots[kernels.OWN + noise.PLACE])
        if slots[kernels.KIND] == kernels.IMPULSE:
            time, following = values[row + process.TIME], values[row + process.NEXT]
            values[row + process.NEXT] = np.where(following <= time, time, process.NEVER)
            values[row + process.RANDOM] = process.NEVER
            values[row + process.RATE] = 0.0
        elif slots[kernels.KIND] == kernels.FILTER:
            matrices = described[place:] if place else values[row + noise.ROWS :]
            matrices[spread] = 0.0
    model[int(model[at.EXCITATION]) :] = described
    return replace(support, excitation=described), model, values
