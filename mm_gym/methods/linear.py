"""The linear plant: a transition matrix."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mm_gym.kernels import layout as at
from mm_gym.kernels import linear
from mm_gym.kernels.entries import build
from mm_gym.methods.base import Method, header, refuse_overflow
from mm_gym.plant import linear_system
from mm_gym.propagators import response_to_tone, transition

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mm_gym.parameters import Support


def _model(support: Support) -> NDArray[np.float64]:
    model = header(support, 20 + 8 * len(support.ground))
    system = linear_system(support.low)
    with refuse_overflow(support):
        model[linear.TRANSITION : linear.RESPONSES] = transition(system, support.time_step).ravel()
        for j, ground in enumerate(support.ground):
            frequency = float(support.low[at.TONES + at.TONE_ROWS * j + at.FREQUENCY])
            response = response_to_tone(system, frequency, ground=ground, time=support.time_step)
            first = linear.RESPONSES + 8 * j
            model[first : first + 8] = response.ravel()
    return model


LINEAR = Method(
    name="exact",
    plant="linear",
    how=(
        "transition matrix, computed once in decimal arithmetic and rounded once; "
        "harmonic excitation as an exosystem"
    ),
    order="exact for a held force",
    bound="round-off: 1e-12 of the trajectory's scale",
    cost=lambda model: (
        f"one 4 x 5 product, and 8 products for each of {int(model[at.TONE_COUNT])} harmonics"
    ),
    model=_model,
    entries=build(linear.propagate),
)
