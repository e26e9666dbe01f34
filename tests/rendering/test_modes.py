"""Environments give their pictures in every mode that Gymnasium knows."""

import pickle
import subprocess
import sys
import time

import gymnasium
import numpy as np
import pygame
import pytest
from gymnasium.error import DependencyNotInstalled, ResetNeeded
from gymnasium.wrappers import RenderCollection
from tasks import TASKS

from mm_gym import MovingMassEnv, MovingMassVectorEnv, SceneError
from mm_gym.lanes import layout
from mm_gym.rendering.look import SIZE
from mm_gym.sb3 import make_vec_env

SCENE = TASKS["mm_gym/PreStretch-v0"]
SHAPE = (SIZE[1], SIZE[0], 3)


def begun(mode, kind=MovingMassEnv, **kwargs):
    env = kind(SCENE, render_mode=mode, **kwargs)
    env.reset(seed=0)
    env.action_space.seed(0)
    return env


def run(program):
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, check=False, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("name", TASKS)
def test_every_task_is_drawn(name):
    env = gymnasium.make(name, render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    env.step(env.action_space.sample())
    second = env.render()
    for frame in (first, second):
        assert (frame.shape, frame.dtype) == (SHAPE, np.uint8)
        assert frame.flags.writeable
    assert (first != second).any()
    assert not np.shares_memory(first, second)
    env.close()


def test_list_is_that_of_gymnasiums_collection():
    envs = [begun("rgb_array_list"), RenderCollection(begun("rgb_array"))]
    frames = []
    for env in envs:
        env.reset(seed=1)
        env.step(np.zeros(1, np.float32))
        env.step(np.ones(1, np.float32))
        frames.append(env.render())
        assert env.render() == []
    assert len(frames[0]) == len(frames[1]) == 3
    np.testing.assert_array_equal(*frames)


def test_list_begins_anew_with_an_episode_after_a_state_was_set(monkeypatch):
    """Each block of lanes has a clock of its own then."""
    env = begun("rgb_array_list", MovingMassVectorEnv, num_envs=2 * layout.BLOCK)
    monkeypatch.setattr(env._renderer, "_frame", lambda _: None)
    still, lanes = np.zeros((env.num_envs, 1), np.float32), np.arange(env.num_envs)
    for _ in range(3):
        env.step(still)
    env.reset(options={"reset_mask": lanes >= layout.BLOCK})
    env.set_state(env.get_state())
    env.step(still)
    for first in (0, layout.BLOCK):
        env.render()
        env.step(still)
        env.reset(options={"reset_mask": lanes == first})
        assert [len(frames) for frames in env.render()] == np.where(lanes == first, 1, 2).tolist()


def test_rendering_changes_no_motion():
    ends = []
    for mode in (None, "rgb_array"):
        env = begun(mode)
        for _ in range(5):
            env.step(env.action_space.sample())
            env.render()
        ends.append(env.get_state())
    for name, value in ends[0].items():
        assert np.asarray(value).tobytes() == np.asarray(ends[1][name]).tobytes()


def test_window_opens_and_closes_and_is_paced():
    env = begun("human")
    assert pygame.display.get_surface().get_size() == SIZE
    began = time.perf_counter()
    for _ in range(4):
        env.step(env.action_space.sample())
    # Three whole intervals lie between the four frames.
    assert time.perf_counter() - began > 3.0 / env.metadata["render_fps"]
    assert env.render() is None
    env.close()
    assert not pygame.display.get_init()
    env.close()


def test_window_that_its_user_closes_stays_closed():
    env = begun("human")
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    for _ in range(3):
        env.step(env.action_space.sample())
    assert not pygame.display.get_init()
    env.close()


def test_window_shows_several_lanes():
    envs = begun("human", MovingMassVectorEnv, num_envs=3)
    envs.step(envs.action_space.sample())
    assert envs.render() is None
    width, height = pygame.display.get_surface().get_size()
    assert (width, height) == (2 * SIZE[0], 2 * SIZE[1])
    pixels = pygame.surfarray.array3d(pygame.display.get_surface())
    assert (pixels[: SIZE[0], : SIZE[1]] != pixels[SIZE[0] :, : SIZE[1]]).any()
    envs.close()
    envs.close()


@pytest.mark.parametrize("mode", ["rgb_array", "rgb_array_list"])
def test_native_vector_draws_what_single_environments_do(mode):
    name = "mm_gym/PreStretch-v0"
    made = [gymnasium.make_vec(name, 2, kind, render_mode=mode) for kind in ("sync", None)]
    frames = []
    for envs in made:
        envs.reset(seed=0)
        for k in range(3):
            envs.step(np.full((2, 1), 0.3 * k, np.float32))
        frames.append(envs.render())
        assert isinstance(frames[-1], tuple)
        envs.close()
    np.testing.assert_array_equal(*frames)


def test_stable_baselines_gets_the_pictures():
    envs = make_vec_env("mm_gym/PreStretch-v0", 2, render_mode="rgb_array")
    envs.reset()
    images = envs.get_images()
    assert [image.shape for image in images] == [SHAPE, SHAPE]
    assert envs.render().shape == (2 * SHAPE[0], SHAPE[1], 3)
    assert envs.metadata["render_fps"] == 15
    envs.close()


@pytest.mark.parametrize("kind", [MovingMassEnv, MovingMassVectorEnv])
def test_pickled_environment_goes_on_drawing(kind):
    env = begun("rgb_array", kind)
    env.step(env.action_space.sample())
    env.render()
    other = pickle.loads(pickle.dumps(env))  # noqa: S301 - just written
    action = env.action_space.sample()
    for one in (env, other):
        one.step(action)
    np.testing.assert_array_equal(one.state, env.state)
    pictures = [np.asarray(one.render()) for one in (env, other)]
    assert pictures[0].shape == pictures[1].shape
    # Their charts differ, because the past is not pickled; the mechanism, in the middle, does not.
    middle = slice(100, 190), slice(0, 480)
    np.testing.assert_array_equal(*(p.reshape(SHAPE)[middle] for p in pictures))


def test_programs_that_quit_pygame_do_not_disturb_the_pictures():
    env = begun("rgb_array")
    before = env.render()
    pygame.quit()
    pygame.font.init()
    env.step(np.zeros(1, np.float32))
    assert (env.render() != before).any()


def test_nothing_is_drawn_without_a_mode():
    env = begun(None)
    assert env.render() is None
    assert MovingMassVectorEnv(SCENE, 2).render() is None
    env.close()


@pytest.mark.parametrize("kind", [MovingMassEnv, MovingMassVectorEnv])
def test_unknown_mode_is_warned_of_with_the_nearest_and_draws_nothing(kind):
    words = "render_mode: got 'rgb_arry'; did you mean 'rgb_array'"
    with pytest.warns(UserWarning, match=words):
        env = kind(SCENE, render_mode="rgb_arry")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    with pytest.raises(SceneError, match=words):
        env.render()


def test_nothing_can_be_drawn_before_the_first_reset():
    with pytest.raises(ResetNeeded, match="reset"):
        MovingMassEnv(SCENE, render_mode="rgb_array").render()
    assert MovingMassEnv(SCENE, render_mode="rgb_array_list").render() == []


def test_gymnasium_makes_lists_of_pictures_with_a_wrapper_of_its_own():
    env = gymnasium.make("mm_gym/PreStretch-v0", render_mode="rgb_array_list")
    assert (env.render_mode, env.unwrapped.render_mode) == ("rgb_array_list", "rgb_array")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    assert [frame.shape for frame in env.render()] == [SHAPE, SHAPE]


def test_missing_pygame_is_named_with_its_extra(monkeypatch):
    env = begun("rgb_array")
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(DependencyNotInstalled, match="extra `render`"):
        env.render()


def test_pygame_is_imported_with_the_first_picture():
    program = """
import sys, gymnasium, mm_gym
env = gymnasium.make("mm_gym/PreStretch-v0", render_mode="rgb_array")
env.reset(seed=0)
env.step(env.action_space.sample())
print("pygame" in sys.modules)
env.render()
print("pygame" in sys.modules)
"""
    # pygame's own greeting is not printed.
    assert run(program).split() == ["False", "True"]


def test_keys_command_every_actuator_to_its_ends():
    env = gymnasium.make("mm_gym/Hybrid-v0")
    keys = env.unwrapped.get_keys_to_action()
    assert all(action in env.action_space for action in keys.values())
    assert keys[pygame.K_RIGHT,].tolist() == [1.0, 0.0]
    assert keys[pygame.K_LEFT, pygame.K_DOWN].tolist() == [-1.0, -1.0]
    assert len(keys) == 8
    assert len(begun(None).get_keys_to_action()) == 2
