"""The limit of a carriage without inertia: three states; v1 follows from the balance of forces."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mm_gym.kernels import layout as at
from mm_gym.kernels import linear
from mm_gym.methods.base import Method, header, refuse_overflow
from mm_gym.methods.linear import LINEAR
from mm_gym.plant import values_of
from mm_gym.propagators import massless_response_to_tone, massless_transition

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mm_gym.parameters import Support


def _model(support: Support) -> NDArray[np.float64]:
    model = header(support, 20 + 8 * len(support.ground))
    values, time = values_of(support.low), support.time_step
    with refuse_overflow(support):
        model[linear.TRANSITION : linear.RESPONSES] = massless_transition(values, time).ravel()
        for j, ground in enumerate(support.ground):
            frequency = float(support.low[at.TONES + at.TONE_ROWS * j + at.FREQUENCY])
            first = linear.RESPONSES + 8 * j
            response = massless_response_to_tone(values, frequency, ground=ground, time=time)
            model[first : first + 8] = response.ravel()
    return model


MASSLESS = Method(
    name="exact",
    plant="massless carriage",
    how="transition matrix of the three states x1, x2, v2; v1 balances the forces on the carriage",
    order=LINEAR.order,
    bound=LINEAR.bound,
    cost=LINEAR.cost,
    model=_model,
    entries=LINEAR.entries,
)
