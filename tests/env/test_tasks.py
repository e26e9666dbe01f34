"""Is every registered task what its file says, and the same in a vector as alone?"""

import re
from pathlib import Path

import numpy as np
import pytest

from mm_gym import MovingMassEnv, MovingMassVectorEnv, load_scene
from mm_gym.env.tasks import TASKS

FILES = Path(__file__).parents[2] / "configs" / "scenes"


def file_of(name):
    words = re.findall("[A-Z][a-z]+", name.partition("/")[2])
    return FILES / f"{'_'.join(words).lower()}.toml"


@pytest.mark.parametrize("name", TASKS)
def test_file_holds_the_registered_scene(name):
    assert load_scene(file_of(name)) == TASKS[name]


def test_every_scene_file_is_a_task():
    assert set(FILES.glob("*.toml")) == {file_of(name) for name in TASKS}


@pytest.mark.parametrize("name", TASKS)
def test_lanes_of_a_task_equal_single_environments(name):
    native = MovingMassVectorEnv(TASKS[name], 3)
    singles = [MovingMassEnv(TASKS[name]) for _ in range(3)]
    observations, _ = native.reset(seed=5)
    for i, env in enumerate(singles):
        assert env.reset(seed=5 + i)[0].tobytes() == observations[i].tobytes()
    shape = (60, *native.action_space.shape)
    for actions in np.random.default_rng(0).uniform(-1.3, 1.3, shape).astype(np.float32):
        observations, rewards, *_, info = native.step(actions)
        for i, env in enumerate(singles):
            observation, reward, *_, single_info = env.step(actions[i])
            assert observation.tobytes() == observations[i].tobytes()
            assert reward == rewards[i]
            for key in ("state", "applied"):
                assert single_info[key].tobytes() == info[key][i].tobytes()
