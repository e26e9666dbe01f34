"""Slots of the splitting's model, behind those of the Taylor series that it falls back on."""

from __future__ import annotations

from mm_gym.excitation.sources import MOST_ROWS
from mm_gym.methods.taylor import layout as series

MOST = 8
"""Columns of the extrapolation, at most."""

FIRST_CHECK, COLUMNS, LIMIT, IS_SPRUNG, IS_DRAWN, DEGREE = (series.MODEL_END + k for k in range(6))
# The sample interval that the columns are for [s], and by what angle, squared, excitation turns.
INTERVAL, FASTEST_TURN = DEGREE + 1, DEGREE + 2
# For each number of columns: the angle, squared, up to which they may be enough.
LONGEST = FASTEST_TURN + 1
# Of the plant, from PLANT on, unless they are drawn: 1 / m1, 1 / m2 [1/kg], -k1 alpha / m1 [1/s^2],
# -k1 beta / m1 [1/(m s)^2]. Of drawn plants also what the dampers do, -(c + d) / m1, c / m1 and
# c / m2 [1/s], and these are rows from OWN on.
BY_M1, BY_M2, LINEAR, CUBIC, DAMPED, DRAGGED, DRAGGING = range(7)
PLANT = LONGEST + MOST
# 1 / (n + 1)!, the weights of the dampers' series, up to the degree.
RECIPROCALS, MOST_DEGREE = PLANT + DAMPED, 24
# For the bounds of the errors: the square of the sample interval [s^2]; multiplied by it, the slope
# of all springs over m1 at rest [1] and what it grows by with x1^2 [1/m^2]; what multiplies the
# term of a long way [1/m^2]; of springs of finite stretch, what multiplies their slope [m/N] and
# their bend in that term [1/N]; the angle's square in what raises the estimate; for each number of
# columns, what multiplies the term of a held force, and the angle's square in what the estimate of
# one column less lets expect.
SQUARE, STEEPNESS, STEEPER, BENT, COUPLED, BENT_APART, RAISE, PUSHED = (
    RECIPROCALS + MOST_DEGREE + 1 + k for k in range(8)
)
LATER = PUSHED + MOST
# For each number of columns, what a bend of the excitation is multiplied by.
BENDING = LATER + MOST

# Of each column: its substeps; with h their length, h / 6, h / 3, 2 h / 3 [s], h^2 / 24 [s^2]; how
# far velocities carry the positions in h / 2 (2, 2), and what is left of the velocities (2, 2).
COLUMN, COLUMN_SIZE = BENDING + MOST, 13
COUNT, SIXTH, THIRD, MIDDLE, GRADIENT, DRIFT, DECAY = 0, 1, 2, 3, 4, 5, 9

# For each number of columns: the weight of each, and what weighs them to the estimate of the error.
WEIGHTS = COLUMN + COLUMN_SIZE * MOST
ESTIMATE = MOST
WEIGHTS_SIZE = 2 * MOST
END = WEIGHTS + WEIGHTS_SIZE * (MOST + 1)

# Rows of a vector each: the columns' states, what is drawn of each lane's plant, what excites it.
OWN = 4 * MOST
SOURCES = OWN + DRAGGING + 1
ROWS = SOURCES + MOST_ROWS
