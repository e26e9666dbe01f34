"""Score a trained agent against every baseline: ``python -m agents.evaluate runs/first``.

Writes tables and figures into the run's folder and prints the table.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path  # noqa: TC003 - tyro reads the annotation
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table
from stable_baselines3 import PPO

from agents.controllers.learned import Learned
from agents.evaluation.episodes import Evaluation, baselines, evaluate
from agents.report.figures import draw_response, draw_scores
from agents.training.runs import Run, RunError
from mm_gym import Scene, SceneError
from mm_gym.files import write_csv


@dataclass(frozen=True)
class Arguments:
    """What to evaluate."""

    folder: Annotated[Path, tyro.conf.Positional]
    """folder of a finished run, runs/NAME"""
    episodes: int = 200
    """held-out episodes"""


def report_run(run: Run, episodes: int = 200) -> list[Evaluation]:
    """Evaluate a run's model and the baselines on the same held-out episodes.

    The result is written to the run's folder and printed.

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
    write_results(run, results)
    draw_scores(results, scene, run.folder / "score_against_frequency.png")
    draw_response(results[0], results[-1], scene, run.folder / "response.png")
    print_table(results, scene)
    Console().print(f"written: {run.folder}/", highlight=False)
    return results


def write_results(run: Run, results: list[Evaluation]) -> None:
    """Write ``scores.csv``, a row per controller, and ``episodes.csv``, a row per episode."""
    write_csv(
        run.folder / "scores.csv",
        ["controller", "score [-]", "ratio to reference [-]", "mean return [-]"],
        [
            [result.name for result in results],
            [result.score for result in results],
            [result.score / results[0].score for result in results],
            [result.returns.mean() for result in results],
        ],
    )
    write_csv(
        run.folder / "episodes.csv",
        ["frequency [rad/s]", *(f"score of {result.name} [-]" for result in results)],
        [results[0].frequency, *(result.episode_scores for result in results)],
    )


def print_table(results: list[Evaluation], scene: Scene) -> None:
    """Print the controllers, best last reference first."""
    unit = f"{scene.objective.displacement_scale * 1e3:g} mm"
    table = Table(
        title=f"score: rms of x1 / {unit} over {results[0].returns.size} held-out episodes"
    )
    table.add_column("controller", no_wrap=True)
    for heading in ("score", "ratio", "mean return"):
        table.add_column(heading, justify="right")
    for result in sorted(results, key=lambda result: -result.score):
        table.add_row(
            result.name,
            f"{result.score:.3f}",
            f"{result.score / results[0].score:.2f}",
            f"{result.returns.mean():.2f}",
        )
    Console().print(
        table, f"ratio: to {results[0].name}, the best of its kind", sep="\n", highlight=False
    )


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
