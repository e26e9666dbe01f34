"""Does the LQG cost what it says, from the observation alone?"""

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, CARRIAGE_FORCE_FRICTION, PRE_STRETCH

from agents.control.feedback import Feedback, TrueState
from agents.control.kalman_filter import UNMODELLED
from agents.control.kalman_state import KalmanState
from agents.controllers.lqg import LQG, best_detuned_lqg, design_lqg
from agents.controllers.lqr import LQR
from agents.controllers.predictive_lqg import PredictiveLQG
from agents.controllers.rate_limited_lqg import RateLimitedLQG
from agents.controllers.registry import laws
from agents.controllers.tuned import baselines
from agents.scoring import evaluate, validation_cost
from agents.training.config import CONFIGS
from mm_gym import DesignError, MovingMassVectorEnv, Scene, load_scene
from mm_gym.scene.excitation import Impulse

NOISY = Scene(
    springs={"kind": "small_on_large", "stiffness": 35.0, "stretch": 2.0},
    interface={"kind": "viscous", "damping": 0.3},
    excitation=[
        {"kind": "noise", "rms": 1.0, "low_frequency": 30.0, "high_frequency": 90.0},
    ],
    # The force costs what one of 4 N would, and is never clipped.
    actuation={"force": {"limit": 400.0, "lag": 0.01}},
    sensors={
        "channels": ["carriage_acceleration", "sphere_offset"],
        "noise": {"carriage_acceleration": 3.0, "sphere_offset": 5e-4},
        "delay": 2,
    },
    objective={"effort_weight": 100.0, "velocity_weight": 0.1},
    control={"time_step": 0.01, "steps": 700},
)
# Impulses of one direction, some 3 N on average.
PUSHED = NOISY.replace(
    excitation=[*NOISY.excitation, Impulse(size=(0.0, 0.06), rate=100.0)],
)
REACTING = PUSHED.replace(
    **{"objective.carriage_acceleration_weight": 0.1},
    **{"objective.carriage_acceleration_scale": 10.0},
)
LANES, SETTLED = 300, 200

EPISODES = 50_000  # the first ten thousand alone are 2.3 standard errors off


def test_cost_is_the_riccati_equations_in_the_interval_of_fifty_thousand_episodes():
    law = LQG(NOISY, unmodelled=1e-6)
    env = MovingMassVectorEnv(NOISY, EPISODES, autoreset_mode="Disabled")
    observation, info = env.reset(seed=0)
    memory = law.begin(env)
    costs, steps = np.zeros(EPISODES), NOISY.control.steps
    for step in range(steps):
        action, memory = law.act(memory, observation, info)
        observation, reward, *_, info = env.step(action)
        if step >= SETTLED:
            costs -= reward / (steps - SETTLED)
    # Of the mean of independent episodes, 95 %.
    half = 1.96 * costs.std(ddof=1) / np.sqrt(EPISODES)
    assert abs(costs.mean() - law.design.cost) <= half
    assert half <= 2e-3 * law.design.cost


@pytest.mark.parametrize(
    "scene", [NOISY, PUSHED, REACTING], ids=["noisy", "pushed", "accelerations"]
)
def test_cost_and_error_are_those_of_the_riccati_equations(scene):
    law = LQG(scene, unmodelled=1e-6)
    env = MovingMassVectorEnv(scene, LANES, autoreset_mode="Disabled")
    observation, info = env.reset(seed=0)
    memory = law.begin(env)
    costs, errors = [], []
    for step in range(scene.control.steps):
        late = memory["estimate"]  # before this step's observation
        state = info["state"]
        action, memory = law.act(memory, observation, info)
        assert np.abs(action).max() < 1.0
        if step >= SETTLED:
            c, gain = law.design.system.C, law.design.filters[-1]
            shown = observation.astype(float) * law.frame.unit
            errors.append((late + (shown - late @ c.T) @ gain.T)[:, :4] - state)
        observation, reward, *_, info = env.step(action)
        if step >= SETTLED:
            costs.append(-reward)
    # Lanes are independent: five standard errors of their mean.
    of_lanes = np.mean(costs, axis=0)
    spread = of_lanes.std(ddof=1) / np.sqrt(LANES)
    assert abs(of_lanes.mean() - law.design.cost) <= 5.0 * spread
    assert spread <= 0.01 * law.design.cost
    each = np.mean(np.square(errors), axis=0)  # (lanes, 4)
    expected = np.diag(law.design.error)[:4]
    uncertain = each.std(axis=0, ddof=1) / np.sqrt(LANES)
    assert np.all(np.abs(each.mean(axis=0) - expected) <= 5.0 * uncertain)
    assert np.all(uncertain <= 0.03 * expected)


def test_regulators_and_plans_know_what_pushes_all_the_time():
    pytest.importorskip("osqp")
    scene = REACTING.replace(**{"control.steps": 60})
    costs = [
        evaluate(scene, law(scene), episodes=3).cost
        for law in (
            LQG,
            lambda scene: PredictiveLQG(scene, 1.0, UNMODELLED),
            lambda scene: RateLimitedLQG(
                scene.replace(**{"actuation.force.rate_limit": 1e9}), 1.0, 1e-12, UNMODELLED
            ),
        )
    ]
    assert costs[1:] == pytest.approx([costs[0]] * 2, rel=1e-4)


def test_what_pushes_all_the_time_does_not_bias_an_estimate():
    source, lanes = KalmanState(PUSHED), 100
    env = MovingMassVectorEnv(PUSHED, lanes, autoreset_mode="Disabled")
    observation, info = env.reset(seed=0)
    memory, errors = source.begin(lanes), []
    action = np.zeros(env.action_space.shape)
    for _ in range(SETTLED):
        state, _, memory = source.read(memory, observation, info)
        errors.append(state - info["state"])
        memory = source.note(memory, action)
        observation, *_, info = env.step(action)
    last = np.mean(errors[-SETTLED // 2 :], axis=0)
    spread = last.std(axis=0, ddof=1) / np.sqrt(lanes)
    assert np.all(np.abs(last.mean(axis=0)) <= 5.0 * spread)


def test_without_noise_and_late_it_costs_what_the_regulator_of_the_true_state_does():
    # The first frame shows the whole state, and the rest follows from the model.
    late = CARRIAGE_FORCE.replace(**{"sensors.delay": 2})
    known = Feedback(CARRIAGE_FORCE, LQR(CARRIAGE_FORCE), TrueState())
    expected = evaluate(CARRIAGE_FORCE, known, episodes=50)
    found = evaluate(late, LQG(late), episodes=50)
    assert found.cost == pytest.approx(expected.cost, rel=1e-4)
    assert (expected.reads, found.reads) == ("full state", "observation")


@pytest.mark.parametrize("delay", [0, 2])
def test_where_episodes_begin_is_known_also_if_it_is_not_0(delay):
    # A state that is known from the start needs no frame, so the gain is 0 at first.
    initial = {"carriage_displacement": 0.01, "sphere_offset": 0.02}
    begun = CARRIAGE_FORCE.replace(initial=initial)
    late = begun.replace(**{"sensors.delay": delay})
    law = LQG(late)
    assert not law.design.filters[0].any()
    np.testing.assert_allclose(law.design.start[:4], [0.01, 0.03, 0.0, 0.0])
    expected = evaluate(begun, Feedback(begun, LQR(begun), TrueState()), episodes=20).cost
    assert evaluate(late, law, episodes=20).cost == pytest.approx(expected, rel=1e-3)


def test_baselines_have_an_lqg_where_one_can_be_designed():
    assert "LQG" in [one.name for one in baselines(CARRIAGE_FORCE).controllers]
    found, not_scored = baselines(CARRIAGE_FORCE_FRICTION)
    assert "LQG" not in [one.name for one in found]
    assert "no stabilising solution" in not_scored["LQG"]


def test_where_the_force_changes_slowly_another_effort_weight_costs_half():
    scene = load_scene(CONFIGS / "structures" / "tower.toml").replace(**{"control.steps": 400})
    detuned, stated = (validation_cost(scene, one(scene)) for one in (best_detuned_lqg, LQG))
    assert detuned < 0.5 * stated


def test_without_a_weight_of_the_force_a_detuned_lqg_is_designed_all_the_same():
    # The default weight is 0, and agents begin as LQGs there too.
    scene = load_scene(CONFIGS / "structures" / "frame.toml").replace(
        **{"objective.effort_weight": 0.0, "control.steps": 125}
    )
    assert "lqg" not in laws(scene)
    regulated, damped = (
        validation_cost(scene, laws(scene)[name](scene))
        for name in ("detuned-lqg", "velocity-feedback")
    )
    assert regulated < 0.5 * damped


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (PRE_STRETCH, r"actuation\.force: missing"),
        (CARRIAGE_FORCE.replace(**{"objective.effort_weight": 0.0}), "effort_weight: got 0"),
        (
            CARRIAGE_FORCE.replace(**{"actuation.force": {"rate_limit": 10.0, "command": "rate"}}),
            r"command: got 'rate'",
        ),
        (
            CARRIAGE_FORCE.replace(
                **{
                    "sensors.channels": ["carriage_velocity"],
                    "objective.stroke_weight": 1.0,
                    "actuation.force.between": "masses",
                }
            ),
            "not detectable",
        ),
        (CARRIAGE_FORCE_FRICTION, "no stabilising solution"),
    ],
)
def test_ill_posed_designs_are_refused_with_the_reason(scene, message):
    with pytest.raises(DesignError, match=message):
        design_lqg(scene)
