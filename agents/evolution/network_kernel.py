"""The forward pass of a population of networks, each over lanes of its own.

All loops over lanes are innermost and of single precision, so that they are vectorised.
"""

import numpy as np
from numba import types
from numba.extending import intrinsic, overload

from mm_gym.compiler import borrowing_kernel, inlined_kernel

SINGLE = np.float32
ZERO, ONE, TWO, THREE = SINGLE(0.0), SINGLE(1.0), SINGLE(2.0), SINGLE(3.0)
NINE, TWENTY_SEVEN = SINGLE(9.0), SINGLE(27.0)

FOUR = 4  # products that are added at once


@intrinsic
def _fma(_context, x, y, z):
    def build(_context, builder, _signature, arguments):
        return builder.fma(*arguments)

    return types.float32(x, y, z), build


def fma(x, y, z):
    """Return x y + z, in a kernel rounded once.

    Explicit: fastmath fuses on processors that can, and a training would repeat on those only.
    """
    return x * y + z


@overload(fma)
def _compiled_fma(x, y, z):  # noqa: ARG001 - numba compares the names
    return lambda x, y, z: _fma(x, y, z)  # noqa: PLW0108 - numba wants a plain function


@inlined_kernel
def copy_row(row, target):
    """Copy a row (lanes,)."""
    for lane in range(row.size):
        target[lane] = row[lane]


@inlined_kernel
def combine(weights, constant, rows, total):
    """Write a constant plus weights (n,) times rows (n, lanes) to the total (lanes,)."""
    lanes, n, j = total.size, weights.size, 0
    if n >= FOUR:
        w0, w1, w2, w3 = weights[0], weights[1], weights[2], weights[3]
        r0, r1, r2, r3 = rows[0], rows[1], rows[2], rows[3]
        for lane in range(lanes):
            near, far = fma(w0, r0[lane], w1 * r1[lane]), fma(w2, r2[lane], w3 * r3[lane])
            total[lane] = constant + (near + far)
        j = FOUR
    else:
        for lane in range(lanes):
            total[lane] = constant
    add_products(weights[j:], rows[j:], total)


@inlined_kernel
def add_products(weights, rows, total):
    """Add weights (n,) times rows (n, lanes) to the total (lanes,), which is written."""
    lanes, n, j = total.size, weights.size, 0
    while j + FOUR <= n:
        w0, w1, w2, w3 = weights[j], weights[j + 1], weights[j + 2], weights[j + 3]
        r0, r1, r2, r3 = rows[j], rows[j + 1], rows[j + 2], rows[j + 3]
        for lane in range(lanes):
            near, far = fma(w0, r0[lane], w1 * r1[lane]), fma(w2, r2[lane], w3 * r3[lane])
            total[lane] += near + far
        j += FOUR
    while j < n:
        w0, r0 = weights[j], rows[j]
        for lane in range(lanes):
            total[lane] = fma(w0, r0[lane], total[lane])
        j += 1


@inlined_kernel
def bounded_tanh(value):
    """Return the rational function of `agents.network.layers.FUNCTIONS`."""
    v = min(max(value, -THREE), THREE)
    square = v * v
    return v * (TWENTY_SEVEN + square) / fma(NINE, square, TWENTY_SEVEN)


@inlined_kernel
def add_unit(own, rows, total):
    """Add a hidden unit's part to the only action, where there are four inputs, in one loop."""
    constant, w0, w1, w2, w3, part = own[0], own[1], own[2], own[3], own[4], own[5]
    r0, r1, r2, r3 = rows[0], rows[1], rows[2], rows[3]
    for lane in range(total.size):
        near, far = fma(w0, r0[lane], w1 * r1[lane]), fma(w2, r2[lane], w3 * r3[lane])
        total[lane] = fma(part, bounded_tanh(constant + (near + far)), total[lane])


@borrowing_kernel
def correlate(pair, unit, rows, sums, left, right, result):
    """Compute one correlation unit (lanes,), see `agents.network.layers.Correlation`.

    The pair (2 n,) weighs the rows (n, lanes) twice; the unit (4,) has memory, floor, offset and
    scale; the sums (2, lanes) are read and written; left and right (lanes,) are working memory.
    """
    n = pair.size // 2
    memory, floor, offset, scale = unit[0], unit[1], unit[2], unit[3]
    combine(pair[:n], ZERO, rows, left)
    combine(pair[n:], ZERO, rows, right)
    products, squares = sums[0], sums[1]
    for lane in range(result.size):
        a, b = left[lane], right[lane]
        products[lane] = fma(TWO * a, b, memory * products[lane])
        squares[lane] = fma(b, b, fma(a, a, memory * squares[lane]))
        result[lane] = (products[lane] / (floor + squares[lane]) - offset) * scale


@borrowing_kernel
def remember(keep, enter, back, rows, memory, result):
    """Move the linear memory (m + k, lanes) on; the last k rows are the last actions.

    Weights are keep (m, m) of the memory, enter (m, n) of the observed rows (n, lanes) and back
    (m, k) of the actions, (m, 0) if it does not know them. The result (m, lanes) is the memory.
    """
    m = len(keep)
    for j in range(len(keep)):
        combine(keep[j], ZERO, memory[:m], result[j])
        add_products(enter[j], rows, result[j])
        add_products(back[j], memory[m:], result[j])
    for j in range(len(keep)):
        copy_row(result[j], memory[j])


@borrowing_kernel
def forward(observed, actions, parameters, fixed, sums, memory, sizes):
    """Compute the actions of candidates; the lanes of a candidate stand side by side.

    Parameters
    ----------
    observed, actions
        (n, candidates * lanes or more) and (k, candidates * lanes) in [-1, 1], which is written.
    parameters
        (candidates, N) of each candidate, in the order of `agents.training.network.Network`.
    fixed
        (r, 4) of each correlation unit; keep, enter and back of the linear memory.
    sums
        (2 r + m + k, candidates * lanes) sums of the units, linear memory and, if it knows them,
        the last actions; read and written.
    memory, sizes
        (n + m + r + 2, lanes) working memory; (n, hidden, k).
    """
    n, hidden, k = sizes
    units, keep, enter, back = fixed
    r, m, lanes = len(units), len(keep), actions.shape[1] // len(parameters)
    inputs = n + m + r
    rows, value, other = memory[:inputs], memory[inputs], memory[inputs + 1]
    for candidate in range(len(parameters)):
        own, begin, i = parameters[candidate], candidate * lanes, 0
        end = begin + lanes
        for j in range(n):
            copy_row(observed[j, begin:end], rows[j])
        if m > 0:
            remember(keep, enter, back, rows[:n], sums[2 * r :, begin:end], rows[n : n + m])
        for q in range(r):
            pair, unit = own[i : i + 2 * (n + m)], rows[n + m + q]
            own_sums = sums[2 * q : 2 * q + 2, begin:end]
            correlate(pair, units[q], rows[: n + m], own_sums, value, other, unit)
            i += 2 * (n + m)
        for action in range(k):
            total = actions[action, begin:end]
            combine(own[i + 1 : i + 1 + inputs], own[i], rows, total)
            i += 1 + inputs
        for _ in range(hidden):
            if inputs == FOUR and k == 1:
                add_unit(own[i : i + FOUR + 2], rows, actions[0, begin:end])
                i += FOUR + 2
                continue
            combine(own[i + 1 : i + 1 + inputs], own[i], rows, value)
            i += 1 + inputs
            for lane in range(lanes):
                value[lane] = bounded_tanh(value[lane])
            for action in range(k):
                total, weight = actions[action, begin:end], own[i + action]
                for lane in range(lanes):
                    total[lane] = fma(weight, value[lane], total[lane])
            i += k
        for action in range(k):
            total = actions[action, begin:end]
            for lane in range(lanes):
                total[lane] = min(max(total[lane], -ONE), ONE)
            if back.shape[1] > 0:
                copy_row(total, sums[2 * r + m + action, begin:end])
