"""Are laws compared on late and noisy sensors, and do they use nothing but these?"""

import re
from pathlib import Path

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, HYBRID, PRE_STRETCH, TASKS

from agents.commands.controller_tables import LATE, PAGE, RATES, with_rows
from agents.control.feedback import Feedback
from agents.controllers.extremum_seeking import ExtremumSeeking
from agents.controllers.feedforward_lqr import FeedforwardLQR
from agents.controllers.finite_horizon_lqr import FiniteHorizonLQR
from agents.controllers.lqg import WeightedLQG
from agents.controllers.phase_law import PhaseLaw
from agents.controllers.predictive_control import predictive_control
from agents.controllers.registry import read_found
from agents.controllers.velocity_feedback import VelocityFeedback
from agents.evaluation.rigs import DELAY, _filters, compare, late, time_of_action
from agents.report.pages import markdown
from mm_gym import MovingMassVectorEnv, load_scene

SHAKEN = CARRIAGE_FORCE.replace(excitation=HYBRID.excitation)
LAWS = {
    "feed-forward": (SHAKEN, FeedforwardLQR),
    "finite horizon": (CARRIAGE_FORCE, FiniteHorizonLQR),
    "extremum seeking": (PRE_STRETCH, ExtremumSeeking),
}


@pytest.mark.parametrize("name", [*LAWS, "predictive"])
def test_hidden_state_does_not_change_what_claims_the_observation(name) -> None:
    if name == "predictive":
        scene = late(PRE_STRETCH)
        controller = predictive_control(scene, PhaseLaw(scene))
    else:
        scene, make = LAWS[name]
        scene = late(scene)
        controller = Feedback(scene, make(scene))
    env = MovingMassVectorEnv(scene, 2)
    assert controller.reads == "observation"
    actions = []
    for scrambled in (False, True):
        observation, info = env.reset(seed=5)
        memory = controller.begin(env)
        for _ in range(6):
            known = {key: np.full_like(info[key], np.nan) for key in info} if scrambled else info
            action, memory = controller.act(memory, observation, known)
            actions.append(action)
            observation, *_, info = env.step(action)
    np.testing.assert_array_equal(actions[:6], actions[6:])


def test_sensors_are_late_and_all_but_the_actuators_own_are_noisy() -> None:
    shown = late(HYBRID)
    assert shown.sensors.delay == DELAY
    assert shown.sensors.noise["sphere_offset"] == pytest.approx(1e-4)  # of 10 mm
    assert shown.sensors.noise["ground_acceleration"] == HYBRID.sensors.noise["ground_acceleration"]
    assert "stretch" not in shown.sensors.noise


def test_law_is_scored_on_the_late_sensors_and_on_the_true_state() -> None:
    scene = CARRIAGE_FORCE.replace(**{"control.steps": 40})
    ((name, seen, known),) = compare(scene, [Feedback(scene, VelocityFeedback(scene, 5.0))])[:1]
    assert name == "velocity feedback, 5 N s/m"
    assert seen != known
    assert seen == pytest.approx(known, rel=0.1)


def test_time_of_an_action_is_that_of_one_lane() -> None:
    scene = CARRIAGE_FORCE
    quick = time_of_action(scene, Feedback(scene, VelocityFeedback(scene, 5.0)))
    planned = time_of_action(scene, predictive_control(scene, VelocityFeedback(scene, 5.0)))
    assert 0.0 < 5.0 * quick < planned


def test_rows_of_a_task_are_replaced_and_the_others_stay() -> None:
    rows = [["`mm_gym/PreStretch-v0`", "a", "1", "2"], ["`mm_gym/Hybrid-v0`", "b", "3", "4"]]
    text = "before\n\n" + markdown(LATE, rows[:1]) + "\n\nafter\n"
    text = with_rows(text, LATE, "mm_gym/Hybrid-v0", [["b", "5", "6"]])
    text = with_rows(text, LATE, "mm_gym/Hybrid-v0", [["b", "3", "4"]])
    assert text == "before\n\n" + markdown(LATE, rows[::-1]) + "\n\nafter\n"


def test_controllers_with_a_filter_have_the_numbers_of_the_task() -> None:
    scene = load_scene("mm_gym/ActiveMassDamper-v0")
    filters = _filters(scene)
    assert list(filters) == ["LQG", "detuned LQG", WeightedLQG.name, "H-infinity"]
    found = read_found()["mm_gym/ActiveMassDamper-v0"].controllers["weighted-lqg"].numbers
    assert filters[WeightedLQG.name](late(scene)).numbers == found


def test_predictive_control_costs_more_from_the_observation_than_from_the_true_state() -> None:
    text = Path(PAGE).read_text("utf-8")
    rows = re.findall(r"\| predictive control, .*? \| (\S+) \| (\S+) \|", text)
    assert len(rows) == len(TASKS)
    assert all(float(seen) >= float(known) for seen, known in rows)


def test_page_has_both_tables_for_every_task_and_says_where_predictive_control_is_late() -> None:
    text = Path(PAGE).read_text("utf-8")
    for header in (LATE, RATES):
        table = text.partition(markdown(header, []))[2].partition("\n\n")[0]
        assert list(dict.fromkeys(re.findall(r"^\| `(.*?)`", table, re.MULTILINE))) == list(TASKS)
    ratios = zip(TASKS, re.findall(r"(\S+) \|$", table, re.MULTILINE), strict=True)
    late = [task[len("mm_gym/") : -len("-v0")] for task, ratio in ratios if float(ratio) <= 1.0]
    told = re.findall(r"On (\S+(?: and \S+)*) one core is too slow for real time", text)
    assert told == [" and ".join(late)]
