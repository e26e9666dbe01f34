"""Extrapolated splitting: drifts solved exactly, kicks by the springs, and their gradient.

A substep is the fourth-order method A of Chin (Phys. Lett. A 226, 1997), after Suzuki: drifts of
both masses with their dampers, between kicks by the springs, the held force and the excitation; the
kick in the middle is corrected by the force's gradient. It is symmetric, so that its error is a
series in even powers of the substep: several columns, each with its own number of substeps, are
extrapolated (Gragg, 1965) until what the coarsest one contributes is below the tolerance. Where
that does not happen the Taylor series takes over.

Lanes are taken LANES at a time, without branches. A lane's result follows from its own numbers.
Constants of the plant are numbers where all lanes share them, and vectors where they are drawn.

Arguments of several kernels: `last`, the last column; `turn`, what `_turn` returns; `b` (of.ROWS,
LANES), the columns' states, what is drawn, what excites.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.excitation.sources import excitation, load_sources, strongest
from mm_gym.lanes import layout
from mm_gym.lanes.arithmetic import fma, prefer_widest_vectors, stay_apart
from mm_gym.lanes.groups import read, write_states
from mm_gym.lanes.simd import LANES, element, everywhere
from mm_gym.lanes.simd_masks import all_hold, larger, where
from mm_gym.lanes.simd_memory import rows_on_stack
from mm_gym.law.interface import Law, is_excited, is_finite
from mm_gym.law.motion import control_forces
from mm_gym.law.springs import pair_bend, pair_force, pair_slope, stiffness
from mm_gym.methods.splitting import layout as slots
from mm_gym.methods.taylor import kernel as taylor

if TYPE_CHECKING:
    from collections.abc import Callable

RISE, LEAST_RISE = 7.0, 2.0
"""Of the way between two kicks, over what is left of the way to a collapse, in the estimate; and
what the estimate is raised by at rest."""

_rows = rows_on_stack(slots.ROWS)


def propagate_with(law: Law) -> Callable[..., int]:
    """Return the kernel of a law of motion."""

    @borrowing_kernel
    def propagate(model, lanes, first, last):
        """Advance the lanes by one sample interval; force and stretch are held over it."""
        return _propagate(law, model, lanes, first, last)

    return propagate


@inlined_kernel
def _propagate(law, model, lanes, first, last):
    """Advance the lanes by one sample interval."""
    if model[layout.SAMPLE_INTERVAL] != model[slots.INTERVAL]:  # up to an impulse, or from one
        return taylor.propagate(model, lanes, first, last)
    b, columns, i, status = _rows(), int(model[slots.FIRST_CHECK]), first, layout.OK
    while i < last:
        done = 0
        if not model[slots.IS_SPRUNG] > 0.0:
            done = columns
            i = _advance(model, lanes, b, columns, i, last)
            if last - i < LANES:
                done = 0
        if i < last:
            status = max(status, _finish(law, model, lanes, b, done, i, min(LANES, last - i)))
            i += LANES
    return status


@borrowing_kernel
def _advance(model, lanes, b, columns, first, last):
    """Advance lanes by the columns that are expected to do, while they do.

    Parameters
    ----------
    b
        (of.ROWS, LANES) written: the columns' states, and the constants of drawn plants.
    columns
        How many there are.

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
    slot = slots.WEIGHTS + slots.WEIGHTS_SIZE * columns
    for i in range(first, last - LANES + 1, LANES):
        push, x1, x2, v1, v2 = _loaded(model, lanes, b, i, LANES)
        reached = everywhere(0.0)
        for k in range(columns):
            c1, c2, c3, c4, reached = _column(model, b, k, push, x1, x2, v1, v2)
            b[4 * k], b[4 * k + 1], b[4 * k + 2], b[4 * k + 3] = c1, c2, c3, c4
        y1, y2, w1, w2 = _weighed(model, slot, b, columns - 1)
        turn, size = _turn(model, reached), _largest(x1, x2, y1, y2)
        raised, speed = model[slots.RAISE] * turn, _largest(v1, v2, w1, w2)
        near = _is_within(model, slot, b, columns - 1, turn, size, speed, raised)
        near = near & (turn <= model[slots.LONGEST + columns - 1])
        near = near & _is_little_pushed(model, columns - 1, push, turn, size)
        if not all_hold(near):
            return i
        write_states(lanes, i, y1, y2, w1, w2)
    return last - (last - first) % LANES


@borrowing_kernel
def _advance_by_one(model, lanes, b, first, last):
    """Advance lanes by one column, while it does; return as `_advance`."""
    prefer_widest_vectors()
    stay_apart()
    for i in range(first, last - LANES + 1, LANES):
        push, x1, x2, v1, v2 = _loaded(model, lanes, b, i, LANES)
        y1, y2, w1, w2, reached = _column(model, b, 0, push, x1, x2, v1, v2)
        turn, size = _turn(model, reached), _largest(x1, x2, y1, y2)
        near = (turn <= model[slots.LONGEST]) & _is_little_pushed(model, 0, push, turn, size)
        near = near & (model[slots.BENT] * _bent(model, push, size, abs(y1 - x1)) <= size)
        if not all_hold(near):
            b[0], b[1], b[2], b[3] = y1, y2, w1, w2
            return i
        write_states(lanes, i, y1, y2, w1, w2)
    return last - (last - first) % LANES


@borrowing_kernel
def _finish(law, model, lanes, b, done, i, count):
    """Advance the lanes i .. i + count - 1, each by as many columns as it needs.

    Parameters
    ----------
    b
        (of.ROWS, LANES) read and written: the columns' states, what is drawn, what excites.
    done
        How many columns are in b already.
    """
    prefer_widest_vectors()
    stay_apart()
    push, x1, x2, v1, v2 = _loaded(model, lanes, b, i, count)
    first_check, sprung = int(model[slots.FIRST_CHECK]), model[slots.IS_SPRUNG] > 0.0
    bends, pair = (everywhere(0.0), everywhere(0.0)), (push, push, push)
    most = drag = push
    if sprung:
        pair, drag = _pair(law, lanes, i, count), _drag(model, lanes, b, i, count)
        most = abs(push) + abs(drag)
        if is_excited(law):
            load_sources(model, lanes, i, count, b, slots.SOURCES)
            most, bends = _strongest(model, b, most)
    y1, y2, w1, w2, kept, reached = x1, x2, v1, v2, everywhere(0.0), everywhere(0.0)
    apart = reached, reached
    for k in range(int(model[slots.COLUMNS])):
        if k >= done:
            if sprung:
                held, state = (push, drag, pair), (x1, x2, v1, v2)
                c1, c2, c3, c4, reached, apart = _sprung_column(law, model, b, k, held, state)
            else:
                c1, c2, c3, c4, reached = _column(model, b, k, push, x1, x2, v1, v2)
            b[4 * k], b[4 * k + 1], b[4 * k + 2], b[4 * k + 3] = c1, c2, c3, c4
        elif k == done - 1:
            reached = _column(model, b, k, push, x1, x2, v1, v2)[4]
        if k + 1 < first_check:
            continue
        slot = slots.WEIGHTS + slots.WEIGHTS_SIZE * (k + 1)
        s1, s2, s3, s4 = _weighed(model, slot, b, k)
        turn, size = _turn(model, reached), _largest(x1, x2, s1, s2)
        if is_finite(law):
            turn = fma(model[slots.COUPLED], pair[0] * pair_slope(*_on(pair, apart[0])), turn)
        near = turn <= model[slots.LONGEST + k]
        near = near & _is_little_pushed(model, k, most, turn, size)
        speed = _largest(v1, v2, s3, s4)
        if k > 0:
            raised = model[slots.RAISE] * turn
            if is_finite(law):
                raised = larger(raised, _rise(pair, *apart))
            near = near & _is_within(model, slot, b, k, turn, size, speed, raised)
        else:
            bent = model[slots.BENT] * _bent(model, most, size, abs(s1 - x1))
            if is_finite(law):
                way = abs((s2 - s1) - (x2 - x1))
                bend = pair[0] * pair_bend(*_on(pair, apart[0]))
                bent = fma(model[slots.BENT_APART] * bend, _bent(model, most, size, way), bent)
            near = near & (bent <= size)
        if is_excited(law):
            share = model[slots.BENDING + k]
            near = near & (share * bends[0] <= size) & (share * bends[1] <= speed)
        fresh = near & (kept == 0.0)
        y1, y2 = where(fresh, s1, y1), where(fresh, s2, y2)
        w1, w2 = where(fresh, s3, w1), where(fresh, s4, w2)
        kept = where(fresh, 1.0, kept)
        if all_hold(kept > 0.0):
            break
    if count == LANES and all_hold(kept > 0.0):
        write_states(lanes, i, y1, y2, w1, w2)
        return layout.OK
    status = layout.OK
    for k in range(count):
        if element(kept, k) == 0.0:
            status = max(status, taylor.propagate(model, lanes, i + k, i + k + 1))
        else:
            lanes[layout.X1, i + k], lanes[layout.X2, i + k] = element(y1, k), element(y2, k)
            lanes[layout.V1, i + k], lanes[layout.V2, i + k] = element(w1, k), element(w2, k)
    return status


@inlined_kernel
def _loaded(model, lanes, b, i, count):
    """Return the acceleration by the held force [m/s^2] and the state of a group of lanes.

    Constants that are drawn go to the rows from of.OWN on.
    """
    push = read(lanes, layout.FORCE, i, count)
    if model[slots.IS_DRAWN] > 0.0:
        by_m1, by_m2 = (
            1.0 / read(lanes, layout.M1, i, count),
            1.0 / read(lanes, layout.M2, i, count),
        )
        k1, c = -by_m1 * read(lanes, layout.K1, i, count), read(lanes, layout.C, i, count)
        b[slots.OWN + slots.BY_M1], b[slots.OWN + slots.BY_M2] = by_m1, by_m2
        b[slots.OWN + slots.LINEAR] = k1 * read(lanes, layout.ALPHA, i, count)
        b[slots.OWN + slots.CUBIC] = k1 * read(lanes, layout.BETA, i, count)
        b[slots.OWN + slots.DAMPED] = -by_m1 * (c + read(lanes, layout.D, i, count))
        b[slots.OWN + slots.DRAGGED], b[slots.OWN + slots.DRAGGING] = by_m1 * c, by_m2 * c
        push = push * by_m1
    else:
        push = push * model[slots.PLANT + slots.BY_M1]
    x1, x2 = read(lanes, layout.X1, i, count), read(lanes, layout.X2, i, count)
    return push, x1, x2, read(lanes, layout.V1, i, count), read(lanes, layout.V2, i, count)


@inlined_kernel
def _pair(law, lanes, i, count):
    """Return 2 k0 [N/m], stretch and 1 / l0 [1/m] of springs of finite stretch; of others k2."""
    k0, stretch = read(lanes, layout.K0, i, count), read(lanes, layout.STRETCH, i, count)
    if is_finite(law):
        return k0 + k0, stretch, 1.0 / read(lanes, layout.L0, i, count)
    return stiffness(k0, stretch), stretch, stretch


@inlined_kernel
def _on(pair, offset):
    """Return what the laws of such springs read: their stretch, and the offset over l0."""
    return pair[1], offset * pair[2]


@inlined_kernel
def _drag(model, lanes, b, i, count):
    """Return the deceleration of the spheres by a force held between the masses [m/s^2].

    Constants that are drawn are read from the rows that `_loaded` writes.
    """
    by_m2 = everywhere(model[slots.PLANT + slots.BY_M2])
    if model[slots.IS_DRAWN] > 0.0:
        by_m2 = b[slots.OWN + slots.BY_M2]
    return control_forces(model, read(lanes, layout.FORCE, i, count))[0] * by_m2


@inlined_kernel
def _turn(model, reached):
    """Return by what angle, squared, the springs turn the motion in a sample interval.

    Where they are steepest: at the largest displacement on the way [m], given squared.
    """
    return fma(model[slots.STEEPER], reached, model[slots.STEEPNESS])


@inlined_kernel
def _rise(pair, furthest, way):
    """Return by what springs raise the estimate whose force rises towards their collapse.

    Parameters
    ----------
    furthest, way
        The largest offset, and the largest way between two kicks [m].
    """
    rise = RISE * way * pair[2] / (pair[1] - furthest * pair[2])
    return fma(rise, rise, LEAST_RISE)


@inlined_kernel
def _largest(a, b, c, d):
    """Return the largest size of four numbers."""
    return larger(larger(abs(a), abs(b)), larger(abs(c), abs(d)))


@inlined_kernel
def _is_within(model, slot, b, last, turn, size, speed, raised):
    """Tell whether the errors of several columns are within the limit, by their estimates.

    Parameters
    ----------
    slot
        Slot of the weights.
    b
        (of.ROWS, LANES) read: the columns' states.
    size, speed
        The largest position [m] and velocity [m/s] at the start and at the end.
    raised
        By what the first column raises the estimates, where that is more than 1.
    """
    raised = larger(raised, everywhere(1.0))
    size, speed = model[slots.LIMIT] * size, model[slots.LIMIT] * speed
    near = raised * _estimate(model, slot, b, last, turn, 0) <= size
    near = near & (raised * _estimate(model, slot, b, last, turn, 2) <= speed)
    near = near & (raised * _estimate(model, slot, b, last, turn, 1) <= size)
    return near & (raised * _estimate(model, slot, b, last, turn, 3) <= speed)


@inlined_kernel
def _is_little_pushed(model, last, push, turn, size):
    """Tell whether the bound of the error under a force is within the limit.

    Parameters
    ----------
    push
        Acceleration by the force, at its strongest [m/s^2].
    size
        The largest position at the start and at the end [m].
    """
    shift = model[slots.SQUARE] * abs(push)
    # Multiplied by the square of the size, and for each further column by the size once more.
    error, allowed = model[slots.PUSHED + last] * turn * shift * larger(shift, size), size * size
    larger_one = larger(larger(turn, everywhere(model[slots.FASTEST_TURN])) * size, shift)
    for _ in range(last):
        error, allowed = error * larger_one, allowed * size
    return error <= allowed


@borrowing_kernel
def _strongest(model, b, push):
    """Return the largest acceleration without springs [m/s^2], and what bends of it count for.

    What Simpson's rule leaves of it counts for the positions [m] and for the velocities [m/s].

    Parameters
    ----------
    push
        Accelerations by the held force, added up [m/s^2].
    """
    by_m1, h = everywhere(model[slots.PLANT + slots.BY_M1]), model[layout.SAMPLE_INTERVAL]
    if model[slots.IS_DRAWN] > 0.0:
        by_m1 = b[slots.OWN + slots.BY_M1]
    force, ground = strongest(model, b, slots.SOURCES)
    third, fourth = fma(by_m1, force[1], ground[1]), fma(by_m1, force[2], ground[2])
    bends = h * h * fma(4.0, third, fourth), h * fourth
    return push + fma(by_m1, force[0], ground[0]), bends


@inlined_kernel
def _bent(model, push, size, way):
    """Return what multiplies a spring's bend in the bound of one column's error on a long way.

    Parameters
    ----------
    push
        Acceleration by the force [m/s^2].
    size
        The largest position at the start and at the end [m].
    way
        How much longer or shorter the spring becomes [m].
    """
    return way * fma(way, way, size * (model[slots.SQUARE] * abs(push)))


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
    before = slot - slots.WEIGHTS_SIZE + slots.ESTIMATE
    c, error, earlier = b[4 * last + row], everywhere(0.0), everywhere(0.0)
    for j in range(last):
        apart = b[4 * j + row] - c
        error = fma(model[slot + slots.ESTIMATE + j], apart, error)
        earlier = fma(model[before + j], apart, earlier)
    return larger(abs(error), model[slots.LATER + last] * turn * abs(earlier))


@inlined_kernel
def _springs(numbers, first):
    """Return -k1 alpha / m1, -k1 beta / m1, 1 / m1 and 1 / m2, of all lanes or of each."""
    return (
        (numbers[first + slots.LINEAR], numbers[first + slots.CUBIC]),
        (numbers[first + slots.BY_M1], numbers[first + slots.BY_M2]),
    )


@inlined_kernel
def _dampers(model, slot):
    """Return how the dampers let the masses drift in half a substep of a column."""
    return _matrix(model, slot + slots.DRIFT), _matrix(model, slot + slots.DECAY)


@inlined_kernel
def _own_dampers(model, b, slot):
    """Return the same of each lane: the series of exp(M t) and of its integral, v' = M v."""
    t = 0.75 * model[slot + slots.MIDDLE]  # half a substep
    m11, m12 = t * b[slots.OWN + slots.DAMPED], t * b[slots.OWN + slots.DRAGGED]
    m21 = t * b[slots.OWN + slots.DRAGGING]
    m, order = (m11, m12, m21), int(model[slots.DEGREE])
    zero, weight = everywhere(0.0), everywhere(model[slots.RECIPROCALS + order])
    p = weight, zero, zero, weight
    for n in range(order - 1, -1, -1):
        p = _times_and(m, p, model[slots.RECIPROCALS + n])
    return (t * p[0], t * p[1], t * p[2], t * p[3]), _times_and(m, p, 1.0)


@inlined_kernel
def _times_and(m, p, weight):
    """Return M P and a weight on the diagonal; what M has at its end is minus what is before it."""
    (m11, m12, m21), (p11, p12, p21, p22) = m, p
    return (
        fma(m11, p11, fma(m12, p21, weight)),
        fma(m11, p12, m12 * p22),
        m21 * (p11 - p21),
        fma(m21, p12 - p22, weight),
    )


@inlined_kernel
def _column(model, b, k, push, x1, x2, v1, v2):
    """Return the state after a column's substeps, without springs between the masses.

    Behind it the largest displacement [m], squared.
    """
    slot = slots.COLUMN + slots.COLUMN_SIZE * k
    if model[slots.IS_DRAWN] > 0.0:
        springs, dampers = _springs(b, slots.OWN)[0], _own_dampers(model, b, slot)
        return _substeps(model, slot, springs, dampers, push, (x1, x2, v1, v2))
    springs, dampers = _springs(model, slots.PLANT)[0], _dampers(model, slot)
    return _substeps(model, slot, springs, dampers, push, (x1, x2, v1, v2))


@inlined_kernel
def _substeps(model, slot, springs, dampers, push, state):
    """Return the same of given springs and dampers."""
    (linear, cubic), (drift, decay), (x1, x2, v1, v2) = springs, dampers, state
    sixth, third = model[slot + slots.SIXTH], model[slot + slots.THIRD]
    middle, gradient = model[slot + slots.MIDDLE], model[slot + slots.GRADIENT]
    constant, slope = middle * fma(gradient, linear, 1.0), 3.0 * middle * gradient * cubic
    square = x1 * x1
    a, furthest = fma(fma(cubic, square, linear), x1, push), square
    v1 = fma(sixth, a, v1)
    for _ in range(int(model[slot + slots.COUNT])):
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
def _sprung_column(law, model, b, k, held, state):
    """Return the same with springs or a force between the masses, or excitation.

    Behind it the largest offset, and the largest way of the offset at once [m].
    """
    slot = slots.COLUMN + slots.COLUMN_SIZE * k
    if model[slots.IS_DRAWN] > 0.0:
        plant = _springs(b, slots.OWN), _own_dampers(model, b, slot)
        return _sprung_substeps(law, model, slot, plant, held, state, b)
    shared = _springs(model, slots.PLANT), _dampers(model, slot)
    return _sprung_substeps(law, model, slot, shared, held, state, b)


@inlined_kernel
def _sprung_substeps(law, model, slot, plant, held, state, b):
    """Return the same of given springs and dampers, and what is held: push, drag and the pair."""
    ((linear, cubic), (by_m1, by_m2)), (drift, decay) = plant
    (push, drag, pair), (x1, x2, v1, v2) = held, state
    sixth, third = model[slot + slots.SIXTH], model[slot + slots.THIRD]
    middle, gradient = model[slot + slots.MIDDLE], model[slot + slots.GRADIENT]
    springs, length = (linear, cubic, pair[0] * by_m1, pair[0] * by_m2, pair), 3.0 * third
    furthest, offset, way = abs(x1), x2 - x1, everywhere(0.0)
    widest = abs(offset)
    drive = _drive(law, model, b, by_m1, (push, drag), 0.0)
    a1, a2 = _accelerations(law, springs, drive, x1, x2)
    v1, v2 = fma(sixth, a1, v1), fma(sixth, a2, v2)
    for n in range(int(model[slot + slots.COUNT])):
        x1, x2, v1, v2 = _drifted(drift, decay, x1, x2, v1, v2)
        drive = _drive(law, model, b, by_m1, (push, drag), (n + 0.5) * length)
        a1, a2 = _accelerations(law, springs, drive, x1, x2)
        apart, slope = a2 - a1, fma(3.0 * cubic, x1 * x1, linear)
        if is_finite(law):
            apart = apart * pair_slope(*_on(pair, x2 - x1))
            widest, way = larger(abs(x2 - x1), widest), larger(abs(x2 - x1 - offset), way)
            offset = x2 - x1
        furthest = larger(abs(x1), furthest)
        v1 = fma(middle, fma(gradient, fma(springs[2], apart, slope * a1), a1), v1)
        v2 = fma(middle, fma(-gradient * springs[3], apart, a2), v2)
        x1, x2, v1, v2 = _drifted(drift, decay, x1, x2, v1, v2)
        drive = _drive(law, model, b, by_m1, (push, drag), (n + 1.0) * length)
        a1, a2 = _accelerations(law, springs, drive, x1, x2)
        furthest = larger(abs(x1), furthest)
        if is_finite(law):
            widest, way = larger(abs(x2 - x1), widest), larger(abs(x2 - x1 - offset), way)
            offset = x2 - x1
        v1, v2 = fma(third, a1, v1), fma(third, a2, v2)
    return x1, x2, fma(-sixth, a1, v1), fma(-sixth, a2, v2), furthest * furthest, (widest, way)


@inlined_kernel
def _drive(law, model, b, by_m1, held, time):
    """Return what pushes the carriage and shakes it, and what shakes and drags the sphere [m/s^2].

    Parameters
    ----------
    held
        Accelerations by the force that is held, on the carriage and against the sphere.
    time
        Since the sample interval's start [s].
    """
    push, drag = held
    if is_excited(law):
        force, ground = excitation(model, b, slots.SOURCES, everywhere(time))
        return fma(by_m1, force, push), ground, ground + drag
    return push, everywhere(0.0), drag


@inlined_kernel
def _accelerations(law, springs, drive, x1, x2):
    """Return what all but dampers accelerates the masses by: (1) and (2) of docs/model.md."""
    (linear, cubic, on1, on2, pair), (push, shake, back), offset = springs, drive, x2 - x1
    if is_finite(law):
        stretch, shortened = _on(pair, offset)
        offset = pair_force(1.0, stretch, offset, shortened)
    outer = fma(fma(cubic, x1 * x1, linear), x1, push - shake)
    return fma(on1, offset, outer), fma(-on2, offset, -back)


@inlined_kernel
def _matrix(model, slot):
    """Return a matrix of two rows, as scalars."""
    return model[slot], model[slot + 1], model[slot + 2], model[slot + 3]


@inlined_kernel
def _drifted(drift, decay, x1, x2, v1, v2):
    """Return the state after half a substep under the dampers alone."""
    x1, x2 = fma(drift[0], v1, fma(drift[1], v2, x1)), fma(drift[2], v1, fma(drift[3], v2, x2))
    return x1, x2, fma(decay[0], v1, decay[1] * v2), fma(decay[2], v1, decay[3] * v2)
