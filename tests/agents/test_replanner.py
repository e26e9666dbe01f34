"""Does preview change what it should, and nothing else?"""

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, TASKS

from agents.control.feedback import Feedback
from agents.controllers.lqr import LQR
from agents.evaluation.plans import Replanner
from agents.scoring import evaluate
from mm_gym import MovingMassVectorEnv
from mm_gym.sensitivity import Sensitivities, expected


def test_without_excitation_there_is_nothing_to_foresee() -> None:
    scene = CARRIAGE_FORCE.replace(**{"control.steps": 20})
    one, other = (evaluate(scene, Replanner(scene, foresees=f), episodes=4) for f in (True, False))
    np.testing.assert_array_equal(one.penalties, other.penalties)
    # Forty steps ahead on a linear plant: the regulator's cost, but for what is left after them.
    regulator = evaluate(scene, Feedback(scene, LQR(scene)), episodes=4)
    np.testing.assert_allclose(other.penalties, regulator.penalties, rtol=0.02)


@pytest.mark.parametrize("name", ["PreStretchNoise", "Hybrid"])
def test_preview_of_noise_is_worth_something_in_every_episode(name: str) -> None:
    scene = TASKS[f"mm_gym/{name}-v0"].replace(**{"control.steps": 50})
    one, other = (evaluate(scene, Replanner(scene, foresees=f), episodes=4) for f in (True, False))
    assert np.all(one.penalties < other.penalties)


@pytest.mark.parametrize("name", ["PreStretchNoise", "PreStretchShock", "Hybrid"])
def test_what_is_expected_is_the_mean_of_what_comes(name: str) -> None:
    count, steps = 4000, 8
    scene = TASKS[f"mm_gym/{name}-v0"]
    env = MovingMassVectorEnv(scene, count)
    env.reset(seed=3)
    for _ in range(5):
        env.step(np.zeros(env.action_space.shape))
    start = env.get_state()
    # All lanes go on from the first one's state, each with its own random numbers.
    values = np.repeat(start["values"][:, :1], count, axis=1)
    if name == "PreStretchShock":
        values = start["values"].copy()
        values[:4] = values[:4, :1]
    support, model, mean = expected(env.plant.support, env.plant.model, values)
    actions = np.zeros((env.action_space.shape[1], count))
    ends = []
    for of, constants, lanes in (
        (env.plant.support, (env.plant.model, env.plant.task), values),
        (support, (model, env.plant.task), mean),
    ):
        moved = Sensitivities(of, constants, (lanes, start["streams"]))
        for _ in range(steps):
            moved.step(actions)
        ends.append(moved.state[:4])
    np.testing.assert_array_equal(ends[1], ends[1][:, :1] + np.zeros(count))
    scatter = ends[0].std(axis=1)
    assert np.all(scatter > 0.0)
    # Four standard deviations of a mean of so many lanes.
    assert np.all(np.abs(ends[0].mean(axis=1) - ends[1][:, 0]) < 4.0 * scatter / count**0.5)
