"""Do laws whose numbers change act as designs with these numbers, and is that worth something?"""

from dataclasses import replace

import numpy as np
import pytest
from tasks import TASKS

from agents.commands import export
from agents.control.feedback import Feedback
from agents.controllers.adjustable import Scheduled
from agents.controllers.inertial_drive import INERTIAL_DRIVE, OF_DESIGN
from agents.controllers.predictive_control import (
    ROLLOUTS,
    RolloutPredictiveControl,
    predictive_control,
)
from agents.evolution.search import Evolution, EvolveSettings, evolve
from agents.policies import network
from agents.scoring import VALIDATION_SEED, evaluate, validation_cost
from agents.training.parts import agent_of, make_parts, recorded_parts
from agents.training.runs import Run
from mm_gym import SceneError

SCENE = TASKS["mm_gym/CarriageForceFriction-v0"]
LAW = INERTIAL_DRIVE.best(SCENE).law
SHORT = SCENE.replace(**{"control.steps": 60})


def settings(**fields):
    given = {"base": "inertial-drive", "schedules": True, "name": "tiny"} | fields
    small = {"candidates": 6, "episodes": 4, "generations": 3, "hidden": 2}
    return EvolveSettings(task="mm_gym/CarriageForceFriction-v0", **small | given)


def test_each_lane_acts_as_the_design_with_its_numbers():
    coordinates = np.random.default_rng(0).standard_normal((5, len(LAW.free)))
    together = evaluate(SHORT, Feedback(SHORT, LAW.at(coordinates)), episodes=5)
    assert LAW.numbers == INERTIAL_DRIVE.numbers(SCENE)  # they are not changed in place
    order = [name for name in INERTIAL_DRIVE.free(SCENE) if name not in OF_DESIGN]
    assert list(LAW.free) == order
    for lane, own in enumerate(coordinates):
        every = {
            **dict.fromkeys(INERTIAL_DRIVE.free(SCENE), 0.0),
            **dict(zip(order, own, strict=True)),
        }
        numbers = INERTIAL_DRIVE.at(SCENE, list(every.values()), LAW.numbers)
        alone = evaluate(SHORT, INERTIAL_DRIVE.design(SHORT, numbers), episodes=5)
        np.testing.assert_allclose(
            together.penalties[lane], alone.penalties[lane], rtol=1e-9, atol=0.0
        )


def test_a_mirrored_state_is_the_same_situation():
    state = np.random.default_rng(1).standard_normal((40, 4)) * [0.01, 0.01, 0.2, 0.2]
    memory, mirrored = LAW.begin(40), LAW.begin(40)
    for _ in range(3):
        seen = LAW.situation(memory, state)
        assert seen.shape == (40, LAW.inputs)
        np.testing.assert_array_equal(seen, LAW.situation(mirrored, -state))
        _, memory = LAW.action(memory, state, np.zeros((40, 1)))
        _, mirrored = LAW.action(mirrored, -state, np.zeros((40, 1)))
        state = 0.5 * state


def test_rollouts_cost_less_than_their_law_and_less_with_a_longer_look_ahead():
    controller = predictive_control(SCENE, LAW)
    assert isinstance(controller.law, RolloutPredictiveControl)
    few = {"episodes": 20, "seed": VALIDATION_SEED}
    blind = RolloutPredictiveControl(SCENE, LAW, replace(ROLLOUTS, horizon=3))
    of_law, planned, short = (
        evaluate(SCENE, one, **few).cost
        for one in (Feedback(SCENE, LAW), controller, Feedback(SCENE, blind))
    )
    # 0.161, 0.149 and more: what numbers of each step are worth here.
    assert planned < 0.95 * of_law
    assert planned < short


def test_rollouts_always_try_the_laws_own_numbers():
    search = replace(ROLLOUTS, spread=1e-12, least_spread=0.0, horizon=40, plans=4)
    law = RolloutPredictiveControl(SHORT, LAW, search)
    state, applied = np.array([[0.0, 0.015, 0.0, 0.0]]), np.zeros((1, 1))
    begun = law.begin(1)
    begun["plan"][:] = -4.0  # numbers that lead nowhere
    action, after = law.action(begun, state, applied)
    np.testing.assert_allclose(after["plan"], 0.0, atol=1e-9)
    np.testing.assert_allclose(action, np.clip(LAW.action(LAW.begin(1), state, applied)[0], -1, 1))


def test_rollouts_that_try_nothing_else_are_the_law():
    still = replace(ROLLOUTS, spread=1e-12, least_spread=0.0, horizon=2, plans=6)
    both = RolloutPredictiveControl(SHORT, LAW, still), LAW
    planned, of_law = (evaluate(SHORT, Feedback(SHORT, law), episodes=4) for law in both)
    np.testing.assert_allclose(planned.penalties, of_law.penalties, rtol=1e-6)


def constant(actions):
    """Return a policy that always gives these actions (d,)."""
    d = len(actions)
    weights = np.zeros((1, LAW.inputs)), np.zeros((d, 1))
    return network(weights, (np.zeros(1), actions), "tanh", -np.ones(d), np.ones(d))


def test_schedule_of_one_action_is_the_design_with_these_numbers():
    actions = np.linspace(-0.8, 0.8, len(LAW.free))
    law = Scheduled(LAW, constant(np.float32(actions)), 1.5, "schedule")
    moved = LAW.at(np.tile(1.5 * np.float32(actions).astype(np.float64), (4, 1)))
    both = (evaluate(SHORT, Feedback(SHORT, one), episodes=4).penalties for one in (law, moved))
    np.testing.assert_allclose(*both, rtol=1e-9)


def test_schedule_begins_as_its_base_and_costs_in_a_search_what_it_costs_in_an_evaluation():
    search = Evolution(settings(), SCENE)
    parts = make_parts(search.settings)
    assert search.began_as == "inertial drive"
    assert search._cost({"vector": search.first}) == pytest.approx(
        validation_cost(SCENE, parts.base), rel=1e-12
    )
    moved = search.first + 0.02 * np.random.default_rng(0).standard_normal(search.first.shape)
    learned = parts.controller(search._policy({"vector": moved}))
    # The kernel acts in single precision, and the drive switches.
    assert search._cost({"vector": moved}) == pytest.approx(
        validation_cost(SCENE, learned), rel=1e-3
    )


def test_run_of_a_schedule_is_scored_as_it_was_validated_and_says_what_an_export_lacks(
    tmp_path, monkeypatch, capsys
):
    run = Run("tiny", tmp_path)
    evolve(settings(candidates=12, episodes=24, generations=12, spread=0.1), run, bar=False)
    parts = recorded_parts(run.scene(), run.read(), trust=False)
    agent = agent_of(run, parts)
    assert isinstance(agent, Feedback)
    assert isinstance(agent.law, Scheduled)
    rows = run.metrics.read_text().splitlines()[1:]
    best = min(float(row.split(",")[1]) for row in rows)
    assert best < 0.999 * validation_cost(SCENE, parts.base)  # it has moved
    # The kernel acts in single precision, and the drive switches.
    assert validation_cost(SCENE, agent) == pytest.approx(best, rel=1e-3)
    words = ["export", str(run.folder), "--out", str(tmp_path / "out.safetensors")]
    monkeypatch.setattr("sys.argv", words)
    assert export.main() is None
    assert capsys.readouterr().out == f"written: {words[-1]}\n"
    late = Run("late", tmp_path)  # what is late is estimated by the scene's model
    late.open(settings(changes={"sensors.delay": 1}))
    constant(np.zeros(len(LAW.free))).save(late.policy)
    words[1] = str(late.folder)
    assert export.main() is None
    told = capsys.readouterr().out
    numbers = recorded_parts(late.scene(), late.read(), trust=False).scheduled.numbers
    assert "actions set numbers of the controller inertial-drive" in told
    assert f"lead = {numbers['lead']:.6g} + 0.3 * action, within" in told
    assert f"push = {numbers['push']:.6g} * exp(0.5 * action)" in told
    small = constant(np.zeros(1))
    small.save(late.policy)
    assert (
        "got 5 observed numbers and 1 action; a schedule of the inertial drive has 5 and 12"
        in str(export.main()) + capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ("base", "got"), [(None, "no base"), ("none", "no base"), ("lqr", "base 'lqr'")]
)
def test_base_without_such_numbers_is_refused_by_name(base, got):
    with pytest.raises(SceneError, match=rf"schedules: got {got}; .* of inertial-drive can"):
        Evolution(settings(base=base), SCENE)


def test_search_around_no_base_of_that_name_is_refused():
    with pytest.raises(SceneError, match="base: got 'none'; allowed for this scene: "):
        Evolution(settings(base="none", schedules=False), SCENE)


def test_settings_that_schedule_nothing_are_written_as_before_there_were_schedules():
    assert "schedules" not in settings(schedules=False).model_dump()
    assert settings().model_dump()["schedules"] is True
