"""What is known on a task: its reference, finished trainings, changed scenes and an episode."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from agents.control.controller import Controller
from agents.controllers.learned import Learned
from agents.controllers.tuned import classical_laws
from agents.evaluation.aggregates import Estimate, interquartile_mean, proportion, shared_episodes
from agents.evaluation.contestants import Entry, Episodes
from agents.evaluation.headroom import EPISODES
from agents.evaluation.plans import Effort, Planner
from agents.evaluation.scores import SCORES, read_scores
from agents.evaluation.studies import DELAY, NOISE, Outcome, outcomes
from agents.evolution.search import EvolveSettings
from agents.policies import Policy, load_policy
from agents.scoring import Evaluation, evaluate, validation_cost
from agents.sweeps.trials import LEARNERS, algorithm_of
from agents.training.config import RunSettings, short_name
from agents.training.parts import Parts, make_parts
from agents.training.runs import Run, RunError
from agents.training.starts import start_of
from mm_gym import Scene
from mm_gym.arrays import Array

STUDIES = {"carriage.stiffness": 1.0, NOISE: 0.0, DELAY: None}
"""What is changed -> the level of the scene as designed, if no level is it."""

EFFORT = Effort(random=1, kept=1, first=5, second=12, rounds=0, searches=0, last=8)
"""Of the plan of the episode that is shown."""


@dataclass(frozen=True, eq=False)
class Curve:
    """The validations of one training."""

    # steps, costs, seconds: (validations,) control steps of all lanes [-], cost [-] and time [s].
    steps: Array
    costs: Array
    seconds: Array


@dataclass(frozen=True, eq=False)
class Trainings:
    """The trainings of one algorithm on a task."""

    algorithm: str  # its name
    results: Sequence[Evaluation]  # of each seed, in the same held-out episodes
    curves: Sequence[Curve]  # of each seed

    @property
    def penalties(self) -> Array:
        """(seeds, episodes) as in `Evaluation`."""
        return np.array([result.penalties for result in self.results])

    @property
    def costs(self) -> Array:
        """(seeds,) cost of each training [-]."""
        return np.array([result.cost for result in self.results])

    @property
    def median(self) -> int:
        """The seed whose cost is in the middle; of two, the better."""
        return int(np.argsort(self.costs)[(len(self.costs) - 1) // 2])

    def middle_curve(self) -> tuple[Array, Array]:
        """Return what the seeds have in common, up to the shortest: time and least cost so far.

        Returns
        -------
        seconds
            (validations,) median over the seeds [s].
        costs
            (3, validations) least, median and most of the seeds [-].
        """
        count = min(len(curve.costs) for curve in self.curves)
        seconds = np.median([curve.seconds[:count] for curve in self.curves], axis=0)
        least = [np.minimum.accumulate(curve.costs[:count]) for curve in self.curves]
        return seconds, np.percentile(least, (0.0, 50.0, 100.0), axis=0)


@dataclass(frozen=True, eq=False)
class OnTask:
    """What is known on a task."""

    task: str  # its id
    # The reference controller in the same episodes: the best of `classical_laws` in them.
    law: Evaluation
    law_validation: float  # its cost in the validation episodes [-]
    trainings: Sequence[Trainings]  # of each algorithm
    known: Mapping[str, float]  # role -> the least cost of `docs/task_scores.json` [-]
    plans: Array  # (episodes,) costs of the clairvoyant optima [-]
    # Of the law and of each algorithm's middle training on changed scenes.
    outcomes: Sequence[Outcome]
    # Of a force alone: the LQR's, the best algorithm's middle training's at rest and at full scale,
    # see `slopes`.
    slopes: Array | None
    # Of a stretch: an episode by the law, by the same training and by the planner.
    examples: Sequence[Evaluation]

    @property
    def name(self) -> str:
        """The short name of the task."""
        return short_name(self.task)

    @property
    def best(self) -> Trainings:
        """The trainings of the best algorithm."""
        return best_of(self.trainings)

    def scores(self, costs: Array) -> Array:
        """Return s = (J_constant - J) / (J_constant - J_best found) of costs J."""
        constant = self.known["constant"]
        return (constant - costs) / (constant - self.known["planner"])


def algorithms_of(known: Sequence[OnTask]) -> list[str]:
    """Return the names of the algorithms that were run on any task, in the order of `LEARNERS`."""
    found = {of.algorithm for one in known for of in one.trainings}
    return sorted(found, key=LEARNERS.index)


def best_of(trainings: Sequence[Trainings]) -> Trainings:
    """Return the trainings of the algorithm with the least interquartile mean cost."""
    return min(trainings, key=lambda own: float(interquartile_mean(own.costs[None])))


def middle_cost(trainings: Trainings) -> Estimate:
    """Return the interquartile mean of the seeds' costs, with its interval, if there are several.

    The interval is for other seeds and other episodes.
    """
    return shared_episodes(trainings.penalties)


def cheaper(trainings: Trainings, law: Evaluation) -> int:
    """Return how many seeds cost less than a controller in the same episodes."""
    return int((trainings.costs < law.cost).sum())


def improvement(trainings: Trainings, law: Evaluation) -> Estimate:
    """Return the probability that a training's cost is below a controller's in these episodes.

    The interval is for other seeds in the same episodes.
    """
    return proportion(cheaper(trainings, law), len(trainings.costs))


def episodes_won(trainings: Trainings, law: Evaluation) -> float:
    """Return which fraction of all episodes of all seeds costs less than with the controller."""
    return float((trainings.penalties < law.penalties).mean())


def slopes(policy: Policy, at: float) -> Array:
    """Return the mean slope (n,) of the first action over each observed number, from -at to at."""
    ends = at * np.eye(policy.sizes[0])
    return (policy.act(ends) - policy.act(-ends))[:, 0] / (2.0 * at)


def on_task(task: str, trials: Sequence[RunSettings], folder: Path) -> OnTask:
    """Measure a task, with finished trainings in a folder and the committed scores.

    Raise `SceneError` if the scores cannot be read, or the task has none; `RunError` if the scores
    are of another scene.
    """
    scene = trials[0].load_scene()
    scores = read_scores(tasks=[task])[task]
    if scores["scene_digest"] != scene.digest:
        msg = f"{task}: {SCORES.name} is of another scene; run: python -m agents headroom {task}"
        raise RunError(msg)
    known: dict[str, float] = {}
    for row in scores["rows"]:
        known[row["role"]] = min(row["cost"], known.get(row["role"], np.inf))
    plans = next(row for row in scores["rows"] if row["role"] == "planner")["plans"]
    results = [(evaluate(scene, law, episodes=EPISODES), law) for law in classical_laws(scene)]
    result, law = min(results, key=lambda pair: pair[0].cost)
    trainings, agents = trainings_of(trials, folder)
    middle = {of.algorithm: agents[of.algorithm][of.median] for of in trainings}
    rows = [
        Entry("reference controller", [law]),
        *(Entry(name, [one]) for name, one in middle.items()),
    ]
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


def trainings_of(
    trials: Sequence[RunSettings], folder: Path
) -> tuple[list[Trainings], dict[str, list[Controller]]]:
    """Return the finished trainings of a task, scored, and the agents of each algorithm."""
    scene = trials[0].load_scene()
    agents: dict[str, list[Controller]] = {}
    curves: dict[str, list[Curve]] = {}
    for trial, agent in zip(trials, _trained(trials, folder), strict=True):
        agents.setdefault(algorithm_of(trial), []).append(agent)
        curve = Curve(*Run(trial.name, folder).validations())
        curves.setdefault(algorithm_of(trial), []).append(curve)
    trainings = [
        Trainings(name, [evaluate(scene, one, episodes=EPISODES) for one in own], curves[name])
        for name, own in agents.items()
    ]
    return trainings, agents


def _trained(trials: Sequence[RunSettings], folder: Path) -> list[Controller]:
    """Return the policies of finished trainings as controllers.

    Trainings that differ in their seed alone have one base in common, which is tuned once.
    """
    parts: dict[str, Parts] = {}
    found: list[Controller] = []
    for trial in trials:
        policy = load_policy(Run(trial.name, folder).policy)
        same = trial.model_copy(update={"seed": 0, "name": ""}).model_dump_json()
        if same not in parts:
            parts[same] = make_parts(trial)
        found.append(parts[same].controller(policy, trial.name))
    return found


def _slopes(scene: Scene, agent: Controller) -> Array | None:
    """Return (3, n): the LQR's slopes, and the agent's at rest and at full scale."""
    if scene.actuation.names != ("force",) or not isinstance(agent, Learned):
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
