"""Train on the adaptive absorber within three minutes, and report: ``python -m agents.demo``."""

from __future__ import annotations

import sys
from pathlib import Path

from agents.train import train_and_report
from agents.training.config import TrainSettings, read_settings
from agents.training.runs import numbered

SETTINGS = Path(__file__).parents[1] / "configs" / "agents" / "pre_stretch.toml"


def main() -> str | int | None:
    """Train anew, beside earlier demos, or continue an interrupted one."""
    return train_and_report(numbered(read_settings(SETTINGS, TrainSettings)))


if __name__ == "__main__":
    sys.exit(main())
