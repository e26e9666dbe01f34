"""Do the committed scores hold, and is there something to gain on every task?"""

import json
from dataclasses import replace

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, PRE_STRETCH, TASKS

from agents.controllers.constant import constant_stretch, no_control
from agents.controllers.feedback import Feedback
from agents.controllers.lqr import LQR
from agents.evaluation.episodes import evaluate
from agents.evaluation.headroom import LEARNED, SCORES, headroom, least_cost
from agents.evaluation.planner import SEARCH, Planner
from agents.evaluation.statistics import interval

COMMITTED = json.loads(SCORES.read_text("utf-8"))
COMMAND = "python -m agents.headroom"


@pytest.mark.parametrize("name", TASKS)
def test_scores_are_of_the_present_scene(name) -> None:
    assert COMMITTED[name]["scene_digest"] == TASKS[name].digest, f"run `{COMMAND} {name}`"


@pytest.mark.parametrize("name", TASKS)
def test_something_known_gains_a_fifth_on_the_best_constant(name) -> None:
    rows = COMMITTED[name]["rows"]
    constant = next(row["cost"] for row in rows if row["role"] == "constant")
    assert least_cost(rows) <= 0.8 * constant


@pytest.mark.parametrize("name", TASKS)
def test_no_fixed_action_beats_the_best_constant(name) -> None:
    costs = {row["role"]: row["cost"] for row in COMMITTED[name]["rows"]}
    # Where a rate is commanded, going to the best stretch costs effort that staying does not.
    assert costs["constant"] <= costs["zero"] * 1.001


@pytest.mark.slow
@pytest.mark.parametrize("name", TASKS)
def test_scores_come_out_again(name) -> None:
    committed = [row for row in COMMITTED[name]["rows"] if row["role"] != LEARNED]
    for again, row in zip(headroom(TASKS[name]), committed, strict=True):
        assert again["role"] == row["role"]
        assert row["low"] <= again["cost"] <= row["high"]


def test_interval_is_that_of_the_central_limit() -> None:
    penalties = 1.0 + 0.2 * np.random.default_rng(3).standard_normal(400)
    low, high = interval(penalties)
    half = 1.96 * penalties.std() / 400**0.5
    # A percentile of 10,000 resamples scatters by about 2 % of the half width.
    assert low**2 == pytest.approx(penalties.mean() - half, abs=0.1 * half)
    assert high**2 == pytest.approx(penalties.mean() + half, abs=0.1 * half)


def test_planner_cannot_beat_the_regulator_that_is_optimal() -> None:
    lqr = LQR(CARRIAGE_FORCE)
    planned = evaluate(CARRIAGE_FORCE, Planner(CARRIAGE_FORCE, lqr), episodes=5)
    known = evaluate(CARRIAGE_FORCE, Feedback(CARRIAGE_FORCE, lqr), episodes=5)
    # Optimal over an endless horizon without the limit; in a second of clipped force a little less.
    assert 0.99 * known.cost <= planned.cost <= known.cost * (1.0 + 1e-9)


def test_planner_finds_what_its_law_does_not() -> None:
    scene = PRE_STRETCH.replace(**{"control.steps": 100})
    law = no_control(scene)
    planned = evaluate(scene, Planner(scene, law, replace(SEARCH, rounds=2)), episodes=4)
    assert planned.cost < 0.7 * evaluate(scene, Feedback(scene, law), episodes=4).cost


@pytest.mark.parametrize("name", ["mm_gym/PreStretchShock-v0", "mm_gym/Hybrid-v0"])
def test_planner_does_better_than_its_law_under_random_excitation(name) -> None:
    scene = TASKS[name].replace(**{"control.steps": 60})
    law = constant_stretch(scene, 2.0)
    planned = evaluate(scene, Planner(scene, law, replace(SEARCH, rounds=1)), episodes=20)
    # In each episode by itself: the plans are tried against the disturbance that then comes.
    assert np.all(
        planned.penalties
        <= evaluate(scene, Feedback(scene, law), episodes=20).penalties * (1 + 1e-9)
    )


def test_planner_refuses_episodes_that_end_early() -> None:
    scene = CARRIAGE_FORCE.replace(**{"objective.displacement_limit": 0.01})
    with pytest.raises(ValueError, match="end early"):
        Planner(scene, no_control(scene))
