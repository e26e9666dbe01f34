"""What an environment is made from: single changes, the number of its steps, its specification."""

import json
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import TimeAwareObservation, TimeLimit
from tasks import CARRIAGE_FORCE, HYBRID, TASKS

from mm_gym import MovingMassEnv, MovingMassVectorEnv, SceneError, load_scene
from mm_gym.sb3 import make_vec_env
from mm_gym.tasks import path_of

NAME = "mm_gym/CarriageForce-v0"
STEPS = CARRIAGE_FORCE.control.steps
SHORT = CARRIAGE_FORCE.replace(**{"control.steps": 9})


def lasts(env):
    """Control steps of an episode, of one environment or the first lane of several."""
    env.reset(seed=0)
    for step in range(1, 2 * HYBRID.control.steps):
        _, _, terminated, truncated, _ = env.step(np.zeros(env.action_space.shape, np.float32))
        if np.any(terminated | truncated):
            return step
    return None


@pytest.mark.parametrize("name", TASKS)
def test_number_of_steps_in_the_specification_is_that_of_the_scene(name):
    assert gymnasium.make(name).spec.max_episode_steps == TASKS[name].control.steps


MADE = [
    ({}, STEPS),
    ({"max_episode_steps": 7}, 7),
    ({"changes": {"control.steps": 50}}, 50),
    ({"changes": {"control.steps": 2 * STEPS}}, 2 * STEPS),
    ({"changes": {"control.steps": 30}, "max_episode_steps": 30}, 30),
    ({"changes": {"control.steps": 30}, "max_episode_steps": 20}, 20),
    ({"changes": {"control.steps": 2 * STEPS}, "max_episode_steps": STEPS + 9}, STEPS + 9),
    ({"scene": "mm_gym/Hybrid-v0"}, HYBRID.control.steps),
    ({"scene": path_of("mm_gym/Hybrid-v0")}, HYBRID.control.steps),
    ({"scene": SHORT}, 9),
    ({"scene": SHORT, "max_episode_steps": 7}, 7),
    ({"scene": SHORT, "changes": {"control.steps": 11}}, 11),
    ({"scene": path_of("mm_gym/Hybrid-v0"), "max_episode_steps": 8}, 8),
]


@pytest.mark.parametrize(("arguments", "steps"), MADE)
def test_episodes_last_as_long_as_asked_for_however_they_are_made(arguments, steps):
    single = gymnasium.make(NAME, **arguments)
    assert lasts(single) == single.spec.max_episode_steps
    again = gymnasium.make(EnvSpec.from_json(single.spec.to_json()))
    vector = gymnasium.make_vec(NAME, 2, **arguments, autoreset_mode=AutoresetMode.DISABLED)
    more = gymnasium.make_vec(EnvSpec.from_json(vector.spec.to_json()))
    sync = gymnasium.make_vec(NAME, 2, "sync", **arguments)
    assert {lasts(env) for env in (single, again, vector, more, sync)} == {steps}
    assert again.unwrapped.scene == single.unwrapped.scene
    assert more.unwrapped.scene == vector.unwrapped.scene
    assert (again.spec, more.spec) == (single.spec, vector.spec)
    assert vector.spec.max_episode_steps == steps


@pytest.mark.parametrize(("arguments", "steps"), MADE)
def test_observed_time_ends_with_the_episode(arguments, steps):
    env = TimeAwareObservation(gymnasium.make(NAME, **arguments))
    assert env.max_timesteps == steps


@pytest.mark.parametrize("limit", [{}, {"max_episode_steps": -1}])
def test_without_a_limit_of_gymnasiums_the_scene_alone_ends_episodes(limit):
    given = {"changes": {"control.steps": 2 * STEPS}} | limit
    single = gymnasium.make(NAME, **given)
    vector = gymnasium.make_vec(NAME, 2, **given, autoreset_mode=AutoresetMode.DISABLED)
    assert lasts(single) == lasts(vector) == 2 * STEPS
    wrapper = single
    while wrapper is not wrapper.unwrapped:
        assert not isinstance(wrapper, TimeLimit)
        wrapper = wrapper.env


def test_time_limit_of_ones_own_is_left_alone():
    env = TimeLimit(gymnasium.make(NAME, changes={"control.steps": 2 * STEPS}), 12)
    assert lasts(env) == 12


def test_registration_of_ones_own_sets_the_steps(monkeypatch):
    registry = dict(gymnasium.registry)
    monkeypatch.setattr(gymnasium.envs.registration, "registry", registry)
    for steps, lasting in ((5, 5), (2 * STEPS, STEPS)):
        name = f"Mine{steps}-v0"
        gymnasium.register(
            name, "mm_gym:MovingMassEnv", max_episode_steps=steps, kwargs={"scene": NAME}
        )
        assert lasts(gymnasium.make(name)) == lasting


def test_limit_does_not_lengthen_episodes_and_is_refused_where_the_environment_is_told():
    longer = {"changes": {"control.steps": 20}, "max_episode_steps": 30}
    assert lasts(gymnasium.make(NAME, **longer)) == 20
    words = (
        r"max_episode_steps: got 30; allowed: 1 to 20, the scene's control\.steps; "
        r"for longer episodes pass changes=\{'control\.steps': 30\}"
    )
    with pytest.raises(SceneError, match=words):
        gymnasium.make_vec(NAME, 2, **longer)


def test_shortened_vector_moves_as_an_environment_that_gymnasium_cuts():
    single = gymnasium.make(NAME, max_episode_steps=5)
    vector = gymnasium.make_vec(NAME, 2, max_episode_steps=5)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 1)).astype(np.float32)
    single.reset(seed=3)
    vector.reset(seed=3)
    for action in actions:
        one, several = single.step(action), vector.step(np.array([action, action]))
        for mine, theirs in zip(one[:4], several[:4], strict=True):
            np.testing.assert_array_equal(mine, theirs[0])
    assert one[3]


@pytest.mark.parametrize("steps", [0, -3, 2.5, True])
def test_number_of_steps_is_checked(steps):
    with pytest.raises(SceneError, match=f"max_episode_steps: got {steps}"):
        MovingMassVectorEnv(NAME, 2, max_episode_steps=steps)


def test_number_of_steps_of_a_vector_may_be_of_numpy():
    assert lasts(MovingMassVectorEnv(NAME, 2, max_episode_steps=np.int64(6))) == 6


CHANGES = {
    "control.steps": 13,
    "carriage.cubic_coefficient": 2e6,
    "initial.carriage_displacement": [-0.002, 0.003],
    "actuation.force.rate_limit": 50.0,
}


@pytest.mark.parametrize(
    "make",
    [
        lambda **changes: MovingMassEnv(NAME, **changes),
        lambda **changes: MovingMassVectorEnv(CARRIAGE_FORCE, 2, **changes),
        lambda **changes: gymnasium.make(NAME, **changes),
        lambda **changes: gymnasium.make_vec(NAME, 2, **changes),
        lambda **changes: gymnasium.make_vec(NAME, 2, "sync", **changes).envs[0],
        lambda **changes: make_vec_env(NAME, 2, **changes).env,
    ],
    ids=["single", "vector", "make", "make_vec", "sync", "sb3"],
)
def test_fields_change_by_dotted_name_wherever_a_scene_is_chosen(make):
    expected = load_scene(NAME).replace(**CHANGES)
    assert make(changes=json.loads(json.dumps(CHANGES))).unwrapped.scene == expected
    with pytest.raises(SceneError) as caught:
        make(changes={"control.stepz": 3, "carriage.mass": "heavy"})
    assert sorted(str(caught.value).splitlines()) == [
        "carriage.mass: got 'heavy'; allowed: a number",
        "control.stepz: unknown key; did you mean 'steps'?; allowed: time_step, steps",
    ]


@pytest.mark.parametrize("changes", [["control.steps"], "control.steps", {1: 2}, 3])
def test_changes_are_a_dictionary(changes):
    with pytest.raises(SceneError, match=r"changes: got .*; allowed: a dictionary of val"):
        MovingMassEnv(NAME, changes=changes)


def test_change_of_a_drawn_field_is_refused_unless_it_is_drawn_no_more():
    """The draw would take the place of the number at every reset."""
    name, changes = "mm_gym/PreStretchRobust-v0", {"carriage.mass": 2.0}
    with pytest.raises(SceneError) as caught:
        MovingMassEnv(name, changes=changes)
    allowed = "randomization.carriage.mass, as the scene draws this field"
    assert str(caught.value) == f"changes: carriage.mass: got 2.0; allowed: {allowed}"
    fixed = MovingMassEnv(name, changes=changes | {"randomization": {}})
    assert fixed.scene.carriage.mass == 2.0
    wider = MovingMassEnv(name, changes={"randomization.carriage.mass": [1.0, 2.0]})
    assert wider.scene.randomization["carriage.mass"] == (1.0, 2.0)


def test_scene_is_a_scene_a_name_or_a_path():
    file = path_of(NAME)
    given = [CARRIAGE_FORCE, NAME, file, str(file)]
    assert {MovingMassEnv(scene).scene.digest for scene in given} == {CARRIAGE_FORCE.digest}
    assert Path(file).is_file()
    with pytest.raises(
        SceneError, match="scene: got int; allowed: a Scene, the id of a task or the path"
    ):
        MovingMassEnv(3)


def test_environment_made_directly_has_no_specification():
    for env in (MovingMassEnv(NAME), MovingMassVectorEnv(NAME, 2)):
        assert env.spec is None
