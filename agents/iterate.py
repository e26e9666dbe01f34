"""Iterate values on a grid: ``python -m agents.iterate PreStretchShock``.

Finds the best law without foresight where the stretch alone is tuned, the plant is linear at every
stretch, and nothing but random impulses disturbs it. A task or a file of settings comes first, then
flags over it. An interrupted run continues from its last checkpoint when the same command is given
again, and a finished one goes on with more ``--sweeps`` or ``--time-budget``.
"""

from __future__ import annotations

from agents.errors import leave
from agents.search.command import search_from_command_line
from agents.value_iteration.iteration import iterate
from agents.value_iteration.settings import IterateSettings


def main() -> str | int | None:
    """Iterate from the command line, and print the cost on the held-out episodes."""
    return search_from_command_line(IterateSettings, iterate, __doc__ or "")


if __name__ == "__main__":
    leave(main())
