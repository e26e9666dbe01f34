"""What is there to gain on each task: ``python -m agents.headroom [TASK ...]``.

Scores fixed, classical and clairvoyant controllers on the same hundred episodes, and writes
``docs/task_scores.json``, from which ``docs/tasks.md`` takes its numbers.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import gymnasium
import numpy as np
import tyro

from agents.controllers.controller import ConstantAction, RandomActions
from agents.controllers.neutraliser import FREQUENCY, MatchingStretch
from agents.evaluation.episodes import HELD_OUT_SEED, best_constant, classical_laws, evaluate
from agents.evaluation.planner import Planner
from agents.training.config import TrainSettings
from mm_gym import Scene, SceneError
from mm_gym.files import write_text

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from agents.controllers.controller import Controller
    from agents.evaluation.episodes import Evaluation

SCORES = Path(__file__).parents[2] / "docs" / "task_scores.json"
EPISODES = 100
RESAMPLES = 10_000


@dataclass(frozen=True)
class Arguments:
    """What to score."""

    tasks: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """registered ids; all of mm_gym by default"""
    out: Path = SCORES
    """file that the scores are written to; those of other tasks in it are kept"""


def headroom(scene: Scene) -> list[dict[str, str | float]]:
    """Score every controller, the planner last, on the same held-out episodes.

    Returns
    -------
    list of dict
        Of each: its role, its name, its cost with the ends of a 95 % interval, and its rms of
        x1 / displacement_scale. Roles: "zero", "random", "constant" (the best on these very
        episodes), "law" (tuned on others), "informed" (knows what an agent does not), "planner".
    """
    laws = classical_laws(scene)
    rows = [
        scored("zero", scene, ConstantAction(scene)),
        scored("random", scene, RandomActions(scene)),
        scored("constant", scene, best_constant(scene, HELD_OUT_SEED)),
        *(scored("law", scene, law) for law in laws),
    ]
    if FREQUENCY in scene.randomization:
        rows.append(scored("informed", scene, MatchingStretch(scene)))
    best = min(range(len(laws)), key=lambda i: rows[3 + i]["cost"])
    return [*rows, scored("planner", scene, Planner(scene, laws[best]))]


def scored(role: str, scene: Scene, controller: Controller) -> dict[str, str | float]:
    """Return a row: what one controller does on the held-out episodes."""
    result = evaluate(scene, controller, episodes=EPISODES)
    low, high = interval(result)
    values = {"cost": result.cost, "low": low, "high": high, "displacement": result.score}
    return {"role": role, "controller": result.name} | {
        name: float(f"{value:.6g}") for name, value in values.items()
    }


def interval(result: Evaluation) -> tuple[float, float]:
    """Return the 95 % interval of the cost: the bootstrap's percentiles over episodes."""
    costs = result.episode_costs
    drawn = np.random.default_rng(0).integers(costs.size, size=(RESAMPLES, costs.size))
    means: NDArray[np.float64] = costs[drawn].mean(axis=1)
    low, high = np.sqrt(np.percentile(means, (2.5, 97.5)))
    return float(low), float(high)


def tasks() -> list[str]:
    """Return the ids that mm_gym registers."""
    return [name for name in gymnasium.registry if name.startswith("mm_gym/")]


def print_scores(name: str, rows: list[dict[str, str | float]], seconds: float) -> None:
    """Print the rows of a task."""
    print(f"{name}: {seconds:.0f} s")
    for row in rows:
        print(f"  {row['controller']:60} {row['cost']:.4f} [{row['low']:.4f}, {row['high']:.4f}]")


def main() -> str | None:
    """Score from the command line."""
    arguments = tyro.cli(Arguments, description=__doc__)
    scores = json.loads(arguments.out.read_text("utf-8")) if arguments.out.exists() else {}
    try:
        for name in arguments.tasks or tasks():
            scene = TrainSettings(task=name).load_scene()
            began = time.perf_counter()
            rows = headroom(scene)
            print_scores(name, rows, time.perf_counter() - began)
            scores[name] = {"scene_digest": scene.digest, "episodes": EPISODES, "rows": rows}
            ordered = {task: scores[task] for task in tasks() if task in scores}
            write_text(arguments.out, json.dumps(ordered, indent=1) + "\n")
    except SceneError as error:
        return f"error: {error}"
    return None


if __name__ == "__main__":
    sys.exit(main())
