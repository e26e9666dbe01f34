"""Programs that show, record and control environments, but do not know this package."""

import warnings

import gymnasium
import numpy as np
import pygame
import pytest
from gymnasium import wrappers
from gymnasium.wrappers import vector
from stable_baselines3.common.vec_env import VecVideoRecorder

from mm_gym.rendering.look import SIZE
from mm_gym.sb3 import make_vec_env

NAME = "mm_gym/PreStretch-v0"
SHAPE = (SIZE[1], SIZE[0], 3)

# The encoder that moviepy starts is waited for by its own thread.
pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")


def steps(env, count):
    env.reset(seed=0)
    for _ in range(count):
        observation, *_ = env.step(env.action_space.sample())
    return observation


def test_observations_can_be_pictures():
    env = wrappers.AddRenderObservation(gymnasium.make(NAME, render_mode="rgb_array"))
    assert steps(env, 2) in env.observation_space
    assert env.observation_space.shape == SHAPE


@pytest.mark.parametrize("mode", ["rgb_array", "rgb_array_list"])
def test_gymnasium_shows_pictures_in_its_own_window(mode):
    env = wrappers.HumanRendering(gymnasium.make(NAME, render_mode=mode))
    steps(env, 2)
    assert pygame.display.get_surface().get_size() == SIZE
    env.close()


def test_gymnasium_records_a_video(tmp_path):
    env = gymnasium.make(NAME, render_mode="rgb_array")
    env = wrappers.RecordVideo(env, str(tmp_path / "new"), episode_trigger=lambda _: True)
    steps(env, 5)
    env.close()
    (video,) = (tmp_path / "new").iterdir()
    assert video.stat().st_size > 1000


def test_gymnasium_records_a_video_of_lanes(tmp_path):
    envs = gymnasium.make_vec(NAME, 2, render_mode="rgb_array")
    envs = vector.RecordVideo(envs, str(tmp_path / "new"), step_trigger=lambda k: k == 0)
    steps(envs, 5)
    envs.close()
    (video,) = (tmp_path / "new").iterdir()
    assert video.stat().st_size > 1000


def test_stable_baselines_records_a_video(tmp_path):
    envs = make_vec_env(NAME, 2, render_mode="rgb_array")
    envs = VecVideoRecorder(envs, str(tmp_path), lambda k: k == 0, video_length=3)
    envs.reset()
    for _ in range(5):
        envs.step(np.zeros((2, 1), np.float32))
    assert envs.frames_per_sec == 15
    envs.close()
    (video,) = tmp_path.iterdir()
    assert video.stat().st_size > 1000


def test_gymnasium_plays_with_the_keyboard():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it looks for a window of matplotlib, too
        from gymnasium.utils.play import play  # noqa: PLC0415 - the warning
    actions = []

    def watch(_before, _after, action, *_):
        actions.append(float(action[0]))
        if len(actions) == 2:
            pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.K_LEFT))
        if len(actions) == 4:
            pygame.event.post(pygame.event.Event(pygame.QUIT))

    env = gymnasium.make(NAME, render_mode="rgb_array")
    play(env, callback=watch, noop=np.zeros(1, np.float32), seed=0)
    assert actions == [0.0, 0.0, -1.0, -1.0]
