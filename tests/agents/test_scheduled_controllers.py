"""Controllers that follow an amplitude, a rig or a delay: do they follow what is there?"""

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, TASKS

from agents.control.controller import part
from agents.control.feedback import Feedback
from agents.controllers.adaptive_lqr import FACTORS, UNSURE, AdaptiveLQR
from agents.controllers.gain_scheduling import GainScheduledLQR, Schedule
from agents.controllers.lqr import LQR
from agents.controllers.registry import laws, obstacle
from agents.controllers.smith_predictor import SmithPredictor
from mm_gym import MovingMassVectorEnv

DUFFING = TASKS["mm_gym/CarriageForceDuffing-v0"]
STIFFNESS = CARRIAGE_FORCE.carriage.stiffness
RIGS = CARRIAGE_FORCE.replace(
    randomization={"carriage.stiffness": [0.8 * STIFFNESS, 1.2 * STIFFNESS]},
    **{"control.steps": 60},
)


def scheduled(factor=1.0):
    stiffness = DUFFING.carriage.stiffness
    return GainScheduledLQR(
        DUFFING, Schedule(DUFFING, stiffness * np.array([0.5, 1.0, 4.0])), factor
    )


def test_the_stiffness_is_that_of_the_amplitude_it_implies():
    state = np.random.default_rng(0).standard_normal((40, 4)) * [0.01, 0.01, 0.5, 0.5]
    carriage, found = DUFFING.carriage, scheduled().stiffness(state)
    square = state[:, 0] ** 2 + carriage.mass * state[:, 2] ** 2 / found
    linear, cubic = carriage.linear_coefficient, carriage.cubic_coefficient
    wanted = carriage.stiffness * (linear + 0.75 * cubic * square)
    np.testing.assert_allclose(found, wanted, rtol=1e-12)  # round-off of a quadratic equation
    assert (found > carriage.stiffness).all()


def test_small_motions_have_the_regulator_at_rest_and_large_ones_another():
    state = np.array([[1e-6, 0.0, 1e-5, 0.0], [0.02, 0.0, 0.1, 0.0]])
    small, large = scheduled(0.5).action({}, state, np.zeros((2, 1)))[0]
    regulator = 0.5 * LQR(DUFFING).action({}, state, np.zeros((2, 1)))[0]
    # Of a millionth of a metre the cubic spring adds some 1e-8 of the stiffness.
    assert small == pytest.approx(regulator[0], rel=1e-6)
    assert large != pytest.approx(regulator[1], rel=0.05)


def test_the_stiffness_of_each_rig_is_identified():
    lanes = 20
    env = MovingMassVectorEnv(RIGS, lanes, autoreset_mode="Disabled")
    schedule = Schedule(RIGS, FACTORS * STIFFNESS)
    controller = Feedback(RIGS, AdaptiveLQR(RIGS, schedule, 0.2))
    seen, _ = env.reset(seed=0)
    memory = controller.begin(env)
    for _ in range(RIGS.control.steps):
        action, memory = controller.act(memory, seen, {})
        seen, *_ = env.step(action)
    memory = part(memory, "law")
    found = STIFFNESS * (1.0 + memory["errors"][:, 0])
    drawn = env.drawn("carriage.stiffness")
    assert np.abs(drawn / STIFFNESS - 1.0).max() > 0.1
    # The error is taken for a force that is held, which is off by (step w)^2 / 24 = 2 % of how far
    # a rig is from what is stated, at most a fifth; the sphere's friction is noise to it.
    np.testing.assert_allclose(found, drawn, rtol=0.01)
    assert (memory["spread"][:, 0, 0] < 0.1 * UNSURE**2).all()


def test_a_smith_predictor_without_disturbance_knows_the_present():
    scene = CARRIAGE_FORCE.replace(
        initial={"carriage_displacement": 0.0, "sphere_offset": 0.0},
        **{"sensors.delay": 3, "control.steps": 30},
    )
    env = MovingMassVectorEnv(scene, 4, autoreset_mode="Disabled")
    seen, _ = env.reset(seed=0)
    source, draw = SmithPredictor(scene), np.random.default_rng(1)
    memory, late = source.begin(4), 0.0
    for step in range(20):
        state, _, memory = source.read(memory, seen, {})
        truth = env.state
        # Observations are in single precision, the model moves as the plant does.
        np.testing.assert_allclose(state, truth, rtol=0.0, atol=1e-6 * np.abs(truth).max() + 1e-9)
        if step > 3:
            late = max(late, float(np.abs(memory["estimate"] - truth).max()))
        action = draw.uniform(-1.0, 1.0, (4, 1))
        memory = source.note(memory, action)
        seen, *_ = env.step(action)
    assert late > 1e-3


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("gain-scheduled-lqr", "carriage.cubic_coefficient: got 0"),
        ("adaptive-lqr", "carriage.stiffness is not drawn"),
        ("smith-predictor", "sensors.delay: got 0"),
    ],
)
def test_scene_with_nothing_to_follow_is_refused_by_name(name, reason):
    assert name not in laws(CARRIAGE_FORCE)
    assert reason in obstacle(name, CARRIAGE_FORCE)
