"""Rows of the lanes array, and slots of the model and task arrays.

Rows are components and columns are lanes, so that a loop over lanes reads memory in order.
"""

from __future__ import annotations

# Status codes; of several, the largest is returned.
OK = 0
ENDED = 1  # an episode ended in one of the lanes
NOT_FINITE = 2  # an action is NaN or infinite; nothing was changed
ESCAPED = 3
TOO_MANY_EVENTS = 4
TOO_MANY_SERIES = 5
DIVERGED = 6
COLLAPSED = 7
TOO_MANY_STEPS = 8
UNREWARDED = 9

MESSAGES: dict[int, str] = {
    ESCAPED: (
        "escape: carriage.cubic_coefficient < 0 drives the carriage ever faster away from the "
        "middle; objective.displacement_limit ends such an episode instead"
    ),
    TOO_MANY_EVENTS: (
        "more changes of the friction's regime in one control step than can be followed; "
        "shorten control.time_step"
    ),
    TOO_MANY_SERIES: (
        "the series needs too many steps within one control step; "
        "shorten control.time_step or loosen solver.tolerance"
    ),
    TOO_MANY_STEPS: (
        "the motion needs too many steps within one control step; "
        "shorten control.time_step or loosen solver.tolerance"
    ),
    DIVERGED: (
        "the state is no longer finite, or what it costs is beyond the largest double; "
        "shorten control.time_step, or choose another solver.method"
    ),
    COLLAPSED: (
        "the offset has shortened a spring of finite stretch to nothing; "
        "it is valid for |offset| < stretch * rest_length"
    ),
    UNREWARDED: "reward: the caller's own is not a finite number after this control step",
}
"""What went wrong, for the codes above NOT_FINITE."""

BLOCK = 512
"""Lanes worked on together.

Few enough to stay in the first-level cache, many enough to fill the vector units.
"""

# Rows of the lanes array: state, what the actuators apply, bookkeeping.
X1, X2, V1, V2 = 0, 1, 2, 3
FORCE, STRETCH, DAMPING = 4, 5, 6  # side by side; DAMPING goes on to another row, see `DAMPED`
APPLIED = {"force": FORCE, "stretch": STRETCH, "damping": DAMPING, "voltage": DAMPING}
"""By the actuators' names; a scene has a damping or a voltage at most."""
BEGAN = 7  # NOW when the episode began
FORCE_ASKED, STRETCH_ASKED, DAMPING_ASKED = 8, 9, 10  # what a rate commanded adds up to

# Rows of what follows from the state, written only if a channel shows them.
CARRIAGE_ACCELERATION, SPHERE_ACCELERATION, SPRING_FORCE = 11, 12, 13
DISTURBANCE, GROUND_ACCELERATION = 14, 15
DERIVED = range(CARRIAGE_ACCELERATION, GROUND_ACCELERATION + 1)
REACTIONS = range(CARRIAGE_ACCELERATION, SPRING_FORCE + 1)

# Rows of the flags that say how a control step ended; MARKED: whether one of a block is set, in its
# first lane.
TERMINATED, TRUNCATED, MARKED = 0, 1, 2

# Rows of the physical parameters, which randomisation may draw for each episode.
M1, M2, K1, D, ALPHA, BETA = 16, 17, 18, 19, 20, 21
C, MU1, MU2, VR, CHI, FN = 22, 23, 24, 25, 26, 27
K0, L0 = 28, 29

# What dry friction comes to, written when an episode begins (`law.dry_friction.write_regimes`): its
# slope in stick is in row C, where a viscous interface has its damping; this is mu2 F_N [N].
KINETIC_FORCE = 30

# Rows of a block's clock, in its first lane: the control steps made so far, and until how many none
# of its episodes has had its steps. So no step counts for every lane.
NOW, DUE = 31, 32

# Rows of the first harmonic; the next harmonic follows HARMONIC_ROWS further down. COSINE and SINE
# are those of the present phase, ROTATE_COSINE and ROTATE_SINE those of its advance in one sample
# interval.
HARMONICS = 33
HARMONIC_ROWS = 7
AMPLITUDE, FREQUENCY, PHASE, COSINE, SINE, ROTATE_COSINE, ROTATE_SINE = 0, 1, 2, 3, 4, 5, 6

# Behind the harmonics come the jets: what all other sources of force, then of ground acceleration,
# do in the present sample interval h, as coefficients of (t / h)^n; then each source's own rows.

# Rows of a lane's own sensors, behind all others: delay in control steps, probability of a dropout,
# age of the newest frame observed; then of each channel the standard deviation of its noise and
# what it shows too much, in SI units.
DELAY, DROPOUT, AGE = 0, 1, 2
SENSORS_SIZE = 3
SPREAD, BIAS = 0, 1
ERRORS_SIZE = 2

# Rows of a lane's own actuator, behind those: lag [s], rate limit [1/s times its unit], and what
# follows from them when an episode begins: the fraction of the way that the lag lets it go in a
# control step, and the largest change in one.
LAG, RATE_LIMIT, LAG_FACTOR, TRAVEL = 0, 1, 2, 3
ACTUATOR_SIZE = 4

# Slots of the model array, common to every method; those of a method begin at MODEL_OWN.
SAMPLE_INTERVAL, HARMONIC_COUNT, GROUND = (
    0,
    1,
    2,
)  # [s]; bit j of GROUND: harmonic j shakes the ground
INTERVALS = 3  # sample intervals in a control step
JETS, TERMS = 4, 5  # row of the first jet; its coefficients, 0 if there are no other sources
EXCITATION = 6  # slot where the sampled excitation is described
INTERFACE = 7
"""Row of the first parameter of an interface in value form; its own states, if any, are before."""
BETWEEN = 8
"""1 if the control force acts between the masses, 0 if between the ground and the carriage."""
DAMPED = 9
"""Row that an actuated damping or voltage goes on to: C, D or one of the interface's; 0 if none
is actuated."""
MODEL_OWN = 10

# Slots of the task array.
# Of each actuator: whether there is one, least and largest value, most change in a control step;
# whether it is commanded by rate, and the fraction of the way that a lag lets it go in one.
HAS_FORCE, FORCE_LOW, FORCE_LIMIT, FORCE_RATE, FORCE_IS_RATE, FORCE_LAG_FACTOR = range(6)
HAS_STRETCH, STRETCH_LOW, STRETCH_HIGH, STRETCH_RATE = 6, 7, 8, 9
STRETCH_IS_RATE, STRETCH_LAG_FACTOR = 10, 11
HAS_DAMPING, DAMPING_LOW, DAMPING_HIGH, DAMPING_RATE = 12, 13, 14, 15
DAMPING_IS_RATE, DAMPING_LAG_FACTOR = 16, 17
WEIGHT_DISPLACEMENT, WEIGHT_VELOCITY, WEIGHT_EFFORT, WEIGHT_STROKE = 18, 19, 20, 21
DISPLACEMENT_LIMIT, RAIL_LIMIT, STEPS = 22, 23, 24
# Whether a channel or the reward reads what follows from the state; an acceleration or a force
# between the masses; whether there is noise.
IS_DERIVED, HAS_REACTIONS, IS_NOISY = 25, 26, 27
# Numbers of its stream that a lane passes over after each frame, whether its sensors have noise or
# not, so that what excites it does not depend on them; whether the sensors' noise is these numbers.
RESERVED, HAS_RESERVED_NOISE = 28, 29
# Of the squares of what follows from the state, and whether one of them is not 0.
WEIGHT_CARRIAGE_ACCELERATION, WEIGHT_SPHERE_ACCELERATION, WEIGHT_COUPLING_FORCE = 30, 31, 32
HAS_DERIVED_COST = 33
# Of what each lane has for itself: first row of its sensors and of each actuator, see below, 0 if
# it is the same in all lanes; frames observed; largest delay; whether frames are lost.
SENSORS_ROW, FORCE_ROW, STRETCH_ROW, DAMPING_ROW = 34, 35, 36, 37
HISTORY, MOST_DELAY, HAS_DROPOUT = 38, 39, 40
TIME_STEP = 41  # [s] of a control step
CHANNEL_COUNT = 42
CHANNELS = 43  # then, per channel, CHANNEL_SIZE slots
CHANNEL_SIZE = 5
SHOWN, SUBTRACTED = 0, 1  # rows of the lanes; SUBTRACTED is NO_ROW where none is
SCALE, ZERO, NOISE = 2, 3, 4  # factor, value shown as 0, scaled standard deviation of the noise
NO_ROW = -1

OBSERVATION_BOUND = 3.4028234663852886e38
"""Largest number of single precision: an observation beyond it is shown as this."""
