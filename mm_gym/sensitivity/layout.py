"""Slots of the sensitivities' model, rows of the lanes behind the plant's own, and causes."""

from __future__ import annotations

from mm_gym.lanes import layout
from mm_gym.methods.runge_kutta import layout as runge_kutta

# Slots of the model behind those of `mm_gym.methods.runge_kutta`, which begin with those of
# `mm_gym.methods.taylor`: how many series of which degree cover a sample interval of a linear
# plant, and how many a control step; the first row behind the plant's own; how many columns of
# deviations there are, and what causes the deviation in each.
PIECES, DEGREE, STEP_PIECES, STEP_DEGREE, FIRST_ROW, WIDTH, CAUSES = (
    runge_kutta.TIMES + runge_kutta.MOST_STAGES - 1 + k for k in range(7)
)

STATES = 4
"""Columns of deviations by the states of the two masses."""

MOST_SERIES = 1_000_000
"""Series in a sample interval before giving up."""

# Rows behind the plant's own: the velocities that the last propagation reached, the time since the
# episode began [s], then x1 of each column, x2, v1 and v2.
LAST_V1, LAST_V2, TIME, TANGENTS = 0, 1, 2, 3

NONE = -1.0
"""Cause of a column that only the state at the start, or nothing, makes deviate. Others are the row
of a parameter in a lane, among them FORCE and STRETCH; of harmonics, that of their own."""

CAUSED = (
    *(layout.FORCE, layout.STRETCH, layout.M1, layout.M2),
    *(layout.K1, layout.D, layout.ALPHA, layout.BETA, layout.C),
    *(layout.MU1, layout.MU2, layout.VR, layout.CHI, layout.FN, layout.K0, layout.L0),
)
"""Rows of the parameters whose deviations are followed, other than those of harmonics."""
