"""Slots of the model of switched friction."""

from __future__ import annotations

from mm_gym.lanes import layout

# STICK and SLIP hold where the levels of each regime begin, the whole sample interval first, whose
# length is WHOLE [s]; STICK_SERIES and SLIP_SERIES where the coefficients of its series do, of
# TERMS terms, 0 where there are none.
VR, LAST_LEVEL, STICK, SLIP, LEVEL_SIZE, DEGREE, WHOLE = (layout.MODEL_OWN + i for i in range(7))
STICK_SERIES, SLIP_SERIES, TERMS = (layout.MODEL_OWN + i for i in range(7, 10))
REGIMES = layout.MODEL_OWN + 10

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

# Slots of a regime's terms, for an interval h and accelerations outer = (k1 x1 + d v1 - u) / m1 and
# inner = (k2 (x2 - x1) + c w + sign f) / m1, with u in either: h times the coefficients of x1, v1,
# u, x2 - x1, w, sign and u in them; RATIO = 1 + m1 / m2 in w' = outer - RATIO inner; then from term
# n of v1 and w and from that before it to term n + 1: the same of v1 before and v1, of w before and
# w, h / (n + 1).
RATIO, NEXT, TERM = 7, 8, 5
