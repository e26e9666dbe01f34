"""Evolve a small network around a controller.

For example ``python -m agents evolve PreStretchShock --seed 1``.

A task or a file of settings comes first, then flags over it. An interrupted run continues from its
last checkpoint when the same command is given again, and a finished one goes on with more
``--generations`` or ``--time-budget``; the best network of the validations is kept.
"""

from agents.commands._search import search_and_score
from agents.errors import command
from agents.evolution.search import EvolveSettings, evolve


@command
def main(settings: EvolveSettings) -> None:
    """Evolve from the command line, and print the cost on the held-out episodes."""
    search_and_score(settings, evolve)
