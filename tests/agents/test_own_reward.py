"""An own reward in every command that takes one: as the built-in objective, or refused by name."""

import json
import sys

import numpy as np
import pytest
from exported import policy_of
from tasks import CARRIAGE_FORCE, PRE_STRETCH, PRE_STRETCH_SHOCK

from agents.commands import evaluate as command
from agents.control.trajectories import Trajectories
from agents.controllers.constant import uncontrolled
from agents.controllers.lqr import LQR
from agents.controllers.newton_predictive_control import NewtonPredictiveControl
from agents.controllers.predictive_control import PredictiveControl, predictive_control
from agents.controllers.velocity_feedback import best_velocity_feedback
from agents.evaluation.contestants import Episodes as Compared
from agents.evaluation.contestants import law_of, read_field
from agents.evaluation.measurement import measure
from agents.evolution.search import EvolveSettings, evolve
from agents.gradient.descent import descend
from agents.gradient.settings import GradientSettings
from agents.policies import PolicyError, load_policy
from agents.scoring import evaluate
from agents.training.config import TrainSettings
from agents.training.reinforcement import train
from agents.training.runs import Run, RunError
from agents.value_iteration.iteration import IterateSettings, iterate
from mm_gym import DesignError, MovingMassVectorEnv, OwnReward, SceneError, compile_scene, rewarded

EXACT = {
    "objective": {"displacement_scale": 2.0**-7, "velocity_scale": 0.5},
    "control.steps": 40,
}
"""One square, over a power of two, which rounds nothing: an own cost is bitwise the same."""

SCENE = CARRIAGE_FORCE.replace(**EXACT)

TEXT = """
def cost(carriage_displacement):
    return (carriage_displacement * 128.0) ** 2
"""


def cost(carriage_displacement):
    return (carriage_displacement * 128.0) ** 2


OWN = OwnReward(cost)


@pytest.fixture
def reward(tmp_path):
    (tmp_path / "own.py").write_text(TEXT)
    return f"{tmp_path}/own.py:cost"


def test_episodes_whose_cost_may_fall_again_are_not_ended_for_it():
    scene, law = rewarded(SCENE, OWN), uncontrolled(SCENE)
    whole, ended = (evaluate(one, law, episodes=2, most=1e-6).penalties for one in (scene, SCENE))
    np.testing.assert_array_equal(whole, evaluate(SCENE, law, episodes=2).penalties)
    assert (ended < whole).all()


def test_evaluation_is_that_of_the_objective():
    law = best_velocity_feedback(SCENE)
    plain, own = evaluate(SCENE, law), evaluate(rewarded(SCENE, OWN), law)
    np.testing.assert_array_equal(own.penalties, plain.penalties)
    # Laws are tuned by it too.
    tuned = best_velocity_feedback(rewarded(SCENE, OWN))
    assert tuned.law.gain == law.law.gain


def settings(kind, **fields):
    return kind(**({"task": "mm_gym/CarriageForce-v0", "changes": EXACT} | fields))


TRAINING = {"steps": 160, "evaluations": 1, "lanes": 8}
TRAINING |= {"ppo": {"rollout": 10, "batch_size": 40, "hidden": (8,)}}
SEARCH = {"law": "none", "hidden": 4, "extra": 1, "evaluations": 2}


@pytest.mark.parametrize(
    ("run_it", "kind", "fields"),
    [
        (train, TrainSettings, TRAINING),
        (evolve, EvolveSettings, SEARCH | {"candidates": 6, "episodes": 4, "generations": 3}),
    ],
)
def test_training_is_that_of_the_objective(run_it, kind, fields, reward, tmp_path):
    plain, own = Run("plain", tmp_path), Run("own", tmp_path)
    run_it(settings(kind, name="plain", **fields), plain, bar=False)
    run_it(settings(kind, name="own", reward=reward, **fields), own, bar=False)
    assert own.metrics.read_bytes() == plain.metrics.read_bytes()
    before, after = load_policy(plain.policy), load_policy(own.policy)
    for one, other in zip(before.arrays.values(), after.arrays.values(), strict=True):
        np.testing.assert_array_equal(one, other)
    record = json.loads(own.record.read_text())
    assert record["code"] == {reward.rpartition(":")[0]: TEXT}
    assert record["scene_digest"] == SCENE.digest


def test_descent_is_that_of_the_objective(reward, tmp_path):
    fields = SEARCH | {"episodes": 4, "iterations": 3, "oscillators": 1}
    plain, own = Run("plain", tmp_path), Run("own", tmp_path)
    descend(settings(GradientSettings, name="plain", **fields), plain, bar=False)
    descend(settings(GradientSettings, name="own", reward=reward, **fields), own, bar=False)
    (_, before, _), (_, after, _) = plain.validations(), own.validations()
    # Slopes by differences have errors of 1e-9, of passes in single precision.
    np.testing.assert_allclose(after, before, rtol=1e-5)
    assert before[-1] != before[0]


def test_value_iteration_refuses_it_by_name(reward, tmp_path):
    with pytest.raises(DesignError, match=r"got .*own.py:cost; allowed for value iteration"):
        iterate(IterateSettings(name="own", reward=reward), Run("own", tmp_path), bar=False)
    assert not (tmp_path / "own" / "run.json").exists()


def test_predictive_control_plans_by_it():
    scene = SCENE.replace(**{"control.steps": 20})
    made = [PredictiveControl(one, LQR(CARRIAGE_FORCE)) for one in (scene, rewarded(scene, OWN))]
    plans = []
    for law in made:
        state = np.array([[0.01, 0.01, 0.0, 0.0], [0.0, 0.0, 0.2, 0.0], [0.005, 0.0, -0.1, 0.1]])
        plans.append(law.action(law.begin(3), state, np.zeros((3, 1)))[0])
    np.testing.assert_array_equal(*plans)


def pushed(disturbance_force):
    return disturbance_force**2


def test_predictive_control_refuses_what_its_model_does_not_show():
    scene = rewarded(PRE_STRETCH, OwnReward(pushed))
    with pytest.raises(DesignError, match="reads disturbance_force; the model of predictive"):
        predictive_control(scene, uncontrolled(scene).law)


def test_plans_by_squares_refuse_it_by_name():
    scene = rewarded(CARRIAGE_FORCE, OWN)
    with pytest.raises(DesignError, match="reward: got cost; allowed for plans by Gauss-Newton"):
        NewtonPredictiveControl(scene)
    env = MovingMassVectorEnv(scene, 2, autoreset_mode="Disabled")
    env.reset(seed=0)
    with pytest.raises(DesignError, match="allowed for plans by Gauss-Newton"):
        Trajectories(scene, compile_scene(scene), env.get_state())


def few(scene):
    """The baselines, but for those whose tuning takes long."""
    return [best_velocity_feedback(scene)], {}


def finished(tmp_path, reward):
    run = Run("own", tmp_path)
    train(settings(TrainSettings, name="own", reward=reward, **TRAINING), run, bar=False)
    return run


def test_loading_a_run_never_executes_its_reward(reward, tmp_path):
    run = finished(tmp_path, reward)
    (tmp_path / "own.py").write_text("raise SystemExit('executed')\n")
    assert law_of(str(run.folder), SCENE, np.random.default_rng(0)).name == str(run.folder)
    with pytest.raises(
        PolicyError,
        match=r"own.py:cost: scoring executes .*allow it with --trust",
    ):
        command.report_run(run, episodes=2)
    with pytest.raises(SceneError, match="SystemExit: executed"):
        command.report_run(run, episodes=2, trust=True)


def test_run_is_scored_by_the_reward_that_is_asked_for(reward, tmp_path, monkeypatch):
    run = finished(tmp_path, reward)
    monkeypatch.setattr(
        "agents.commands.evaluate.baselines", lambda scene: ([best_velocity_feedback(scene)], {})
    )
    (tmp_path / "four.py").write_text(TEXT.replace("128.0", "256.0"))
    mine = command.report_run(run, episodes=4, trust=True)
    four = command.report_run(run, episodes=4, reward=f"{tmp_path}/four.py:cost")
    for one, other in zip(mine, four, strict=True):
        np.testing.assert_array_equal(4.0 * one.penalties, other.penalties)


def test_comparison_is_by_the_reward(reward):
    names = ("lqr", "velocity-feedback")
    field = read_field(names, ("CarriageForce",), reward)
    (task,) = field.scenes
    assert field.scenes[task].own_reward.name == reward
    (result,) = measure(field, Compared(2, 4))
    lqr = evaluate(rewarded(CARRIAGE_FORCE, OWN), law_of("lqr", CARRIAGE_FORCE, None), episodes=8)
    row = result.labels.index("lqr")
    np.testing.assert_array_equal(result.sample.penalties[row].ravel(), lqr.penalties)


def test_run_of_an_own_reward_is_not_compared_by_the_objective(reward, tmp_path):
    run = Run("own", tmp_path)
    run.open(TrainSettings(task="CarriageForce", name="own", reward=reward))
    policy_of([4, 2, 1], "tanh").save(run.policy)
    with pytest.raises(RunError, match=r"own: trained for the reward .*own\.py:cost.*--reward"):
        read_field([str(run.folder), "no-control"])
    field = read_field([str(run.folder)], (), reward)
    assert all(scene.own_reward is not None for scene in field.scenes.values())


def test_flag_scores_a_controller(reward, tmp_path, monkeypatch, capsys):
    (tmp_path / "law.py").write_text(
        "import numpy as np\n"
        "class Law:\n"
        "    def __init__(self, scene):\n        pass\n"
        "    def action(self, memory, state, applied):\n"
        "        return -0.5 * np.sign(state[:, 2:3]), memory\n"
    )
    monkeypatch.setattr(
        "agents.commands.evaluate.baselines", lambda scene: ([best_velocity_feedback(scene)], {})
    )
    words = ["agents.evaluate", "CarriageForce", "--controller", f"{tmp_path}/law.py:Law"]
    monkeypatch.setattr(sys, "argv", [*words, "--episodes", "4", "--reward", reward])
    assert command.main() is None
    monkeypatch.setattr(sys, "argv", [*words, "--reward", reward.replace("cost", "cst")])
    assert "no class or function 'cst'; did you mean 'cost'" in command.main()
    capsys.readouterr()


def test_base_is_tuned_by_the_reward_of_its_training(tmp_path, monkeypatch):
    (tmp_path / "own.py").write_text(
        "def cost(carriage_displacement, carriage_velocity):\n"
        "    return carriage_displacement**2 + 1e-2 * carriage_velocity**2\n"
    )
    other = f"{tmp_path}/own.py:cost"
    tuned = [best_velocity_feedback(one).name for one in (SCENE, rewarded(SCENE, other))]
    assert tuned[0] != tuned[1]
    run = Run("around", tmp_path)
    fields = {"task": "CarriageForce", "changes": EXACT, "base": "velocity-feedback"}
    run.open(TrainSettings(**fields, name="around"))
    policy_of([5, 2, 1], "tanh").save(run.policy)
    scored = []
    monkeypatch.setattr(
        command, "report", lambda controllers, *others: scored.append((controllers[-1], *others))
    )
    command.report_run(run, reward=other)
    assert scored[0][0].base.name == tuned[0]
    assert scored[0][1].own_reward is not None
    assert scored[0][-1] == run.folder / "scored-by-cost"  # the run's own scores stay
    command.report_run(run)
    assert scored[1][-1] == run.folder
    assert law_of(str(run.folder), rewarded(SCENE, other), None).base.name == tuned[0]


def test_reward_of_a_training_is_run_where_it_is_asked_for(reward, tmp_path):
    run = Run("around", tmp_path)
    fields = {"task": "CarriageForce", "changes": EXACT, "base": "no-control", "reward": reward}
    run.open(TrainSettings(**fields, name="around"))
    policy_of([5, 2, 1], "tanh").save(run.policy)
    with pytest.raises(PolicyError, match="allow it with --trust"):
        law_of(str(run.folder), SCENE, None)
    assert law_of(str(run.folder), rewarded(SCENE, reward), None).name == str(run.folder)


def negative(carriage_displacement):
    return -1.0 - carriage_displacement**2


def test_cost_without_a_root_is_refused():
    law = law_of("no-control", PRE_STRETCH_SHOCK, None)
    with pytest.raises(SceneError, match="reward: negative is negative on average"):
        evaluate(rewarded(PRE_STRETCH_SHOCK, negative), law, episodes=2)
