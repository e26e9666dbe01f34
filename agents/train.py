"""Train an agent.

For example ``python -m agents.train PreStretch --name first --seed 1``.

A task, which stands for its file in ``configs/agents``, or a file of settings comes first, then
flags over it. An interrupted run continues from its last checkpoint when the same command is given
again, and a finished one goes on with more ``--steps``; the best policy of the validations is kept.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from gymnasium.error import DependencyNotInstalled

from agents.errors import leave
from agents.evaluate import SINGLE, report_run
from agents.policies import PolicyError
from agents.training.config import TrainSettings, settings_from_command_line
from agents.training.ending import notes_of
from agents.training.reinforcement import train
from agents.training.runs import INTERRUPTED, Run, RunError
from mm_gym import CompileError, SceneError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from agents.controllers.controller import Controller


def main() -> str | int | None:
    """Train from the command line, then report."""
    try:
        settings = settings_from_command_line(TrainSettings, __doc__ or "")
    except SceneError as error:
        return f"error: {error}"
    return train_and_report(settings)


def train_and_report(
    settings: TrainSettings,
    beside: Sequence[Controller] = (),
    *,
    episodes: int = SINGLE,
    name: str = "learned",
) -> str | int | None:
    """Train and report, beside other controllers too; return what `leave` takes.

    Parameters
    ----------
    episodes, name
        Of the report: how many, and what the agent is called there.
    """
    run = Run(settings.name)
    try:
        train(settings, run)
        report_run(run, episodes, name=name, beside=beside, trust=True)
        for note in notes_of(run):
            print(note)
    except (SceneError, CompileError, RunError, PolicyError, DependencyNotInstalled) as error:
        return f"error: {error}"
    except OSError as error:  # a full disk, a folder that cannot be written to
        kept = "its last checkpoint is whole: give the same command again when there is room"
        if run.finished:
            kept = f"trained; score it when there is room: python -m agents.evaluate {run.folder}"
        return f"error: {error}\n{run.folder}: {kept}"
    except KeyboardInterrupt as interrupt:
        print(run.advice(interrupt), file=sys.stderr)
        return INTERRUPTED
    return None


if __name__ == "__main__":
    leave(main())
