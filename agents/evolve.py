"""Evolve a small network around a law: ``python -m agents.evolve PreStretchShock --seed 1``.

A task or a file of settings comes first, then flags over it. An interrupted run continues from its
last checkpoint when the same command is given again, and a finished one goes on with more
``--generations`` or ``--time-budget``; the best network of the validations is kept.
"""

from __future__ import annotations

import sys

from gymnasium.error import DependencyNotInstalled

from agents.controllers.learned import Learned
from agents.evaluation.episodes import evaluate
from agents.evolution.search import evolve
from agents.evolution.settings import EvolveSettings
from agents.policies import PolicyError, load_policy
from agents.training.config import settings_from_command_line
from agents.training.runs import INTERRUPTED, Run, RunError
from mm_gym import CompileError, DesignError, SceneError

ERRORS = (
    SceneError,
    CompileError,
    DesignError,
    RunError,
    PolicyError,
    DependencyNotInstalled,
    OSError,  # a full disk
)

EPISODES = 100
"""Held-out episodes of the cost that is printed."""


def main() -> str | int | None:
    """Evolve from the command line, and print the cost on the held-out episodes."""
    try:
        settings = settings_from_command_line(EvolveSettings, __doc__ or "")
    except SceneError as error:
        return f"error: {error}"
    return evolve_and_score(settings)


def evolve_and_score(settings: EvolveSettings) -> str | int | None:
    """Evolve and score; return what `sys.exit` takes."""
    run = Run(settings.name)
    try:
        evolve(settings, run)
        learned = Learned(load_policy(run.policy), "evolved")
        cost = evaluate(settings.load_scene(), learned, episodes=EPISODES).cost
    except ERRORS as error:
        return f"error: {error}"
    except KeyboardInterrupt:
        print(run.advice, file=sys.stderr)
        return INTERRUPTED
    print(f"{cost:.4f} is its cost on {EPISODES} held-out episodes")
    print(f"beside every law: python -m agents.evaluate {run.folder}")
    return None


if __name__ == "__main__":
    sys.exit(main())
