"""Write the page on the tasks, ``docs/tasks.md``: ``python -m agents.task_page``.

It describes the tasks' scenes; its scores come from ``python -m agents.headroom``.
"""

from __future__ import annotations

import argparse

from agents.errors import ERRORS, leave
from agents.evaluation.scores import read_scores
from agents.report.task_page import PAGE, page
from mm_gym.files import write_text
from mm_gym.tasks import ids


def main() -> str | None:
    """Write the page; return what is wrong, or None."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    try:
        write_text(PAGE, page(read_scores(tasks=ids())))
    except ERRORS as error:
        return f"error: {error}"
    return None


if __name__ == "__main__":
    leave(main())
