"""Transition matrix of the linear plant, and of that whose carriage has no mass."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mm_gym.arrays import Array
from mm_gym.excitation.kinds import IMPULSES
from mm_gym.lanes import layout
from mm_gym.methods.base import ExactMethod, Settings, header, refuse_overflow
from mm_gym.methods.linear import kernel
from mm_gym.methods.support import LINEAR, MASSLESS
from mm_gym.state_space.equations import values_of
from mm_gym.state_space.transition import halved_transitions, harmonic, jet, response, transition
from mm_gym.step.control_step import build

if TYPE_CHECKING:
    from mm_gym.methods.support import Support


class Linear(ExactMethod):
    """Transition matrix; harmonics and sampled excitation are exosystems (Van Loan, 1978)."""

    name = "exact"
    title = "the transition matrix"
    how = (
        "transition matrix, computed once in decimal arithmetic and rounded once; "
        "excitation as an exosystem"
    )
    kinds = (LINEAR,)
    entries = build(
        kernel.propagate, simplest=(kernel.is_simple, kernel.at_once), respond=kernel.respond
    )

    def model(self, support: Support, settings: Settings) -> Array:  # noqa: ARG002
        """Return the constants of the kernel.

        They are the transition, the responses to harmonics and to jets, and, if there are impulses,
        the transitions over a half, a quarter, ... of the sample interval.
        """
        p, time = values_of(support.low), support.sample_interval
        with refuse_overflow(support):
            own = transition(p, time, is_between=support.is_between)
            parts = [header(support, 0), own.ravel()]
            for frequency, ground in zip(support.frequencies, support.ground, strict=True):
                wave = harmonic(float(frequency))
                parts.append(response(p, wave, ground=ground, time=time).ravel())
            for ground in (False, True) if support.terms else ():
                source = jet(support.terms, time)
                parts.append(response(p, source, ground=ground, time=time).ravel())
            if support.excitation[IMPULSES]:
                parts.append(halved_transitions(p, time, kernel.HALVINGS).ravel())
        return np.concatenate(parts)

    def cost(self, model: Array) -> str:
        """Return the number of products."""
        return f"{20 + 8 * int(model[layout.HARMONIC_COUNT] + model[layout.TERMS])} products"


class Massless(Linear):
    """Transition matrix of the three states x1, x2, v2: v1 balances the forces on the carriage."""

    title = "the transition matrix of three states"
    how = "transition matrix of the three states x1, x2, v2; v1 balances the forces on the carriage"
    kinds = (MASSLESS,)

    def limit(self, support: Support) -> str | None:
        """Return what the method needs and the scene does not have, or None."""
        if support.slips or support.is_nonlinear:
            return "needs a viscous interface, or none, and linear springs"
        if support.varying:
            return "needs parameters, stretch and frequencies that have one value each"
        if not support.low[layout.C] + support.low[layout.D] > 0.0:
            return "needs interface.damping + carriage.damping > 0, or nothing resists its motion"
        return None
