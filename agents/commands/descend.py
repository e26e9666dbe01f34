"""Train a network around a controller by exact gradients.

For example ``python -m agents descend PreStretchNoise --seed 1``.

The first argument is a task, which stands for its file in ``configs/gradient``, or a file of
settings; flags override it. The same command continues an interrupted run from its last checkpoint.
More ``--iterations`` or ``--time-budget`` extend a finished run. The run keeps the network of the
least validation cost.
"""

from agents.commands._search import search_and_score
from agents.errors import command
from agents.gradient.descent import descend
from agents.gradient.settings import GradientSettings


@command
def main(settings: GradientSettings) -> None:
    """Train from the command line, and print the cost on the held-out episodes."""
    search_and_score(settings, descend)
