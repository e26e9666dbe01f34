"""Slots of the Runge-Kutta model, behind those of the Taylor series that it falls back on."""

from __future__ import annotations

from mm_gym.excitation.sources import MOST_ROWS
from mm_gym.methods.taylor import layout as series

# Steps of a sample interval to begin with, 0 if the series do all the work; stages of a step; the
# limit of the interval's relative error, and of a step's second estimate, squared; whether the two
# estimates combine to one; by what part of its bend, over the square of the step [1/s^2], a slip
# velocity may differ from a cubic; how near the predicted time of an event must come [s]; how often
# to take the root of the error for the next length; the number of the first of the stages' sums.
STEPS, STAGES, LIMIT, COARSE, IS_COMBINED, BEND, NEAR, ROOTS, SUM = (
    series.MODEL_END + k for k in range(9)
)
TIMES = SUM + 1
"""Of each stage behind the first, in steps."""

MOST_STAGES = 13
"""The end of the step counts."""

# Rows of a vector each. First those that a lane takes along to another slot: the state where the
# step begins, the interface's own last; the coefficients of the equations, in the order of
# `law.motion.Coefficients`; the forces held on the carriage and between the masses [N].
STATE, OWN, COEFFICIENTS = 0, 4, 6
ONE_BY_M1, ONE_BY_M2, LINEAR, CUBIC, D, K2, TWICE_K0, BY_L0, STRETCH, FORCE, PAIR = (
    COEFFICIENTS + k for k in range(11)
)
# Of dry friction: the reference velocity, slope in stick, slope and force at w = 0 in slip, regime.
VR, CREEP, CHI, SLIPPING, REGIME = (PAIR + 1 + k for k in range(5))
# Where the step begins in the sample interval [s]; its length [s], also over m1 and m2; the steps
# so far; the lane's number; whether it is done.
ELAPSED, LENGTH, BY_M1, BY_M2, COUNT, LANE, OUTCOME = (REGIME + 1 + k for k in range(7))
GOES_ON, DONE, GIVEN_UP = 0.0, 1.0, 2.0
# The boundary, 1 or -1, at which the step is to end, 0 if at none; the length of the next step [s],
# 0 if the error says it; what corrects the time of this one [s]; whether it ends in a new regime.
TARGET, NEXT, SHIFT, ARRIVES = (OUTCOME + 1 + k for k in range(4))
# Both accelerations of each stage, times the step's length; of the first a lane takes along.
KICKS = ARRIVES + 1
MOVED = KICKS + 2
END = KICKS + 2 * MOST_STAGES
"""The state at the step's end, as `STATE`."""
SOURCES = END + 6
"""Those of `excitation.sources`."""
# Whether the step is accepted, and by what factor the next may be longer; whether the slip velocity
# stays in its regime, leaves it, or may; at which boundary, and after what part of the step.
GOOD, FACTOR, VERDICT, SIDE, TIME = (SOURCES + MOST_ROWS + k for k in range(5))
STAYS, LEAVES, MAY_LEAVE = 0.0, 1.0, 2.0
OWN_KICKS = TIME + 1
"""Changes of the interface's own states, as `KICKS`; with one of them every other row is empty."""
# Parameters of the interface; the first two are those of the line that it is in one regime.
PARAMETERS = SLOPE = OWN_KICKS + 2 * MOST_STAGES
INTERCEPT = SLOPE + 1
MOST_PARAMETERS = 16
SIZE = PARAMETERS + MOST_PARAMETERS
