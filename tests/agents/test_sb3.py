"""The native VecEnv reports to Stable-Baselines3 what its own VecEnv would."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv
from tasks import CARRIAGE_FORCE

from mm_gym import MovingMassEnv, MovingMassVectorEnv
from mm_gym.sb3 import VectorEnvAdapter, make_vec_env

SHORT = CARRIAGE_FORCE.replace(**{"control.steps": 9, "objective.displacement_limit": 0.0095})


def test_steps_equal_those_of_dummy_vec_env_through_ends_of_episodes() -> None:
    native = make_vec_env("mm_gym/CarriageForce-v0", 6, scene=SHORT)
    plain = DummyVecEnv([lambda: MovingMassEnv(SHORT)] * 6)
    for env in (native, plain):
        env.seed(4)
    np.testing.assert_array_equal(native.reset(), plain.reset())
    generator = np.random.default_rng(0)
    terminations = truncations = 0
    for _ in range(40):
        actions = generator.uniform(-1, 1, (6, 1)).astype(np.float32)
        ours, theirs = native.step(actions), plain.step(actions)
        np.testing.assert_array_equal(ours[0], theirs[0])
        np.testing.assert_array_equal(ours[1].astype(np.float32), theirs[1])
        np.testing.assert_array_equal(ours[2], theirs[2])
        for mine, reference in zip(ours[3], theirs[3], strict=True):
            assert ("terminal_observation" in mine) == ("terminal_observation" in reference)
            if "terminal_observation" in mine:
                np.testing.assert_array_equal(
                    mine["terminal_observation"], reference["terminal_observation"]
                )
                assert mine["TimeLimit.truncated"] == reference["TimeLimit.truncated"]
                truncations += mine["TimeLimit.truncated"]
                terminations += not mine["TimeLimit.truncated"]
    assert terminations
    assert truncations


def test_episode_statistics_equal_those_of_monitor() -> None:
    native = make_vec_env("mm_gym/CarriageForce-v0", 1, scene=SHORT)
    plain = DummyVecEnv([lambda: Monitor(MovingMassEnv(SHORT))])
    for env in (native, plain):
        env.seed(2)
        env.reset()
    episodes = 0
    for _ in range(30):
        actions = np.zeros((1, 1), np.float32)
        ours, theirs = native.step(actions)[3][0], plain.step(actions)[3][0]
        assert ("episode" in ours) == ("episode" in theirs)
        if "episode" in ours:
            episodes += 1
            assert ours["episode"]["l"] == theirs["episode"]["l"]
            # Monitor rounds returns to six decimals.
            assert ours["episode"]["r"] == pytest.approx(theirs["episode"]["r"], abs=1e-6)
    assert episodes > 2


def test_options_reach_every_lane() -> None:
    env = make_vec_env("mm_gym/CarriageForce-v0", 3)
    env.set_options([{"initial.carriage_displacement": x} for x in (0.001, 0.002, 0.003)])
    env.reset()
    assert [info["state"][0] for info in env.reset_infos] == [0.001, 0.002, 0.003]
    env.reset()
    assert env.reset_infos[0]["state"][0] != 0.001


def test_unequal_options_are_refused() -> None:
    env = make_vec_env("mm_gym/CarriageForce-v0", 2)
    env.set_options([{"initial.carriage_displacement": 0.001}, {}])
    with pytest.raises(ValueError, match="same fields"):
        env.reset()
    env.reset()  # refused options are cleared


def test_views_are_refused_because_observations_are_kept() -> None:
    with pytest.raises(ValueError, match="copy: got False"):
        make_vec_env("mm_gym/CarriageForce-v0", 2, copy=False)


def test_other_autoreset_modes_are_refused() -> None:
    env = MovingMassVectorEnv(CARRIAGE_FORCE, 2, autoreset_mode=AutoresetMode.NEXT_STEP)
    with pytest.raises(ValueError, match="autoreset_mode"):
        VectorEnvAdapter(env)


def test_attributes_and_methods_of_the_environment_are_reached() -> None:
    env = make_vec_env("mm_gym/CarriageForce-v0", 3)
    env.reset()
    assert env.get_attr("scene", indices=[0, 2]) == [CARRIAGE_FORCE] * 2
    assert env.env_method("get_state")[0]["values"].shape[1] == 3
    assert env.env_is_wrapped(Monitor) == [True] * 3
    assert env.env_is_wrapped(gymnasium.wrappers.TimeLimit) == [False] * 3
    env.set_attr("label", "here")
    assert env.get_attr("label") == ["here"] * 3
    with pytest.raises(ValueError, match="share one environment"):
        env.set_attr("label", "there", indices=0)
