"""Scene, seed and options of a reset: each is used as given; a bad one changes nothing."""

import numpy as np
import pytest
from rollouts import random_actions, rollout
from tasks import CARRIAGE_FORCE, PRE_STRETCH

from mm_gym import MovingMassEnv, MovingMassVectorEnv, Scene, SceneError
from mm_gym.lanes import layout


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
        ({"initial.stretch": np.ma.masked_array(2.0)}, "initial.stretch: got a masked array"),
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


STATES = ("carriage_displacement", "sphere_offset", "carriage_velocity", "sphere_velocity")
WIDE = CARRIAGE_FORCE.replace(
    initial={
        "carriage_displacement": [-0.01, 0.01],
        "sphere_offset": [-0.02, 0.02],
        "carriage_velocity": 0.1,
        "sphere_velocity": [0.1, 0.3],
    },
    randomization={"sphere.mass": [0.03, 0.05]},
)


def start_of(env):
    x1, offset, v1, v2 = (env.drawn(f"initial.{name}") for name in STATES)
    return np.array([x1, offset + x1, v1, v2])


def test_drawn_initial_state_is_that_of_each_episode_and_stays_known():
    env = MovingMassVectorEnv(WIDE, 40, max_episode_steps=7, autoreset_mode="SameStep")
    with pytest.raises(SceneError, match=r"carriage\.mass: no episode has begun"):
        env.drawn("carriage.mass")
    with pytest.raises(SceneError, match=r"initial\.sphere_offset: no episode has begun"):
        env.drawn("initial.sphere_offset")
    _, info = env.reset(seed=3)
    start = info["state"].T.copy()
    lone = MovingMassEnv(WIDE)
    lone.reset(seed=4)
    np.testing.assert_array_equal(start_of(lone), start[:, 1])
    for step in range(1, 20):
        np.testing.assert_array_equal(start_of(env), start)
        env.step(np.zeros((40, 1), np.float32))
        if step % 7 == 0:
            assert (env.state.T[0] != start[0]).all()
            start = env.state.T.copy()


def test_given_initial_state_is_what_was_given_until_the_next_episode():
    env = MovingMassVectorEnv(WIDE, 3, autoreset_mode="Disabled")
    given = {"initial.sphere_offset": [0.001, 0.002, 0.003], "initial.carriage_velocity": 0.5}
    env.reset(seed=0, options=given)
    env.step(np.zeros((3, 1), np.float32))
    np.testing.assert_array_equal(env.drawn("initial.sphere_offset"), [0.001, 0.002, 0.003])
    np.testing.assert_array_equal(env.drawn("initial.carriage_velocity"), 0.5)
    _, info = env.reset(options={"reset_mask": np.array([True, False, False])})
    first, *others = env.drawn("initial.sphere_offset")
    assert info["state"][0, 0] + first == info["state"][0, 1]
    assert others == [0.002, 0.003]
    assert env.drawn("initial.carriage_velocity").tolist() == [0.1, 0.5, 0.5]


def test_initial_state_behind_a_state_that_was_set_is_not_told():
    env = MovingMassEnv(WIDE)
    env.reset(seed=0, options={"initial.sphere_offset": 0.004})
    env.set_state(env.get_state())
    with pytest.raises(SceneError, match=r"initial\.sphere_offset: a state was set"):
        env.drawn("initial.sphere_offset")
    assert 0.03 <= env.drawn("sphere.mass") <= 0.05
    env.reset()
    assert -0.02 <= env.drawn("initial.sphere_offset") <= 0.02


def test_stretch_is_that_at_the_start_where_it_is_actuated_and_the_episodes_where_not():
    env = MovingMassEnv("mm_gym/PreStretchShock-v0")
    _, info = env.reset(seed=5)
    first = info["applied"][0]
    env.step([1.0])
    assert env.drawn("initial.stretch") == first
    held = MovingMassEnv(
        WIDE.replace(
            springs={"kind": "small_on_large", "stretch": 1.5},
            randomization={"springs.stretch": [1.0, 3.0]},
        )
    )
    held.reset(seed=5)
    assert held.drawn("springs.stretch") == held.get_state()["values"][layout.STRETCH, 0]
