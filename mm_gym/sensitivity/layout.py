"""Slots of the sensitivities' model, rows of the lanes behind the plant's own, and causes."""

from __future__ import annotations

from mm_gym.lanes import layout as at

# Slots of the model: which forces there are, the first row behind the plant's own, how many series
# of which degree cover a sample interval of a linear plant, and how many a control step, whether
# the deviations obey the same linear equations all along a regime, how many columns of deviations
# there are, and what causes the deviation in each.
HAS_FRICTION, IS_CUBIC, IS_FINITE, FIRST_ROW, PIECES, DEGREE = (at.MODEL_OWN + i for i in range(6))
STEP_PIECES, STEP_DEGREE, IS_LINEAR, WIDTH, CAUSES = (at.MODEL_OWN + i for i in range(6, 11))

COLUMNS, STATES = 8, 4
"""Columns of deviations that a lane by itself has, a vector of doubles, and those of the states."""

MOST_SERIES = 1_000_000
"""Series in a sample interval before giving up."""

# Rows behind the plant's own: the velocities that the last propagation reached, the time since the
# episode began [s], then x1 of each column, x2, v1 and v2.
LAST_V1, LAST_V2, TIME, TANGENTS = 0, 1, 2, 3

NONE = -1.0
"""Cause of a column that only the state at the start, or nothing, makes deviate. Others are the row
of a parameter in a lane, among them FORCE and STRETCH; of harmonics, that of their own."""

CAUSED = (
    *(at.FORCE, at.STRETCH, at.M1, at.M2, at.K1, at.D, at.ALPHA, at.BETA, at.C),
    *(at.MU1, at.MU2, at.VR, at.CHI, at.FN, at.K0, at.L0),
)
"""Rows of the parameters whose deviations are followed, besides those of harmonics."""
