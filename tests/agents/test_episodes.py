"""Are all controllers scored on the same episodes, by what the task asks for?"""

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, PRE_STRETCH, TASKS

from agents.controllers.constant import ConstantStretch, no_control
from agents.controllers.lqr import LQR
from agents.evaluation.episodes import evaluate

LIMITED = CARRIAGE_FORCE.replace(**{"objective.displacement_limit": 0.004})


def test_cost_is_the_rms_where_only_displacement_is_rewarded() -> None:
    result = evaluate(PRE_STRETCH, ConstantStretch(PRE_STRETCH, 1.5), episodes=10)
    assert result.cost == pytest.approx(result.rms, rel=1e-12)
    np.testing.assert_allclose(result.episode_costs, result.episode_rms, rtol=1e-12)


def test_cost_is_the_root_of_the_mean_of_minus_reward() -> None:
    result = evaluate(CARRIAGE_FORCE, LQR(CARRIAGE_FORCE), episodes=10)
    mean = -result.returns.mean() / CARRIAGE_FORCE.control.steps
    assert result.cost == pytest.approx(np.sqrt(mean), rel=1e-12)
    assert result.cost > 1.1 * result.rms  # velocity and force cost too


def test_every_controller_sees_the_same_held_out_episodes() -> None:
    first, second = (
        evaluate(PRE_STRETCH, ConstantStretch(PRE_STRETCH, s), episodes=10) for s in (1.2, 2.4)
    )
    np.testing.assert_array_equal(first.frequency, second.frequency)
    # The first step cannot differ by more than one rate-limited step of the stretch.
    np.testing.assert_allclose(first.applied[0], second.applied[0], atol=2 * 0.04 + 1e-12)


def test_frequency_is_known_only_where_it_is_randomised() -> None:
    scene = TASKS["mm_gym/PreStretchNoise-v0"]
    assert evaluate(scene, no_control(scene), episodes=3).frequency is None
    assert evaluate(PRE_STRETCH, no_control(PRE_STRETCH), episodes=3).frequency is not None


def test_ending_an_episode_early_does_not_lower_its_cost() -> None:
    limited, free = (
        evaluate(scene, no_control(scene), episodes=40) for scene in (LIMITED, CARRIAGE_FORCE)
    )
    ended = np.abs(limited.displacement[-1]) * 0.01 > 0.004
    assert ended.any()
    assert not ended.all()
    # An ended episode gets no more rewards, but counts as if it stayed beyond the limit; the free
    # one decays.
    assert np.all(limited.returns[ended] > free.returns[ended])
    assert np.all(limited.penalties[ended] > free.penalties[ended])
    np.testing.assert_array_equal(limited.penalties[~ended], free.penalties[~ended])
