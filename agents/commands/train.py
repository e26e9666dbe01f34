"""Train an agent by reinforcement learning.

For example ``python -m agents train PreStretch --name first --seed 1``.

The first argument is a task, which stands for its file in ``configs/agents``, or a file of
settings; flags override it. The same command continues an interrupted run from its last checkpoint.
More ``--steps`` extend a finished run. The run keeps the policy of the least validation cost.
"""

from collections.abc import Sequence

from agents.commands.evaluate import SINGLE, report_run
from agents.control.controller import Controller
from agents.errors import command
from agents.training.config import TrainSettings
from agents.training.own_scene import print_misfits
from agents.training.progress import notes_of
from agents.training.reinforcement import train
from agents.training.runs import Run


@command
def main(settings: TrainSettings) -> None:
    """Train from the command line, then report."""
    train_and_report(settings)


def train_and_report(
    settings: TrainSettings,
    others: Sequence[Controller] = (),
    *,
    episodes: int = SINGLE,
    name: str = "learned",
) -> None:
    """Train and report, with other controllers too.

    So many episodes are reported, and the agent by that name.
    """
    run = Run(settings.name)
    print_misfits(settings)
    with run.advised():
        train(settings, run)
        report_run(run, episodes, name=name, others=others, trust=True)
    print(*notes_of(run), sep="\n", end="\n" if notes_of(run) else "")
