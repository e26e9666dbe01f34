"""The limit of a carriage without inertia: three states; v1 follows from the balance of forces."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mm_gym.methods.base import Method, refuse_overflow
from mm_gym.methods.linear.method import LINEAR, linear_model
from mm_gym.state_space.coefficients import values_of
from mm_gym.state_space.transition import massless_response, massless_transition

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mm_gym.methods.support import Support


def _model(support: Support) -> NDArray[np.float64]:
    values, time = values_of(support.low), support.sample_interval
    with refuse_overflow(support):
        return linear_model(
            support,
            massless_transition(values, time),
            lambda source, ground: massless_response(values, source, ground=ground, time=time),
        )


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
