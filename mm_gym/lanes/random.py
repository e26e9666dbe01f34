"""Counter-based random numbers: draw n of a lane is a hash of (key, n).

The generator is SplitMix64 (Steele, Lea and Flood, 2014; the finaliser is Stafford's mix 13). Its
whole state is two integers, so a million lanes seed in milliseconds, an episode is saved and
restored exactly, and lanes do not share anything.
"""

from __future__ import annotations

import math

import numpy as np

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.lanes.elementary import bits_of, double_of, logarithm, on_circle
from mm_gym.lanes.simd import LANES

KEY, COUNT = 0, 1  # rows of the streams array

EPISODE = 32
"""Bits of the counter that count the draws of one episode; those above count the episodes. So an
episode's numbers do not depend on how long the last one was."""

_SENSORS = np.uint64(0xD1B54A32D192ED03)
"""Added to the draw that the sensors' own numbers are hashed from; any odd number will do."""

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)
_CONVERTS_VECTORS = LANES == 16  # noqa: PLR2004 - as many as two registers of AVX-512 hold
_SIGN, _LOWER = np.uint64(1 << 63), np.uint64((1 << 32) - 1)
_FROM_2_TO_THE_52, _FROM_2_TO_THE_84 = np.uint64(0x433 << 52), np.uint64(0x453 << 52)
"""Bits of these powers: the bits of an integer below 2^32 are added, times 1 and times 2^32."""


@borrowing_kernel
def mix(z):
    """Return the SplitMix64 finaliser of a 64-bit integer."""
    z = (z ^ (z >> np.uint64(30))) * _FIRST
    z = (z ^ (z >> np.uint64(27))) * _SECOND
    return z ^ (z >> np.uint64(31))


@borrowing_kernel
def seed_streams(streams, seeds, mask):
    """Give the lanes of the mask the streams of their seeds."""
    for i in range(seeds.shape[0]):
        if mask[i]:
            # Two rounds: neighbouring seeds must not give overlapping sequences of counters.
            streams[KEY, i] = mix(mix(seeds[i]) + _GOLDEN)
            streams[COUNT, i] = np.uint64(0)


@borrowing_kernel
def uniform(streams, i):
    """Return the next number of lane i, uniform in [0, 1) with 53 bits."""
    streams[COUNT, i] += np.uint64(1)
    return _fraction(mix(streams[KEY, i] + streams[COUNT, i] * _GOLDEN))


@borrowing_kernel
def numbered(key, n):
    """Return number n of the sequence of a key, uniform in [0, 1).

    The key is such a number too: one row of a lane holds it.
    """
    return _fraction(mix(mix(np.uint64(key * 2.0**53)) + np.uint64(n) * _GOLDEN))


@borrowing_kernel
def _fraction(bits):
    """Return the number in [0, 1) that the upper 53 of 64 bits stand for."""
    return np.float64(bits >> np.uint64(11)) * 2.0**-53


@borrowing_kernel
def next_episode(streams, i):
    """Move lane i to the numbers of its next episode."""
    episode = (streams[COUNT, i] >> np.uint64(EPISODE)) + np.uint64(1)
    streams[COUNT, i] = episode << np.uint64(EPISODE)


@inlined_kernel
def normals(streams, i):
    """Return the next two independent numbers of the standard normal law."""
    pair = normals_ahead(streams, 0, i)
    count_draws(streams, 2, i)
    return pair


@inlined_kernel
def count_draws(streams, draws, i):
    """Count draws of lane i."""
    streams[COUNT, i] += np.uint64(draws)


@inlined_kernel
def normals_ahead(streams, ahead, i):
    """Return two normal numbers from the draws of lane i after the next `ahead`, not counted."""
    draw = streams[KEY, i] + (streams[COUNT, i] + np.uint64(ahead + 1)) * _GOLDEN
    return normal_pair(mix(draw), mix(draw + _GOLDEN))


@inlined_kernel
def normals_of_sensors(streams, ahead, i):
    """Return two of the sensors' own normal numbers in lane i, those after the first `ahead`.

    They are a hash of the lane's place in its stream, and take nothing out of it: what is drawn
    from the stream does not depend on the sensors. Frames with the same place have the same.
    """
    key = mix(streams[KEY, i] + streams[COUNT, i] * _GOLDEN + _SENSORS)
    draw = key + np.uint64(ahead + 1) * _GOLDEN
    return normal_pair(mix(draw), mix(draw + _GOLDEN))


@inlined_kernel
def chance_of_sensors(streams, ahead, i):
    """Return one of the sensors' own numbers in lane i, uniform in [0, 1): see above."""
    key = mix(streams[KEY, i] + streams[COUNT, i] * _GOLDEN + _SENSORS)
    return _fraction(mix(key + np.uint64(ahead + 1) * _GOLDEN))


@inlined_kernel
def _whole(bits):
    """Return an integer below 2^53 as a double.

    Only AVX-512 converts vectors of them; others take halves, as the last digits of larger doubles.
    """
    if _CONVERTS_VECTORS:
        return np.float64(np.int64(bits))
    high = double_of(np.int64((bits >> np.uint64(32)) | _FROM_2_TO_THE_84))
    return high - (2.0**84 + 2.0**52) + double_of(np.int64((bits & _LOWER) | _FROM_2_TO_THE_52))


@inlined_kernel
def normal_pair(first, second):
    """Return two independent normal numbers from two draws of 64 bits (Box and Muller, 1958).

    The first draw is the radius. The second is the angle within an eighth of a turn on either side
    of the first axis; the bits that it does not need reflect it to the others. There are no
    branches, so that the compiler vectorises a loop over lanes.
    """
    chance = (_whole(first >> np.uint64(11)) + 1.0) * 2.0**-53  # in (0, 1]
    radius = math.sqrt(-2.0 * logarithm(chance))
    angle = _whole((second ^ _SIGN) >> np.uint64(11)) - 2.0**52  # of a number with a sign
    c, s = on_circle(angle * 2.0**-53)
    radius = double_of(bits_of(radius) ^ np.int64(second << np.uint64(63)))
    is_reflected = second & np.uint64(2) != np.uint64(0)
    return radius * (s if is_reflected else c), radius * (c if is_reflected else s)
