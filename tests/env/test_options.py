"""Scene, seed and options of a reset: each is used as given; a bad one changes nothing."""

import numpy as np
import pytest
from rollouts import random_actions, rollout
from tasks import PRE_STRETCH

from mm_gym import MovingMassVectorEnv, Scene, SceneError


@pytest.mark.parametrize("name", ["initial.stretch", "initial.sphere_offset"])
def test_what_a_step_changes_is_not_called_drawn(make, name):
    with pytest.raises(SceneError, match=rf"{name}: changes in every step"):
        make(PRE_STRETCH).drawn(name)


def test_options_fix_what_would_be_drawn(make):
    env = make(PRE_STRETCH)
    options = {
        "excitation.0.frequency": 50.0,
        "initial.stretch": 2.0,
        "initial.carriage_displacement": 0.003,
        "initial.sphere_offset": -0.001,
        "initial.sphere_velocity": 0.2,
    }
    _, info = env.reset(seed=0, options=options)
    assert np.all(info["applied"] == 2.0)
    assert np.all(env.drawn("excitation.0.frequency") == 50.0)
    expected = np.array([0.003, 0.003 - 0.001, 0.0, 0.2])
    assert (np.atleast_2d(env.state) == expected).all()


def test_options_do_not_disturb_the_stream(make, assert_same):
    env, twin = make(PRE_STRETCH), make(PRE_STRETCH)
    env.reset(seed=0, options={"excitation.0.frequency": 50.0})
    twin.reset(seed=0)
    assert np.all(env.drawn("excitation.0.phase") == twin.drawn("excitation.0.phase"))
    assert_same(env.reset(), twin.reset())


def test_options_of_the_vector_may_differ_by_lane():
    env = MovingMassVectorEnv(PRE_STRETCH, 3)
    frequencies = np.array([45.0, 55.0, 65.0])
    env.reset(seed=0, options={"excitation.0.frequency": frequencies})
    assert (env.drawn("excitation.0.frequency") == frequencies).all()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"excitation.0.frequncy": 50.0}, "did you mean 'excitation.0.frequency'"),
        ({"excitation.0.frequency": 100.0}, "excitation.0.frequency: got 100.0; allowed: 44 to 71"),
        ({"excitation.0.frequency": np.nan}, "excitation.0.frequency: got nan"),
        ({"excitation.0.frequency": "50"}, "excitation.0.frequency: got"),
        ({"excitation.0.frequency": 1j}, "excitation.0.frequency: got"),
        ({"excitation.0.frequency": None}, "excitation.0.frequency: got"),
        ({"excitation.0.frequency": [50.0] * 7}, "excitation.0.frequency: got"),
        ({"initial.carriage_displacement": np.inf}, "initial.carriage_displacement: got inf"),
        ({"initial.stretch": 3.5}, "initial.stretch: got 3.5; allowed: 1 to 3"),
        ({"carriage.mass": 0.2}, "carriage.mass: got 0.2; allowed: 0.1 to 0.1"),
        ({"initial.stretch": [1, [2]]}, "initial.stretch: got [1, [2]]"),
        ({"seed": 3}, "seed: not a field"),
        ({3: 3.0}, "3: not a field"),
        ([], "options: got []; allowed: a dictionary"),
        (3, "options: got 3; allowed: a dictionary"),
    ],
    ids=str,
)
def test_bad_options_are_refused_and_change_nothing(make, options, words, assert_same):
    env = make(PRE_STRETCH)
    env.reset(seed=0)
    rollout(env, random_actions(env, 2))
    before = env.get_state()
    with pytest.raises(SceneError) as caught:
        env.reset(seed=5, options=options)
    assert words in str(caught.value)
    assert_same(before, env.get_state())


@pytest.mark.parametrize("seed", [-1, 0.5, "1"])
def test_bad_seed_is_refused_and_changes_nothing(make, scene, seed, assert_same):
    env = make(scene)
    env.reset(seed=0)
    before = env.get_state()
    with pytest.raises(Exception, match=r"[Ss]eed|integer"):  # Gymnasium's own errors, and ours
        env.reset(seed=seed)
    assert_same(before, env.get_state())


def test_scene_is_needed_and_needs_an_actuator(make, tmp_path):
    with pytest.raises(SceneError, match="needs an actuator"):
        make(Scene())
    with pytest.raises(SceneError, match="scene: got dict"):
        make({"carriage": {}})
    with pytest.raises(SceneError, match="no such file"):
        make(tmp_path / "scene.toml")


def test_scene_may_be_a_file(make, tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text("[actuation.force]\nlimit = 2.0\n", "utf-8")
    for path in (file, str(file)):
        assert make(path).scene.actuation.force.limit == 2.0
