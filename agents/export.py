"""Write a policy as C source for a microcontroller: ``python -m agents.export runs/first``.

The source is C99, allocates nothing and needs no library but, for tanh, the mathematical one. What
it costs in memory and time is printed.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from agents.exports.c_source import c_source
from agents.exports.measure import expense_of
from agents.policies import PolicyError, load_policy
from mm_gym import SceneError
from mm_gym.files import write_text


@dataclass(frozen=True)
class Arguments:
    """What to export."""

    policy: Annotated[Path, tyro.conf.Positional]
    """folder of a finished run, runs/NAME, or a policy's .npz file"""
    out: Path = Path("policy.c")
    """the file to write"""


def main() -> str | None:
    """Export from the command line."""
    arguments = tyro.cli(Arguments, description=__doc__)
    path = arguments.policy
    try:
        policy = load_policy(path / "policy.npz" if path.is_dir() else path)
        write_text(arguments.out, c_source(policy))
    except (PolicyError, SceneError, OSError) as error:
        return f"error: {error}"
    expense = expense_of(policy)
    print(f"written: {arguments.out}")
    print(f"constants {expense.read_only} bytes, state {expense.state} bytes (float)")
    print(f"{expense.products} products a step", end="")
    print("" if expense.seconds is None else f", {1e9 * expense.seconds:.0f} ns on this machine")
    return None


if __name__ == "__main__":
    sys.exit(main())
