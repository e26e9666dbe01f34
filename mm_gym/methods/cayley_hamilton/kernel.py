"""Propagation of a linear plant of which only the stretch and what drives it change.

By the theorem of Cayley and Hamilton the exponential of a 4 by 4 generator is a cubic in it. The
four coefficients are entire functions of the springs' stiffness, so over what the stretch reaches
each is one polynomial. A harmonic force is not summed up: the steady motion that it causes is taken
off the state, and put on again at the step's end. Sampled excitation is a polynomial in time of
degree n - 1: Taylor's series of the motion is summed up to the derivative n, which nothing drives
any more, and what remains is a cubic in the generator times that derivative.

Within the kernel the state is x1, the offset, and h times v1 and the slip velocity w: all of one
unit, so that the generator has none.
"""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors
from mm_gym.lanes.memory import span
from mm_gym.law.linear_motion import ROUND_OFF
from mm_gym.law.springs import stiffness

COEFFICIENTS = 10
"""Of each polynomial in the stiffness. `method` says why so many."""

# Slots of the model. The generator, in units of the sample interval h and the carriage's mass m1,
# K0 among it; what brings the stiffness to [-1, 1]; whether a force can be held; and a bound of the
# generator.
K1, D, C, K0, PUSH, MASS_RATIO, MIDDLE, SCALE, IS_PUSHED = (layout.MODEL_OWN + i for i in range(9))
PHASE = IS_PUSHED + 1
# Four polynomials for the state, four for a held force, four for what remains of Taylor's series;
# the highest coefficient first.
OF_STATE = PHASE + 1
OF_FORCE = OF_STATE + 4 * COEFFICIENTS
OF_REST = OF_FORCE + 4 * COEFFICIENTS
END = OF_REST + 4 * COEFFICIENTS

LINE = 2
"""Terms of a jet that is linear in time."""


@borrowing_kernel
def propagate(model, lanes, first, last):
    """Advance the lanes by one sample interval; force and stretch are held over it."""
    count, terms = int(model[layout.HARMONIC_COUNT]), int(model[layout.TERMS])
    if count == 1 and terms == 0:
        _move_with_harmonic(model, lanes, first, last)
    else:
        for j in range(count):
            _shift(model, lanes, j, False, first, last)
        if terms == 0:
            _move(model, lanes, first, last)
        elif terms == LINE:
            _move_along_line(model, lanes, first, last)
        else:
            _move_along(model, terms, lanes, first, last)
        for j in range(count):
            _shift(model, lanes, j, True, first, last)
    if model[IS_PUSHED] > 0.0 and (terms == 0 or model[layout.BETWEEN] > 0.0):
        _push(model, lanes, first, last)
    return layout.OK


@borrowing_kernel
def _move(model, lanes, first, last):
    """Advance the state as if nothing drove it."""
    prefer_widest_vectors()
    h, generator, cubic = model[layout.SAMPLE_INTERVAL], _generator(model), _cubic(model, OF_STATE)
    by_h, k0, middle, scale = 1.0 / h, model[K0], model[MIDDLE], model[SCALE]
    x1s, x2s = lanes[layout.X1, first:last], lanes[layout.X2, first:last]
    v1s, v2s = lanes[layout.V1, first:last], lanes[layout.V2, first:last]
    stretches = lanes[layout.STRETCH, first:last]
    for i in range(last - first):
        k2 = stiffness(k0, stretches[i])
        z = x1s[i], x2s[i] - x1s[i], h * v1s[i], h * (v2s[i] - v1s[i])
        x1, offset, v1, w = _moved(generator, cubic, k2, scale * (k2 - middle), z)
        x1s[i], x2s[i], v1s[i], v2s[i] = x1, x1 + offset, by_h * v1, by_h * (v1 + w)


@borrowing_kernel
def _move_along_line(model, lanes, first, last):
    """Advance the state under the held force and jets that are linear in time."""
    prefer_widest_vectors()
    h, generator, cubic = model[layout.SAMPLE_INTERVAL], _generator(model), _cubic(model, OF_REST)
    stiffnesses = model[K0], model[MIDDLE], model[SCALE]
    push = (
        model[PUSH],
        1.0 - model[layout.BETWEEN],
    )  # a force between the masses is added in `_push`
    jets, times = int(model[layout.JETS]), (h, 1.0 / h, h * h)
    if last - first == 1:  # a lone lane does without what a loop prepares
        _step_along_line(generator, cubic, stiffnesses, push, times, lanes, jets, first)
        return
    for i in span(first, last):
        _step_along_line(generator, cubic, stiffnesses, push, times, lanes, jets, i)


@inlined_kernel
def _step_along_line(generator, cubic, stiffnesses, push, times, lanes, jets, i):
    """Advance lane i under the held force and jets that are linear in time.

    Parameters
    ----------
    generator, cubic
        Constants of the plant, and the cubic's coefficients.
    stiffnesses
        K0, MIDDLE and SCALE.
    push
        Acceleration times h^2 per force, and the part of the held force that counts.
    times
        The sample interval h [s], 1 / h and h^2.
    lanes
        (rows, lanes) float64; the state is written.
    jets
        Row of the first jet.
    """
    (k0, middle, scale), (h, by_h, square), (push, part) = stiffnesses, times, push
    k2 = stiffness(k0, lanes[layout.STRETCH, i])
    x1, v1, ground = lanes[layout.X1, i], lanes[layout.V1, i], jets + LINE
    z = x1, lanes[layout.X2, i] - x1, h * v1, h * (lanes[layout.V2, i] - v1)
    force = push * fma(part, lanes[layout.FORCE, i], lanes[jets, i])
    y = _driven(generator, k2, z, force, square * lanes[ground, i], 1.0)
    force = push * lanes[jets + 1, i]
    rest = _driven(generator, k2, y, force, square * lanes[ground + 1, i], 0.5)
    z = z[0] + y[0], z[1] + y[1], z[2] + y[2], z[3] + y[3]
    x1, offset, v1, w = _moved(generator, cubic, k2, scale * (k2 - middle), rest)
    x1, v1 = z[0] + x1, z[2] + v1
    lanes[layout.X1, i], lanes[layout.X2, i] = x1, x1 + (z[1] + offset)
    lanes[layout.V1, i], lanes[layout.V2, i] = by_h * v1, by_h * (v1 + (z[3] + w))


@borrowing_kernel
def _move_along(model, terms, lanes, first, last):
    """Advance the state under the held force and any jets."""
    h, generator, cubic = model[layout.SAMPLE_INTERVAL], _generator(model), _cubic(model, OF_REST)
    by_h, push, square, jets = 1.0 / h, model[PUSH], h * h, int(model[layout.JETS])
    part = 1.0 - model[layout.BETWEEN]
    for i in range(first, last):
        k2 = stiffness(model[K0], lanes[layout.STRETCH, i])
        x1, v1 = lanes[layout.X1, i], h * lanes[layout.V1, i]
        y = x1, lanes[layout.X2, i] - x1, v1, h * lanes[layout.V2, i] - v1
        z, force = (0.0, 0.0, 0.0, 0.0), part * lanes[layout.FORCE, i]
        for n in range(terms):
            z = z[0] + y[0], z[1] + y[1], z[2] + y[2], z[3] + y[3]
            force, ground = push * (force + lanes[jets + n, i]), lanes[jets + terms + n, i]
            y, force = _driven(generator, k2, y, force, square * ground, 1.0 / (n + 1.0)), 0.0
        y = _moved(generator, cubic, k2, model[SCALE] * (k2 - model[MIDDLE]), y)
        z = z[0] + y[0], z[1] + y[1], by_h * (z[2] + y[2]), by_h * (z[3] + y[3])
        lanes[layout.X1, i], lanes[layout.X2, i] = z[0], z[0] + z[1]
        lanes[layout.V1, i], lanes[layout.V2, i] = z[2], z[2] + z[3]


@borrowing_kernel
def _move_with_harmonic(model, lanes, first, last):
    """Advance the state under one harmonic force."""
    prefer_widest_vectors()
    h, generator, cubic = model[layout.SAMPLE_INTERVAL], _generator(model), _cubic(model, OF_STATE)
    by_h, k0, middle, scale = 1.0 / h, model[K0], model[MIDDLE], model[SCALE]
    push, ratio = model[PUSH], model[MASS_RATIO]
    x1s, x2s = lanes[layout.X1, first:last], lanes[layout.X2, first:last]
    v1s, v2s = lanes[layout.V1, first:last], lanes[layout.V2, first:last]
    stretches = lanes[layout.STRETCH, first:last]
    amplitudes = lanes[layout.HARMONICS + layout.AMPLITUDE, first:last]
    frequencies = lanes[layout.HARMONICS + layout.FREQUENCY, first:last]
    cosines, sines = (
        lanes[layout.HARMONICS + layout.COSINE, first:last],
        lanes[layout.HARMONICS + layout.SINE, first:last],
    )
    turns = lanes[layout.HARMONICS + layout.ROTATE_COSINE, first:last]
    slants = lanes[layout.HARMONICS + layout.ROTATE_SINE, first:last]
    for i in range(last - first):
        k2, c, s, turn, slant = (
            stiffness(k0, stretches[i]),
            cosines[i],
            sines[i],
            turns[i],
            slants[i],
        )
        steady = _steady(generator, ratio, k2, push * amplitudes[i], h * frequencies[i])
        y1, y2, u1, u2 = _at_phase(steady, c, s)
        z = x1s[i] - y1, x2s[i] - x1s[i] - y2, h * v1s[i] - u1, h * (v2s[i] - v1s[i]) - u2
        x1, offset, v1, w = _moved(generator, cubic, k2, scale * (k2 - middle), z)
        y1, y2, u1, u2 = _at_phase(steady, fma(c, turn, -s * slant), fma(s, turn, c * slant))
        x1, offset, v1, w = x1 + y1, offset + y2, v1 + u1, w + u2
        x1s[i], x2s[i], v1s[i], v2s[i] = x1, x1 + offset, by_h * v1, by_h * (v1 + w)


@borrowing_kernel
def _shift(model, lanes, j, is_end, first, last):
    """Take the steady motion under a harmonic force off the state, or put it on at the end.

    Parameters
    ----------
    is_end
        Whether the motion at the interval's end is put on, or that at its start taken off.
    """
    prefer_widest_vectors()
    h, generator, k0 = model[layout.SAMPLE_INTERVAL], _generator(model), model[K0]
    push, ratio, by_h, harmonic = (
        model[PUSH],
        model[MASS_RATIO],
        1.0 / h,
        layout.HARMONICS + layout.HARMONIC_ROWS * j,
    )
    for i in range(first, last):
        c, s = lanes[harmonic + layout.COSINE, i], lanes[harmonic + layout.SINE, i]
        if is_end:
            turn, slant = (
                lanes[harmonic + layout.ROTATE_COSINE, i],
                lanes[harmonic + layout.ROTATE_SINE, i],
            )
            c, s = fma(c, turn, -s * slant), fma(s, turn, c * slant)
        k2 = stiffness(k0, lanes[layout.STRETCH, i])
        amplitude = push * lanes[harmonic + layout.AMPLITUDE, i]
        steady = _steady(generator, ratio, k2, amplitude, h * lanes[harmonic + layout.FREQUENCY, i])
        x1, offset, v1, w = _at_phase(steady, c, s)
        sign = 1.0 if is_end else -1.0
        lanes[layout.X1, i] += sign * x1
        lanes[layout.X2, i] += sign * (x1 + offset)
        lanes[layout.V1, i] += sign * by_h * v1
        lanes[layout.V2, i] += sign * by_h * (v1 + w)


@borrowing_kernel
def _push(model, lanes, first, last):
    """Add what the held force causes from rest."""
    prefer_widest_vectors()
    generator, cubic = _generator(model), _cubic(model, OF_FORCE)
    slide = (
        generator[3] if model[layout.BETWEEN] > 0.0 else 1.0
    )  # w', as the carriage speeds up by 1
    by_h, k0, middle, scale = (
        1.0 / model[layout.SAMPLE_INTERVAL],
        model[K0],
        model[MIDDLE],
        model[SCALE],
    )
    x1s, x2s = lanes[layout.X1, first:last], lanes[layout.X2, first:last]
    v1s, v2s = lanes[layout.V1, first:last], lanes[layout.V2, first:last]
    stretches, forces, push = (
        lanes[layout.STRETCH, first:last],
        lanes[layout.FORCE, first:last],
        model[PUSH],
    )
    for i in range(last - first):
        k2, u = stiffness(k0, stretches[i]), push * forces[i]
        z = 0.0, 0.0, u, -slide * u
        x1, offset, v1, w = _moved(generator, cubic, k2, scale * (k2 - middle), z)
        x1s[i] += x1
        x2s[i] += x1 + offset
        v1s[i] += by_h * v1
        v2s[i] += by_h * (v1 + w)


@borrowing_kernel
def respond(model, lanes, time, v1, v2, i):
    """Add to the state of a lane its free motion after given velocities at rest (Taylor series).

    Parameters
    ----------
    model
        (m,) float64, read.
    lanes
        (rows, lanes) float64; the stretch is read, the state written.
    time
        How long the motion lasts [s]; less than the sample interval.
    v1, v2
        Velocities at its start [m/s].
    i
        The lane.
    """
    h, generator = model[layout.SAMPLE_INTERVAL], _generator(model)
    k2 = stiffness(model[K0], lanes[layout.STRETCH, i])
    part, by_h, rest = time / h, 1.0 / h, (0.0, 0.0, 0.0, 0.0)
    z = term = (0.0, 0.0, h * v1, h * (v2 - v1))
    n, bound, phase = 0.0, 1.0, part * model[PHASE]
    while bound > ROUND_OFF:
        n += 1.0
        step, bound = part / n, bound * (phase / n)
        y1, y2, u1, u2 = _next(generator, k2, term, 0.0, rest)
        term = step * y1, step * y2, step * u1, step * u2
        z = z[0] + term[0], z[1] + term[1], z[2] + term[2], z[3] + term[3]
    lanes[layout.X1, i] += z[0]
    lanes[layout.X2, i] += z[0] + z[1]
    lanes[layout.V1, i] += by_h * z[2]
    lanes[layout.V2, i] += by_h * (z[2] + z[3])


@borrowing_kernel
def _generator(model):
    """Return what the generator consists of, but for the springs' stiffness."""
    return model[K1], model[D], model[C], 1.0 + 1.0 / model[MASS_RATIO]


@borrowing_kernel
def _cubic(model, k):
    """Return four polynomials from slot k."""
    return (
        _polynomial(model, k),
        _polynomial(model, k + COEFFICIENTS),
        _polynomial(model, k + 2 * COEFFICIENTS),
        _polynomial(model, k + 3 * COEFFICIENTS),
    )


@borrowing_kernel
def _polynomial(m, k):
    """Return the coefficients of a polynomial; as scalars, like `linear.kernel.transition`."""
    first, second = (m[k], m[k + 1], m[k + 2], m[k + 3], m[k + 4]), k + 5
    return first, (m[second], m[second + 1], m[second + 2], m[second + 3], m[second + 4])


@inlined_kernel
def _value(polynomial, t):
    """Return the value of a polynomial (Horner)."""
    high, low = polynomial
    y = fma(fma(fma(fma(high[0], t, high[1]), t, high[2]), t, high[3]), t, high[4])
    return fma(fma(fma(fma(fma(y, t, low[0]), t, low[1]), t, low[2]), t, low[3]), t, low[4])


@inlined_kernel
def _moved(generator, cubic, k2, t, z):
    """Return the cubic in the generator times a state (Horner); t is k2 on [-1, 1]."""
    f3, f2, f1, f0 = (
        _value(cubic[3], t),
        _value(cubic[2], t),
        _value(cubic[1], t),
        _value(cubic[0], t),
    )
    y = f3 * z[0], f3 * z[1], f3 * z[2], f3 * z[3]
    y = _next(generator, k2, y, f2, z)
    y = _next(generator, k2, y, f1, z)
    return _next(generator, k2, y, f0, z)


@inlined_kernel
def _next(generator, k2, y, f, z):
    """Return the generator times y, plus f z: (1) of docs/model.md, and (2) less (1)."""
    k1, d, c, both = generator
    coupling, outer = fma(c, y[3], k2 * y[1]), fma(d, y[2], k1 * y[0])
    return (
        fma(f, z[0], y[2]),
        fma(f, z[1], y[3]),
        fma(f, z[2], coupling - outer),
        fma(f, z[3], fma(-both, coupling, outer)),
    )


@inlined_kernel
def _driven(generator, k2, y, push, ground, part):
    """Return the next term of Taylor's series of the motion, from one term.

    Parameters
    ----------
    generator, k2
        Of the plant.
    y
        A term: the derivative n of the state over n!.
    push, ground
        What force and ground contribute at that order, as accelerations times h^2.
    part
        1 / (n + 1).
    """
    x1, offset, v1, w = _next(generator, k2, y, 1.0, (0.0, 0.0, push - ground, -push))
    return part * x1, part * offset, part * v1, part * w


@inlined_kernel
def _steady(generator, ratio, k2, force, turn):
    """Return the steady motion under a harmonic force, whose phase advances by `turn` in a step.

    That is x1 and offset, per cosine and per sine of the phase (force times the sine), and `turn`:
    (20) of docs/model.md.
    """
    k1, d, c, _ = generator
    inertia = ratio * turn * turn
    # Complex stiffnesses: carriage, springs and interface, sphere on them.
    outer, outer_loss = fma(-turn, turn, k1), turn * d
    loss = turn * c
    inner = k2 - inertia
    real = fma(outer, inner, fma(-outer_loss, loss, -k2 * inertia))
    imaginary = fma(outer, loss, fma(outer_loss, inner, -loss * inertia))
    size = force / fma(real, real, imaginary * imaginary)
    real, imaginary = size * real, -size * imaginary
    x1_sine, x1_cosine = fma(inner, real, -loss * imaginary), fma(inner, imaginary, loss * real)
    return x1_cosine, x1_sine, inertia * imaginary, inertia * real, turn


@inlined_kernel
def _at_phase(steady, c, s):
    """Return the state of the steady motion at a phase."""
    x1_cosine, x1_sine, offset_cosine, offset_sine, turn = steady
    return (
        fma(x1_cosine, c, x1_sine * s),
        fma(offset_cosine, c, offset_sine * s),
        turn * fma(x1_sine, c, -x1_cosine * s),
        turn * fma(offset_sine, c, -offset_cosine * s),
    )
