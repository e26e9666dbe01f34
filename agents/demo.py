"""Evolve a network in seconds, train PPO, and report both beside the laws: ``make demo``.

All control the adaptive absorber, on the same held-out episodes, within three minutes.
"""

from __future__ import annotations

import sys
from pathlib import Path

from agents.controllers.learned import Learned
from agents.evolution.settings import EvolveSettings
from agents.evolve import evolve_and_score
from agents.policies import load_policy
from agents.train import train_and_report
from agents.training.config import TrainSettings, read_settings
from agents.training.runs import Run, numbered

SETTINGS = Path(__file__).parents[1] / "configs" / "agents" / "pre_stretch.toml"

GENERATIONS = 600
"""Of the evolution: some fifteen seconds on two cores."""


def main() -> str | int | None:
    """Run anew, beside earlier demos, or continue an interrupted one."""
    trained = numbered(read_settings(SETTINGS, TrainSettings))
    evolved = EvolveSettings(
        task=trained.task,
        name=f"{trained.name}-evolved",
        generations=GENERATIONS,
        time_budget=30.0,
    )
    status = evolve_and_score(evolved)
    if status is not None:
        return status
    network = Learned(load_policy(Run(evolved.name).policy), "evolved network")
    return train_and_report(trained, beside=[network])


if __name__ == "__main__":
    sys.exit(main())
