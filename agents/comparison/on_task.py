"""What is known on a task, measured: its best law, trainings, changed scenes and an episode."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agents.comparison.entries import Entry, Episodes, validation_cost
from agents.comparison.robustness import DELAY, NOISE, outcomes
from agents.comparison.trainings import Curve, OnTask, Trainings, best_of, slopes
from agents.controllers.controller import columns
from agents.controllers.learned import Learned
from agents.evaluation.baselines import classical_laws
from agents.evaluation.episodes import evaluate
from agents.evaluation.headroom import EPISODES
from agents.evaluation.planner import Effort, Planner
from agents.evaluation.scores import SCORES, read_scores
from agents.evolution.settings import EvolveSettings
from agents.policies import load_policy
from agents.search.starts import start_of
from agents.sweeps.trials import algorithm_of
from agents.training.config import TrainSettings
from agents.training.parts import Parts, make_parts
from agents.training.runs import Run, RunError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path
    from typing import Any

    from agents.controllers.controller import Controller
    from agents.evaluation.episodes import Evaluation
    from agents.training.config import RunSettings
    from mm_gym import Scene

STUDIES = {"carriage.stiffness": 1.0, NOISE: 0.0, DELAY: None}
"""What is changed -> the level of the scene as designed, if no level is it."""

EFFORT = Effort(random=1, kept=1, first=5, second=12, rounds=0, last=8)
"""Of the plan of the episode that is shown."""


def on_task(task: str, trials: Sequence[RunSettings], folder: Path) -> OnTask:
    """Measure a task, with finished trainings in a folder and the committed scores.

    Raises
    ------
    SceneError
        If the scores cannot be read, or the task has none.
    RunError
        If the scores are of another scene.
    """
    scene = trials[0].load_scene()
    scores = read_scores(tasks=[task])[task]
    if scores["scene_digest"] != scene.digest:
        msg = f"{task}: {SCORES.name} is of another scene; run: python -m agents.headroom {task}"
        raise RunError(msg)
    known: dict[str, float] = {}
    for row in scores["rows"]:
        known[row["role"]] = min(row["cost"], known.get(row["role"], np.inf))
    plans = next(row for row in scores["rows"] if row["role"] == "planner")["plans"]
    results = [(evaluate(scene, law, episodes=EPISODES), law) for law in classical_laws(scene)]
    result, law = min(results, key=lambda pair: pair[0].cost)
    agents: dict[str, list[Controller]] = {}
    curves: dict[str, list[Curve]] = {}
    for trial, agent in zip(trials, _trained(trials, folder), strict=True):
        agents.setdefault(algorithm_of(trial), []).append(agent)
        curves.setdefault(algorithm_of(trial), []).append(_curve(Run(trial.name, folder)))
    trainings = [
        Trainings(name, [evaluate(scene, one, episodes=EPISODES) for one in own], curves[name])
        for name, own in agents.items()
    ]
    middle = {of.algorithm: agents[of.algorithm][of.median] for of in trainings}
    rows = [Entry("best law", [law]), *(Entry(name, [one]) for name, one in middle.items())]
    best = middle[best_of(trainings).algorithm]
    return OnTask(
        task,
        result,
        validation_cost(scene, law),
        trainings,
        known,
        np.array([plan["cost"] for plan in plans]),
        outcomes(scene, rows, Episodes(1, EPISODES), studies=list(STUDIES)),
        _slopes(scene, best),
        _examples(scene, law, best),
    )


def _trained(trials: Sequence[RunSettings], folder: Path) -> list[Controller]:
    """Return the policies of finished trainings as controllers.

    Trainings that differ in their seed alone have one base in common, which is tuned once.
    """
    parts: dict[str, Parts] = {}
    found: list[Controller] = []
    for trial in trials:
        policy = load_policy(Run(trial.name, folder).policy)
        if not isinstance(trial, TrainSettings):
            found.append(Learned(policy, trial.name))
            continue
        same = trial.model_copy(update={"seed": 0, "name": ""}).model_dump_json()
        if same not in parts:
            parts[same] = make_parts(trial)
        found.append(parts[same].controller(policy, trial.name))
    return found


def _curve(run: Run) -> Curve:
    steps, costs, seconds = run.validations()
    return Curve(steps, seconds, costs)


def _slopes(scene: Scene, agent: Controller) -> np.ndarray[Any, Any] | None:
    """Return (3, n): the LQR's slopes, and the agent's at rest and at full scale."""
    if columns(scene) != ("force",) or not isinstance(agent, Learned):
        return None
    start = start_of(scene, EvolveSettings(law="regulator"), np.random.default_rng(0))
    return np.stack([start.direct[0, 1:], *(slopes(agent.policy, at) for at in (0.01, 0.5))])


def _examples(scene: Scene, law: Controller, agent: Controller) -> list[Evaluation]:
    """Return the first held-out episode, by the law, the agent and the planner."""
    if scene.actuation.stretch is None:
        return []
    found = [evaluate(scene, one, episodes=2) for one in (law, agent)]
    starts = {result.name: result.applied for result in found}
    return [*found, evaluate(scene, Planner(scene, starts, EFFORT), episodes=2)]
