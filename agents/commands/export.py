"""Write a policy for other programs.

For example ``python -m agents export runs/first --out policy.c``. The ending of ``--out`` selects
the format: ``.c`` is C99 for a microcontroller, which allocates nothing and needs no library but,
for tanh, the mathematical one; ``.onnx`` is for any ONNX runtime; ``.safetensors`` for NumPy. The
command prints the memory and the time that the C source needs. A run is exported with the scene's
channels, actuators, units and scales, and so is a controller or a file with ``--task``, or a file
that was exported so: the C source then has ``policy_act_si``, from SI units to SI units.

A controller is written as the arithmetic that it does, and an agent around one together with it.
Where a controller does more than arithmetic, the command says which action to pass to the agent,
and how to add the two, and the C source has no ``policy_act_si``.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from agents.commands.evaluate import read_policy
from agents.errors import command
from agents.exports.controllers import controller_policy
from agents.network.c_source import c_source, seconds_of
from agents.network.files import ENDINGS
from agents.network.interface import Interface
from agents.network.onnx import onnx_bytes
from agents.policies import AnyPolicy, Policy, PolicyError, load_exported, load_policy
from agents.training.parts import Parts, agent_of, base_controller, trained_parts
from agents.training.progress import read_ending
from agents.training.runs import Run
from agents.value_table.policy import TablePolicy
from mm_gym import SceneError, load_scene
from mm_gym.errors import refuse
from mm_gym.files import check_outputs, write_bytes
from mm_gym.scene import Document
from mm_gym.tasks import task_or_scene
from mm_gym.user_code import is_path

WRITERS = {
    ".c": lambda policy, interface, comment: c_source(
        policy.graph(), interface, comment
    ).text.encode(),
    ".onnx": lambda policy, interface, comment: onnx_bytes(
        policy.graph(), "\n".join([*(interface.told if interface else ()), comment])
    ),
    ".safetensors": lambda policy, interface, _: policy.to_bytes(interface),
}
"""By the file's ending: what returns its content, given the policy, its interface, a comment."""


class Arguments(Document):
    """What to export."""

    policy: Annotated[Path, tyro.conf.Positional]
    """folder of a finished run, runs/NAME, a policy's file, a controller's name or FILE.py:NAME
    with --task, or with --trust a .zip archive of Stable-Baselines3's PPO"""
    out: Path = Path("policy.c")
    """the file to write; its ending is .c, .onnx or .safetensors"""
    task: str | None = None
    """task or scene file of a controller, or of a policy's file that does not know its scene"""
    trust: bool = False
    """open an archive, and run a run's own base, although that can run any code"""


@dataclass(frozen=True)
class Exported:
    """What is written."""

    policy: AnyPolicy
    interface: Interface | None = None  # channels and actuators, or None where they are not known
    comment: str = ""  # what its user has to add

    def content(self, out: Path) -> bytes:
        """Return the content of a file; raise `PolicyError` if it cannot hold a table."""
        if isinstance(self.policy, TablePolicy) and out.suffix != ".safetensors":
            msg = (
                f"--out: got {str(out)!r}; allowed for a policy of value iteration: .safetensors; "
                f"it is a table of {self.policy.after.size:,} numbers, which no "
                "microcontroller can hold"
            )
            raise PolicyError(msg)
        return WRITERS[out.suffix](self.policy, self.interface, self.comment)


def read_exported(arguments: Arguments) -> Exported:
    """Return what is named, with its base in it where that can be exported.

    Raise `PolicyError`, `RunError` or `SceneError` if there is none, or its base is code of the
    user's that is not trusted.
    """
    path, task, trust = arguments.policy, arguments.task, arguments.trust
    if path.is_dir():
        if task is not None:
            refuse("--task", f"{task!r} with the run {path}", "none: a run has its own scene")
        return _of_run(Run(path.name, path.parent), trust=trust)
    name = str(path)
    is_controller = is_path(name) or not (path.suffix or path.exists())
    if task is None:
        if is_controller:
            msg = f"{name}: no such file; a controller needs --task"
            raise PolicyError(msg)
        return Exported(*_of_file(path, trust=trust))
    scene = load_scene(task_or_scene(task))
    interface = Interface.of_scene(scene)
    if is_controller:
        controller = base_controller(scene, name, "controller")
        return Exported(controller_policy(controller, scene, name), interface)
    policy, known = _of_file(path, trust=trust)
    policy.check(interface.observed, len(interface.commands))
    if known not in (None, interface):
        other = [
            one for one in Interface.model_fields if getattr(known, one) != getattr(interface, one)
        ]
        refuse(
            "--task",
            f"{task!r}, which differs in {', '.join(other)} from the scene of {path}",
            "none, or the scene that the file was exported for",
        )
    return Exported(policy, interface)


def _of_file(path: Path, *, trust: bool) -> tuple[AnyPolicy, Interface | None]:
    """Return the policy of a file, with what the file says that it is connected to."""
    return (read_policy(path, trust=trust), None) if path.suffix == ".zip" else load_exported(path)


def _of_run(run: Run, *, trust: bool) -> Exported:
    """Return what a run stands for: its agent, or the controller that costs less."""
    policy, scene, name = load_policy(run.policy), run.scene(), run.read()["settings"].get("base")
    parts, ending = trained_parts(run, trust=trust), read_ending(run)
    interface = Interface.of_scene(scene)
    if ending is not None and (returned := ending.returned) is not None:
        comment = f"It is the controller {returned}, which costs less than the run's agent."
        controller = agent_of(run, parts, returned)
        try:
            return Exported(controller_policy(controller, scene, returned), interface, comment)
        except SceneError as error:
            msg = f"{error}. {comment} The agent is in {run.policy}"
            raise PolicyError(msg) from error
    if parts.base is None:
        return Exported(policy, interface)
    assert isinstance(policy, Policy)  # noqa: S101 - no table is around a controller
    whole = parts.controller(policy)  # refuses one that is not of its size
    try:
        return Exported(controller_policy(whole, scene, name), interface)
    except SceneError:
        return Exported(policy, comment=_left(parts, policy, name))


def _left(parts: Parts, policy: Policy, name: str) -> str:
    """Return what the user of an agent has to add whose controller cannot be exported."""
    if parts.scheduled is not None:
        return (
            f"Its actions set numbers of the controller {name}, which is not in it: "
            f"{parts.scheduled.told(parts.authority)}. It reads the controller's situation "
            f"({type(parts.scheduled).__name__}.situation)."
        )
    k = policy.actions
    last = "last input is" if k == 1 else f"last {k} inputs are"
    return (
        f"Its {last} the action of the controller {name}, which is not in it; "
        f"apply clip(controller + {parts.authority} * action, -1, 1)."
    )


@command
def main(arguments: Arguments) -> str | None:
    """Export from the command line."""
    out = arguments.out
    if out.suffix not in WRITERS:
        return f"error: --out: got {str(out)!r}; allowed: a name that ends in {', '.join(WRITERS)}"
    named = arguments.policy
    check_outputs([out], [named, *(named / f"policy{ending}" for ending in ENDINGS)])
    exported = read_exported(arguments)
    write_bytes(out, exported.content(out))
    print(f"written: {out}")
    if exported.comment:
        print(exported.comment)
    if out.suffix == ".c":
        print_expense(exported)
    return None


def print_expense(exported: Exported) -> None:
    """Print what the C source of a policy needs."""
    policy = exported.policy
    assert not isinstance(policy, TablePolicy)  # noqa: S101 - refused before
    source = c_source(policy.graph(), exported.interface)
    print(
        f"constants {4 * source.constants} bytes, state {4 * source.remembered} bytes, "
        f"arrays on the stack {4 * source.working} bytes (float)"
    )
    seconds = seconds_of(source, policy.observed, policy.actions)
    print(f"{source.products} products a step", end="")
    print("" if seconds is None else f", {1e9 * seconds:.0f} ns on this machine")
