"""Slots of the sensitivities' model, rows of the lanes behind the plant's own, and causes."""

from __future__ import annotations

from mm_gym.kernels import layout as at

# Slots of the model: which forces there are, the first row behind the plant's own, how many series
# of which degree cover a sample interval of a linear plant, whether the deviations obey the same
# linear equations all along a regime, and what causes the deviation in each column.
HAS_FRICTION, IS_CUBIC, IS_FINITE, FIRST_ROW, PIECES, DEGREE, IS_LINEAR, CAUSES = (
    at.MODEL_OWN + i for i in range(8)
)

COLUMNS, STATES = 8, 4
"""Columns of deviations worked out together, a vector of doubles, and those of the states."""

MODEL_SIZE = CAUSES - at.MODEL_OWN + COLUMNS

# Rows behind the plant's own: the velocities that the last propagation reached, the time since the
# episode began [s], then x1, offset, v1 and slip velocity of each column.
LAST_V1, LAST_V2, TIME, TANGENTS = 0, 1, 2, 3
ROWS = TANGENTS + 4 * COLUMNS

NONE = -1.0
"""Cause of a column that only the state at the start, or nothing, makes deviate. Others are the row
of a parameter in a lane, among them FORCE and STRETCH; of harmonics, that of their own."""

CAUSED = (
    *(at.FORCE, at.STRETCH, at.M1, at.M2, at.K1, at.D, at.ALPHA, at.BETA, at.C),
    *(at.MU1, at.MU2, at.VR, at.CHI, at.FN, at.K0, at.L0),
)
"""Rows of the parameters whose deviations are followed, besides those of harmonics."""
