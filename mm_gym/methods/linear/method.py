"""The linear plant: a transition matrix."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.control_step import build
from mm_gym.methods.base import Method, header, refuse_overflow
from mm_gym.methods.linear import kernel as linear
from mm_gym.state_space.coefficients import linear_system
from mm_gym.state_space.transition import jet, response, harmonic, transition

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from mm_gym.methods.support import Support
    from mm_gym.state_space.transition import Exosystem


def _model(support: Support) -> NDArray[np.float64]:
    system, time = linear_system(support.low), support.sample_interval
    with refuse_overflow(support):
        return linear_model(
            support,
            transition(system, time),
            lambda source, ground: response(system, source, ground=ground, time=time),
        )


def linear_model(
    support: Support,
    transition: NDArray[np.float64],
    respond: Callable[[Exosystem, bool], NDArray[np.float64]],
) -> NDArray[np.float64]:
    """Return the constants of `kernels.linear`: transition, responses to harmonics and to jets."""
    parts = [header(support, 0), transition.ravel()]
    for j, ground in enumerate(support.ground):
        parts.append(respond(harmonic(float(support.frequencies[j])), ground).ravel())
    if support.terms:
        source = jet(support.terms, support.sample_interval)
        parts += [respond(source, ground).ravel() for ground in (False, True)]
    return np.concatenate(parts)


def _cost(model: NDArray[np.float64]) -> str:
    products = 20 + 8 * int(model[at.HARMONIC_COUNT] + model[at.TERMS])
    intervals = int(model[at.INTERVALS])
    return f"{products} products" + (
        f" in each of {intervals} sample intervals" if intervals > 1 else ""
    )


LINEAR = Method(
    name="exact",
    plant="linear",
    how=(
        "transition matrix, computed once in decimal arithmetic and rounded once; "
        "excitation as an exosystem"
    ),
    order="exact for a held force",
    bound="round-off: 1e-12 of the trajectory's scale",
    cost=_cost,
    model=_model,
    entries=build(linear.propagate, linear.at_once),
)
