"""Train a network around a law by gradients: ``python -m agents.descend PreStretchNoise --seed 1``.

A task, which stands for its file in ``configs/gradient``, or a file of settings comes first, then
flags over it. An interrupted run continues from its last checkpoint when the same command is given
again, and a finished one goes on with more ``--iterations`` or ``--time-budget``; the best network
of the validations is kept.
"""

from __future__ import annotations

from agents.errors import leave
from agents.gradient.descent import descend
from agents.gradient.settings import GradientSettings
from agents.search.command import search_from_command_line


def main() -> str | int | None:
    """Train from the command line, and print the cost on the held-out episodes."""
    return search_from_command_line(GradientSettings, descend, __doc__ or "")


if __name__ == "__main__":
    leave(main())
