"""Train a PPO agent.

For example ``python -m agents.train configs/agents/pre_stretch.toml --name first --seed 1``.

A killed run continues from its last checkpoint; the best model of the validations is kept.
"""

from __future__ import annotations

import sys

from agents.evaluate import report_run
from agents.training.config import settings_from_command_line
from agents.training.ppo import train
from agents.training.runs import Run, RunError
from mm_gym import SceneError


def main() -> str | None:
    """Train from the command line, then report."""
    try:
        settings = settings_from_command_line(__doc__ or "")
        run = Run(settings.name)
        train(settings, run)
        report_run(run)
    except (SceneError, RunError) as error:
        return f"error: {error}"
    return None


if __name__ == "__main__":
    sys.exit(main())
