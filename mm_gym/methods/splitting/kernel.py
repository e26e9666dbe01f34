"""Extrapolated splitting: drifts solved exactly, kicks by the springs, and their gradient.

A substep is the fourth-order method A of Chin (Phys. Lett. A 226, 1997), after Suzuki: drifts of
both masses with their dampers, between kicks by the springs and the held force; the kick in the
middle is corrected by the force's gradient. It is symmetric, so that its error is a series in even
powers of the substep: several columns, each with its own number of substeps, are extrapolated
(Gragg, 1965) until what the coarsest one contributes is below the
tolerance. Where that does not happen the Taylor series takes over.

Lanes are taken LANES at a time, without branches. A lane's result follows from its own numbers.
"""

from __future__ import annotations

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.lanes import layout as at
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors, stay_apart
from mm_gym.lanes.groups import read, write_states
from mm_gym.lanes.simd import LANES, element, everywhere
from mm_gym.lanes.simd_masks import all_hold, larger, where
from mm_gym.lanes.simd_memory import load, rows_on_stack
from mm_gym.law.forces import stiffness
from mm_gym.methods.splitting import layout as of
from mm_gym.methods.taylor import kernel as taylor

_columns = rows_on_stack(4 * of.MOST)


@borrowing_kernel
def propagate(model, lanes, first, last):
    """Advance the lanes by one sample interval; force and stretch are held over it."""
    b, columns, i, status = _columns(), int(model[of.FIRST_CHECK]), first, at.OK
    while i < last:
        done = 0
        if not model[of.IS_SPRUNG] > 0.0:
            done = columns
            i = _advance(model, lanes, b, columns, i, last)
            if last - i < LANES:
                done = 0
        if i < last:
            status = max(status, _finish(model, lanes, b, done, i, min(LANES, last - i)))
            i += LANES
    return status


@borrowing_kernel
def _advance(model, lanes, b, columns, first, last):
    """Advance lanes by the columns that are expected to do, while they do.

    Parameters
    ----------
    model
        (m,) read.
    lanes
        (rows, count) read, and the state written.
    b
        (4 * of.MOST, LANES) written: the columns' states.
    columns
        How many there are.
    first, last
        The lanes first .. last - 1.

    Returns
    -------
    int
        The first of LANES lanes for one of which they do not do, their columns in b; or of what is
        left.
    """
    if columns == 1:
        return _advance_by_one(model, lanes, b, first, last)
    prefer_widest_vectors()
    stay_apart()
    slot, furthest = of.WEIGHTS + of.WEIGHTS_SIZE * columns, model[of.FURTHEST + columns - 1]
    for i in range(first, last - LANES + 1, LANES):
        push, x1, x2, v1, v2 = _loaded(model, lanes, i)
        reached = everywhere(0.0)
        for k in range(columns):
            c1, c2, c3, c4, reached = _column(_constants(model, k), push, x1, x2, v1, v2)
            b[4 * k], b[4 * k + 1], b[4 * k + 2], b[4 * k + 3] = c1, c2, c3, c4
        y1, y2, w1, w2 = _weighed(model, slot, b, columns - 1)
        turn, size = _turn(model, reached), _largest(x1, x2, y1, y2)
        near = _is_within(model, slot, b, columns - 1, turn, size, _largest(v1, v2, w1, w2))
        near = near & (reached <= furthest)
        near = near & _is_little_pushed(model, columns - 1, push, turn, size)
        if not all_hold(near):
            return i
        write_states(lanes, i, y1, y2, w1, w2)
    return last - (last - first) % LANES


@borrowing_kernel
def _advance_by_one(model, lanes, b, first, last):
    """Do the same with one column."""
    prefer_widest_vectors()
    stay_apart()
    constants, furthest = _constants(model, 0), model[of.FURTHEST]
    for i in range(first, last - LANES + 1, LANES):
        push, x1, x2, v1, v2 = _loaded(model, lanes, i)
        y1, y2, w1, w2, reached = _column(constants, push, x1, x2, v1, v2)
        turn, size = _turn(model, reached), _largest(x1, x2, y1, y2)
        near = (reached <= furthest) & _is_little_pushed(model, 0, push, turn, size)
        near = near & _is_short_way(model, push, size, x1, y1)
        if not all_hold(near):
            b[0], b[1], b[2], b[3] = y1, y2, w1, w2
            return i
        write_states(lanes, i, y1, y2, w1, w2)
    return last - (last - first) % LANES


@borrowing_kernel
def _finish(model, lanes, b, done, i, count):
    """Advance the lanes i .. i + count - 1, each by as many columns as it needs.

    Parameters
    ----------
    model
        (m,) read.
    lanes
        (rows, count) read, and the state written.
    b
        (4 * of.MOST, LANES) read and written: the columns' states.
    done
        How many columns are in b already.
    i, count
        The first lane, and how many, at most LANES.
    """
    prefer_widest_vectors()
    stay_apart()
    x1, x2 = read(lanes, at.X1, i, count), read(lanes, at.X2, i, count)
    v1, v2 = read(lanes, at.V1, i, count), read(lanes, at.V2, i, count)
    push = read(lanes, at.FORCE, i, count) * model[of.BY_M1]
    first_check, sprung = int(model[of.FIRST_CHECK]), model[of.IS_SPRUNG] > 0.0
    k2 = everywhere(0.0)
    if sprung:
        k2 = stiffness(model[of.K0], read(lanes, at.STRETCH, i, count))
    y1, y2, w1, w2, kept, reached = x1, x2, v1, v2, everywhere(0.0), everywhere(0.0)
    for k in range(int(model[of.COLUMNS])):
        if k >= done:
            if sprung:
                c1, c2, c3, c4, reached = _sprung_column(model, k, push, k2, x1, x2, v1, v2)
            else:
                c1, c2, c3, c4, reached = _column(_constants(model, k), push, x1, x2, v1, v2)
            b[4 * k], b[4 * k + 1], b[4 * k + 2], b[4 * k + 3] = c1, c2, c3, c4
        elif k == done - 1:
            reached = _column(_constants(model, k), push, x1, x2, v1, v2)[4]
        if k + 1 < first_check:
            continue
        slot = of.WEIGHTS + of.WEIGHTS_SIZE * (k + 1)
        s1, s2, s3, s4 = _weighed(model, slot, b, k)
        turn, size = _turn(model, reached), _largest(x1, x2, s1, s2)
        near = reached <= model[of.FURTHEST + k]
        near = near & _is_little_pushed(model, k, push, turn, size)
        if k > 0:
            near = near & _is_within(model, slot, b, k, turn, size, _largest(v1, v2, s3, s4))
        else:
            near = near & _is_short_way(model, push, size, x1, s1)
        fresh = near & (kept == 0.0)
        y1, y2 = where(fresh, s1, y1), where(fresh, s2, y2)
        w1, w2 = where(fresh, s3, w1), where(fresh, s4, w2)
        kept = where(fresh, 1.0, kept)
        if all_hold(kept > 0.0):
            break
    status = at.OK
    for k in range(count):
        if element(kept, k) == 0.0:
            status = max(status, taylor.propagate(model, lanes, i + k, i + k + 1))
        else:
            lanes[at.X1, i + k], lanes[at.X2, i + k] = element(y1, k), element(y2, k)
            lanes[at.V1, i + k], lanes[at.V2, i + k] = element(w1, k), element(w2, k)
    return status


@inlined_kernel
def _loaded(model, lanes, i):
    """Return the acceleration by the held force [m/s^2] and the state of LANES lanes."""
    push = load(lanes, at.FORCE, i) * model[of.BY_M1]
    x1, x2 = load(lanes, at.X1, i), load(lanes, at.X2, i)
    return push, x1, x2, load(lanes, at.V1, i), load(lanes, at.V2, i)


@inlined_kernel
def _turn(model, reached):
    """Return by what angle, squared, the springs turn the motion in a sample interval.

    Where they are steepest: at the largest displacement on the way [m], given squared.
    """
    return fma(model[of.STEEPER], reached, model[of.STEEPNESS])


@inlined_kernel
def _largest(a, b, c, d):
    """Return the largest size of four numbers."""
    return larger(larger(abs(a), abs(b)), larger(abs(c), abs(d)))


@inlined_kernel
def _is_within(model, slot, b, last, turn, size, speed):
    """Tell whether the errors of several columns are within the limit, by their estimates.

    Parameters
    ----------
    model
        (m,) read.
    slot
        Slot of the weights.
    b
        (4 * of.MOST, LANES) read: the columns' states.
    last
        The last column.
    turn
        As `_turn` returns it.
    size, speed
        The largest position [m] and velocity [m/s] at the start and at the end.
    """
    raised = larger(model[of.RAISE] * turn, everywhere(1.0))
    size, speed = model[of.LIMIT] * size, model[of.LIMIT] * speed
    near = raised * _estimate(model, slot, b, last, turn, 0) <= size
    near = near & (raised * _estimate(model, slot, b, last, turn, 2) <= speed)
    near = near & (raised * _estimate(model, slot, b, last, turn, 1) <= size)
    return near & (raised * _estimate(model, slot, b, last, turn, 3) <= speed)


@inlined_kernel
def _is_little_pushed(model, last, push, turn, size):
    """Tell whether the bound of the error under a held force is within the limit.

    Parameters
    ----------
    model
        (m,) read.
    last
        The last column.
    push
        Acceleration by the force [m/s^2].
    turn
        As `_turn` returns it.
    size
        The largest position at the start and at the end [m].
    """
    shift = model[of.SQUARE] * abs(push)
    # Multiplied by the square of the size, and for each further column by the size once more.
    error, allowed = model[of.PUSHED + last] * turn * shift * larger(shift, size), size * size
    larger_one = larger(turn * size, shift)
    for _ in range(last):
        error, allowed = error * larger_one, allowed * size
    return error <= allowed


@inlined_kernel
def _is_short_way(model, push, size, x1, y1):
    """Tell whether the bound of one column's error on a long way is within the limit.

    Parameters
    ----------
    model
        (m,) read.
    push
        Acceleration by the force [m/s^2].
    size
        The largest position at the start and at the end [m].
    x1, y1
        The carriage's position at the start and at the end [m].
    """
    way, shift = abs(y1 - x1), model[of.SQUARE] * abs(push)
    return model[of.BENT] * way * fma(way, way, size * shift) <= size


@inlined_kernel
def _weighed(model, slot, b, last):
    """Return the weighed columns 0 .. last: the last one, and the others' differences from it."""
    c1, c2, c3, c4 = b[4 * last], b[4 * last + 1], b[4 * last + 2], b[4 * last + 3]
    s1, s2, s3, s4 = c1, c2, c3, c4
    for j in range(last):
        weight = model[slot + j]
        s1, s2 = fma(weight, b[4 * j] - c1, s1), fma(weight, b[4 * j + 1] - c2, s2)
        s3, s4 = fma(weight, b[4 * j + 2] - c3, s3), fma(weight, b[4 * j + 3] - c4, s4)
    return s1, s2, s3, s4


@inlined_kernel
def _estimate(model, slot, b, last, turn, row):
    """Return the estimate of the error of a row of the state.

    What the first column contributes, or what it contributed one column earlier lets expect.
    """
    before = slot - of.WEIGHTS_SIZE + of.ESTIMATE
    c, error, earlier = b[4 * last + row], everywhere(0.0), everywhere(0.0)
    for j in range(last):
        apart = b[4 * j + row] - c
        error = fma(model[slot + of.ESTIMATE + j], apart, error)
        earlier = fma(model[before + j], apart, earlier)
    return larger(abs(error), model[of.LATER + last] * turn * abs(earlier))


@inlined_kernel
def _constants(model, k):
    """Return the constants of a column, as scalars."""
    slot = of.COLUMN + of.COLUMN_SIZE * k
    return (
        (model[of.LINEAR], model[of.CUBIC]),
        (int(model[slot + of.COUNT]), model[slot + of.SIXTH], model[slot + of.THIRD]),
        (model[slot + of.CONSTANT], model[slot + of.SLOPE]),
        _four(model, slot + of.DRIFT),
        _four(model, slot + of.DECAY),
    )


@inlined_kernel
def _column(constants, push, x1, x2, v1, v2):
    """Return the state after a column's substeps, without springs between the masses.

    Behind it the largest displacement [m], squared.
    """
    (linear, cubic), (count, sixth, third), (constant, slope), drift, decay = constants
    square = x1 * x1
    a, furthest = fma(fma(cubic, square, linear), x1, push), square
    v1 = fma(sixth, a, v1)
    for _ in range(count):
        x1, x2, v1, v2 = _drifted(drift, decay, x1, x2, v1, v2)
        square = x1 * x1
        a, furthest = fma(fma(cubic, square, linear), x1, push), larger(square, furthest)
        v1 = fma(a, fma(slope, square, constant), v1)
        x1, x2, v1, v2 = _drifted(drift, decay, x1, x2, v1, v2)
        square = x1 * x1
        a, furthest = fma(fma(cubic, square, linear), x1, push), larger(square, furthest)
        v1 = fma(third, a, v1)
    return x1, x2, fma(-sixth, a, v1), v2, furthest


@inlined_kernel
def _sprung_column(model, k, push, k2, x1, x2, v1, v2):
    """Return the same with springs between the masses."""
    slot = of.COLUMN + of.COLUMN_SIZE * k
    linear, cubic, sixth, third = (
        model[of.LINEAR],
        model[of.CUBIC],
        model[slot + of.SIXTH],
        model[slot + of.THIRD],
    )
    middle, gradient = model[slot + of.MIDDLE], model[slot + of.GRADIENT]
    drift, decay = _four(model, slot + of.DRIFT), _four(model, slot + of.DECAY)
    on1, on2, furthest = k2 * model[of.BY_M1], k2 * model[of.BY_M2], x1 * x1
    a1, a2 = _accelerations(linear, cubic, on1, on2, push, x1, x2)
    v1, v2 = fma(sixth, a1, v1), fma(sixth, a2, v2)
    for _ in range(int(model[slot + of.COUNT])):
        x1, x2, v1, v2 = _drifted(drift, decay, x1, x2, v1, v2)
        a1, a2 = _accelerations(linear, cubic, on1, on2, push, x1, x2)
        apart, slope = a2 - a1, fma(3.0 * cubic, x1 * x1, linear)
        furthest = larger(x1 * x1, furthest)
        v1 = fma(middle, fma(gradient, fma(on1, apart, slope * a1), a1), v1)
        v2 = fma(middle, fma(-gradient * on2, apart, a2), v2)
        x1, x2, v1, v2 = _drifted(drift, decay, x1, x2, v1, v2)
        a1, a2 = _accelerations(linear, cubic, on1, on2, push, x1, x2)
        furthest = larger(x1 * x1, furthest)
        v1, v2 = fma(third, a1, v1), fma(third, a2, v2)
    return x1, x2, fma(-sixth, a1, v1), fma(-sixth, a2, v2), furthest


@inlined_kernel
def _accelerations(linear, cubic, on1, on2, push, x1, x2):
    """Return what springs and force accelerate the masses by: (1) and (2) of docs/model.md."""
    offset = x2 - x1
    return fma(fma(cubic, x1 * x1, linear), x1, fma(on1, offset, push)), -on2 * offset


@inlined_kernel
def _four(model, slot):
    """Return four numbers, as scalars."""
    return model[slot], model[slot + 1], model[slot + 2], model[slot + 3]


@inlined_kernel
def _drifted(drift, decay, x1, x2, v1, v2):
    """Return the state after half a substep under the dampers alone."""
    x1, x2 = fma(drift[0], v1, fma(drift[1], v2, x1)), fma(drift[2], v1, fma(drift[3], v2, x2))
    return x1, x2, fma(decay[0], v1, decay[1] * v2), fma(decay[2], v1, decay[3] * v2)
