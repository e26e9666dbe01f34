"""The random excitation of a plant as linear systems: shaping filters and impulses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.excitation import filters as shaping
from mm_gym.excitation import impulse_process as process
from mm_gym.excitation import kinds as kernels
from mm_gym.excitation import noise

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from mm_gym.methods.support import Support

    Array = NDArray[np.float64]

ROWS = {
    kernels.IMPULSE: process.ROWS,
    kernels.FILTER: noise.ROWS,
}


@dataclass(frozen=True)
class ShapingFilter:
    """A filter of white noise, z' = F z + white noise, whose output is the excitation.

    Attributes
    ----------
    name
        Dotted name of the part of the excitation.
    ground
        Whether it shakes the ground.
    generator, intensity
        (k, k) F [1/s], and the intensity of the white noise on the states [1/s].
    output
        (k,) the excitation [N] or [m/s^2] per state.
    transition, spread
        (k, k) exp(F h) over a sample interval, and a root of the covariance added in it.
    sampled_output
        (k,) as `output`, for an excitation that is linear between its samples.
    """

    name: str
    ground: bool
    generator: Array
    intensity: Array
    output: Array
    transition: Array
    spread: Array
    sampled_output: Array


@dataclass(frozen=True)
class RandomImpulses:
    """Random impulses: their rate [1/s], and mean and mean square of their size [N s] or [m/s]."""

    ground: bool
    rate: float
    mean: float
    square: float


def shaping_filters(support: Support, row: Array) -> list[ShapingFilter]:
    """Return the filters of the noise of a lane (rows,), as they are while the envelope is 1."""
    return [
        _filter(name, slots, first, support.sample_interval, row)
        for name, slots, first in _parts(support, kernels.FILTER)
    ]


def random_impulses(support: Support, row: Array) -> list[RandomImpulses]:
    """Return the random impulses of a lane (rows,)."""
    found: list[RandomImpulses] = []
    for _, slots, first in _parts(support, kernels.IMPULSE):
        own = slots[kernels.OWN :]
        size = float(row[first + process.SIZE])
        low, high = (size, size)
        if own[process.IS_RANGE] > 0.0:
            low, high = float(own[process.LOWEST]), float(own[process.HIGHEST])
        rate = float(row[first + process.RATE])
        if rate > 0.0:
            square = (low**2 + low * high + high**2) / 3.0
            ground = bool(slots[kernels.TARGET] > 0.0)
            found.append(RandomImpulses(ground, rate, 0.5 * (low + high), square))
    return found


def filter_matrices(filters: Array, interval: float, *, passes_velocity: bool) -> Array:
    """Return the matrices (`shaping.MATRICES`,) of noise over a sample interval [s].

    The filters are (2, 2): frequency [rad/s] and damping ratio of the low-pass and of the
    high-pass.
    """
    matrices = np.zeros((shaping.MATRICES, 1))
    lane = np.zeros(1, np.int64)
    shaping.write_matrices(matrices, 0, filters.reshape(-1, 1), passes_velocity, interval, lane)
    return matrices[:, 0]


def _parts(support: Support, kind: int) -> Iterator[tuple[str, Array, int]]:
    """Yield dotted name, slots and first row of the parts of one kind."""
    described = support.excitation
    for k in range(int(described[0])):
        slots = described[kernels.FIRST + kernels.SIZE * k :][: kernels.SIZE]
        if int(slots[kernels.KIND]) != kind:
            continue
        first = int(slots[kernels.ROW])
        own = range(first, first + ROWS[kind])
        name = next(name for name, row in support.names.items() if row in own)
        yield name.rpartition(".")[0], slots, first


def _filter(name: str, slots: Array, first: int, interval: float, row: Array) -> ShapingFilter:
    passes_velocity = bool(slots[kernels.OWN + noise.PASSES_VELOCITY] > 0.0)
    own = row[first : first + noise.ROWS]
    filters = own[noise.LOW_PASS : noise.HIGH_PASS_DAMPING + 1].reshape(2, 2)
    matrices = filter_matrices(filters, interval, passes_velocity=passes_velocity)
    order = shaping.ORDER if own[noise.HIGH_PASS] > 0.0 else shaping.ORDER // 2
    transition = matrices[shaping.TRANSITION : shaping.SPREAD].reshape(shaping.ORDER, -1)
    output = matrices[shaping.OUTPUT : shaping.OUTPUT + order] * own[noise.RMS]
    stationary = _root(matrices[shaping.START_SPREAD : shaping.OUTPUT], order)
    # In continuous time nothing is lost between samples, so the variance is that at an instant.
    deviation = np.linalg.norm(output @ stationary)
    factor = own[noise.RMS] / deviation if deviation > 0.0 else 0.0
    intensity = np.zeros((order, order))
    intensity[1, 1] = own[noise.LOW_PASS]  # (E13) of docs/excitation.md
    return ShapingFilter(
        name=name,
        ground=bool(slots[kernels.TARGET] > 0.0),
        generator=_generator(own, order, passes_velocity=passes_velocity),
        intensity=intensity,
        output=output * factor,
        transition=transition[:order, :order].copy(),
        spread=_root(matrices[shaping.SPREAD : shaping.START_SPREAD], order),
        sampled_output=output,
    )


def _root(packed: Array, order: int) -> Array:
    """Return a Cholesky factor that is packed by rows."""
    root = np.zeros((shaping.ORDER, shaping.ORDER))
    root[np.tril_indices(shaping.ORDER)] = packed
    return root[:order, :order]


def _generator(own: Array, order: int, *, passes_velocity: bool) -> Array:
    """Return F, (E9) to (E11) of docs/excitation.md."""
    low, damping = own[noise.LOW_PASS], 2.0 * own[noise.LOW_PASS_DAMPING]
    high, high_damping = own[noise.HIGH_PASS], 2.0 * own[noise.HIGH_PASS_DAMPING]
    generator = np.zeros((shaping.ORDER, shaping.ORDER))
    generator[0, 1], generator[1, :2] = low, (-low, -damping * low)  # (E9)
    generator[2, 3] = high  # (E11)
    passed = damping if passes_velocity else 0.0  # (E10)
    generator[3] = high * np.array([1.0, passed, -1.0, -high_damping])
    return generator[:order, :order]
