"""What a policy's C source costs: memory, and time on this machine."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from agents.exports.c_source import c_source, constants, state_of, widths

if TYPE_CHECKING:
    from agents.policies import Policy

CALLS = 200_000

_MAIN = """
#include <stdio.h>
#include <time.h>
int main(void) {{
    policy_state state;
    REAL observation[{observed}], action[{k}], sum = 0;
    policy_begin(&state);
    const clock_t begun = clock();
    for (int call = 0; call < {calls}; call++) {{
        for (int i = 0; i < {observed}; i++) observation[i] = (REAL)((call + 7 * i) % 13 - 6) / 6;
        policy_act(&state, observation, action);
        sum += action[0];
    }}
    printf("%g %g", (double)(clock() - begun) / CLOCKS_PER_SEC / {calls}, (double)sum);
    return 0;
}}
"""


@dataclass(frozen=True)
class Expense:
    """What a policy needs.

    Attributes
    ----------
    read_only, state, stack
        Bytes of constants, those kept from step to step, and those of arrays on the stack, with
        float.
    products
        Multiplications with weights in a step.
    seconds
        Of a step on this machine, or None without a C compiler.
    """

    read_only: int
    state: int
    stack: int
    products: int
    seconds: float | None


def expense_of(policy: Policy) -> Expense:
    """Return what a policy needs; its time is measured with `cc`, if there is one."""
    inner = (policy.direct, policy.keep, policy.enter, policy.pairs, policy.base[:, :-1])
    arrays = (*policy.weights, *policy.cell[:2], *inner)
    return Expense(
        read_only=4 * constants(policy),
        state=4 * state_of(policy),
        stack=4 * sum(widths(policy)),
        products=sum(array.size for array in arrays),
        seconds=_seconds(policy),
    )


def _seconds(policy: Policy) -> float | None:
    compiler = shutil.which("cc")
    if compiler is None:
        return None
    observed, *_, k = policy.sizes
    with tempfile.TemporaryDirectory() as folder:
        source, program = Path(folder) / "policy.c", Path(folder) / "policy"
        source.write_text(c_source(policy) + _MAIN.format(observed=observed, k=k, calls=CALLS))
        command = [compiler, "-O2", "-std=c99", str(source), "-o", str(program), "-lm"]
        subprocess.run(command, check=True, capture_output=True)  # noqa: S603 - our own source
        done = subprocess.run([program], check=True, capture_output=True, text=True)  # noqa: S603
    return float(done.stdout.split()[0])
