"""Slots of the Taylor series' model, and rows of its series."""

from __future__ import annotations

import numpy as np

from mm_gym.lanes import layout

# Slots of the model.
ORDER, TOLERANCE, HAS_FRICTION, IS_CUBIC, IS_FINITE, MODEL_END = (
    layout.MODEL_OWN + i for i in range(6)
)

# Rows of the series in one array, WIDTH apart: the state; x1**2; what `write_series` writes; both
# sides' stretch of a finite pair, and stretch**-2; w in units of a part of the step; and 1 / n.
WIDTH = 36
X1, X2, V1, V2, W, SQUARE, FORCE, GROUND = (WIDTH * k for k in range(8))
LONG, SHORT, LONG_INVERSE, SHORT_INVERSE, SCALED, RECIPROCAL = (WIDTH * k for k in range(8, 14))

# Unsigned: an index that might be negative costs a comparison.
ONE, SQUARES = np.uintp(1), np.uintp(SQUARE)

# Behind them the state (x1, x2, v1, v2, w) and the coefficients of a lane. One array: handing over
# many costs time.
STATE = WIDTH * 14
BY_M1, BY_M2, K1, BETA, D, K2, U, PAIR, C, ESCAPE = (STATE + 5 + k for k in range(10))

# Those of finite pairs and friction: slots of vectors of lanes do without.
SMOOTH_END = ESCAPE + 1
DURATION, K0, L0, STRETCH, CHI, INTERCEPT, VR, SIZE = (SMOOTH_END + k for k in range(8))
