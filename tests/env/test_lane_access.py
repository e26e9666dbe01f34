"""Lanes asked one by one answer as the environments of Gymnasium's SyncVectorEnv."""

import copy

import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv
from tasks import PRE_STRETCH

from mm_gym import MovingMassEnv, MovingMassVectorEnv


@pytest.fixture
def twins():
    native = MovingMassVectorEnv(PRE_STRETCH, 3)
    sync = SyncVectorEnv([lambda: MovingMassEnv(PRE_STRETCH)] * 3)
    for envs in (native, sync):
        envs.reset(seed=4)
        envs.step(np.full((3, 1), 0.5, np.float32))
    return native, sync


@pytest.mark.parametrize(
    "name", ["state", "scene", "action_space", "observation_space", "render_mode", "spec"]
)
def test_attributes_are_those_of_single_environments(twins, name, assert_same):
    native, sync = twins
    assert_same(native.get_attr(name), sync.get_attr(name))
    assert_same(native.call(name), sync.call(name))


def test_drawn_values_and_states_are_those_of_single_environments(twins, assert_same):
    native, sync = twins
    name = "excitation.0.frequency"
    assert native.call("drawn", name) == sync.call("drawn", name)
    assert len(set(native.call("drawn", name))) == 3
    single, action = MovingMassEnv(PRE_STRETCH), np.zeros(1, np.float32)
    for mine, env in zip(native.call("get_state"), sync.envs, strict=True):
        single.set_state(mine)
        assert_same(single.step(action), env.step(action))


def test_attributes_of_ones_own_are_set_for_each_lane(twins):
    native, sync = twins
    for envs in (native, sync):
        envs.set_attr("label", "all")
        assert envs.get_attr("label") == ("all", "all", "all")
        envs.set_attr("label", ["a", "b", "c"])
        assert envs.get_attr("label") == ("a", "b", "c")
        with pytest.raises(ValueError, match="2"):
            envs.set_attr("label", ["a", "b"])
    assert copy.deepcopy(native).get_attr("label") == ("a", "b", "c")


@pytest.mark.parametrize("name", ["scene", "state", "num_envs", "action_space", "step"])
def test_attributes_of_the_environment_are_not_set_without_effect(twins, name):
    with pytest.raises(ValueError, match=f"{name}: the environment's own, which follows from its"):
        twins[0].set_attr(name, 3)


@pytest.mark.parametrize("name", ["step", "reset", "set_state", "_prepare"])
def test_methods_that_a_lane_cannot_run_alone_are_refused(twins, name):
    with pytest.raises(AttributeError, match=f"{name}: a single lane cannot run it"):
        twins[0].call(name)


def test_unknown_name_is_refused(twins):
    for envs in twins:
        with pytest.raises(AttributeError, match="unknown_name"):
            envs.get_attr("unknown_name")


def test_all_lanes_are_closed_at_once(twins):
    native, sync = twins
    assert native.call("close") == sync.call("close") == (None, None, None)
