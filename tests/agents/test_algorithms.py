"""Do all algorithms train, continue bitwise, and leave policies that act as their models?"""

import json
import signal

import kills
import numpy as np
import pytest
import torch
from exported import in_c, in_numpy, in_onnx

from agents.evaluation.contestants import law_of
from agents.policies import PolicyError, load_policy
from agents.scoring import evaluate
from agents.training import reinforcement
from agents.training.algorithms import CLASSES, make_model, policy_of
from agents.training.config import TrainSettings
from agents.training.lanes import TrainingLanes, make_lanes
from agents.training.parts import make_parts
from agents.training.reinforcement import Reinforcement, train
from agents.training.runs import Run, RunError

ALGORITHMS = list(CLASSES)


def tiny(algorithm, **fields):
    own = {"hidden": (8,), "batch_size": 40, "reward_scale": 5.0}
    if "ppo" in algorithm:
        own |= {"rollout": 10, "epochs": 2}
    else:
        own |= {"learning_starts": 100, "buffer_size": 600, "gradient_steps": 1}
    data = {"task": "mm_gym/CarriageForce-v0", "name": "tiny", "lanes": 8, "steps": 800}
    data |= {"algorithm": algorithm, "evaluations": 4, "changes": {"control.steps": 40}}
    return TrainSettings(**(data | {algorithm: own} | fields))


def model_of(settings, folder):
    torch.set_num_threads(1)  # as `train` does
    lanes = reinforcement._normalised(settings, make_lanes(settings, make_parts(settings)))
    return make_model(settings, folder / "log", lanes)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_policy_and_its_exports_act_as_the_model_that_it_is_from(algorithm, tmp_path):
    model = model_of(tiny(algorithm, normalise_observations=True), tmp_path).learn(400)
    policy_of(model).save(tmp_path / "policy.safetensors")
    policy, generator = load_policy(tmp_path / "policy.safetensors"), np.random.default_rng(0)
    size, state, starts = model.observation_space.shape[0], None, np.ones(500, np.bool_)
    episodes, wanted = generator.standard_normal((500, 20, size)).astype(np.float32), []
    for observed in episodes.swapaxes(0, 1):
        shown = model.get_vec_normalize_env().normalize_obs(observed)
        want, state = model.predict(shown, state, starts, deterministic=True)
        starts[:] = False
        wanted.append(want)
    want = np.stack(wanted, axis=1)
    # The model computes in single precision: sums of products of order one round by 1e-7.
    for acted in (in_numpy(policy, episodes), in_c(policy, episodes, tmp_path)):
        np.testing.assert_allclose(acted, want, rtol=0.0, atol=1e-6)
    pytest.importorskip("onnxruntime")
    np.testing.assert_allclose(in_onnx(policy, episodes), want, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_agent_begins_as_the_law_that_it_is_added_to(algorithm, tmp_path):
    settings = tiny(algorithm, base="lqr", normalise_observations=True)
    parts = make_parts(settings)
    policy = policy_of(model_of(settings, tmp_path))
    agent = evaluate(parts.scene, parts.controller(policy), episodes=20)
    law = evaluate(parts.scene, parts.base, episodes=20)
    np.testing.assert_array_equal(agent.penalties, law.penalties)


def outcome(run):
    policy = load_policy(run.policy)
    metrics = np.loadtxt(run.metrics, delimiter=",", skiprows=1)
    return [metrics, *policy.arrays.values()]


def assert_same_outcome(run, other):
    for own, others in zip(outcome(run), outcome(other), strict=True):
        np.testing.assert_array_equal(own, others)


class Killed(Exception):  # noqa: N818 - not an error
    pass


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_killed_training_continues_bitwise(algorithm, tmp_path, monkeypatch):
    # Episodes end early and apart, so that lanes of the base are at different steps.
    changes = {"control.steps": 40, "objective.displacement_limit": 0.003}
    settings = tiny(
        algorithm, base="lqg", changes=changes, normalise_observations=True, normalise_rewards=True
    )
    whole, broken = Run("tiny", tmp_path / "whole"), Run("tiny", tmp_path / "broken")
    train(settings, whole, bar=False)
    validate = Reinforcement._validate

    def die(search, log):
        if search.rounds >= 600:
            raise Killed
        validate(search, log)

    with monkeypatch.context() as patch:
        patch.setattr(Reinforcement, "_validate", die)
        with pytest.raises(Killed):
            train(settings, broken, bar=False)
    assert not broken.finished
    train(settings, broken, bar=False)
    assert_same_outcome(broken, whole)


@pytest.mark.parametrize("wanted", [2, 10])
def test_off_policy_runs_killed_at_random_instants_end_as_if_uninterrupted(wanted, tmp_path):
    settings = tiny("sac", base="lqr", evaluations=8)
    whole, broken = Run("tiny", tmp_path / "whole"), Run("tiny", tmp_path / "broken")
    train(settings, whole, bar=False)
    draw, killed = np.random.default_rng(wanted), 0
    while not broken.finished:
        # Just before a file is touched, where most could go wrong.
        touches = int(draw.integers(8, 30)) if killed < wanted else None
        process = kills.begin_training(settings, tmp_path / "broken", touches)
        process.join()
        assert process.exitcode in {0, -signal.SIGKILL}
        killed += process.exitcode == -signal.SIGKILL
    assert killed == wanted
    assert_same_outcome(broken, whole)


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_of_an_off_policy_training_waits_for_the_step_and_loses_nothing(tmp_path):
    settings = tiny("sac", steps=600)
    whole, broken = Run("tiny", tmp_path / "whole"), Run("tiny", tmp_path / "broken")
    train(settings, whole, bar=False)
    step, left = TrainingLanes.step_wait, 37

    def interrupt(lanes):
        nonlocal left
        left -= 1
        if left == 0:
            signal.raise_signal(signal.SIGINT)
        return step(lanes)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TrainingLanes, "step_wait", interrupt)
        with pytest.raises(KeyboardInterrupt):
            train(settings, broken, bar=False)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    train(settings, broken, bar=False)
    assert_same_outcome(broken, whole)


def test_finished_run_goes_on_with_more_steps_and_keeps_its_first_policy(tmp_path):
    run, first = Run("tiny", tmp_path), tiny("sac", steps=400, evaluations=2)
    train(first, run, bar=False)
    policy, rows = run.policy.read_bytes(), run.metrics.read_text()
    train(first.model_copy(update={"steps": 800}), run, bar=False)
    assert run.finished
    assert run.metrics.read_text().startswith(rows)
    assert float(run.metrics.read_text().splitlines()[-1].split(",")[0]) == 800.0
    assert (run.folder / "policy-400.safetensors").read_bytes() == policy
    record = json.loads(run.record.read_text())
    assert record["settings"]["steps"] == 800
    assert [stage["steps"] for stage in record["earlier"]] == [400]
    with pytest.raises(RunError, match="other settings"):
        train(first, run, bar=False)  # fewer steps than it has


def test_policy_of_a_base_is_refused_without_it(tmp_path):
    settings = tiny("ppo", base="lqr")
    policy = policy_of(model_of(settings, tmp_path))
    parts = make_parts(settings.model_copy(update={"base": None}))
    with pytest.raises(PolicyError, match="got 5 observed numbers and 1 action; the scene has 4"):
        evaluate(parts.scene, parts.controller(policy), episodes=2)


def test_training_around_a_law_does_not_lose_it(tmp_path):
    settings = tiny("ppo", base="velocity-feedback", changes={}, steps=1600, evaluations=2)
    run = Run("tiny", tmp_path)
    train(settings, run, bar=False)
    parts = make_parts(settings)
    learned = evaluate(parts.scene, parts.controller(load_policy(run.policy)), episodes=50)
    named = law_of(str(run.folder), parts.scene, np.random.default_rng(0))
    assert evaluate(parts.scene, named, episodes=50).cost == learned.cost
    still = evaluate(parts.scene, make_parts(tiny("ppo", base="no-control")).base, episodes=50)
    # The law's cost is half of that without control; an agent of 1,600 steps stays close to it.
    assert learned.cost < 0.7 * still.cost


def test_training_without_a_bar_prints_nothing(tmp_path, capsys):
    train(tiny("ppo", steps=80, evaluations=1), Run("tiny", tmp_path), bar=False)
    assert capsys.readouterr() == ("", "")
