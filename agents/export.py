"""Write a policy for other programs: ``python -m agents.export runs/first --out policy.c``.

The ending of ``--out`` says as what: ``.c`` is C99 for a microcontroller, which allocates nothing
and needs no library but, for tanh, the mathematical one; ``.onnx`` is for any ONNX runtime;
``.npz`` for NumPy. What the C source costs in memory and time is printed.

Of an agent that is added to a law, the law is part of what is written if it is a linear one of the
observation. If not, it is said which action has to be handed in and added.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro
from gymnasium.error import DependencyNotInstalled

from agents.errors import leave
from agents.evaluate import read_policy
from agents.exports.c_source import c_source
from agents.exports.linear_base import linear_base
from agents.exports.measure import expense_of
from agents.exports.onnx_graph import onnx_bytes
from agents.policies import PolicyError, load_policy
from agents.training.parts import recorded_parts
from agents.training.runs import Run, RunError
from agents.value_table.policy import TablePolicy
from mm_gym import SceneError
from mm_gym.files import check_outputs, write_bytes

if TYPE_CHECKING:
    from agents.policies import AnyPolicy, Policy

WRITERS = {
    ".c": lambda policy, comment: c_source(policy, comment).encode(),
    ".onnx": onnx_bytes,
    ".npz": lambda policy, _: policy.to_bytes(),
}
"""By the file's ending: what returns its content, given the policy and a comment."""


@dataclass(frozen=True)
class Arguments:
    """What to export."""

    policy: Annotated[Path, tyro.conf.Positional]
    """folder of a finished run, runs/NAME, a policy's .npz file, or with --trust a .zip archive of
    Stable-Baselines3's PPO"""
    out: Path = Path("policy.c")
    """the file to write; its ending is .c, .onnx or .npz"""
    trust: bool = False
    """open an archive, and run a run's own base, although that can run any code"""


def content_of(policy: AnyPolicy, out: Path, comment: str) -> bytes:
    """Return the content of the file to write; raise `PolicyError` if it cannot hold a table."""
    if isinstance(policy, TablePolicy) and out.suffix != ".npz":
        msg = (
            f"--out: got {str(out)!r}; allowed for a policy of value iteration: .npz; it is no "
            f"network but a table of {policy.after.size:,} numbers, more than a microcontroller has"
        )
        raise PolicyError(msg)
    return WRITERS[out.suffix](policy, comment)


def read_whole(path: Path, *, trust: bool) -> tuple[AnyPolicy, str]:
    """Return the policy of a run or file, its base in it if that is linear, and what is missing.

    Raises
    ------
    PolicyError, RunError, SceneError
        If there is none, or its base is code of the user's that is not trusted.
    """
    if not path.is_dir():
        return read_policy(path, trust=trust), ""
    run = Run(path.name, path.parent)
    policy, record = load_policy(run.policy), run.read()
    name = record["settings"].get("base")
    if name is None:
        return policy, ""
    scene = run.scene()
    settings = {"base": name, "authority": record["settings"]["authority"]}
    parts = recorded_parts(scene, settings, trust=trust)
    assert parts.base is not None  # noqa: S101 - it has a name
    gains = linear_base(parts.base, scene)
    if gains is None:
        k = policy.sizes[-1]
        return policy, (
            f"Its last {k} inputs are the action of the law {name}, which is not in it; "
            f"apply clip(law + {parts.authority} * action, -1, 1)."
        )
    return replace(policy, base=gains.astype(np.float32), authority=parts.authority), ""


def main() -> str | None:
    """Export from the command line."""
    arguments = tyro.cli(Arguments, description=__doc__)
    out = arguments.out
    if out.suffix not in WRITERS:
        return f"error: --out: got {str(out)!r}; allowed: a name that ends in {', '.join(WRITERS)}"
    try:
        check_outputs([out], [arguments.policy, arguments.policy / "policy.npz"])
        policy, comment = read_whole(arguments.policy, trust=arguments.trust)
        write_bytes(out, content_of(policy, out, comment))
    except (PolicyError, RunError, SceneError, DependencyNotInstalled, OSError) as error:
        return f"error: {error}"
    print(f"written: {out}")
    if comment:
        print(comment)
    if out.suffix == ".c":
        print_expense(policy)
    return None


def print_expense(policy: Policy) -> None:
    """Print what the C source of a policy needs."""
    needed = expense_of(policy)
    print(
        f"constants {needed.read_only} bytes, state {needed.state} bytes, "
        f"arrays on the stack {needed.stack} bytes (float)"
    )
    print(f"{needed.products} products a step", end="")
    print("" if needed.seconds is None else f", {1e9 * needed.seconds:.0f} ns on this machine")


if __name__ == "__main__":
    leave(main())
