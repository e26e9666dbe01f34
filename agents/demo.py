"""Train on the adaptive absorber within three minutes, and report: ``python -m agents.demo``."""

from __future__ import annotations

import sys
from pathlib import Path

from agents.evaluate import report_run
from agents.training.config import read_settings
from agents.training.ppo import train
from agents.training.runs import Run

SETTINGS = Path(__file__).parents[1] / "configs" / "agents" / "pre_stretch.toml"


def main() -> None:
    """Train anew, or continue a killed demo."""
    settings = read_settings(SETTINGS)
    run = Run(settings.name)
    if run.finished:
        run.clear()
    train(settings, run)
    report_run(run)


if __name__ == "__main__":
    sys.exit(main())
