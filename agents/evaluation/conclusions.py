"""Conclusions from what was measured: costs, scores, and their intervals."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from agents.control.controller import Reads
from agents.evaluation.aggregates import (
    LEVEL,
    Estimate,
    cost_estimate,
    estimate,
    interquartile_mean,
    of_means,
    performance_profile,
    probability_of_improvement,
)
from agents.evaluation.contestants import Episodes
from agents.evaluation.headroom import least_cost, read_scores
from agents.evaluation.measurement import TaskResult
from agents.scoring import tail_mean
from mm_gym import Scene
from mm_gym.arrays import Array

THRESHOLDS = np.linspace(-0.5, 1.1, 65)  # scores at which the performance profile is taken

CHOSEN = "best classical controller"
"""Label of the one that did best on each task's validation episodes."""


@dataclass(frozen=True, eq=False)
class Row:
    """What one controller did on one task."""

    controller: str  # its label
    reads: Reads
    trainings: int  # number of trainings with a seed of their own; 1 for all others
    cost: Estimate  # root of the mean penalty of all episodes [-]
    # s = (J_constant - J) / (J_constant - J_best found) [-], or None where no best is known.
    score: Estimate | None
    worst_episode: float  # the largest cost of an episode [-]
    worst_tenth: float  # the cost of the worst tenth of them (CVaR) [-]
    # Cost over that of the task's reference in the same episodes, less 1 [-]; negative is better.
    # None for the reference itself, see `TaskResult.compared`, and where it may cost nothing.
    change: Estimate | None
    episodes_won: float  # fraction of them that cost less than with the reference [-]


@dataclass(frozen=True, eq=False)
class Overall:
    """What one controller did on all tasks."""

    controller: str  # its label
    interquartile_mean: Estimate  # of its scores
    probability_of_improvement: Mapping[str, float]  # over another, by that one's label
    # (thresholds, 3): the fraction of its scores that is greater than each of `THRESHOLDS`, with
    # the ends of the 95 % interval.
    profile: Array


@dataclass(frozen=True, eq=False)
class Comparison:
    """All conclusions."""

    episodes: Episodes  # that all controllers went through
    tables: Mapping[str, Sequence[Row]]  # task -> rows, the least cost first
    results: Sequence[TaskResult]  # what they follow from
    # The controllers that were on all tasks, the best first; none unless the best is known on all.
    overall: Sequence[Overall]


def best_known(task: str, scene: Scene) -> float | None:
    """Return the least known cost over that of the best constant [-], from the committed scores.

    It is None for a scene that has none, as one with an own reward.
    """
    if scene.own_reward is not None:  # the digest leaves it out
        return None
    scores = read_scores().get(task)
    if scores is None or scores["scene_digest"] != scene.digest:
        return None
    rows = scores["rows"]
    constant = next(row["cost"] for row in rows if row["role"] == "constant")
    return least_cost(rows) / constant


def conclude(
    results: Sequence[TaskResult], scenes: Mapping[str, Scene], episodes: Episodes
) -> Comparison:
    """Return the conclusions; equal results and episodes give equal ones to the last digit."""
    generator = np.random.default_rng(episodes.first)
    resampled = [result.sample.resampled(generator) for result in results]
    known = [best_known(result.task, scenes[result.task]) for result in results]
    tables = {
        result.task: sorted(
            (_row(result, k, drawn, ratio) for k in range(len(result.labels))),
            key=lambda row: row.cost.value,
        )
        for result, drawn, ratio in zip(results, resampled, known, strict=True)
    }
    ratios = [ratio for ratio in known if ratio is not None]
    overall: list[Overall] = []
    if len(ratios) == len(results) > 1:
        overall = _overall(results, resampled, ratios)
    return Comparison(episodes, tables, results, overall)


def scores_of(means: Array, constant: Array, ratio: float) -> Array:
    """Return the scores of mean penalties, with those of the best constant in the same episodes.

    J_best found is the given ratio times J_constant: both are of the committed episodes, which
    need not be these.
    """
    return (1.0 - np.sqrt(means / constant)) / (1.0 - ratio)


def _row(result: TaskResult, k: int, drawn: Array, ratio: float | None) -> Row:
    sample, reference = result.sample, result.compared
    own, other = sample.penalties[k], sample.penalties[reference]
    score = change = None
    if ratio is not None:
        score = of_means(sample, drawn, partial(scores_of, ratio=ratio), k, result.reference)
    if k != reference and drawn[reference].all():
        change = of_means(
            sample, drawn, lambda own, other: np.sqrt(own / other) - 1.0, k, reference
        )
    return Row(
        controller=result.labels[k],
        reads=result.reads[k],
        trainings=len(own) if sample.trained[k] else 1,
        cost=cost_estimate(sample, k, drawn),
        score=score,
        worst_episode=float(np.sqrt(own.max())),
        worst_tenth=float(np.sqrt(tail_mean(own.ravel()))),
        change=change,
        episodes_won=float((own < other).mean()),
    )


def _overall(
    results: Sequence[TaskResult], resampled: Sequence[Array], ratios: Sequence[float]
) -> list[Overall]:
    indices = {
        label: [result.labels.index(label) for result in results]
        for label in results[0].labels
        if all(label in result.labels for result in results)
    }
    if all(result.chosen is not None for result in results):
        indices[CHOSEN] = [result.chosen or 0 for result in results]
    scores: dict[str, Array] = {}
    drawn: dict[str, Array] = {}
    for label, rows in indices.items():
        measured, resamples = [], []
        for result, draws, ratio, k in zip(results, resampled, ratios, rows, strict=True):
            means = result.sample.penalties.mean(axis=2)
            measured.append(scores_of(means[k], means[result.reference], ratio))
            resamples.append(scores_of(draws[k], draws[result.reference], ratio))
        scores[label], drawn[label] = np.stack(measured, axis=-2), np.stack(resamples, axis=-2)
    first = results[0].sample
    trained = {label: bool(first.trained[rows[0]]) for label, rows in indices.items()}
    found = [
        Overall(
            controller=label,
            interquartile_mean=estimate(
                float(interquartile_mean(own)),
                interquartile_mean(drawn[label]),
                own,
                drawn[label],
                trained=trained[label],
                episodes=first.penalties.shape[2],
            ),
            profile=_profile(own, drawn[label]),
            probability_of_improvement={
                other: float(probability_of_improvement(own, scores[other]))
                for other in scores
                if other != label
            },
        )
        for label, own in scores.items()
    ]
    return sorted(found, key=lambda one: -one.interquartile_mean.value)


def _profile(scores: Array, drawn: Array) -> Array:
    ends = np.percentile(performance_profile(drawn, THRESHOLDS), LEVEL, axis=0)
    return np.column_stack([performance_profile(scores, THRESHOLDS), *ends])
