"""Do laws whose numbers change act as designs with these numbers, and is that worth something?"""

from dataclasses import replace

import numpy as np
from tasks import TASKS

from agents.control.feedback import Feedback
from agents.controllers.inertial_drive import INERTIAL_DRIVE, OF_DESIGN
from agents.controllers.predictive_control import (
    ROLLOUTS,
    RolloutPredictiveControl,
    predictive_control,
)
from agents.scoring import VALIDATION_SEED, evaluate

SCENE = TASKS["mm_gym/CarriageForceFriction-v0"]
LAW = INERTIAL_DRIVE.best(SCENE).law
SHORT = SCENE.replace(**{"control.steps": 60})


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


def test_rollouts_that_try_nothing_else_are_the_law():
    still = replace(ROLLOUTS, spread=1e-12, least_spread=0.0, horizon=2, plans=6)
    both = RolloutPredictiveControl(SHORT, LAW, still), LAW
    planned, of_law = (evaluate(SHORT, Feedback(SHORT, law), episodes=4) for law in both)
    np.testing.assert_allclose(planned.penalties, of_law.penalties, rtol=1e-6)
