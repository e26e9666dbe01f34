"""Find the optimum without preview by value iteration on a grid.

For example ``python -m agents iterate PreStretchShock``.

It is for scenes where the stretch alone is tuned, the plant is linear at every stretch, and nothing
but random impulses disturbs it. A task or a file of settings comes first, then flags over it. An
interrupted run continues from its last checkpoint when the same command is given again, and a
finished one goes on with more ``--sweeps`` or ``--time-budget``.
"""

from agents.commands._search import search_and_score
from agents.errors import command
from agents.value_iteration.iteration import IterateSettings, iterate


@command
def main(settings: IterateSettings) -> None:
    """Iterate from the command line, and print the cost on the held-out episodes."""
    search_and_score(settings, iterate)
