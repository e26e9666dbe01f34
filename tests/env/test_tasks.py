"""A task is one file: its name is the id, and whatever takes a scene takes the id."""

import shutil

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from tasks import CARRIAGE_FORCE

from mm_gym import MovingMassEnv, MovingMassVectorEnv, SceneError, load_scene, tasks
from mm_gym.env.registration import register_envs

FILES = sorted(tasks.FOLDER.rglob("*.toml"))


def test_every_file_is_a_registered_task_that_loads():
    registered = {name for name in gymnasium.registry if name.startswith("mm_gym/")}
    assert registered == {*tasks.ids(), *tasks.robust_ids()}
    assert {tasks.path_of(name): load_scene(name) for name in registered} == {
        file: load_scene(file) for file in FILES
    }


@pytest.mark.parametrize("name", tasks.ids())
def test_second_line_of_a_file_says_what_the_task_is(name):
    line = tasks.path_of(name).read_text("utf-8").splitlines()[1]
    assert line.startswith(f"# {name}: ")
    assert line.endswith(".")


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("pre_stretch", "mm_gym/PreStretch-v0"),
        ("pre_stretch_v1", "mm_gym/PreStretch-v1"),
        ("a_very_long_name_v12", "mm_gym/AVeryLongName-v12"),
        ("pre_vibrated", "mm_gym/PreVibrated-v0"),
    ],
)
def test_name_of_a_file_gives_the_id(tmp_path, monkeypatch, file, name):
    monkeypatch.setattr(tasks, "FOLDER", tmp_path)
    (tmp_path / f"{file}.toml").touch()
    assert tasks.ids() == [name]
    assert tasks.path_of(name) == tmp_path / f"{file}.toml"


def test_one_file_adds_a_task(tmp_path, monkeypatch):
    folder, name = tmp_path / "tasks", "mm_gym/SkyHook-v3"
    shutil.copytree(tasks.FOLDER, folder)
    (folder / "sky_hook_v3.toml").write_text("[actuation.force]\nlimit = 7.0\n", "utf-8")
    monkeypatch.setattr(tasks, "FOLDER", folder)
    monkeypatch.setattr(gymnasium.envs.registration, "registry", dict(gymnasium.registry))
    monkeypatch.setattr(gymnasium, "registry", gymnasium.envs.registration.registry)
    register_envs()
    assert name in tasks.ids()
    assert len([*tasks.ids(), *tasks.robust_ids()]) == len(FILES) + 1
    for env in (gymnasium.make(name), gymnasium.make_vec(name, 2), MovingMassEnv(name)):
        env.reset(seed=0)
        env.step(env.action_space.sample())
        assert env.unwrapped.scene.actuation.force.limit == 7.0


def test_registering_again_changes_nothing():
    before = dict(gymnasium.registry)
    register_envs()
    assert gymnasium.registry == before


@pytest.mark.parametrize("name", tasks.ids())
def test_specification_goes_through_json(name):
    spec = gymnasium.spec(name)
    assert EnvSpec.from_json(spec.to_json()) == spec
    single = gymnasium.make(name)
    again = gymnasium.make(EnvSpec.from_json(single.spec.to_json()))
    assert again.spec == single.spec
    assert again.unwrapped.scene == single.unwrapped.scene == load_scene(name)
    vector = gymnasium.make_vec(name, 3, autoreset_mode="SameStep")
    again = gymnasium.make_vec(EnvSpec.from_json(vector.spec.to_json()))
    assert again.spec == vector.spec
    assert again.num_envs == 3
    assert again.metadata == vector.metadata
    assert again.unwrapped.scene == load_scene(name)


@pytest.mark.parametrize(
    "use",
    [
        load_scene,
        MovingMassEnv,
        MovingMassVectorEnv,
        lambda name: gymnasium.make("mm_gym/CarriageForce-v0", scene=name),
    ],
    ids=["load_scene", "single", "vector", "make"],
)
@pytest.mark.parametrize(
    ("name", "nearest"),
    [
        ("mm_gym/PreStrech-v0", "mm_gym/PreStretch-v0"),
        ("mm_gym/PreStretch", "mm_gym/PreStretch-v0"),
        ("mm_gym/prestretch-v0", "mm_gym/PreStretch-v0"),
        ("CarriageForce-v0", "mm_gym/CarriageForce-v0"),
        ("mm-gym/Hybrid-v0", "mm_gym/Hybrid-v0"),
    ],
)
def test_misspelt_id_is_answered_with_the_nearest(use, name, nearest):
    words = f"^task: '{name}' is not a task of mm_gym; did you mean '{nearest}'.; allowed: mm_gym/"
    with pytest.raises(SceneError, match=words):
        use(name)


def test_path_that_looks_like_an_id_in_part_is_a_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mm_gym" / "tasks").mkdir(parents=True)
    for path in ("mm_gym/tasks/mine.toml", "mm_gym/mine.toml", "mine-v0.toml"):
        (tmp_path / path).write_text("[carriage]\nmass = 0.3\n", "utf-8")
        assert load_scene(path).carriage.mass == 0.3


def test_scene_given_beside_an_id_is_the_one_used():
    scene = CARRIAGE_FORCE.replace(**{"control.steps": 7})
    for given in (scene, "mm_gym/Hybrid-v0", str(tasks.path_of("mm_gym/Hybrid-v0"))):
        env = gymnasium.make("mm_gym/CarriageForce-v0", scene=given).unwrapped
        assert env.scene == (scene if given is scene else load_scene("mm_gym/Hybrid-v0"))


@pytest.mark.parametrize("name", tasks.ids())
def test_lanes_of_a_task_equal_single_environments(name):
    native = MovingMassVectorEnv(name, 3)
    singles = [MovingMassEnv(name) for _ in range(3)]
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
