"""Score a trained agent against every baseline: ``python -m agents.evaluate runs/first``.

Writes tables and figures into the run's folder and prints the ranking by the task's cost.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path  # noqa: TC003 - tyro reads the annotation
from typing import Annotated

import tyro
from stable_baselines3 import PPO

from agents.controllers.learned import Learned
from agents.evaluation.baselines import baselines
from agents.evaluation.episodes import Evaluation, evaluate
from agents.report.figures import draw_costs, draw_response
from agents.report.tables import print_ranking, write_episodes, write_scores
from agents.training.runs import Run, RunError
from mm_gym import Scene, SceneError


@dataclass(frozen=True)
class Arguments:
    """What to evaluate."""

    folder: Annotated[Path, tyro.conf.Positional]
    """folder of a finished run, runs/NAME"""
    episodes: int = 200
    """held-out episodes"""


def report_run(run: Run, episodes: int = 200) -> list[Evaluation]:
    """Evaluate a run's model and the baselines on the same held-out episodes.

    The results are written to the run's folder and printed.

    Returns
    -------
    list of Evaluation
        The reference baseline first, the learned agent last.
    """
    record = run.read()
    if not run.finished:
        msg = f"{run.folder}: training is not over; continue it: python -m agents.train"
        raise RunError(msg)
    scene = Scene(**record["scene"])
    controllers = [*baselines(scene), Learned(PPO.load(run.model, device="cpu"))]
    results = [evaluate(scene, controller, episodes=episodes) for controller in controllers]
    write_scores(results, run.folder / "scores.csv")
    write_episodes(results, run.folder / "episodes.csv")
    draw_costs(results, run.folder / "costs.png")
    draw_response(results[0], results[-1], scene, run.folder / "response.png")
    print_ranking(results, scene)
    print(f"written: {run.folder}/")
    return results


def main() -> str | None:
    """Evaluate from the command line."""
    arguments = tyro.cli(Arguments, description=__doc__)
    try:
        report_run(Run(arguments.folder.name, arguments.folder.parent), arguments.episodes)
    except (SceneError, RunError) as error:
        return f"error: {error}"
    return None


if __name__ == "__main__":
    sys.exit(main())
