"""Slots of the splitting's model, behind those of the Taylor series that it falls back on."""

from __future__ import annotations

from mm_gym.methods.taylor import layout as series

MOST = 8
"""Columns of the extrapolation, at most."""

FIRST_CHECK, COLUMNS, LIMIT, IS_SPRUNG = (series.MODEL_END + k for k in range(4))
# For each number of columns: the largest displacement [m], squared, at which they may be enough.
FURTHEST = IS_SPRUNG + 1
# Of the plant: 1 / m1, 1 / m2 [1/kg], -k1 alpha / m1 [1/s^2], -k1 beta / m1 [1/(m s)^2], k0 [N/m].
BY_M1, BY_M2, LINEAR, CUBIC, K0 = (FURTHEST + MOST + k for k in range(5))
# For the bounds of the errors: the square of the sample interval [s^2]; multiplied by it, the slope
# of all springs over m1 at rest [1] and what it grows by with x1^2 [1/m^2]; what multiplies the
# term of a long way [1/m^2]; the angle's square in what raises the estimate; for each number of
# columns, what multiplies the term of a held force, and the angle's square in what the estimate of
# one column less lets expect.
SQUARE, STEEPNESS, STEEPER, BENT, RAISE, PUSHED = (K0 + 1 + k for k in range(6))
LATER = PUSHED + MOST

# Of each column: its substeps; with h their length, h / 6, h / 3, 2 h / 3 [s], h^2 / 24 [s^2], and
# for the middle kick 2 h / 3 (1 + LINEAR h^2 / 24) [s] and 2 h / 3 CUBIC h^2 / 8 [s/m^2]; how far
# velocities carry the positions in h / 2 (2, 2), and what is left of the velocities (2, 2).
COLUMN, COLUMN_SIZE = LATER + MOST, 15
COUNT, SIXTH, THIRD, MIDDLE, GRADIENT, CONSTANT, SLOPE, DRIFT, DECAY = 0, 1, 2, 3, 4, 5, 6, 7, 11

# For each number of columns: the weight of each, and what weighs them to the estimate of the error.
WEIGHTS = COLUMN + COLUMN_SIZE * MOST
ESTIMATE = MOST
WEIGHTS_SIZE = 2 * MOST
END = WEIGHTS + WEIGHTS_SIZE * (MOST + 1)
