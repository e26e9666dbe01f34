"""Slots of the Runge-Kutta model, behind those of the Taylor series that it falls back on."""

from __future__ import annotations

from mm_gym.methods.taylor import layout as series

# Steps of a sample interval, 0 if the series do all the work; stages of a step; the limit of the
# interval's relative error, and of a step's second estimate, squared; whether the two estimates
# combine to one; by what part of its bend a slip velocity may differ from a cubic; how near the
# predicted time of an event must come [s].
STEPS, STAGES, LIMIT, COARSE, IS_COMBINED, BEND, NEAR = (series.MODEL_END + k for k in range(7))
TABLEAU = NEAR + 1
"""For each stage: its time, then for each earlier one the weights in velocities and positions; then
for each estimate those of all stages."""

MOST_STAGES = 13
"""The end of the step counts."""

MOST_SOURCES = 48
"""Rows that excitation may have."""

# Rows of a vector each: the state at the step's start and end; the accelerations of the stages.
STATE, END = 0, 4
FIRST, SECOND = 8, 8 + MOST_STAGES
# Coefficients of the equations, in the order of `law.motion.Coefficients`; the force held [N].
COEFFICIENTS = SECOND + MOST_STAGES
BY_M1, BY_M2, LINEAR, CUBIC, D, SLOPE, INTERCEPT, K2, TWICE_K0, BY_L0, STRETCH, FORCE = (
    COEFFICIENTS + k for k in range(12)
)
# Of dry friction: the reference velocity, slope in stick, slope and force at w = 0 in slip, regime.
VR, CREEP, CHI, SLIPPING, REGIME = (FORCE + 1 + k for k in range(5))
# Where the step begins in the sample interval [s], and its length [s]; whether it is accepted.
ELAPSED, LENGTH, GOOD = (REGIME + 1 + k for k in range(3))
# Whether the slip velocity stays in its regime, leaves it, or may; the boundary, 1 or -1, at which
# the next step is to end, 0 if at none; its length [s]; what corrects the time of this one [s].
VERDICT, TARGET, NEXT, SHIFT = (GOOD + 1 + k for k in range(4))
STAYS, LEAVES, MAY_LEAVE = 0.0, 1.0, 2.0
# Of a lane that waits: its number, its steps so far, and whether it is done.
LANE, COUNT, OUTCOME = (SHIFT + 1 + k for k in range(3))
GOES_ON, DONE, GIVEN_UP = 0.0, 1.0, 2.0
SOURCES = OUTCOME + 1
"""Then the jets' coefficients, and amplitude, frequency, cosine and sine of each harmonic."""
HARMONIC_ROWS = 4
SIZE = SOURCES + MOST_SOURCES
