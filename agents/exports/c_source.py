"""A policy as C99 without allocation or libraries, for a microcontroller."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.policies import PolicyError

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


def c_source(policy: Policy) -> str:
    """Return the source of a policy: `policy_begin`, then `policy_act` in each control step.

    Raises
    ------
    PolicyError
        If the policy is a recurrent one.
    """
    if policy.cell:
        msg = "policy: a recurrent one; allowed: dense layers, with correlation units or without"
        raise PolicyError(msg)
    observed, r = policy.sizes[0], len(policy.units)
    *hidden, k = (len(bias) for bias in policy.biases)
    arrays = {f"weight_{i}": weight for i, weight in enumerate(policy.weights)}
    arrays |= {f"bias_{i}": bias for i, bias in enumerate(policy.biases)}
    arrays |= {name: getattr(policy, name) for name in ("low", "high", *_present(policy))}
    last = "(REAL)tanh((double)next[i])" if policy.squashed else "next[i]"
    parts = [
        _head(policy),
        *(_array(name, values) for name, values in arrays.items()),
        f"typedef struct {{ REAL sums[{max(r, 1)}][2]; }} policy_state;",
        _CLIP,
        f"static REAL activated(REAL x) {{\n{ACTIVATIONS[policy.activation]}\n}}" if hidden else "",
        _DENSE,
        _BEGIN.format(rows=max(r, 1)),
        "void policy_act(policy_state *state, const REAL *observation, REAL *action) {",
        f"    REAL input[{observed + r}], next[{max(*hidden, k) if hidden else k}];",
        f"    REAL value[{max(hidden)}];" if hidden else "",
        f"    for (int i = 0; i < {observed}; i++) input[i] = observation[i];",
        _UNITS.format(r=r, n=observed) if r else "    (void)state;",
        *_layers(policy),
        f"    for (int i = 0; i < {k}; i++) action[i] = clip({last}, low[i], high[i]);",
        "}",
    ]
    return "\n".join(part for part in parts if part) + "\n"


def constants(policy: Policy) -> int:
    """Return how many numbers a policy consists of."""
    arrays = [*policy.weights, *policy.biases, policy.low, policy.high]
    return sum(array.size for array in (*arrays, policy.direct, policy.pairs, policy.units))


def _present(policy: Policy) -> list[str]:
    return [name for name in ("direct", "pairs", "units") if getattr(policy, name).size]


def _head(policy: Policy) -> str:
    observed, *_, k = policy.sizes
    return f"""/* A policy of mm_gym: {observed} observed numbers to {k} actions.

   policy_begin(&state) at an episode's start, policy_act(&state, observation, action) in each
   control step. REAL is float unless the compiler is told otherwise: -DREAL=double. */
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

_BEGIN = """void policy_begin(policy_state *state) {{
    for (int q = 0; q < {rows}; q++) state->sums[q][0] = state->sums[q][1] = 0;
}}"""

_UNITS = """    for (int q = 0; q < {r}; q++) {{
        const REAL memory = units[4 * q], floor = units[4 * q + 1];
        const REAL offset = units[4 * q + 2], scale = units[4 * q + 3];
        REAL *sums = state->sums[q], ab[2] = {{0, 0}};
        add_products(pairs + q * 2 * {n}, observation, ab, 2, {n});
        sums[0] = memory * sums[0] + 2 * ab[0] * ab[1];
        sums[1] = memory * sums[1] + ab[0] * ab[0] + ab[1] * ab[1];
        input[{n} + q] = (sums[0] / (floor + sums[1]) - offset) * scale;
    }}"""
