"""Slots of the model of switched friction."""

from __future__ import annotations

from mm_gym.lanes import layout

# STICK and SLIP hold where the levels of each regime begin, the whole sample interval first, whose
# length is WHOLE [s]; SERIES where the model of `lanes_kernel` does, 0 where there is none.
VR, LAST_LEVEL, STICK, SLIP, LEVEL_SIZE, DEGREE, WHOLE = (layout.MODEL_OWN + i for i in range(7))
SERIES = layout.MODEL_OWN + 7
REGIMES = layout.MODEL_OWN + 8

# Slots of a level: rows against the inputs (x1, x2, v1, v2, sign, u), or, for w'' now, the change
# of w and the gains of h**2 |w''| / 2, against the inputs (x1, x2 - x1, v1, w, sign, u).
SECOND, ROWS, CHANGE, GAINS, GAIN_OF_SECOND, HARMONICS = 0, 6, 30, 36, 42, 43
# Then for each harmonic the same against cosine and sine times amplitude, and the cosine and sine
# of its turn.
HARMONIC_SECOND, HARMONIC_ROWS, HARMONIC_CHANGE, HARMONIC_GAINS, HARMONIC_TURN, HARMONIC_SIZE = (
    0,
    2,
    10,
    12,
    14,
    16,
)
