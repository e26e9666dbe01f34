"""The headroom of a task: fixed, classical and clairvoyant control on the same hundred episodes.

The committed scores, ``docs/task_scores.json``, are read within bounds.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from pydantic import BaseModel, Field, model_validator

from agents.control.controller import Controller
from agents.control.feedback import Feedback
from agents.controllers.adjustable import adjustable
from agents.controllers.constant import ConstantAction, best_constant, held, no_control
from agents.controllers.noise import RandomActions
from agents.controllers.predictive_control import (
    ROLLOUTS,
    RolloutPredictiveControl,
    predictive_control,
)
from agents.controllers.registry import entries
from agents.controllers.tuned import best_law, classical_laws, designed, further_laws, makers
from agents.evaluation.plans import Effort, Planner, Replanner
from agents.scoring import HELD_OUT_SEED, Evaluation, evaluate, written
from agents.training.runs import checked
from mm_gym import DesignError, Scene, SceneError
from mm_gym.arrays import Array
from mm_gym.files import read_json
from mm_gym.metrics import passive_scene

SCORES = Path(__file__).parents[2] / "docs" / "task_scores.json"

MOST_BYTES = 2**24  # largest file of scores

NEEDED = ("constant", "planner")
"""Roles that every task has a row of: others are compared with them."""

Cost = Annotated[float, Field(ge=0)]


class Plan(BaseModel, strict=True, allow_inf_nan=False):
    """The clairvoyant optimum of an episode."""

    cost: Cost
    start: str


class Scored(BaseModel, extra="allow", strict=True, allow_inf_nan=False):
    """A row of `Headroom`."""

    role: str
    controller: str
    reads: str
    cost: Cost
    low: Cost
    high: Cost
    displacement: float
    plans: list[Plan] = []


class Preview(BaseModel, strict=True, allow_inf_nan=False):
    """What `preview` returns."""

    expected: Cost
    foreseen: Cost


class TaskScores(BaseModel, extra="allow", strict=True, allow_inf_nan=False):
    """What is known of a task."""

    scene_digest: str
    rows: list[Scored]
    preview: Preview | None = None

    @model_validator(mode="after")
    def _has_roles(self) -> Self:
        roles = [row.role for row in self.rows if row.plans or row.role != "planner"]
        for role in NEEDED:
            if role not in roles:
                msg = f"rows: no {role}; allowed: one of each of {', '.join(NEEDED)}, or more"
                raise ValueError(msg)
        return self


def read_scores(path: Path = SCORES, tasks: Iterable[str] = ()) -> dict[str, dict[str, Any]]:
    """Return what is known of each task, by its id, as data of `TaskScores`.

    Some tasks must be in it. Raise `SceneError` if the file cannot be read, is damaged, or lacks a
    task.
    """
    scores: Any = read_json(path, most=MOST_BYTES)
    checked(dict[str, TaskScores], scores, path, "a file of scores")
    for task in tasks:
        if task not in scores:
            msg = f"{path}: {task}: no scores; run: python -m agents headroom {task}"
            raise SceneError(msg)
    return scores


Row = dict[str, Any]

EPISODES = 100
RESAMPLES = 10_000  # draws of the bootstrap

CLASSICAL = ("law", "predictive")
"""Roles of what is designed, not learned, and reads no more than an agent does.

The best controller of a task is the best of these, predictive control included.
"""

VARIED, BEST, AROUND = 150, 3, (0.2, 0.5, 1.0)
"""Designs with other numbers that are tried as starts of plans, those of which an episode keeps so
many, and the spreads of the numbers over those of a search's first trials."""

LARGE = replace(ROLLOUTS, plans=256, elite=12, rounds=4)
THOROUGH = [replace(LARGE, horizon=steps) for steps in (60, 80, 120)]
"""Searches of the numbers of a law that can change in each control step."""

LEARNED = "learned"  # role of a trained agent, which `python -m agents ranking` adds
KEPT = "the plan kept"  # name of a start from an earlier search
ROUNDING = 1e-5  # costs of plans are written with six digits


class Headroom(NamedTuple):
    """What is known of a task."""

    # Of each controller: its role, its name, what it reads, its cost with the ends of a 95 %
    # interval, its rms of x1 / displacement_scale and, where the stretch is actuated, the mean over
    # the episodes of the energy [J] that changing it put in. Roles: "zero", "random", "constant"
    # (the best on these very episodes), "passive" (the best passive damper), "law" (tuned on
    # others), "predictive", "informed" (knows what an agent does not), "planner". The planner, the
    # last, has two entries more: the seed of its search, and of each episode the cost and where the
    # plan is from.
    rows: list[Row]
    plans: Array  # (steps, episodes, k) what the clairvoyant optima apply [N, -]


def headroom(
    scene: Scene, learned: Sequence[Controller] = (), kept: Array | None = None, seed: int = 0
) -> Headroom:
    """Score every controller, the planner last, on the same held-out episodes.

    The planner starts from what all others but the passive damper applied, learned agents too, and
    from the plans that were kept from an earlier search, as `Headroom.plans`. So it is no worse
    than any of them in any episode. Another seed finds other plans.
    """
    controllers = [*controllers_of(scene), *((LEARNED, agent) for agent in learned)]
    results = [(role, evaluate(scene, it, episodes=EPISODES)) for role, it in controllers]
    rows = [row_of(role, result) for role, result in results if role != LEARNED]
    rows[3:3] = passive_rows(scene)
    starts = {result.name: result.applied for _, result in results}
    starts |= varied(scene, seed)
    if kept is not None:
        starts[KEPT] = kept
    row, plans = planned(scene, starts, seed)
    return Headroom([*rows, row], plans)


def varied(scene: Scene, seed: int = 0, episodes: int = EPISODES) -> dict[str, Array]:
    """Return what controllers with other numbers did, as starts of plans: the best of each episode.

    Numbers that suit all episodes suit none best. Those of `VARIED` designs of each controller that
    has free numbers are drawn around the best ones, and numbers that can change in each control
    step are searched there. It is (steps, episodes, k), by name, of the `BEST` designs of each
    episode and of these searches.
    """
    generator, starts = np.random.default_rng(seed), {}
    for entry in entries(scene):
        if entry.tunable is None or entry.refuses(scene) is not None:
            continue
        found, _ = designed(scene, {entry.name: entry.make})
        if (law := adjustable(next(iter(found), None))) is not None:
            for search in THOROUGH:
                one = Feedback(scene, RolloutPredictiveControl(scene, law, search))
                name = f"{entry.name} with numbers of each step, {search.horizon} steps ahead"
                starts[name] = evaluate(scene, one, episodes=episodes).applied
        costs = np.full((BEST, episodes), np.inf)
        applied = np.zeros((BEST, scene.control.steps, episodes, len(scene.actuation.names)))
        for k in range(VARIED):
            try:
                one = entry.tunable.near(scene, AROUND[k % len(AROUND)], generator)
            except DesignError:
                continue
            found = evaluate(scene, one, episodes=episodes)
            worst = costs.argmax(axis=0)
            lanes = np.flatnonzero(found.episode_costs < costs[worst, np.arange(episodes)])
            costs[worst[lanes], lanes] = found.episode_costs[lanes]
            applied[worst[lanes], :, lanes] = found.applied[:, lanes].swapaxes(0, 1)
        for k in np.flatnonzero(np.isfinite(costs).all(axis=1)):
            starts[f"{entry.name} with other numbers {k + 1}"] = applied[k]
    return starts


def controllers_of(scene: Scene) -> list[tuple[str, Controller]]:
    """Return all controllers that can be designed for the scene, each behind its role."""
    laws = classical_laws(scene)
    best = best_law(scene, laws)
    further = [*designed(scene, makers(scene, "filter"))[0], *further_laws(scene)]
    predictive = {"predictive control": lambda scene: predictive_control(scene, best)}
    return [
        ("zero", ConstantAction(scene)),
        ("random", RandomActions(scene)),
        ("constant", best_constant(scene, HELD_OUT_SEED)),
        *(("law", law) for law in [*laws, *further]),
        *(("predictive", law) for law in designed(scene, predictive)[0]),
        *(("informed", law) for law in designed(scene, makers(scene, "informed"))[0]),
    ]


def preview(scene: Scene) -> dict[str, float]:
    """Return the costs of plans made anew in every step, for the mean and for what does come."""
    costs = {
        name: evaluate(scene, Replanner(scene, foresees=foresees), episodes=EPISODES).cost
        for name, foresees in (("expected", False), ("foreseen", True))
    }
    return written(costs)


def over_plans(
    scene: Scene, controllers: Iterable[Controller], rows: Sequence[Mapping[str, Any]]
) -> dict[str, Array]:
    """Return each controller's costs over those of the clairvoyant optima, episode by episode.

    Rows are as of `Headroom`.
    """
    (planner,) = (row for row in rows if row["role"] == "planner")
    known = np.array([plan["cost"] for plan in planner["plans"]])
    return {
        one.name: evaluate(scene, one, episodes=EPISODES).episode_costs / known
        for one in controllers
    }


def passive_rows(scene: Scene) -> list[Row]:
    """Score the best passive damper; none where there is no damping to tune.

    It has another damping of the interface than the scene, and another stiffness of linear springs,
    in the same episodes, and goes to its stretch at once.
    """
    try:
        passive, stretch = passive_scene(scene)
    except DesignError:
        return []
    law = no_control(passive) if stretch is None else held(passive, "stretch", stretch)
    assert passive.interface.kind == "viscous"  # noqa: S101 - as it was tuned
    law.name = f"best passive damper, {passive.interface.damping:.2g} N s/m"
    law.name += "" if stretch is None else f", stretch {stretch:.3f}"
    if passive.springs.kind == "linear":
        law.name += f", springs {passive.springs.stiffness:.3g} N/m"
    return [scored("passive", passive, Feedback(passive, law))]


def least_cost(rows: Sequence[Mapping[str, str | float]]) -> float:
    """Return the least cost of all controllers on the task's own plant."""
    return min(float(row["cost"]) for row in rows if row["role"] != "passive")


def planned(scene: Scene, starts: Mapping[str, Array], seed: int) -> tuple[Row, Array]:
    """Return the planner's row and what it applied, given what others did (steps, episodes, k)."""
    planner = Planner(scene, starts, Effort(seed=seed))
    result = evaluate(scene, planner, episodes=EPISODES)
    pairs = zip(result.episode_costs, planner.origins, strict=True)
    plans = [written({"cost": cost}) | {"start": start} for cost, start in pairs]
    row = row_of("planner", result) | {"seed": planner.effort.seed, "plans": plans}
    return row, result.applied


def scored(role: str, scene: Scene, controller: Controller) -> Row:
    """Return a row: what one controller does on the held-out episodes."""
    return row_of(role, evaluate(scene, controller, episodes=EPISODES))


def row_of(role: str, result: Evaluation) -> Row:
    """Return the row of what a controller did on the held-out episodes."""
    low, high = interval(result.penalties)
    values = {"cost": result.cost, "low": low, "high": high, "displacement": result.rms}
    if result.mean_injected is not None:
        values["injected"] = result.mean_injected
    told = {"role": role, "controller": result.name, "reads": result.reads}
    return told | written(values)


def interval(penalties: Array) -> tuple[float, float]:
    """Return the 95 % interval of the cost: the bootstrap's percentiles over episodes.

    Penalties are as in `Evaluation`; the cost is the root of their mean.
    """
    drawn = np.random.default_rng(0).integers(penalties.size, size=(RESAMPLES, penalties.size))
    means: Array = penalties[drawn].mean(axis=1)
    low, high = np.sqrt(np.percentile(means, (2.5, 97.5)))
    return float(low), float(high)
