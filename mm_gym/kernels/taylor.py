"""Adaptive Taylor series for every plant (Jorba and Zou, Experimental Mathematics 14, 2005).

The field is polynomial but for the finite stretch, a quotient, so the series follows from
recurrences: Cauchy products for the cubic spring, division for the neo-Hookean pair. Its order
follows from the tolerance, each step from its last terms. With dry friction the first exit of
the slip velocity from its regime is found on the series.
"""

from __future__ import annotations

import numpy as np

from mm_gym.kernels import layout as at
from mm_gym.kernels.arithmetic import fma, span
from mm_gym.kernels.friction import NONE, excite, first_exit, sign_of
from mm_gym.kernels.jit import borrowing_kernel, inlined_kernel, kernel
from mm_gym.kernels.vector import alike, larger, read_bits, smaller, where, write_bits

# Slots of the model.
ORDER, TOLERANCE, HAS_FRICTION, IS_CUBIC, IS_FINITE = (at.MODEL_OWN + i for i in range(5))

FEWEST = 8
"""Lowest order of a series."""

MOST_STEPS = 20_000
"""Series in one control step before giving up: some 0.01 s of work."""

_LOG_ZERO = -1.0e5  # what stands for the logarithm of zero
_FAR = 1000.0  # logarithm of a step, beyond which none is limited
_ROUND_OFF = 2.0**-54
_SLACK = 10.0  # binary digits that the last four terms may be smaller than the four before them
_FLOOR = 20.0  # binary digits between the velocities down to which the smaller one is resolved
_SAFETY = 0.9  # the logarithm that steps follow from is 6 % coarse

# Rows of the series in one array, WIDTH apart; the first eight are those of kernels/friction.py.
WIDTH = 36
X1, X2, V1, V2, _OFFSET, _W, _FORCE, _GROUND = (WIDTH * k for k in range(8))
_SQUARE, _LONG, _SHORT, _LONG_POWER, _SHORT_POWER, _SCALED, SHARE = (
    WIDTH * k for k in range(8, 15)
)

# Unsigned: an index that might be negative costs a comparison.
_ONE, _SQUARES = np.uintp(1), np.uintp(_SQUARE)

# Behind them the state (x1, x2, v1, v2, w) and the coefficients of a lane. One array: handing over
# many costs time.
_STATE = WIDTH * 15
BY_M1, BY_M2, K1, BETA, D, K2, _K0, _L0, _STRETCH, U, C, _CHI, _SLIP_FORCE, _VR, SIZE = (
    _STATE + 5 + k for k in range(15)
)


@kernel
def propagate(model, lanes, first, last):
    """Advance the lanes by one control step; force and stretch are held over it."""
    status = at.OK
    c = np.zeros(SIZE)
    write_shares(model, c)
    for i in range(first, last):
        coefficients(lanes, i, model[HAS_FRICTION] > 0.0, c)
        status = max(status, _propagate_lane(model, lanes, i, c))
    return status


@borrowing_kernel
def write_shares(model, c):
    """Write 1 / n for every order."""
    for n in range(int(model[ORDER])):
        c[SHARE + n] = 1.0 / (n + 1.0)


@borrowing_kernel
def coefficients(lanes, i, friction, c):
    """Write what the equations of lane i need."""
    mu1, mu2, vr = lanes[at.MU1, i], lanes[at.MU2, i], lanes[at.VR, i]
    normal, stretch, k0 = lanes[at.FN, i], lanes[at.STRETCH, i], lanes[at.K0, i]
    c[BY_M1], c[BY_M2] = 1.0 / lanes[at.M1, i], 1.0 / lanes[at.M2, i]
    c[D], c[C] = lanes[at.D, i], lanes[at.C, i]
    c[K1], c[BETA] = lanes[at.K1, i] * lanes[at.ALPHA, i], lanes[at.K1, i] * lanes[at.BETA, i]
    c[_K0], c[_L0], c[_STRETCH], c[U] = k0, lanes[at.L0, i], stretch, lanes[at.FORCE, i]
    # Small on large, eq. 15 of the paper: k2 = 2 k0 (1 + 2 / stretch**3).
    c[K2] = 2.0 * k0 * (1.0 + 2.0 / (stretch * stretch * stretch)) if k0 > 0.0 else 0.0
    c[_VR], c[_CHI] = np.inf, 0.0
    if friction:
        c[_VR], c[_CHI], c[C] = vr, lanes[at.CHI, i], mu1 * normal / vr
        c[_SLIP_FORCE] = mu2 * normal - c[_CHI] * vr


@borrowing_kernel
def interface_and_springs(c, offset, w, finite):
    """Return the force on the carriage from a viscous interface and the springs between the masses.

    See docs/model.md.
    """
    if not finite:
        return c[C] * w + c[K2] * offset
    long, short = c[_STRETCH] + offset / c[_L0], c[_STRETCH] - offset / c[_L0]
    pair = (long - 1.0 / (long * long)) - (short - 1.0 / (short * short))
    return c[C] * w + c[_K0] * c[_L0] * pair


@borrowing_kernel
def outer_forces(c, x1, v1):
    """Return the resistance of the carriage's spring and damper less the held force."""
    return (c[K1] + c[BETA] * x1 * x1) * x1 + c[D] * v1 - c[U]


@borrowing_kernel
def _propagate_lane(model, lanes, i, c):
    """Advance one lane, series by series."""
    most, tolerance, duration = int(model[ORDER]), model[TOLERANCE], model[at.TIME_STEP]
    cubic, finite, friction, vr = (
        model[IS_CUBIC] > 0.0,
        model[IS_FINITE] > 0.0,
        model[HAS_FRICTION] > 0.0,
        c[_VR],
    )
    for row in range(4):
        c[_STATE + row] = lanes[row, i]
    w = c[_STATE + 4] = lanes[at.V2, i] - lanes[at.V1, i]
    regime = sign_of(vr, w)
    upper, lower = vr - w, vr + w  # how far the slip velocity is below v_r and above -v_r
    elapsed = 0.0
    unit = (
        duration  # the series' unit of time: about the length of a step, so that no term overflows
    )
    for _ in range(MOST_STEPS):
        excite(c, WIDTH, model, lanes, i, elapsed, unit, most)
        remaining = (duration - elapsed) / unit
        share = share_of(tolerance, unit, duration)
        enough = share if remaining == 1.0 else -1.0
        order = _expand(c, cubic, finite, friction, regime, unit, most, enough)
        if order < FEWEST:
            return at.COLLAPSED
        theta = 1.0 if order < most else min(step_of(c, c, share, order), remaining)
        direction = 0.0
        if friction:
            exit_at, direction = _exit(c, regime, upper, lower, theta, order)
            theta = theta if exit_at == NONE else theta * exit_at
        if not _evaluate(c, friction, theta, order):
            return at.DIVERGED
        if direction != 0.0:
            regime = direction - regime
            c[_STATE + 4] = direction * vr
            upper, lower = (0.0, 2.0 * vr) if direction > 0.0 else (2.0 * vr, 0.0)
        else:
            upper, lower = vr - c[_STATE + 4], vr + c[_STATE + 4]
        elapsed += theta * unit
        if (theta == remaining and direction == 0.0) or elapsed >= duration:
            for row in range(4):
                lanes[row, i] = c[_STATE + row]
            return at.OK
        unit = min(max(theta, 2.0**-20) * unit, duration - elapsed)
    return at.TOO_MANY_SERIES


@inlined_kernel
def share_of(tolerance, unit, duration):
    """Return what a series may use of the tolerance: errors add up."""
    return larger(tolerance * unit / duration, _ROUND_OFF)


@borrowing_kernel
def _exit(series, regime, upper, lower, theta, order):
    """Return where in the step the regime ends, as a fraction of it, and at which boundary.

    The boundary is 1 or -1; NONE and 0 if the regime does not end.
    """
    power = 1.0
    for n in range(1, order + 1):
        power *= theta
        series[_SCALED + n] = series[_W + n] * power
    if regime != 0.0:
        at_time = first_exit(series, _SCALED, order, -upper if regime > 0.0 else -lower, regime)
        return at_time, 0.0 if at_time == NONE else regime
    up, down = (
        first_exit(series, _SCALED, order, upper, -1.0),
        first_exit(series, _SCALED, order, lower, 1.0),
    )
    if up == NONE and down == NONE:
        return NONE, 0.0
    return (up, 1.0) if up <= down else (down, -1.0)


@borrowing_kernel
def _expand(c, cubic, finite, friction, regime, unit, most, enough):
    """Write the series of the state; return its order, 0 if a spring collapsed.

    Term n is the state's n-th derivative times unit**n / n!. The order is the first at which the
    last terms are below the tolerance `enough` of the velocities, at most `most`, and even: two
    orders are worked out together, because positions follow from the velocities before them, so
    that what depends on positions is known for both.
    """
    x1, x2, v1, v2 = c[_STATE], c[_STATE + 1], c[_STATE + 2], c[_STATE + 3]
    w = c[_STATE + 4]
    # What a loop writes to the array it would read from it again: it keeps its own copies.
    by_m1, by_m2, k1, d, k2, beta = c[BY_M1], c[BY_M2], c[K1], c[D], c[K2], c[BETA]
    k2 = 0.0 if finite else k2
    damping = c[C] if regime == 0.0 else c[_CHI]
    held, slip = c[U], (0.0 if regime == 0.0 else regime * c[_SLIP_FORCE])
    c[X1], c[X2], c[V1], c[V2], c[_W] = x1, x2, v1, v2, w
    for m in range(most // 2):
        n = m + m
        step, next_step = unit * c[SHARE + n], unit * c[SHARE + n + 1]
        next_x1, next_x2 = step * v1, step * v2
        c[X1 + n + 1], c[X2 + n + 1] = next_x1, next_x2
        cube = next_cube = 0.0
        if cubic:
            cube, next_cube = cubes(c, m, x1, next_x1)
        pair, next_pair = k2 * (x2 - x1), k2 * (next_x2 - next_x1)
        if finite:
            if not (_stretch(c, n) and _stretch(c, n + 1)):
                return 0
            pair, next_pair = _pair(c, n), _pair(c, n + 1)
        inner, outer = pair + slip, fma(k1, x1, fma(beta, cube, -held))
        v1, v2, w = _accelerate(
            c, n, step, by_m1, by_m2, d, damping, inner, outer, v1, v2, w, friction
        )
        x1, x2, outer = next_step * v1, next_step * v2, fma(k1, next_x1, beta * next_cube)
        v1, v2, w = _accelerate(
            c, n + 1, next_step, by_m1, by_m2, d, damping, next_pair, outer, v1, v2, w, friction
        )
        c[X1 + n + 2], c[X2 + n + 2] = x1, x2
        held = slip = 0.0
        if enough > 0.0 and n + 2 >= FEWEST and is_enough(c, n + 2, enough):
            return n + 2
    return most


@inlined_kernel
def is_enough(c, order, enough):
    """Tell whether the last terms of both velocities are below a tolerance of their scale.

    As `step_of`, at a step of one unit.
    """
    scale1, scale2 = _largest(c, V1), _largest(c, V2)
    both = 2.0**-_FLOOR * larger(scale1, scale2)
    last1, last2 = _last(c, V1, order), _last(c, V2, order)
    within1, within2 = enough * larger(scale1, both), enough * larger(scale2, both)
    return (last1 <= within1) & (last2 <= within2)


@inlined_kernel
def _last(c, row, order):
    """Return the magnitude of the largest of the last eight terms, the earlier four reduced.

    Where only the cubic spring acts, symmetry leaves a term in four; begun at rest under a held
    force, in six; under a force that rises from zero, in eight. Reduced, because where no term is
    missing the last four are to decide.
    """
    last = larger(abs(c[row + order - 3]), _largest(c, row + order - 2))
    before = larger(abs(c[row + order - 7]), _largest(c, row + order - 6))
    return larger(last, 2.0**-_SLACK * before)


@inlined_kernel
def _largest(c, first):
    """Return the magnitude of the largest of three terms."""
    return larger(larger(abs(c[first]), abs(c[first + 1])), abs(c[first + 2]))


@inlined_kernel
def _accelerate(c, n, step, by_m1, by_m2, d, damping, inner, outer, v1, v2, w, friction):
    """Write and return term n + 1 of the velocities, given term n and the forces.

    Those are what the springs between the masses, and the carriage's, add.
    """
    outer -= c[_FORCE + n]
    if friction:
        # Near a stiff stick the digits of v2 - v1 would cancel, so w has a series of its own.
        creep, outer = damping * w, outer + d * v1
        v1 = step * ((creep + inner - outer) * by_m1 - c[_GROUND + n])
        v2 = step * (-(creep + inner) * by_m2 - c[_GROUND + n])
        w = step * (outer * by_m1 - (inner + creep) * (by_m1 + by_m2))
        c[_W + n + 1] = w
    else:
        v1, v2 = accelerated(step, by_m1, by_m2, d, damping, inner, outer, c[_GROUND + n], v1, v2)
    c[V1 + n + 1], c[V2 + n + 1] = v1, v2
    return v1, v2, w


@inlined_kernel
def accelerated(step, by_m1, by_m2, d, damping, inner, outer, ground, v1, v2):
    """Return term n + 1 of the velocities, given term n, of a viscous interface."""
    # Each term waits for the velocities, and for nothing else: they come last.
    on1, on2 = fma(inner - outer, by_m1, -ground), fma(-inner, by_m2, -ground)
    slip = v2 - v1
    v1 = step * fma(-(damping + d) * by_m1, v1, fma(damping * by_m1, v2, on1))
    return v1, step * fma(-damping * by_m2, slip, on2)


@inlined_kernel
def _pair(c, n):
    """Return term n of the force of the springs of finite stretch."""
    offset = c[X2 + n] - c[X1 + n]
    return c[_K0] * fma(2.0, offset, c[_L0] * (c[_SHORT_POWER + n] - c[_LONG_POWER + n]))


@inlined_kernel
def cubes(c, m, newest, next_newest):
    """Return terms 2 m and 2 m + 1 of x1**3, and write those of x1**2, given those of x1.

    Products are summed from the middle outwards, because the newest terms are the last to be known;
    those of the square come in equal pairs.
    """
    n = m + m
    first = c[X1]
    if m == 0:
        square = c[_SQUARE] = first * first
        c[_SQUARE + 1] = 2.0 * first * next_newest
        return square * first, 3.0 * square * next_newest
    middle, following, below = c[X1 + m], c[X1 + m + 1], c[_SQUARE + m]
    square, next_square = 0.5 * middle * middle, middle * following
    cube, next_cube = below * middle, below * following
    other = next_other = alike(first, 0.0)
    for j in span(1, m):
        low, high = np.uintp(m) - j, np.uintp(m) + j
        x, far, farther = c[low], c[high], c[high + _ONE]  # of x1: its row is the first
        below, above = c[_SQUARES + low], c[_SQUARES + high]
        square, next_square = fma(x, far, square), fma(x, farther, next_square)
        cube, next_cube = fma(below, far, cube), fma(below, farther, next_cube)
        other, next_other = fma(above, x, other), fma(above, c[low + _ONE], next_other)
    square = 2.0 * fma(first, newest, square)
    next_square = 2.0 * fma(first, next_newest, next_square)
    c[_SQUARE + n], c[_SQUARE + n + 1] = square, next_square
    below = c[_SQUARE]
    cube = fma(below, newest, cube) + fma(square, first, other)
    next_other = fma(next_square, first, fma(square, c[X1 + 1], next_other))
    return cube, fma(below, next_newest, next_cube) + next_other


@borrowing_kernel
def _stretch(c, n):
    """Write term n of both sides' stretch l and of u = l**-2; False if collapsed.

    From n l0 u_n = -sum (n + j) l_j u_(n-j).
    """
    for side in range(2):
        stretch, power = _LONG + side * WIDTH, _LONG_POWER + side * WIDTH
        c[stretch + n] = (1.0 - 2.0 * side) * (c[X2 + n] - c[X1 + n]) / c[_L0]
        if n == 0:
            c[stretch] += c[_STRETCH]
            if not c[stretch] > 0.0:
                return False
            c[power] = 1.0 / (c[stretch] * c[stretch])
        else:
            total = 0.0
            for j in range(1, n + 1):
                total -= (n + j) * c[stretch + j] * c[power + n - j]
            c[power + n] = total / (n * c[stretch])
    return True


@inlined_kernel
def _log2(x):
    """Return log2 of a magnitude, at most 0.09 too small: its bits read as an integer."""
    return where(x == 0.0, _LOG_ZERO, read_bits(abs(x)) * 2.0**-52 - 1023.0)


@inlined_kernel
def _exp2(y):
    """Return 2**y, at most 6 % too large."""
    return write_bits((smaller(larger(y, -_FAR), _FAR) + 1023.0) * 2.0**52)


@borrowing_kernel
def step_of(c, shares, tolerance, order):
    """Return the step at which the last terms fall below the tolerance, in units of the series.

    Those are the ones that `_last` looks at.

    Each velocity is judged by its own scale, down to 1e-6 of the other's: a fast sphere that
    nothing joins to the carriage must not hide the carriage's motion.
    """
    log = _log2(tolerance)
    one0, one1, one2 = _log2(c[V1]), _log2(c[V1 + 1]), _log2(c[V1 + 2])
    two0, two1, two2 = _log2(c[V2]), _log2(c[V2 + 1]), _log2(c[V2 + 2])
    step1 = _step_of_one(
        c,
        shares,
        V1,
        log + larger(one0, two0 - _FLOOR),
        log + larger(one1, two1 - _FLOOR),
        log + larger(one2, two2 - _FLOOR),
        order,
    )
    step2 = _step_of_one(
        c,
        shares,
        V2,
        log + larger(two0, one0 - _FLOOR),
        log + larger(two1, one1 - _FLOOR),
        log + larger(two2, one2 - _FLOOR),
        order,
    )
    return _SAFETY * _exp2(smaller(step1, step2))


@inlined_kernel
def _step_of_one(c, shares, row, lead0, lead1, lead2, order):
    """Return the logarithm of the step for one velocity, from what its last terms may reach.

    Of the leading terms the one that allows most counts: at rest or at a turning point the first is
    zero.
    """
    last = alike(lead0, _FAR)
    for n in range(order - 3, order + 1):
        allowed = _allowed(shares, _log2(c[row + n]), lead0, lead1, lead2, n)
        last = smaller(last, allowed)
    # One logarithm for all four: they are a rough guard.
    largest = larger(abs(c[row + order - 7]), _largest(c, row + order - 6))
    before = _allowed(shares, _log2(largest), lead0, lead1, lead2, order - 4)
    return smaller(last, before + _SLACK * shares[SHARE + order - 1])


@inlined_kernel
def _allowed(shares, term, lead0, lead1, lead2, n):
    """Return the logarithm of the step that term n allows, from the logarithm of the term."""
    first, second, third = shares[SHARE + n - 1], shares[SHARE + n - 2], shares[SHARE + n - 3]
    step = larger(larger((lead0 - term) * first, (lead1 - term) * second), (lead2 - term) * third)
    return where(term > _LOG_ZERO, step, _FAR)


@borrowing_kernel
def _evaluate(c, friction, theta, order):
    """Advance the state by a time in units of the series; tell whether it is still finite."""
    x1 = x2 = v1 = v2 = w = 0.0
    for n in range(order, 0, -1):
        x1, x2 = fma(x1, theta, c[X1 + n]), fma(x2, theta, c[X2 + n])
        v1, v2 = fma(v1, theta, c[V1 + n]), fma(v2, theta, c[V2 + n])
        if friction:
            w = fma(w, theta, c[_W + n])
    c[_STATE] = fma(x1, theta, c[_STATE])
    c[_STATE + 1] = fma(x2, theta, c[_STATE + 1])
    c[_STATE + 2] = fma(v1, theta, c[_STATE + 2])
    c[_STATE + 3] = fma(v2, theta, c[_STATE + 3])
    c[_STATE + 4] = fma(w, theta, c[_STATE + 4]) if friction else c[_STATE + 3] - c[_STATE + 2]
    return abs(c[_STATE]) + abs(c[_STATE + 1]) + abs(c[_STATE + 2]) + abs(c[_STATE + 3]) < np.inf
