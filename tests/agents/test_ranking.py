"""Is docs/ranking.md what the scores say, and is every unexpected order told and explained?"""

import json
import re
import sys

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, TASKS

from agents.commands import ranking
from agents.evaluation.headroom import EPISODES, SCORES, least_cost, passive_rows
from agents.policies import network
from agents.report.pages import printed
from agents.report.published import read_published
from agents.report.score_pages import COLUMNS, NO_BETTER, surprises
from agents.report.score_pages import RANKING as PAGE
from agents.report.score_pages import ranking_page as page
from agents.training.config import short_name
from mm_gym.metrics import passive_scene

COMMITTED = json.loads(SCORES.read_text("utf-8"))
FORCE = "mm_gym/CarriageForce-v0"


def row(role, controller, cost):
    ends = {"low": cost, "high": cost, "displacement": cost}
    return {"role": role, "controller": controller, "reads": "observation", "cost": cost, **ends}


def test_committed_page_is_up_to_date():
    assert PAGE.read_text("utf-8") == page(COMMITTED), "run `python -m agents ranking`"


def test_controllers_page_explains_unexpected_orders_of_every_task_that_has_some():
    text = (PAGE.with_name("controllers.md")).read_text("utf-8")
    explained = text.partition("\n## Unexpected orders\n")[2].partition("\n## ")[0]
    surprising = [short_name(task) for task in TASKS if surprises(COMMITTED[task]["rows"])]
    assert surprising
    assert [task for task in surprising if f"**{task}**" not in explained] == []


ORDERED = [
    row("zero", "zero action", 1.0),
    row("constant", "constant force", 1.0),
    row("passive", "best passive damper", 0.95),
    row("law", "LQR", 0.5),
    row("law", "velocity feedback", 0.6),
    row("predictive", "predictive control", 0.4),
    row("informed", "informed", 0.35),
    row("planner", "planner", 0.3),
]


@pytest.mark.parametrize(
    ("name", "cost", "told"),
    [
        ("LQR", 1.1, f"LQR is {NO_BETTER}."),
        ("velocity feedback", 0.45, "Velocity feedback costs less than LQR."),
        ("LQR", 0.38, "LQR costs less than predictive control."),
        ("predictive control", 0.33, "Predictive control costs less than informed."),
        ("predictive control", 0.25, "Predictive control costs less than planner."),
        ("best passive damper", 0.45, "Best passive damper costs less than LQR."),
        ("best passive damper", 1.2, f"Best passive damper is {NO_BETTER}."),
    ],
)
def test_an_unexpected_order_is_told(name, cost, told):
    assert surprises(ORDERED) == []
    changed = [one | {"cost": cost} if one["controller"] == name else one for one in ORDERED]
    assert told in surprises(changed)


def test_a_tie_is_no_surprise():
    tie = [*ORDERED, row("law", "velocity feedback, as good", 0.4999)]
    assert surprises(tie) == []


def test_an_unexpected_order_stands_under_its_table():
    rows = [*ORDERED[:4], row("law", "velocity feedback, 3 N s/m", 0.4), *ORDERED[6:]]
    text = page({FORCE: {"rows": rows}})
    assert "\n\n- Velocity feedback, 3 N s/m costs less than LQR.\n" in text


def test_the_best_known_is_of_the_tasks_own_plant():
    rows = [*ORDERED, row("passive", "strong damper", 0.1)]
    assert least_cost(rows) == 0.3


def test_the_summary_has_a_column_for_every_kind():
    head = next(line for line in PAGE.read_text("utf-8").splitlines() if line.startswith("| task"))
    assert head == f"| task | {' | '.join(COLUMNS)} | best found |"
    text = page({FORCE: {"rows": ORDERED}})
    assert f"| `{FORCE}` | 1 | 1 | 0.95 | 0.4 | 0.4 | - | 0.3 |" in text


def test_the_passive_damper_is_that_of_the_tuning():
    (found,) = passive_rows(CARRIAGE_FORCE)
    passive, stretch = passive_scene(CARRIAGE_FORCE)
    assert stretch is None
    assert found["controller"] == f"best passive damper, {passive.interface.damping:.2g} N s/m"
    committed = next(one for one in COMMITTED[FORCE]["rows"] if one["role"] == "passive")
    assert found["cost"] == pytest.approx(committed["cost"], rel=1e-5)
    assert passive_rows(TASKS["mm_gym/CarriageForceFriction-v0"]) == []


def test_a_controller_takes_the_place_of_its_earlier_score_whatever_was_tuned():
    stale = [row("law", "velocity feedback, 1.2e+04 N s/m", 0.4), row("law", "LQR", 0.5)]
    rows = [*ORDERED[:2], *stale]
    ((task, found),) = ranking.of_controllers(["velocity-feedback"], [FORCE])
    assert task == FORCE
    ranking.put(rows, found)
    _, _, kept, new = rows
    assert kept["controller"] == "LQR"
    assert new["controller"] == "velocity feedback, 5.8 N s/m"


def test_a_run_is_scored_and_takes_the_place_of_its_earlier_score(tmp_path, monkeypatch, capsys):
    folder = tmp_path / "ppo-1"
    folder.mkdir()
    record = {"settings": {"task": FORCE}, "scene_digest": CARRIAGE_FORCE.digest}
    record["scene"] = json.loads(CARRIAGE_FORCE.model_dump_json())
    (folder / "run.json").write_text(json.dumps(record))
    scores, page_file = tmp_path / "scores.json", tmp_path / "ranking.md"
    scores.write_text(SCORES.read_text("utf-8"))
    monkeypatch.setattr(ranking, "SCORES", scores)
    monkeypatch.setattr(ranking, "RANKING", page_file)
    monkeypatch.setattr(ranking, "TASKS", tmp_path / "tasks.md")
    monkeypatch.setattr(sys, "argv", ["ranking", str(folder)])
    told = "training is not finished, or policy.safetensors is missing; the command that began it"
    assert told in str(ranking.main())
    for gain in (1.0, 1.5):
        policy_of(gain).save(folder / "policy.safetensors")
        assert ranking.main() is None
        rows = json.loads(scores.read_text())[FORCE]["rows"]
        assert [one["role"] for one in rows if one["controller"] == "ppo-1"] == ["learned"]
    assert EPISODES == 100
    assert re.search(r"\| ppo-1 \| observation \| 0\.0\d+ \|", page_file.read_text())
    assert "written:" in capsys.readouterr().out
    other = CARRIAGE_FORCE.replace(**{"control.steps": 7})
    record |= {"scene": json.loads(other.model_dump_json()), "scene_digest": other.digest}
    (folder / "run.json").write_text(json.dumps(record))
    assert f"trained on {FORCE}, as it was; allowed: a run of the scene of a task" in str(
        ranking.main()
    )


def test_published_policies_have_the_same_cost_in_the_ranking():
    published = [one for one in read_published().rows if one.file and one.task in COMMITTED]
    assert published
    for one in published:
        rows = COMMITTED[one.task]["rows"]
        (found,) = [row for row in rows if row["controller"] == one.agent]
        assert printed(found["cost"]) == printed(one.cost), one.name


def test_published_policies_that_the_scores_have_are_not_scored_again(monkeypatch):
    assert list(ranking.of_published(COMMITTED)) == []
    first = next(one for one in read_published().rows if one.base and one.task == FORCE)
    scores = {FORCE: {"scene_digest": first.scene_digest, "rows": COMMITTED[FORCE]["rows"]}}
    others = [one for one in scores[FORCE]["rows"] if one["controller"] != first.agent]
    for shift, told in ((0.0, first.cost), (2e-4, first.cost), (2e-3, None)):
        score = row("learned", first.agent, first.cost * (1.0 + shift))
        monkeypatch.setattr(ranking, "scored", lambda *_, score=score: score)
        ((task, found),) = ranking.of_published({FORCE: {**scores[FORCE], "rows": others}})
        assert task == FORCE
        assert found["cost"] == pytest.approx(told or score["cost"], rel=1e-5)
        assert list(ranking.of_published({FORCE: {**scores[FORCE], "rows": [*others, found]}})) == (
            [] if told else [(FORCE, score)]
        )


def test_named_controllers_are_scored_and_nothing_else(tmp_path, monkeypatch, capsys):
    scores = tmp_path / "scores.json"
    before = json.loads(SCORES.read_text("utf-8"))
    rows = before[FORCE]["rows"]
    rows[:] = [one | {"cost": 9.0} if one["controller"] == "LQR" else one for one in rows]
    scores.write_text(json.dumps(before))
    monkeypatch.setattr(ranking, "SCORES", scores)
    monkeypatch.setattr(ranking, "RANKING", tmp_path / "ranking.md")
    monkeypatch.setattr(ranking, "TASKS", tmp_path / "tasks.md")
    words = ["ranking", "--controllers", "lqr", "--tasks", "CarriageForce"]
    monkeypatch.setattr(sys, "argv", words)
    assert ranking.main() is None
    after = json.loads(scores.read_text())
    (found,) = [one for one in after[FORCE]["rows"] if one["controller"] == "LQR"]
    (known,) = [one for one in COMMITTED[FORCE]["rows"] if one["controller"] == "LQR"]
    assert found["cost"] == pytest.approx(known["cost"], rel=1e-5)
    assert len(after[FORCE]["rows"]) == len(rows)
    assert {task: of for task, of in after.items() if task != FORCE} == {
        task: of for task, of in before.items() if task != FORCE
    }
    for name, told in (
        ("lqrr", "did you mean 'lqr'"),
        ("no-control", "a controller of some"),
        ("clipped-lqr", "allowed: those that apply to mm_gym/CarriageForce-v0"),
    ):
        monkeypatch.setattr(sys, "argv", [*words[:2], name, *words[3:]])
        assert told in str(ranking.main())
    assert "LQR: 0.0483" in capsys.readouterr().out


def test_scores_that_another_process_writes_meanwhile_stay(tmp_path, monkeypatch):
    scores = tmp_path / "scores.json"
    scores.write_text(json.dumps(COMMITTED))
    monkeypatch.setattr(ranking, "SCORES", scores)
    monkeypatch.setattr(ranking, "RANKING", tmp_path / "ranking.md")
    monkeypatch.setattr(ranking, "TASKS", tmp_path / "tasks.md")

    def long(role, *_):
        now = json.loads(scores.read_text())
        now[FORCE]["rows"].append(row("learned", "of another process", 0.5))
        scores.write_text(json.dumps(now))
        return row(role, "LQR", 0.25)

    monkeypatch.setattr(ranking, "scored", long)
    words = ["ranking", "--controllers", "lqr", "--tasks", "CarriageForce"]
    monkeypatch.setattr(sys, "argv", words)
    assert ranking.main() is None
    rows = json.loads(scores.read_text())[FORCE]["rows"]
    costs = {one["controller"]: one["cost"] for one in rows}
    assert (costs["LQR"], costs["of another process"]) == (0.25, 0.5)


def test_a_controller_that_cannot_be_designed_is_named_and_others_go_on(
    tmp_path, monkeypatch, capsys
):
    scores = tmp_path / "scores.json"
    scores.write_text(SCORES.read_text("utf-8"))
    monkeypatch.setattr(ranking, "SCORES", scores)
    monkeypatch.setattr(ranking, "RANKING", tmp_path / "ranking.md")
    monkeypatch.setattr(ranking, "TASKS", tmp_path / "tasks.md")
    words = ["ranking", "--controllers", "lqg", "--tasks", "CarriageForceFriction"]
    monkeypatch.setattr(sys, "argv", words)
    assert ranking.main() is None
    assert json.loads(scores.read_text()) == COMMITTED
    told = capsys.readouterr().out  # rounding decides whether the solver or its poles show it
    assert re.search(r"lqg: not scored: the regulator.* has no stabilising solution", told)


def policy_of(gain):
    ends = np.array([1.0], np.float32)
    weight = np.array([[0.0, 0.0, -gain, 0.0]], np.float32)
    return network((weight,), (np.zeros(1, np.float32),), "tanh", -ends, ends)
