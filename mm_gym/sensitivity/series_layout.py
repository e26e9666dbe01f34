"""Rows of the series of motion and deviations, and of a lane's coefficients."""

from __future__ import annotations

ORDER = 28
"""Highest order of a series."""

# Rows of the motion's series, WIDTH apart; `write_series` has FORCE and GROUND.
WIDTH = ORDER + 4
X1, OFFSET, V1, W, SQUARE, CUBE, FORCE, GROUND, PAIR = (WIDTH * k for k in range(9))
INNER, OUTER, SCALED, OVER_OFFSET, OVER_STRETCH = (WIDTH * k for k in range(9, 14))
LONG, SHORT, LONG2, SHORT2, LONG3, SHORT3, TERM, ACCELERATION = (WIDTH * k for k in range(14, 22))
LARGEST, SIZE = 22 * WIDTH, 22 * WIDTH + 1

# Parts of the deviations' series: term n of one is the row PART * part + n. Behind them the sizes
# of the terms, and the largest of each column but for the last LAG.
PART = ORDER + 2
SIZES, MOST = 4 * PART, 5 * PART
ROWS = 5 * PART + 1
LAG = 4

# Coefficients of a lane.
M1, M2, K1, ALPHA, BETA, D, HELD, K0, L0, STRETCH, K2 = range(11)
STICK, CHI, INTERCEPT, VR, FN, MU1, MU2, DAMPING, SLIP, REGIME = range(11, 21)
REST = 21
"""What rounding leaves of the offset [m]."""
BETWEEN = 22
"""Force held between the masses [N]; HELD is that on the carriage."""
COEFFICIENTS = 23
