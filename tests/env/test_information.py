"""What steps tell with the observation: nothing, the state, or also the reward's terms."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from tasks import HYBRID, TASKS

from mm_gym import MovingMassEnv, MovingMassVectorEnv, SceneError

LIMITED = HYBRID.replace(
    **{
        "objective.displacement_limit": 0.0009,
        "objective.rail_half_length": 0.002,
        "objective.velocity_weight": 0.3,
        "objective.effort_weight": 0.07,
        "objective.stroke_weight": 0.9,
        "control.steps": 25,
    }
)
TERMS = ["reward_displacement", "reward_velocity", "reward_effort", "reward_stroke"]
LIGHT = ["state", "applied"]
FULL = [*LIGHT, *TERMS, "cost", "constraint"]
LEVELS = {"none": [], "light": LIGHT, "full": FULL}


def actions_for(env, steps=60):
    shape = (steps, *env.action_space.shape)
    return np.random.default_rng(0).uniform(-1.3, 1.3, shape).astype(np.float32)


@pytest.mark.parametrize("level", LEVELS)
def test_level_says_what_information_holds(level):
    single, vector = MovingMassEnv(LIMITED, info=level), MovingMassVectorEnv(LIMITED, 3, info=level)
    for env in (single, vector):
        actions = actions_for(env, 1)
        for info in (env.reset(seed=0)[-1], env.step(actions[0])[-1]):
            assert [name for name in info if not name.startswith("_")] == LEVELS[level]
    assert [type(info[name]) for name in FULL[2:] if name in info] == [np.ndarray] * len(
        LEVELS[level][2:]
    )


@pytest.mark.parametrize("name", TASKS)
def test_light_is_the_default(name):
    assert list(gymnasium.make(name).reset(seed=0)[-1]) == LIGHT


@pytest.mark.parametrize("make", [MovingMassEnv, MovingMassVectorEnv])
def test_unknown_level_is_refused(make):
    words = "info: got 'ful'; did you mean 'full'.; allowed: none, light, full"
    with pytest.raises(SceneError, match=words):
        make(LIMITED, info="ful")


def test_terms_are_those_of_the_documented_reward():
    env, o = MovingMassEnv(LIMITED, info="full"), LIMITED.objective
    env.reset(seed=1)
    exceeded = 0
    for action in actions_for(env):
        _, reward, terminated, truncated, info = env.step(action)
        x1, x2, v1, _ = info["state"]
        a = np.clip(action.astype(float), -1.0, 1.0)
        expected = {
            "reward_displacement": -o.displacement_weight * (x1 / o.displacement_scale) ** 2,
            "reward_velocity": -o.velocity_weight * (v1 / o.velocity_scale) ** 2,
            "reward_effort": -o.effort_weight * (a**2).sum(),
            "reward_stroke": -o.stroke_weight * ((x2 - x1) / o.stroke_scale) ** 2,
        }
        # Products of a few factors each; the sum is of one sign.
        assert {name: info[name] for name in TERMS} == pytest.approx(expected, rel=1e-14)
        assert sum(info[name] for name in TERMS) == pytest.approx(reward, rel=1e-14)
        used = max(abs(x1) / o.displacement_limit, abs(x2 - x1) / o.rail_half_length)
        assert info["constraint"] == pytest.approx(used - 1.0, abs=1e-15 * (1.0 + used))
        assert info["cost"] == float(terminated)
        exceeded += terminated
        if terminated or truncated:
            _, info = env.reset()
            assert [info[name] for name in TERMS] == [0.0] * 4
    assert exceeded


def test_without_limits_the_constraint_is_kept():
    env = MovingMassEnv(HYBRID, info="full")
    env.reset(seed=1)
    info = env.step(np.ones(2, np.float32))[-1]
    assert (info["cost"], info["constraint"]) == (0.0, -1.0)


def without_layout(result):
    return tuple(np.ascontiguousarray(x) if isinstance(x, np.ndarray) else x for x in result)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("copy", [True, False])
def test_lanes_tell_what_single_environments_tell(level, mode, copy, assert_same):
    native = MovingMassVectorEnv(LIMITED, 4, autoreset_mode=mode, info=level, copy=copy)
    sync = SyncVectorEnv([lambda: MovingMassEnv(LIMITED, info=level)] * 4, autoreset_mode=mode)
    assert_same(without_layout(native.reset(seed=3)), without_layout(sync.reset(seed=3)))
    ends = 0
    for action in actions_for(native):
        got, expected = native.step(action), sync.step(action)
        assert_same(without_layout(got), without_layout(expected))
        ended = got[2] | got[3]
        ends += ended.sum()
        if mode is AutoresetMode.DISABLED and ended.any():
            for env in (native, sync):
                env.reset(options={"reset_mask": ended.copy()})
    assert ends >= 8


def test_motion_and_rewards_do_not_depend_on_the_level(assert_same):
    envs = [MovingMassVectorEnv(LIMITED, 3, info=level, copy=False) for level in LEVELS]
    for env in envs:
        env.reset(seed=0)
    for action in actions_for(envs[0]):
        none, light, full = (env.step(action)[:4] for env in envs)
        assert_same(without_layout(none), without_layout(light))
        assert_same(without_layout(full), without_layout(light))
