"""The bounds of observations hold for every observation, or are infinite."""

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import RescaleObservation
from hypothesis import given
from hypothesis import strategies as st
from tasks import CARRIAGE_FORCE, HYBRID, PRE_STRETCH, TASKS

from mm_gym import MovingMassEnv, MovingMassVectorEnv, Scene, SceneError

BIGGEST = np.finfo(np.float32).max


@pytest.mark.parametrize("name", TASKS)
def test_only_what_actuators_apply_is_bounded(name):
    space, scene = gymnasium.make(name).observation_space, TASKS[name]
    applied = [channel in ("stretch", "damping") for channel in scene.sensors.channels]
    applied = np.tile(applied, scene.sensors.history)
    assert np.array_equal(space.low, np.where(applied, np.float32(-1), -np.inf))
    assert np.array_equal(space.high, np.where(applied, np.float32(1), np.inf))


BOTH = ["stretch", "applied_force", "carriage_displacement"]


def bounds(**changes):
    scene = HYBRID.replace(**{"sensors": {"channels": BOTH}, **changes})
    space = MovingMassEnv(scene).observation_space
    return list(zip(space.low.tolist(), space.high.tolist(), strict=True))


def test_noise_has_no_bounds():
    free = (-np.inf, np.inf)
    assert bounds() == [(-1.0, 1.0), (-1.0, 1.0), free]
    assert bounds(**{"sensors.noise": {"stretch": 0.1}}) == [free, (-1.0, 1.0), free]
    assert bounds(**{"sensors.noise": {"applied_force": 0.1}}) == [(-1.0, 1.0), free, free]


def test_displacement_limits_are_no_bounds_because_an_end_exceeds_them():
    scale = CARRIAGE_FORCE.objective.displacement_scale
    env = MovingMassEnv(CARRIAGE_FORCE.replace(**{"objective.displacement_limit": scale}))
    env.reset(options={"initial.carriage_displacement": 0.0, "initial.carriage_velocity": 0.9})
    terminated = False
    while not terminated:
        observation, _, terminated, _, _ = env.step(np.ones(1, np.float32))
    assert abs(observation[0]) > 1.0
    assert observation in env.observation_space


def test_stretch_that_is_not_actuated_is_bounded_by_its_range():
    scene = Scene(
        springs={"kind": "small_on_large"},
        actuation={"force": {}},
        randomization={"springs.stretch": [1.25, 2.5]},
        sensors={"channels": ["stretch"]},
    )
    space = MovingMassEnv(scene).observation_space
    assert (space.low, space.high) == ([1.25], [2.5])
    # A box of one point could not be rescaled.
    space = MovingMassEnv(scene.replace(randomization={})).observation_space
    assert (space.low, space.high) == ([-np.inf], [np.inf])


@given(
    limit=st.floats(1e-150, 1e100),
    minimum=st.floats(1.0, 1e9),
    width=st.floats(1e-7, 1e3),
    seed=st.integers(0, 99),
)
def test_every_observation_lies_within_its_bounds(limit, minimum, width, seed):
    maximum = minimum * (1.0 + width)
    scene = PRE_STRETCH.replace(
        **{
            "excitation": [],
            "randomization": {},
            "actuation.force": {"limit": limit},
            "actuation.stretch.minimum": minimum,
            "actuation.stretch.maximum": maximum,
            "initial.stretch": [minimum, maximum],
            "initial.carriage_displacement": 0.0,
            "sensors": {"channels": ["stretch", "applied_force"], "history": 2},
        }
    )
    lanes = MovingMassVectorEnv(scene, 64)
    space = lanes.observation_space
    seen = [lanes.reset(seed=seed)[0]]
    rng = np.random.default_rng(seed)
    for _ in range(4):
        actions = rng.choice([-1.0, 1.0, -2.0, 0.3], (64, 2)).astype(np.float32)
        seen.append(lanes.step(actions)[0])
    assert all(np.ascontiguousarray(one) in space for one in seen)


@pytest.mark.parametrize("name", TASKS)
def test_fuzzed_observations_of_the_tasks_are_in_their_space(name):
    env = MovingMassVectorEnv(name, 32)
    seen = [env.reset(seed=0)[0]]
    rng = np.random.default_rng(0)
    for _ in range(50):
        actions = rng.uniform(-2.0, 2.0, env.action_space.shape).astype(np.float32)
        seen.append(env.step(actions)[0])
    assert all(np.ascontiguousarray(one) in env.observation_space for one in seen)


def test_observation_beyond_single_precision_is_its_largest_number():
    env = MovingMassEnv(CARRIAGE_FORCE)
    observation, _ = env.reset(options={"initial.carriage_displacement": 1e60})
    assert observation[0] == BIGGEST
    observation, reward, *_ = env.step(np.zeros(1, np.float32))
    assert np.isfinite(observation).all()
    assert observation in env.observation_space
    assert -1e130 < reward < -1e110
    observation, _ = env.reset(options={"initial.carriage_displacement": -1e20})
    assert observation[0] == np.float32(-1e22)


def test_applied_force_is_shown_as_a_part_of_its_limit():
    scene = CARRIAGE_FORCE.replace(
        **{"sensors.channels": ["applied_force"], "actuation.force": {"limit": 3.0, "lag": 0.02}}
    )
    env = MovingMassEnv(scene)
    assert env.reset(seed=0)[0] == [0.0]
    for action in (1.0, -0.5, 2.0):
        observation, *_, info = env.step(np.array([action], np.float32))
        assert observation[0] == pytest.approx(info["applied"][0] / 3.0, rel=1e-7)


def test_applied_force_needs_an_actuator():
    words = r"sensors\.channels: 'applied_force' needs an actuator; set actuation\.force"
    with pytest.raises(SceneError, match=words):
        PRE_STRETCH.replace(**{"sensors.channels": ["applied_force"]})


def test_bounds_can_be_rescaled_where_they_are_finite():
    scene = HYBRID.replace(sensors={"channels": ["stretch", "applied_force"]})
    env = RescaleObservation(MovingMassEnv(scene), np.float32(0), np.float32(1))
    observation, info = env.reset(seed=0)
    assert observation[0] == pytest.approx((info["applied"][1] - 1.0) / 2.0, rel=1e-6)
    assert observation[1] == 0.5
