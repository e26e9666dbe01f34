"""Propagation of a linear plant whose stretch is actuated, as exactly as the tolerance asks for.

The motion is a Taylor series in time, whose derivatives follow from one another; the degree follows
from the tolerance when the scene is compiled.

Lanes are taken LANES at a time, without branches. Within the kernel the state is x1, the offset,
and h times v1 and the slip velocity w: all of one unit, so that the generator has none.
"""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.lanes import layout as at
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors, stay_apart
from mm_gym.lanes.groups import read, write_state, write_states
from mm_gym.lanes.simd import LANES, everywhere
from mm_gym.law.motion import control_forces
from mm_gym.law.springs import stiffness

# Slots of the model. The degree; then in units of the sample interval h and the carriage's mass m1
# the coefficients of the carriage's spring, of the dampers and the springs, 1 + m1 / m2, and what a
# force [N] is multiplied by; then 1 / n! for n = 0 .. MOST.
DEGREE, K1, D, C, K0, BOTH, PUSH, WEIGHTS = (at.MODEL_OWN + i for i in range(8))
MOST = 24
END = WEIGHTS + MOST + 1


@borrowing_kernel
def propagate(model, lanes, first, last):
    """Advance the lanes by one sample interval; force and stretch are held over it."""
    if model[at.HARMONIC_COUNT] > 0.0:
        _propagate_with_harmonic(model, lanes, first, last)
    else:
        _propagate(model, lanes, first, last)
    return at.OK


@borrowing_kernel
def _propagate(model, lanes, first, last):
    """Advance the lanes under a held force."""
    prefer_widest_vectors()
    stay_apart()
    h, degree, generator = model[at.SAMPLE_INTERVAL], int(model[DEGREE]), _generator(model)
    by_h, nothing = 1.0 / h, everywhere(0.0)
    for i in range(first, last, LANES):
        count = min(LANES, last - i)
        k2, (pair, force), z = _loaded(model, lanes, h, i, count)
        z, y = _next(generator, k2, (pair, force), 1.0, z, z)
        for n in range(2, degree + 1):
            z, y = _next(generator, k2, (nothing, 0.0), model[WEIGHTS + n], z, y)
        _write(lanes, by_h, i, count, y)


@borrowing_kernel
def _propagate_with_harmonic(model, lanes, first, last):
    """Advance the lanes under a held force and a harmonic one, whose derivatives take turns."""
    prefer_widest_vectors()
    stay_apart()
    h, degree, generator = model[at.SAMPLE_INTERVAL], int(model[DEGREE]), _generator(model)
    by_h, push, nothing = 1.0 / h, model[PUSH], everywhere(0.0)
    for i in range(first, last, LANES):
        count = min(LANES, last - i)
        k2, (pair, force), z = _loaded(model, lanes, h, i, count)
        scale = push * read(lanes, at.HARMONICS + at.AMPLITUDE, i, count)
        turn = h * read(lanes, at.HARMONICS + at.FREQUENCY, i, count)
        even = scale * read(lanes, at.HARMONICS + at.SINE, i, count)
        odd = turn * (scale * read(lanes, at.HARMONICS + at.COSINE, i, count))
        square = -turn * turn
        z, y = _next(generator, k2, (pair, force + even), 1.0, z, z)
        for n in range(2, degree + 1):
            z, y = _next(generator, k2, (nothing, odd), model[WEIGHTS + n], z, y)
            even, odd = odd, square * even
        _write(lanes, by_h, i, count, y)


@inlined_kernel
def _generator(model):
    """Return what the generator consists of, but for the springs' stiffness."""
    return model[K1], model[D], model[C], model[BOTH]


@inlined_kernel
def _loaded(model, lanes, h, i, count):
    """Return the springs' stiffness, the held forces and the state of the lanes from i on."""
    k2 = stiffness(model[K0], read(lanes, at.STRETCH, i, count))
    force = model[PUSH] * read(lanes, at.FORCE, i, count)
    x1, x2 = read(lanes, at.X1, i, count), read(lanes, at.X2, i, count)
    v1, v2 = read(lanes, at.V1, i, count), read(lanes, at.V2, i, count)
    return k2, control_forces(model, force), (x1, x2 - x1, h * v1, h * (v2 - v1))


@inlined_kernel
def _next(generator, k2, forces, weight, z, y):
    """Return the derivatives that follow from those of one order, and what they add up to.

    Parameters
    ----------
    generator, k2
        The coefficients.
    forces
        Derivatives of the force between the masses and of that on the carriage, of the order of z.
    weight
        1 / n! of the next order n.
    z, y
        Derivatives of x1, offset, h v1 and h w by t / h, and the sum of the series so far.
    """
    (k1, d, c, both), (pair, force) = generator, forces
    x1, offset, v1, w = z
    coupling, outer = fma(c, w, fma(k2, offset, pair)), fma(-d, v1, fma(-k1, x1, force))
    a1 = coupling + outer  # (1) of docs/model.md
    a2 = fma(-both, coupling, -outer)  # (2) less (1)
    return (v1, w, a1, a2), (
        fma(weight, v1, y[0]),
        fma(weight, w, y[1]),
        fma(weight, a1, y[2]),
        fma(weight, a2, y[3]),
    )


@inlined_kernel
def _write(lanes, by_h, i, count, y):
    """Write the state of the lanes i .. i + count - 1."""
    x1, offset, v1, w = y
    x2, v1, v2 = x1 + offset, by_h * v1, by_h * (v1 + w)
    if count == LANES:
        write_states(lanes, i, x1, x2, v1, v2)
    else:
        write_state(lanes, i, count, x1, x2, v1, v2)
