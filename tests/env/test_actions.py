"""Actions: bad ones are refused and change nothing; others are clipped, whatever their type."""

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from rollouts import random_actions, rollout

from mm_gym import ActionError, MovingMassEnv


class Stubborn:
    """Refuses to become an array, as a tensor does that needs its gradient."""

    def __array__(self, dtype=None, copy=None):
        raise RuntimeError


BAD_ACTIONS = {
    "nan": lambda shape: np.full(shape, np.nan, np.float32),
    "nan, double": lambda shape: np.full(shape, np.nan),
    "inf": lambda shape: np.full(shape, np.inf, np.float32),
    "-inf, double": lambda shape: np.full(shape, -np.inf),
    "nan in the last place": lambda shape: np.where(
        np.arange(np.prod(shape)).reshape(shape) == np.prod(shape) - 1, np.nan, 0.0
    ),
    "a column too many": lambda shape: np.zeros((*shape[:-1], shape[-1] + 1), np.float32),
    "an axis too many": lambda shape: np.zeros((1, *shape), np.float32),
    "a number": lambda _: 0.5,
    "nothing": lambda _: None,
    "empty": lambda _: [],
    "a word": lambda _: "left",
    "words": lambda shape: np.full(shape, "0.5"),
    "objects": lambda shape: np.full(shape, object()),
    "complex": lambda shape: np.zeros(shape, np.complex128),
    "booleans": lambda shape: np.zeros(shape, np.bool_),
    "masked": np.ma.masked_all,
    "what refuses to be one": lambda _: Stubborn(),
    "ragged": lambda _: [[0.0], [0.0, 1.0]],
    "a dictionary": lambda _: {"force": 0.0},
}


@pytest.mark.parametrize("name", BAD_ACTIONS)
def test_bad_action_is_refused_and_changes_nothing(make, scene, name, assert_same):
    env = make(scene)
    env.reset(seed=0)
    rollout(env, random_actions(env, 3))
    before = env.get_state()
    with pytest.raises(ActionError, match="action"):
        env.step(BAD_ACTIONS[name](env.action_space.shape))
    assert_same(before, env.get_state())
    # It continues as if the action had not been given.
    twin = make(scene)
    twin.set_state(before)
    actions = random_actions(env, 3)
    assert_same(rollout(env, actions), rollout(twin, actions))


@pytest.mark.parametrize("beyond", [1.5, 100.0, 3e38])
def test_finite_actions_outside_the_space_are_clipped(make, scene, beyond, assert_same):
    env, twin = make(scene), make(scene)
    env.reset(seed=0)
    twin.reset(seed=0)
    for sign in (1.0, -1.0, 1.0):
        action = np.full(env.action_space.shape, sign, np.float32)
        assert_same(env.step(np.float32(beyond) * action), twin.step(action))


def test_type_of_the_action_does_not_matter(make, scene, assert_same):
    env = make(scene)
    env.reset(seed=0)
    saved = env.get_state()
    half = np.full(env.action_space.shape, 0.5, np.float32)
    expected = env.step(half)
    for same in (half.astype(np.float64), half.astype(np.float16), half.tolist(), half[..., ::-1]):
        env.set_state(saved)
        assert_same(env.step(same), expected)
    env.set_state(saved)
    ones = np.ones(env.action_space.shape)
    expected = env.step(ones)
    env.set_state(saved)
    assert_same(env.step(ones.astype(int)), expected)


def test_step_needs_a_running_episode(ending_scene):
    env = MovingMassEnv(ending_scene)
    action = np.zeros(env.action_space.shape, np.float32)
    with pytest.raises(ResetNeeded):
        env.step(action)
    env.reset(seed=0)
    ended = False
    while not ended:
        _, _, terminated, truncated, _ = env.step(action)
        ended = terminated or truncated
    before = env.get_state()
    with pytest.raises(ResetNeeded, match="reset"):
        env.step(action)
    # The end of an episode is part of its state.
    env.reset()
    env.set_state(before)
    with pytest.raises(ResetNeeded):
        env.step(action)
