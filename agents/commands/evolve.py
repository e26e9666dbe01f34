"""Evolve a small network around a controller.

For example ``python -m agents evolve PreStretchShock --seed 1``, or, added to a controller with a
memory of its own, ``python -m agents evolve CarriageForceFriction --base inertial-drive``.

The first argument is a task or a file of settings; flags override it. The same command continues an
interrupted run from its last checkpoint. More ``--generations`` or ``--time-budget`` extend a
finished run. The run keeps the network of the least validation cost.
"""

from agents.commands._search import search_and_score
from agents.errors import command
from agents.evolution.search import EvolveSettings, evolve


@command
def main(settings: EvolveSettings) -> None:
    """Evolve from the command line, and print the cost on the held-out episodes."""
    search_and_score(settings, evolve)
