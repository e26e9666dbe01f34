"""Numbers that searches chose: a controller made with them is the one that was searched."""

import json
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, PRE_STRETCH

from agents.controllers import registry, searched
from agents.controllers.choices import recorded
from agents.controllers.registry import laws, once
from agents.evolution.search import EvolveSettings, evolve
from agents.scoring import validation_cost
from agents.training import search
from agents.training.config import TrainSettings
from agents.training.parts import Best, Parts, agent_of, trained_parts
from agents.training.progress import read_ending
from agents.training.reinforcement import train
from agents.training.runs import Run, RunError
from mm_gym import Scene, SceneError, load_scene

ROOT = Path(__file__).parents[2]
FORCE, SHORT = CARRIAGE_FORCE, CARRIAGE_FORCE.replace(**{"control.steps": 20})
STRETCH = PRE_STRETCH.replace(**{"control.steps": 20})
HYBRID = load_scene("mm_gym/Hybrid-v0").replace(**{"control.steps": 20})
LIMITED = SHORT.replace(**{"actuation.force.rate_limit": 100.0})


def _unused(*_: object) -> NoReturn:
    pytest.fail("a search was made")


@pytest.mark.parametrize(
    ("scene", "name"),
    [
        (SHORT, "velocity-feedback"),  # a value over decades
        (SHORT, "detuned-lqg"),  # one for each size of the unmodelled, and the best of them
        (SHORT, "predictive-lqg"),  # around another controller that is searched
        (LIMITED, "rate-limited-lqg"),  # three numbers together, then two alone
        (STRETCH, "clipped-lqr"),  # a pair
        (STRETCH, "weighted-clipped-lqr"),  # numbers of the file
        (HYBRID, "feedforward-lqr-and-clipped-lqr"),  # of another controller's search
    ],
)
def test_controller_is_made_again_without_its_search(
    scene: Scene, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, numbers = recorded(lambda: laws(scene)[name](scene))
    again, same = recorded(lambda: laws(scene)[name](scene))  # that which is remembered
    assert numbers
    assert list(same) == list(numbers)
    monkeypatch.setattr(searched, "least", _unused)
    monkeypatch.setattr(searched, "minimize_scalar", _unused)
    written = json.loads(json.dumps(list(numbers)))
    made, _ = recorded(lambda: laws(scene)[name](scene), written)
    assert made is not again
    cost = validation_cost(scene, first)
    assert validation_cost(scene, made) == cost
    others = [1.0 + number for number in written]
    if name != "detuned-lqg":  # whose last number is a place
        other, _ = recorded(lambda: laws(scene)[name](scene), others)
        assert validation_cost(scene, other) != cost


def test_numbers_that_are_not_of_the_controller_are_refused() -> None:
    make = lambda: laws(STRETCH)["clipped-lqr"](STRETCH)  # noqa: E731 - one of many calls
    for numbers, told in (
        ([2.0], "got too few numbers; allowed: as many as the controller chooses"),
        ([2.0, 0.1, 0.3], "got 3 numbers; allowed: 2"),
        ([2.5, 0.1], "got 2.5 as a place among 40; allowed: 0 to 39"),
        ([-1.0, 0.1], "got -1 as a place"),
        ([40.0, 0.1], "got 40 as a place"),
    ):
        with pytest.raises(SceneError, match=told) as error:
            recorded(make, numbers, "here.json")
        assert str(error.value).startswith("here.json: numbers: a searched controller: got")
        assert "delete its `numbers`" in str(error.value)


def test_tuned_numbers_outside_their_limits_are_refused() -> None:
    def make() -> searched.Controller:
        return laws(STRETCH)["weighted-clipped-lqr"](STRETCH)

    _, numbers = recorded(make)
    for place, number, told in (
        (0, 1e3, r"weighted-clipped-lqr\.stretch: got 1000; allowed: 1 to 3"),
        (1, -1.0, r"weighted-clipped-lqr\.force: got -1; allowed: 0 to inf"),
    ):
        wrong = [*numbers[:place], number, *numbers[place + 1 :]]
        with pytest.raises(SceneError, match=told):
            recorded(make, wrong)


def test_searches_within_a_search_leave_no_numbers() -> None:
    def inner(scene: Scene) -> searched.Feedback:
        return searched.searched(scene, lambda _: laws(scene)["lqr"](scene).law, np.zeros(3))

    _, numbers = recorded(
        lambda: searched.cheapest(SHORT, lambda _: once(inner, SHORT), np.arange(3.0))
    )
    assert len(numbers) == 2  # of the outer search, then of the controller that it returns


TASK = "mm_gym/CarriageForce-v0"
SMALL = {"candidates": 4, "episodes": 2, "generations": 1, "evaluations": 1, "hidden": 2}


def _evolve(folder: Path, **fields: object) -> Run:
    asked = {} if "scene" in fields else {"task": TASK, "base": "velocity-feedback"}
    settings = EvolveSettings.of({"name": "small", **asked, **SMALL, **fields})
    run = Run("small", folder)
    evolve(settings, run, bar=False)
    return run


def _unsearched(monkeypatch: pytest.MonkeyPatch) -> None:
    registry._once.cache_clear()
    monkeypatch.setattr(searched, "least", _unused)


def test_run_keeps_the_numbers_of_its_base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = _evolve(tmp_path)
    cost = validation_cost(FORCE, agent_of(run, trained_parts(run, trust=False)))
    _unsearched(monkeypatch)
    agent = agent_of(run, trained_parts(run, trust=False))
    assert validation_cost(FORCE, agent) == cost
    _evolve(tmp_path, generations=2)  # nor does the run search when it goes on
    record = run.read()
    assert len(record["numbers"]) == 1
    run.record.write_text(json.dumps(record | {"numbers": [0.5]}))
    other = agent_of(run, trained_parts(run, trust=False))
    assert validation_cost(FORCE, other) != cost


def test_training_that_is_continued_keeps_the_numbers_of_its_base(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ppo = {"batch_size": 100, "epochs": 1}
    small = {"name": "small", "lanes": 4, "steps": 400, "evaluations": 1, "ppo": ppo}
    settings = TrainSettings.of({"task": TASK, "base": "velocity-feedback", **small})
    run = Run("small", tmp_path)
    train(settings, run, bar=False)
    before = run.read()["numbers"]
    _unsearched(monkeypatch)
    train(settings.model_copy(update={"steps": 800}), run, bar=False)
    assert run.read()["numbers"] == before


def test_run_of_an_earlier_version_searches_its_base(tmp_path: Path) -> None:
    run = _evolve(tmp_path)
    cost = validation_cost(FORCE, agent_of(run, trained_parts(run, trust=False)))
    record = run.read()
    del record["numbers"]
    run.record.write_text(json.dumps(record))
    assert validation_cost(FORCE, agent_of(run, trained_parts(run, trust=False))) == cost


@pytest.mark.parametrize(
    ("numbers", "told"),
    [
        (["much"], "numbers.0: got 'much'"),
        ([float("nan")], "NaN"),
        ([], "got too few numbers"),
        ([0.1, 0.2], "got 2 numbers; allowed: 1"),
        ([400.0], "Numerical result out of range"),
    ],
)
def test_damaged_numbers_of_a_run_are_refused(
    tmp_path: Path, numbers: list[object], told: str
) -> None:
    run = _evolve(tmp_path)
    run.record.write_text(json.dumps(run.read() | {"numbers": numbers}))
    for load in (lambda: trained_parts(run, trust=False), lambda: _evolve(tmp_path, generations=2)):
        with pytest.raises((RunError, SceneError), match=told) as error:
            load()
        assert str(error.value).startswith(f"{run.record}: ")


def test_run_keeps_the_numbers_of_the_controller_that_it_returns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = tmp_path / "own.toml"
    scene.write_text((ROOT / "configs" / "scenes" / "carriage_force.toml").read_text())
    best = Best("velocity-feedback", 1e-3)
    monkeypatch.setattr(search, "best_controller", lambda _, **__: best)
    run = _evolve(tmp_path, scene=str(scene), law="none")
    ending, own = read_ending(run), run.scene()
    assert ending is not None
    assert ending.returned == best.name
    assert ending.numbers is not None
    cost = validation_cost(own, laws(own)[best.name](own))
    _unsearched(monkeypatch)
    assert validation_cost(own, agent_of(run, Parts(own))) == cost
    ending.numbers = [400.0]
    ending.write(run)
    with pytest.raises(SceneError, match=r"end\.json: numbers: Numerical"):
        agent_of(run, Parts(own))
