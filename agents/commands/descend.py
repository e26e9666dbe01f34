"""Train a network around a controller by exact gradients.

For example ``python -m agents descend PreStretchNoise --seed 1``.

A task, which stands for its file in ``configs/gradient``, or a file of settings comes first, then
flags over it. An interrupted run continues from its last checkpoint when the same command is given
again, and a finished one goes on with more ``--iterations`` or ``--time-budget``; the best network
of the validations is kept.
"""

from agents.commands._search import search_and_score
from agents.errors import command
from agents.gradient.descent import descend
from agents.gradient.settings import GradientSettings


@command
def main(settings: GradientSettings) -> None:
    """Train from the command line, and print the cost on the held-out episodes."""
    search_and_score(settings, descend)
