"""Transition matrix of the plant whose carriage has no mass: v1 balances the forces on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mm_gym.lanes import layout as at
from mm_gym.methods.base import Settings, refuse_overflow
from mm_gym.methods.linear.method import Linear, linear_model
from mm_gym.methods.support import MASSLESS
from mm_gym.state_space.coefficients import values_of
from mm_gym.state_space.transition import (
    halved_massless_transitions,
    massless_response,
    massless_transition,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mm_gym.methods.support import Support


class Massless(Linear):
    """Transition matrix of the three states x1, x2, v2."""

    title = "the transition matrix of three states"
    how = "transition matrix of the three states x1, x2, v2; v1 balances the forces on the carriage"
    kinds = (MASSLESS,)

    def limit(self, support: Support) -> str | None:
        """Return what the method needs and the scene does not have, or None."""
        if support.slips or support.is_nonlinear:
            return "needs a viscous interface, or none, and linear springs"
        if support.varying:
            return "needs parameters, stretch and frequencies that have one value each"
        if not support.low[at.C] + support.low[at.D] > 0.0:
            return "needs interface.damping + carriage.damping > 0, or nothing resists its motion"
        return None

    def model(self, support: Support, settings: Settings) -> NDArray[np.float64]:  # noqa: ARG002
        """Return the transition matrix and the responses to all excitation."""
        values, time = values_of(support.low), support.sample_interval
        with refuse_overflow(support):
            return linear_model(
                support,
                massless_transition(values, time, is_between=support.is_between),
                lambda source, ground: massless_response(values, source, ground=ground, time=time),
                lambda levels: halved_massless_transitions(values, time, levels),
            )
