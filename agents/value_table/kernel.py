"""Values between the points of the grid, the sweep over it, and the action that follows.

A motion is four coordinates of like size (`agents.value_iteration.iteration`), of which the largest
in absolute value is its face and its size s, with a sign; the three others over s are its
direction, each from -1 to 1. The mirrored motion has the same value, so four faces do. A table has
the shape (stretches, 4, n, n, n, sizes), over stretch, face, direction and size. Between points it
is a cubic polynomial in each direction and linear in s^2: a quadratic form is met exactly, and a
motion beyond the largest size costs on as its square.

All kernels name alike: `table`, `after`, `values`, `expected` tables in float32, one of them of a
single stretch; `y`, `u` motions (4,); `squares` (sizes,) the grid's s^2 from 0 on; `moves`
(stretches, 4, 4) the transition in a control step with each stretch; `cost` (4,) weights of squares
at a step's end; `reach` and places of stretches in distances between stretches; `weights` (3, 4)
working memory; `first` and `last` the lines first .. last - 1 of the grid's 4 n^2. Written are
`values` by `sweep`, `expected` by `expect`, and what the others say.
"""

import numpy as np

from mm_gym.compiler import kernel

SINGLE = np.float32

NODES = 4  # of the cubic polynomials; the least number of points along a direction
ON_NODE = 1e-6  # part of the distance between two stretches within which one is met


@kernel
def node_weights(place, n, weights):
    """Write the weights (4,) of the cubic at a place in 0 .. n - 1; return its first node."""
    first = min(max(int(place) - 1, 0), n - NODES)
    a = place - first
    b, c, d = a - 1.0, a - 2.0, a - 3.0
    weights[0], weights[1] = -b * c * d / 6.0, a * c * d / 2.0
    weights[2], weights[3] = -a * b * d / 2.0, a * b * c / 6.0
    return first


@kernel
def others(face):
    """Return the coordinates that are a face's directions, in order."""
    return int(face < 1), 1 + int(face < 2), 2 + int(face < 3)  # noqa: PLR2004 - coordinates


@kernel
def stencil(y, n, weights):
    """Write the weights (3, 4) around a motion y (4,); return its face and the first nodes.

    Rest has no direction, and gets any.
    """
    face = 0
    for axis in range(1, 4):
        if abs(y[axis]) > abs(y[face]):
            face = axis
    over = 0.5 * (n - 1) / y[face] if y[face] != 0.0 else 0.0
    middle = 0.5 * (n - 1)
    a, b, c = others(face)
    i = node_weights(y[a] * over + middle, n, weights[0])
    j = node_weights(y[b] * over + middle, n, weights[1])
    k = node_weights(y[c] * over + middle, n, weights[2])
    return face, i, j, k


@kernel
def bracket(square, squares, z):
    """Return the interval of sizes with s^2 = `square`, sought from z on, and the place in it."""
    while z < squares.size - 2 and squares[z + 1] < square:
        z += 1
    return z, (square - squares[z]) / (squares[z + 1] - squares[z])


@kernel
def size_square(y):
    """Return s^2 of a motion y (4,)."""
    return max(y[0] * y[0], y[1] * y[1], y[2] * y[2], y[3] * y[3])


@kernel
def lookup(table, y, squares, weights):
    """Return the value of a motion y, from the table of one stretch."""
    face, i, j, k = stencil(y, table.shape[1], weights)
    z, t = bracket(size_square(y), squares, 0)
    below, above, total = SINGLE(1.0 - t), SINGLE(t), 0.0
    for a in range(NODES):
        for b in range(NODES):
            line = SINGLE(0.0)
            for c in range(NODES):
                cell = table[face, i + a, j + b, k + c]
                line += SINGLE(weights[2, c]) * (below * cell[z] + above * cell[z + 1])
            total += weights[0, a] * weights[1, b] * line
    return total


@kernel
def lookup_sizes(table, y, weights, row):
    """Write the values (sizes,) of motions in the direction of y, of each size of the grid.

    The loop over sizes is innermost, so that it is vectorised.
    """
    face, i, j, k = stencil(y, table.shape[1], weights)
    row[:] = SINGLE(0.0)
    for a in range(NODES):
        for b in range(NODES):
            for c in range(NODES):
                weight = SINGLE(weights[0, a] * weights[1, b] * weights[2, c])
                cell = table[face, i + a, j + b, k + c]
                for z in range(row.size):
                    row[z] += weight * cell[z]


@kernel
def point(face, i, j, k, n, u):
    """Write the motion (4,) of size 1 at a point of the grid."""
    step = 2.0 / (n - 1)
    a, b, c = others(face)
    u[a], u[b], u[c], u[face] = step * i - 1.0, step * j - 1.0, step * k - 1.0, 1.0


@kernel
def move(matrix, u, y):
    """Write y = matrix u, (4,)."""
    for a in range(4):
        y[a] = matrix[a, 0] * u[0] + matrix[a, 1] * u[1] + matrix[a, 2] * u[2] + matrix[a, 3] * u[3]


@kernel
def cost_of(cost, y):
    """Return the cost of a step that ends with a motion y: `cost` (4,) weighs the squares."""
    return cost[0] * y[0] ** 2 + cost[1] * y[1] ** 2 + cost[2] * y[2] ** 2 + cost[3] * y[3] ** 2


@kernel
def least_within(after, low, high, best):
    """Write the least values (sizes,) of all stretches from low to high.

    They are linear between those `after` (stretches, sizes) a step with each stretch.
    """
    first, last = int(np.ceil(low - ON_NODE)), int(np.floor(high + ON_NODE))
    best[:] = SINGLE(np.inf)
    for m in range(first, last + 1):
        for z in range(best.size):
            best[z] = min(best[z], after[m, z])
    if first > low + ON_NODE:
        part = SINGLE(first - low)
        for z in range(best.size):
            best[z] = min(best[z], after[first, z] + part * (after[first - 1, z] - after[first, z]))
    if last < high - ON_NODE:
        part = SINGLE(high - last)
        for z in range(best.size):
            best[z] = min(best[z], after[last, z] + part * (after[last + 1, z] - after[last, z]))


@kernel
def sweep(after, values, moves, cost, squares, reach, first, last):
    """Write the values before a step from those after it, its cost apart."""
    stretches, n, sizes = values.shape[0], values.shape[2], values.shape[5]
    u, y, weights = np.empty(4), np.empty(4), np.empty((3, NODES))
    row, ends = np.empty(sizes, SINGLE), np.empty((stretches, sizes), SINGLE)
    for line in range(first, last):
        face, i, j = line // (n * n), line // n % n, line % n
        for k in range(n):
            point(face, i, j, k, n, u)
            for m in range(stretches):
                move(moves[m], u, y)
                lookup_sizes(after[m], y, weights, row)
                own, square, above = cost_of(cost, y), size_square(y), 0
                for z in range(sizes):
                    above, t = bracket(square * squares[z], squares, above)
                    found = (1.0 - t) * row[above] + t * row[above + 1]
                    ends[m, z] = squares[z] * own + found
            for m in range(stretches):
                low, high = max(m - reach, 0.0), min(m + reach, stretches - 1.0)
                least_within(ends, low, high, values[m, face, i, j, k])


@kernel
def expect(values, expected, jumps, chances, cost, squares, first, last):
    """Write what impulses in a step add to the values at its end, times their chances.

    The motion at the step's end differs by jumps (stretches, impulses, 4) of chances (impulses,).
    """
    stretches, n = values.shape[0], values.shape[2]
    u, x, y, weights = np.empty(4), np.empty(4), np.empty(4), np.empty((3, NODES))
    for line in range(first, last):
        face, i, j = line // (n * n), line // n % n, line % n
        for k in range(n):
            point(face, i, j, k, n, u)
            for m in range(stretches):
                for z in range(squares.size):
                    x[:] = np.sqrt(squares[z]) * u
                    undisturbed, total = cost_of(cost, x), 0.0
                    for a in range(chances.size):
                        y[:] = x + jumps[m, a]
                        later = lookup(values[m], y, squares, weights)
                        total += chances[a] * (later + cost_of(cost, y) - undisturbed)
                    expected[m, face, i, j, k, z] = total


@kernel
def choose(after, moves, cost, squares, motions, present, reach, chosen):
    """Write the next stretches (lanes,), for motions (lanes, 4) and the present stretches."""
    stretches = len(after)
    y, weights, ends = np.empty(4), np.empty((3, NODES)), np.empty(stretches)
    for lane in range(chosen.size):
        low = min(max(present[lane] - reach, 0.0), stretches - 1.0)
        high = max(min(present[lane] + reach, stretches - 1.0), 0.0)
        first, last = int(low + ON_NODE), int(np.ceil(high - ON_NODE))
        for m in range(first, last + 1):
            move(moves[m], motions[lane], y)
            ends[m] = cost_of(cost, y) + lookup(after[m], y, squares, weights)
        best, least = low, np.inf
        for m in range(first, last + 1):
            place, value = float(m), ends[m]
            if m < low - ON_NODE:
                place, value = low, ends[m] + (low - m) * (ends[m + 1] - ends[m])
            elif m > high + ON_NODE:
                place, value = high, ends[m] + (m - high) * (ends[m - 1] - ends[m])
            if value < least:
                best, least = place, value
        chosen[lane] = best
