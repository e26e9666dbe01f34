"""Controllers over a distribution of rigs, and the page of them."""

import json
import re
from contextlib import nullcontext

import numpy as np
import pytest
from trainings import controller, training

from agents.__main__ import main
from agents.commands import robustness
from agents.control.actuators import Actuators
from agents.control.observed_state import ObservedState
from agents.control.scene import drawn_but
from agents.control.trajectories import Trajectories
from agents.controllers.learned import Learned
from agents.controllers.lqr import LaggingLQR
from agents.evaluation import rigs
from agents.evaluation.changed_scenes import variants
from agents.evaluation.plans import Effort
from agents.evaluation.rigs import DELAYS, read_robustness, rigs_of, scores_of, task_of
from agents.evolution.search import EvolveSettings
from agents.report.published import published_agents, read_published
from agents.report.score_pages import ROBUSTNESS as PAGE
from agents.report.score_pages import robustness_page as page
from agents.scoring import validation_cost
from agents.sweeps.results import Results, read_results
from agents.training.starts import start_of
from mm_gym import DesignError, MovingMassVectorEnv, SceneError, load_scene
from mm_gym.tasks import robust_ids, short_name

VARIANT = "mm_gym/CarriageForceRobust-v0"

SCORES = read_robustness()


def test_scores_of_many_agents_can_be_read_again(tmp_path, monkeypatch):
    row = SCORES[VARIANT]["rows"][0]
    many = SCORES | {VARIANT: SCORES[VARIANT] | {"rows": [row] * 1000}}
    (tmp_path / "scores.json").write_text(json.dumps(many))
    monkeypatch.setattr(rigs, "FILE", tmp_path / "scores.json")
    assert read_robustness() == many


@pytest.mark.parametrize(
    "text", ["<<<<<<< HEAD", "{", "[]", '{"a": {}}', '{"a": {"scene_digest": "0", "rows": [{}]}}']
)
def test_damaged_scores_are_named(text, tmp_path, monkeypatch):
    (tmp_path / "scores.json").write_text(text)
    monkeypatch.setattr(rigs, "FILE", tmp_path / "scores.json")
    with pytest.raises(SceneError, match=re.escape(f"{tmp_path / 'scores.json'}: not ")):
        read_robustness()


def test_a_controller_is_told_the_middle_of_what_is_drawn():
    scene = load_scene(VARIANT)
    actuators, source = Actuators(scene), ObservedState(scene)
    assert actuators.lag_factor == pytest.approx(-np.expm1(-0.01 / 0.005))
    assert source.delays == range(1, 2)
    assert source.noise == pytest.approx(
        [scene.sensors.noise[name] for name in scene.sensors.channels]
    )


def test_sensors_that_show_the_motion_at_once_neither_err_nor_repeat_a_frame():
    scene = load_scene("mm_gym/CarriageForce-v0")
    bias = {"carriage_displacement": 0.01}
    worse = scene.replace(**{"sensors.dropout": 0.5, "sensors.bias": bias})
    assert rigs.at_once(worse) == rigs.at_once(scene)


@pytest.fixture
def quick(monkeypatch):
    """Make scores of few episodes, and plans of few steps."""
    monkeypatch.setattr(rigs, "EPISODES", 20)
    effort = Effort(random=1, first=3, second=3, rounds=1, steps=3, searches=0, last=3)
    monkeypatch.setattr(rigs, "PLANNED", effort)


@pytest.mark.usefixtures("quick")
def test_rows_are_of_the_rigs_and_of_the_task_with_each_delay():
    rows = scores_of(VARIANT, {})
    roles = ["zero", "constant", "controller", "predictive", "planner"]
    assert list(dict.fromkeys(row["role"] for row in rows)) == roles
    scenes = rigs_of(VARIANT)
    assert scenes["late 0"] == load_scene(task_of(VARIANT))
    zero, (predictive, planner) = rows[0], rows[-2:]
    for row in rows:
        assert row["low"] < row["rigs"] < row["high"] < row["worst"]
        assert ("late 0" in row) == (row not in (predictive, planner))
    # A plan is no worse than what it starts from.
    assert planner["rigs"] < min(row["rigs"] for row in rows[:-1])
    # Without control the delay changes nothing.
    assert zero["late 0"] == zero["late 2"]
    # The Kalman filter that is told one step of delay does best with it.
    lqg, lqr, lagging = (
        next(row for row in rows if row["controller"] == name)
        for name in ("LQG", "LQR", LaggingLQR.name)
    )
    assert lqg["late 1"] < min(lqg["late 0"], lqg["late 2"])
    # What finds the delay loses little by it.
    assert lagging["rigs"] < lqr["rigs"] < min(lqg["rigs"], zero["rigs"])
    assert max(lqr[f"late {n}"] for n in DELAYS) < 1.1 * lqr["late 0"]


def test_rows_of_controllers_stay_and_those_of_agents_are_made_anew():
    rows = [{"role": role, "controller": role} for role in ("controller", "planner", "specialist")]
    assert scores_of(VARIANT, {}, rows) == rows[:2]


def test_agents_are_the_published_policies_of_the_task_and_of_the_variant():
    tasks = {task_of(VARIANT), VARIANT}
    rows = [row for row in read_published().rows if row.task in tasks]
    assert [row for row, *_ in published_agents(rows)] == rows
    assert {row.task for row in rows} == tasks


@pytest.mark.parametrize("name", ["PreStretchShockRobust", "PreStretchNoiseRobust"])
def test_search_on_a_variant_begins_as_a_filter_that_switches_no_more_than_is_known(name):
    variant = f"mm_gym/{name}-v0"
    scene = load_scene(variant)
    start, other = (
        start_of(scene, EvolveSettings(task=task), np.random.default_rng(0))
        for task in (variant, task_of(variant))
    )
    cost, plain = (validation_cost(scene, Learned(one.policy())) for one in (start, other))
    assert start.law == "switching"
    assert len(start.units) == 1
    assert len(start.keep) > len(other.keep)
    assert cost < 1.01 * plain  # which is no control under noise


@pytest.mark.usefixtures("quick")
def test_the_page_is_that_of_its_scores(monkeypatch, tmp_path, capsys):
    assert PAGE.read_text("utf-8") == page(SCORES, read_results())
    for name in ("FILE", "ROBUSTNESS"):
        monkeypatch.setattr(robustness, name, tmp_path / name)
    monkeypatch.setattr("sys.argv", ["agents", "robustness", "CarriageForceRobust"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code is None
    assert f"## {VARIANT}" in (tmp_path / "ROBUSTNESS").read_text("utf-8")
    monkeypatch.setattr("sys.argv", ["agents", "robustness", "CarriageForce"])
    with pytest.raises(SystemExit):
        main()
    assert (
        "tasks: got 'CarriageForce'; did you mean 'CarriageForceRobust'?" in capsys.readouterr().err
    )


def test_scores_that_another_process_writes_meanwhile_stay(monkeypatch, tmp_path):
    file, other = tmp_path / "scores.json", "mm_gym/HybridRobust-v0"
    file.write_text(json.dumps({VARIANT: SCORES[VARIANT], other: SCORES[other]}))
    monkeypatch.setattr("agents.evaluation.rigs.FILE", file)
    monkeypatch.setattr(robustness, "FILE", file)
    monkeypatch.setattr(robustness, "ROBUSTNESS", tmp_path / "page.md")

    def long(*_):
        now = json.loads(file.read_text())
        now[other]["episodes"] = 7
        file.write_text(json.dumps(now))
        return SCORES[VARIANT]["rows"][:3]

    monkeypatch.setattr(robustness, "scores_of", long)
    monkeypatch.setattr("sys.argv", ["robustness", "CarriageForceRobust"])
    assert robustness.main() is None
    found = json.loads(file.read_text())
    assert found[other]["episodes"] == 7
    assert found[VARIANT]["rows"] == SCORES[VARIANT]["rows"][:3]


@pytest.mark.parametrize(
    ("factors", "said"),
    [
        ((0.8, 0.81, 0.82), "cost less than the best controller by more than the 95 % interval."),
        ((0.8, 0.98, 1.1), "they cost less, by less than the interval."),
        ((0.8,), "one seed alone was trained; it costs less."),
        ((1.1, 1.2, 1.3), "they cost no less."),
    ],
)
def test_the_page_compares_all_seeds_with_the_best_controller(factors, said):
    episodes = np.linspace(0.1, 1.0, 100)
    shared = {"task": VARIANT, "scene_digest": load_scene(VARIANT).digest}
    rows = [training(episodes * factor, seed, **shared) for seed, factor in enumerate(factors)]
    best = controller(episodes).model_copy(update=shared)
    found = page({VARIANT: SCORES[VARIANT]}, Results(controllers=[best], trainings=rows))
    (line,) = [line for line in found.splitlines() if line.endswith(said)]
    assert line.startswith(f"On {short_name(VARIANT)} ")
    assert f"| `{short_name(VARIANT)}` | evolution | {len(factors)} | " in found


def test_scores_are_of_the_present_variants():
    assert list(SCORES) == [name for name in robust_ids() if name in SCORES]
    for name, found in SCORES.items():
        assert found["scene_digest"] == load_scene(name).digest, (
            f"python -m agents robustness {name}"
        )


@pytest.mark.parametrize("variant", robust_ids())
def test_there_are_plans_where_they_are_not_refused(variant):
    scene = load_scene(variant)
    env = MovingMassVectorEnv(scene, 2)
    env.reset(seed=0)
    refused = pytest.raises(DesignError, match="no lag of an actuator that is commanded by its")
    planned = {row["role"] for row in SCORES[variant]["rows"]} & {"planner"}
    with nullcontext() if planned else refused:
        Trajectories(scene, env.plant, env.get_state())
    assert bool(planned) == (short_name(variant) != "HybridRobust")


def test_studies_replace_what_is_drawn():
    found = variants(load_scene(VARIANT))
    for (study, level), scene in found.items():
        if study.startswith("delay"):
            assert "sensors.delay" not in scene.randomization
            assert scene.sensors.delay == level
    assert drawn_but(load_scene(VARIANT), "sensors.", "actuation.").keys() == {
        *("carriage.mass", "carriage.stiffness", "carriage.damping"),
        *("sphere.mass", "interface.damping"),
    }
