"""The native VecEnv reports to Stable-Baselines3 what its own VecEnv would."""

import json
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import TransformReward
from gymnasium.wrappers.vector import VectorizeTransformReward
from stable_baselines3.common.env_util import make_vec_env as make_vec_env_of_sb3
from stable_baselines3.common.monitor import Monitor, get_monitor_files
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize
from tasks import CARRIAGE_FORCE

from mm_gym import MovingMassEnv, MovingMassVectorEnv
from mm_gym.sb3 import VectorEnvAdapter, make_vec_env

HALVED = {"wrapper": TransformReward, "func": lambda reward: 0.5 * reward}
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


def own(seed=4, **arguments):
    return make_vec_env("mm_gym/CarriageForce-v0", 5, seed, scene=SHORT, **arguments)


def theirs(seed=4, **arguments):
    return make_vec_env_of_sb3(lambda: MovingMassEnv(SHORT), 5, seed, **arguments)


def assert_same(mine, reference):
    """Compare infos to the last bit, but for the seconds that an episode took."""
    assert mine.keys() == reference.keys()
    for name, value in reference.items():
        if name == "episode":
            assert {**mine[name], "t": 0} == {**value, "t": 0}
            assert mine[name]["t"] >= 0.0
        else:
            assert type(mine[name]) is type(value)
            np.testing.assert_array_equal(mine[name], value)


@pytest.mark.parametrize("every_info", [False, True])
def test_steps_and_infos_equal_those_of_stable_baselines_own_path(every_info) -> None:
    native, plain = own(every_info=every_info), theirs()
    assert native.action_space.sample() == plain.action_space.sample()
    np.testing.assert_array_equal(native.reset(), plain.reset())
    generator, ends = np.random.default_rng(0), 0
    for _ in range(40):
        actions = generator.uniform(-1, 1, (5, 1)).astype(np.float32)
        mine, reference = native.step(actions), plain.step(actions)
        for got, expected in zip(mine[:3], reference[:3], strict=True):
            assert got.dtype == expected.dtype
            np.testing.assert_array_equal(got, expected)
        for done, got, expected in zip(mine[2], mine[3], reference[3], strict=True):
            if done or every_info:
                assert_same(got, expected)
            else:
                assert got == {}
        for got, expected in zip(native.reset_infos, plain.reset_infos, strict=True):
            assert_same(got, expected)
        ends += mine[2].sum()
    assert ends >= 20


def test_monitor_is_read_by_stable_baselines(tmp_path) -> None:
    native, plain = own(monitor_dir=tmp_path / "native"), theirs(monitor_dir=str(tmp_path / "sb3"))
    for env in (native, plain):
        env.reset()
        for _ in range(30):
            env.step(np.zeros((5, 1), np.float32))
        env.close()
    assert [file.name for file in (tmp_path / "native").iterdir()] == ["monitor.csv"]
    mine, reference = (
        sorted(
            line.rpartition(",")[0]
            for file in get_monitor_files(str(tmp_path / name))
            for line in Path(file).read_text("utf-8").splitlines()[2:]
        )
        for name in ("native", "sb3")
    )
    assert mine == reference
    assert len(mine) >= 15
    first, second, *_ = (tmp_path / "native" / "monitor.csv").read_text("utf-8").splitlines()
    assert json.loads(first[1:])["env_id"] == "mm_gym/CarriageForce-v0"
    assert second == "r,l,t"


def test_number_of_lanes_has_two_names() -> None:
    name = "mm_gym/CarriageForce-v0"
    assert make_vec_env(name, n_envs=3).num_envs == make_vec_env(name, np.int64(3)).num_envs == 3
    assert make_vec_env(name).num_envs == 1
    assert make_vec_env(name, env_kwargs={"scene": SHORT}).env.scene == SHORT
    with pytest.raises(ValueError, match="num_envs: got 2 and n_envs = 3; allowed: one of them"):
        make_vec_env(name, 2, n_envs=3)


def test_wrappers_of_vectors_apply_and_episodes_are_monitored_without_them() -> None:
    plain = own()
    wrapped = own(wrapper_class=VectorizeTransformReward, wrapper_kwargs=HALVED)
    normalised = own(wrapper_class=VecNormalize, wrapper_kwargs={"norm_obs": False})
    assert isinstance(normalised, VecNormalize)
    for env in (plain, wrapped):
        env.reset()
    for _ in range(9):
        actions = np.full((5, 1), 0.25, np.float32)
        expected, got = plain.step(actions), wrapped.step(actions)
        np.testing.assert_array_equal(got[1], np.float32(0.5) * expected[1])
        for mine, reference in zip(got[3], expected[3], strict=True):
            assert_same(mine, reference)
    assert "episode" in got[3][-1]


@pytest.mark.parametrize(
    ("wrapper", "advice"),
    [
        (gymnasium.wrappers.RescaleAction, "vectors, such as gymnasium.wrappers.vector.RescaleAc"),
        (gymnasium.wrappers.FrameStackObservation, "vectors$"),
        (repr, "vectors$"),
    ],
)
def test_wrapper_of_single_environments_is_refused_by_name(wrapper, advice) -> None:
    name = wrapper.__name__
    with pytest.raises(ValueError, match=f"wrapper_class: {name} wraps single .* for {advice}"):
        own(wrapper_class=wrapper)


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


def test_mode_of_autoreset_may_be_said_but_is_same_step() -> None:
    assert own(autoreset_mode="SameStep").num_envs == 5
    with pytest.raises(ValueError, match="autoreset_mode: got NextStep; allowed: SameStep"):
        own(autoreset_mode="NextStep")


def test_seed_is_an_integer_of_python_or_numpy() -> None:
    first, second = own(4), own(np.int64(4))
    np.testing.assert_array_equal(first.reset(), second.reset())
    assert first.action_space.sample() == second.action_space.sample()
    for seed in (-1, 1.5, "4", True):
        with pytest.raises(ValueError, match=f"seed: got {seed!r}; allowed: an integer"):
            own(seed)


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
