"""Write the page on the tasks, ``docs/tasks.md``.

It describes the tasks' scenes; its scores come from ``python -m agents headroom``.
"""

from agents.errors import command
from agents.evaluation.headroom import read_scores
from agents.report.score_pages import TASKS, tasks_page
from mm_gym.files import write_text
from mm_gym.tasks import ids


@command
def main() -> None:
    """Write the page."""
    write_text(TASKS, tasks_page(read_scores(tasks=ids())))
