"""Evolve a small network around a law: ``python -m agents.evolve PreStretchShock --seed 1``.

A task or a file of settings comes first, then flags over it. An interrupted run continues from its
last checkpoint when the same command is given again, and a finished one goes on with more
``--generations`` or ``--time-budget``; the best network of the validations is kept.
"""

from __future__ import annotations

from agents.errors import leave
from agents.evolution.search import evolve
from agents.evolution.settings import EvolveSettings
from agents.search.command import search_from_command_line


def main() -> str | int | None:
    """Evolve from the command line, and print the cost on the held-out episodes."""
    return search_from_command_line(EvolveSettings, evolve, __doc__ or "")


if __name__ == "__main__":
    leave(main())
