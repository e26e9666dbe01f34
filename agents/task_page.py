"""Write the page on the tasks, ``docs/tasks.md``: ``python -m agents.task_page``.

It describes the tasks' scenes; its scores come from ``python -m agents.headroom``.
"""

from __future__ import annotations

import json
import sys

from agents.evaluation.headroom import SCORES
from agents.report.task_page import PAGE, page
from mm_gym.files import write_text


def main() -> None:
    """Write the page."""
    write_text(PAGE, page(json.loads(SCORES.read_text("utf-8"))))


if __name__ == "__main__":
    sys.exit(main())
