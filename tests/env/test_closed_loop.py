"""Episodes under a compiled law: those of single steps, to the last bit."""

# ruff: noqa: ARG001 - laws have at least two arguments

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from numba import njit
from tasks import CARRIAGE_FORCE

from mm_gym import ActionError, MovingMassVectorEnv, SimulationError

LANES = 70


@njit
def law(observed, actions, gains, sums):
    """Act on the first number of each observation, and remember them."""
    for i in range(actions.shape[1]):
        sums[i] += observed[0, i]
        for k in range(actions.shape[0]):
            actions[k, i] = gains[k] * observed[0, i]


@njit
def returning(observed, actions):
    return actions[0, 0]


@njit
def failing(observed, actions):
    raise ValueError


@njit
def pushing(observed, actions, size):
    actions[:] = size


def loop_of(env):
    gains, sums = np.full(2, -0.7, np.float32), np.zeros(LANES, np.float32)
    return env.closed_loop(law, gains, sums), gains, sums


def stepped(scene, gain):
    """What single steps come to: returns, least rewards, lengths, terminations, observed sums."""
    env = MovingMassVectorEnv(scene, LANES)
    observation, _ = env.reset(seed=5)
    returns, least = np.zeros(LANES), np.zeros(LANES)
    lengths, early = np.zeros(LANES, int), np.zeros(LANES, bool)
    sums = np.zeros(LANES, np.float32)
    for step in range(1, scene.control.steps + 1):
        sums += observation[:, 0]
        actions = np.repeat(np.float32(gain) * observation[:, :1], env.action_space.shape[1], 1)
        observation, reward, terminated, truncated, _ = env.step(actions)
        alive = lengths == 0
        returns[alive] += reward[alive]
        least[alive] = np.minimum(least, reward)[alive]
        ended = alive & (terminated | truncated)
        lengths[ended], early[ended] = step, terminated[ended]
    return returns, least, lengths, early, sums


class TestEpisodes:
    def test_they_are_those_of_single_steps(self, ending_scene):
        scene = ending_scene
        env = MovingMassVectorEnv(scene, LANES)
        run, *_ = loop_of(env)
        for _ in range(2):  # what one episode leaves must not change the next
            env.reset(seed=5)
            episodes = run()
        for got, want in zip(episodes, stepped(scene, -0.7), strict=False):
            np.testing.assert_array_equal(got, want)
        assert 0 < np.count_nonzero(episodes.terminated) < LANES

    def test_arguments_are_read_anew_and_remember(self):
        scene = CARRIAGE_FORCE.replace(**{"control.steps": 9})
        env = MovingMassVectorEnv(scene, LANES)
        run, gains, sums = loop_of(env)
        for gain in (-0.7, 0.4):
            gains[:], sums[:] = gain, 0.0
            env.reset(seed=5)
            returns, *_, want = stepped(scene, gain)
            np.testing.assert_array_equal(run().returns, returns)
            np.testing.assert_array_equal(sums, want)

    def test_lanes_that_have_begun_are_taken_to_the_end(self):
        env = MovingMassVectorEnv(CARRIAGE_FORCE.replace(**{"control.steps": 9}), LANES)
        run, *_ = loop_of(env)
        env.reset(seed=5)
        env.step(np.zeros((LANES, 1), np.float32))
        env.reset(seed=5, options={"reset_mask": np.arange(LANES) < 4})
        assert run().lengths.tolist() == [9] * 4 + [8] * (LANES - 4)

    def test_next_ones_need_a_reset(self):
        env = MovingMassVectorEnv(CARRIAGE_FORCE, LANES, autoreset_mode="Disabled")
        run, *_ = loop_of(env)
        with pytest.raises(ResetNeeded, match="70 of 70 lanes need reset"):
            run()
        env.reset(seed=5)
        run()
        with pytest.raises(ResetNeeded, match="before an episode"):
            run()
        with pytest.raises(ResetNeeded, match="before step"):
            env.step(np.zeros((LANES, 1), np.float32))


class TestBadLaws:
    env = MovingMassVectorEnv(CARRIAGE_FORCE, 2)

    def test_plain_python_is_refused(self):
        with pytest.raises(TypeError, match="allowed: a function that numba"):
            self.env.closed_loop(law.py_func)

    def test_result_is_refused(self):
        with pytest.raises(TypeError, match="controller: returns float32; allowed: nothing"):
            self.env.closed_loop(returning)

    @pytest.mark.parametrize(
        ("given", "arguments", "error", "message"),
        [
            (failing, (), SimulationError, "controller: raised an error in compiled code"),
            (pushing, (np.nan,), ActionError, "action: got NaN or infinity"),
        ],
    )
    def test_failure_in_an_episode_is_named_and_ends_it(self, given, arguments, error, message):
        run = self.env.closed_loop(given, *arguments)
        self.env.reset(seed=0)
        with pytest.raises(error, match=message):
            run()
        with pytest.raises(ResetNeeded):
            run()

    def test_escape_is_named(self):
        changes = {"carriage.cubic_coefficient": -1e4}
        env = MovingMassVectorEnv(CARRIAGE_FORCE, 2, changes=changes)
        run = env.closed_loop(pushing, 1.0)
        env.reset(seed=0)
        with pytest.raises(SimulationError, match=r"taylor.*escape in the control step"):
            run()
