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
from mm_gym.state_space.equations import linear_system, values_of
from mm_gym.state_space.transition import (
    halved_massless_transitions,
    halved_transitions,
    harmonic,
    jet,
    massless_response,
    massless_transition,
    response,
    transition,
)
from mm_gym.step.control_step import build

if TYPE_CHECKING:
    from collections.abc import Callable

    from mm_gym.methods.support import Support
    from mm_gym.state_space.transition import Exosystem


def _linear_model(
    support: Support,
    transition: Array,
    respond: Callable[[Exosystem, bool], Array],
    halved: Callable[[int], Array],
) -> Array:
    """Return the constants of the kernel.

    They are the transition, the responses to harmonics and to jets, and, if there are impulses, the
    transitions over a half, a quarter, ... of the sample interval.
    """
    parts = [header(support, 0), transition.ravel()]
    for j, ground in enumerate(support.ground):
        parts.append(respond(harmonic(float(support.frequencies[j])), ground).ravel())
    if support.terms:
        source = jet(support.terms, support.sample_interval)
        parts += [respond(source, ground).ravel() for ground in (False, True)]
    if support.excitation[IMPULSES]:
        parts.append(halved(kernel.HALVINGS).ravel())
    return np.concatenate(parts)


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
        """Return the transition matrix and the responses to all excitation."""
        system, time = linear_system(support.low), support.sample_interval
        with refuse_overflow(support):
            return _linear_model(
                support,
                transition(system, time, is_between=support.is_between),
                lambda source, ground: response(system, source, ground=ground, time=time),
                lambda levels: halved_transitions(system, time, levels),
            )

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

    def model(self, support: Support, settings: Settings) -> Array:  # noqa: ARG002
        """Return the transition matrix and the responses to all excitation."""
        values, time = values_of(support.low), support.sample_interval
        with refuse_overflow(support):
            return _linear_model(
                support,
                massless_transition(values, time, is_between=support.is_between),
                lambda source, ground: massless_response(values, source, ground=ground, time=time),
                lambda levels: halved_massless_transitions(values, time, levels),
            )
