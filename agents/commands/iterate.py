"""Find the optimum without preview by value iteration on a grid.

For example ``python -m agents iterate PreStretchShock``.

It is for scenes where the stretch alone is tuned, the plant is linear at every stretch, and nothing
but random impulses disturbs it. The first argument is a task or a file of settings; flags override
it. The same command continues an interrupted run from its last checkpoint. More ``--sweeps`` or
``--time-budget`` extend a finished run.
"""

from agents.commands._search import search_and_score
from agents.errors import command
from agents.value_iteration.iteration import IterateSettings, iterate


@command
def main(settings: IterateSettings) -> None:
    """Iterate from the command line, and print the cost on the held-out episodes."""
    search_and_score(settings, iterate)
