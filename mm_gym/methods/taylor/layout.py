"""Where things are in the arrays of the Taylor series: slots of the model, rows of a series."""

from __future__ import annotations

import numpy as np

from mm_gym.kernels import layout as at

# Slots of the model.
ORDER, TOLERANCE, HAS_FRICTION, IS_CUBIC, IS_FINITE = (at.MODEL_OWN + i for i in range(5))

# Rows of the series in one array, WIDTH apart; the first eight are those of kernels/friction.py.
WIDTH = 36
X1, X2, V1, V2, OFFSET, W, FORCE, GROUND = (WIDTH * k for k in range(8))
SQUARE, LONG, SHORT, LONG_POWER, SHORT_POWER, SCALED, SHARE = (WIDTH * k for k in range(8, 15))

# Unsigned: an index that might be negative costs a comparison.
ONE, SQUARES = np.uintp(1), np.uintp(SQUARE)

# Behind them the state (x1, x2, v1, v2, w) and the coefficients of a lane. One array: handing over
# many costs time.
STATE = WIDTH * 15
BY_M1, BY_M2, K1, BETA, D, K2, K0, L0, STRETCH, U, C, CHI, SLIP_FORCE, VR, SIZE = (
    STATE + 5 + k for k in range(15)
)
