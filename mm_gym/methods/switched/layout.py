"""Slots of the model of switched friction."""

from __future__ import annotations

from mm_gym.kernels import layout as at

# STICK and SLIP hold where the levels of each regime begin, the whole sample interval first, whose
# length is WHOLE [s]; STICK_SERIES and SLIP_SERIES where its terms do, 0 where there are none.
VR, LAST_LEVEL, STICK, SLIP, LEVEL_SIZE, DEGREE, WHOLE, STICK_SERIES, SLIP_SERIES = (
    at.MODEL_OWN + i for i in range(9)
)
REGIMES = at.MODEL_OWN + 9

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

# Slots of a regime's terms, for an interval h: of the first terms of v1 and w against the inputs
# (x1, x2 - x1, v1, w, sign, u); then of each term n + 1 from the second on, for v1 and w, against
# the terms n of v1 and w, and those before them; h / (n + 1) after each; h**2 |w''| / 2 of term 2.
FIRST, NEXT, TERM = 0, 12, 9
