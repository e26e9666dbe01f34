"""A policy as C99 without allocation or libraries, for a microcontroller."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.policies import OPTIONAL

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from agents.policies import Policy

ACTIVATIONS = {
    "tanh": (
        "    if (sizeof(REAL) == sizeof(float)) return (REAL)tanhf((float)x);\n"
        "    return (REAL)tanh((double)x);"
    ),
    "relu": "    return x > 0 ? x : 0;",
    "rational": (
        "    const REAL v = clip(x, -3, 3), square = v * v;\n"
        "    return v * (27 + square) / (27 + 9 * square);"
    ),
}
"""Bodies of the function from x to a unit's value, of `agents.policies.ACTIVATIONS`."""


def c_source(policy: Policy, comment: str = "") -> str:
    """Return the source of a policy: `policy_begin`, then `policy_act` in each control step.

    Parameters
    ----------
    comment
        What is said at its head, besides.
    """
    observed, r, k = policy.sizes[0], len(policy.units), policy.sizes[-1]
    read, m = observed + len(policy.base), len(policy.keep)
    arrays = {f"weight_{i}": weight for i, weight in enumerate(policy.weights)}
    arrays |= {f"bias_{i}": bias for i, bias in enumerate(policy.biases)}
    arrays |= {f"cell_{i}": array for i, array in enumerate(policy.cell)}
    arrays |= {name: getattr(policy, name) for name in ("low", "high", *_present(policy))}
    last = "(REAL)tanh((double)next[i])" if policy.squashed else "next[i]"
    units, inner, widest = widths(policy)
    hidden = len(policy.weights) > 1
    added = f"clip({last}, low[i], high[i])"
    if policy.base.size:
        added = f"clip(proposed[i] + (REAL){policy.authority!r} * {added}, -1, 1)"
    parts = [
        _head(policy, comment),
        *(_array(name, values) for name, values in arrays.items()),
        f"typedef struct {{ REAL sums[{state_of(policy)}]; }} policy_state;",
        _CLIP,
        f"static REAL activated(REAL x) {{\n{ACTIVATIONS[policy.activation]}\n}}" if hidden else "",
        _SIGMOID if policy.cell else "",
        _DENSE,
        _BEGIN.format(count=state_of(policy)),
        "void policy_act(policy_state *state, const REAL *observation, REAL *action) {",
        f"    REAL input[{units}], next[{widest}];",
        f"    REAL value[{inner}];" if inner else "",
        f"    for (int i = 0; i < {observed}; i++) input[i] = observation[i];",
        _BASE.format(n=observed, k=k) if policy.base.size else "",
        _MEMORY.format(m=m, n=read, r=r) if m else "",
        _UNITS.format(r=r, n=read + m) if r else "",
        _CELL.format(n=read, h=policy.cell[1].shape[1]) if policy.cell else "",
        "" if r or m or policy.cell else "    (void)state;",
        *_layers(policy),
        f"    for (int i = 0; i < {k}; i++) action[i] = {added};",
        "}",
    ]
    return "\n".join(part for part in parts if part) + "\n"


def widths(policy: Policy) -> tuple[int, int, int]:
    """Return the lengths of the arrays `input`, `value` and `next`, which are on the stack."""
    outputs = [len(bias) for bias in policy.biases]
    gates = [len(array) for array in policy.cell[2:]]
    read = policy.sizes[0] + sum(map(len, (policy.base, policy.keep, policy.units)))
    cell = [array.shape[1] for array in policy.cell[1:2]]
    return max([read, *cell]), max(outputs[:-1], default=0), max([*outputs, *gates])


def state_of(policy: Policy) -> int:
    """Return how many numbers are kept from step to step, one at least."""
    if policy.cell:
        return 2 * policy.cell[1].shape[1]
    return max(2 * len(policy.units) + len(policy.keep), 1)


def constants(policy: Policy) -> int:
    """Return how many numbers a policy consists of."""
    arrays = [*policy.weights, *policy.biases, *policy.cell, policy.low, policy.high]
    return sum(array.size for array in (*arrays, *(getattr(policy, n) for n in OPTIONAL)))


def _present(policy: Policy) -> list[str]:
    return [name for name in OPTIONAL if getattr(policy, name).size]


def _head(policy: Policy, comment: str) -> str:
    observed, *_, k = policy.sizes
    said = f"\n\n   {comment}" if comment else ""
    return f"""/* A policy of mm_gym: {observed} observed numbers to {k} actions.

   policy_begin(&state) at an episode's start, policy_act(&state, observation, action) in each
   control step. REAL is float unless the compiler is told otherwise: -DREAL=double.{said} */
#include <math.h>
#ifndef REAL
#define REAL float
#endif
"""


def _array(name: str, values: NDArray[np.float32]) -> str:
    numbers = [f"(REAL){float(value)!r}" for value in np.ravel(values)]
    lines = [", ".join(numbers[i : i + 6]) for i in range(0, len(numbers), 6)]
    return f"static const REAL {name}[{len(numbers)}] = {{\n    " + ",\n    ".join(lines) + "\n};"


def _layers(policy: Policy) -> list[str]:
    """Return the lines from `input` to `next`, the action before it is clipped."""
    lines: list[str] = []
    for i, weight in enumerate(policy.weights):
        outputs, inputs = weight.shape
        if i:
            lines.append(f"    for (int i = 0; i < {inputs}; i++) value[i] = activated(next[i]);")
        given = "value" if i else "input"
        lines += [
            f"    for (int i = 0; i < {outputs}; i++) next[i] = bias_{i}[i];",
            f"    add_products(weight_{i}, {given}, next, {outputs}, {inputs});",
        ]
    if policy.direct.size:
        outputs, inputs = policy.direct.shape
        lines.append(f"    add_products(direct, input, next, {outputs}, {inputs});")
    return lines


_CLIP = """static REAL clip(REAL x, REAL low, REAL high) {
    return x < low ? low : x > high ? high : x;
}"""

_DENSE = """static void add_products(
    const REAL *weight, const REAL *input, REAL *sum, int outputs, int inputs) {
    for (int i = 0; i < outputs; i++)
        for (int j = 0; j < inputs; j++) sum[i] += weight[i * inputs + j] * input[j];
}"""

_SIGMOID = """static REAL sigmoid(REAL x) {
    return (REAL)(0.5 + 0.5 * tanh(0.5 * (double)x));
}"""

_BEGIN = """void policy_begin(policy_state *state) {{
    for (int q = 0; q < {count}; q++) state->sums[q] = 0;
}}"""

_BASE = """    REAL proposed[{k}];
    for (int i = 0; i < {k}; i++) {{
        REAL sum = base[i * ({n} + 1) + {n}];
        for (int j = 0; j < {n}; j++) sum += base[i * ({n} + 1) + j] * observation[j];
        proposed[i] = input[{n} + i] = clip(sum, -1, 1);
    }}"""

_MEMORY = """    REAL moved[{m}] = {{0}};
    add_products(keep, state->sums + 2 * {r}, moved, {m}, {m});
    add_products(enter, input, moved, {m}, {n});
    for (int i = 0; i < {m}; i++) state->sums[2 * {r} + i] = input[{n} + i] = moved[i];"""

_UNITS = """    for (int q = 0; q < {r}; q++) {{
        const REAL memory = units[4 * q], floor = units[4 * q + 1];
        const REAL offset = units[4 * q + 2], scale = units[4 * q + 3];
        REAL *sums = state->sums + 2 * q, ab[2] = {{0, 0}};
        add_products(pairs + q * 2 * {n}, input, ab, 2, {n});
        sums[0] = memory * sums[0] + 2 * ab[0] * ab[1];
        sums[1] = memory * sums[1] + ab[0] * ab[0] + ab[1] * ab[1];
        input[{n} + q] = (sums[0] / (floor + sums[1]) - offset) * scale;
    }}"""

_CELL = """    for (int i = 0; i < 4 * {h}; i++) next[i] = cell_2[i];
    add_products(cell_0, input, next, 4 * {h}, {n});
    add_products(cell_1, state->sums + {h}, next, 4 * {h}, {h});
    for (int i = 0; i < {h}; i++) {{
        const REAL entering = sigmoid(next[i]) * (REAL)tanh((double)next[2 * {h} + i]);
        state->sums[i] = sigmoid(next[{h} + i]) * state->sums[i] + entering;
        input[i] = sigmoid(next[3 * {h} + i]) * (REAL)tanh((double)state->sums[i]);
        state->sums[{h} + i] = input[i];
    }}"""
