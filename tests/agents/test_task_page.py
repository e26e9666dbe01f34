"""Is docs/tasks.md what classes, scenes and scores say now?"""

import json

import pytest
from tasks import CARRIAGE_FORCE, HYBRID

from agents.evaluation.headroom import SCORES
from agents.report.score_pages import TASKS as PAGE
from agents.report.score_pages import about, describe
from agents.report.score_pages import tasks_page as page
from mm_gym.tasks import ids


def test_committed_page_is_up_to_date():
    expected = page(json.loads(SCORES.read_text("utf-8")))
    assert PAGE.read_text("utf-8") == expected, "run `python -m agents ranking`"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", ""),
        ("control.steps = 7\n", ""),
        ("# mm_gym/X-v0\n", ""),
        ("#:schema x\n\n# mm_gym/X-v0: a task.\n# More.\n", "A task. "),
    ],
)
def test_a_task_file_need_not_say_what_it_is(tmp_path, text, told):
    (tmp_path / "x.toml").write_text(text)
    assert about(tmp_path / "x.toml") == told


def test_every_task_has_a_section():
    text = PAGE.read_text("utf-8")
    for name in ids():
        assert f"\n## {name}\n" in text


def test_limits_noise_and_delay_are_told():
    scene = HYBRID.replace(
        **{
            "sensors.delay": 2,
            "objective.displacement_limit": 0.02,
            "objective.rail_half_length": 0.05,
            "actuation.force.lag": 0.015,
        }
    )
    text = describe(scene)
    assert "2 control steps late" in text
    assert "Terminates when |x1| exceeds 0.02 m or |x2 - x1| exceeds 0.05 m." in text
    assert "| force on the carriage | N | -0.25 | 0.25 | the most | none | 0.015 s |" in text
    assert "| ground_acceleration | m/s^2 | 0 | 9 | 0.1 |" in text
    assert "rms 3 m/s^2" in text


@pytest.mark.parametrize("weight", [0.0, 1.0, 0.5])
def test_reward_names_every_weighted_term(weight):
    text = describe(CARRIAGE_FORCE.replace(**{"objective.stroke_weight": weight}))
    term = {0.0: "", 1.0: " + ((x2 - x1) / 0.02 m)^2", 0.5: " + 0.5 ((x2 - x1) / 0.02 m)^2"}
    rest = f"(v1 / 0.5 m/s)^2{term[weight]} + 0.01 (sum of squared actions))"
    assert f"-((x1 / 0.01 m)^2 + 0.1 {rest}" in text
