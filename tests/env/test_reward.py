"""Actions and rewards, recomputed from the states that the environment returns."""

import numpy as np
import pytest

from mm_gym import MovingMassEnv, Scene, simulate

BOTH = Scene(
    springs={"kind": "small_on_large", "stretch": 2.0},
    excitation=[{"kind": "harmonic", "amplitude": 1.0, "frequency": 50.0}],
    initial={"carriage_displacement": [-0.01, 0.01]},
    actuation={
        "force": {"limit": 3.0, "rate_limit": 120.0},
        "stretch": {"minimum": 1.2, "maximum": 2.8, "rate_limit": 4.0},
    },
    objective={
        "displacement_weight": 1.5,
        "displacement_scale": 0.004,
        "velocity_weight": 0.3,
        "velocity_scale": 0.2,
        "effort_weight": 0.07,
        "stroke_weight": 0.9,
        "stroke_scale": 0.013,
        "displacement_limit": 0.02,
        "rail_half_length": 0.05,
    },
    sensors={
        "channels": [
            "carriage_displacement",
            "sphere_displacement",
            "sphere_offset",
            "carriage_velocity",
            "sphere_velocity",
            "slip_velocity",
            "stretch",
        ],
        "history": 3,
    },
    control={"steps": 120},
)


@pytest.fixture
def env():
    made = MovingMassEnv(BOTH)
    made.reset(seed=2)
    return made


def random_actions(steps=100):
    return np.random.default_rng(1).uniform(-1.4, 1.4, (steps, 2)).astype(np.float32)


def test_reward_is_the_documented_sum(env):
    o = BOTH.objective
    for action in random_actions():
        _, reward, terminated, _, info = env.step(action)
        x1, x2, v1, _ = info["state"]
        a = np.clip(action.astype(float), -1.0, 1.0)
        expected = -(
            o.displacement_weight * (x1 / o.displacement_scale) ** 2
            + o.velocity_weight * (v1 / o.velocity_scale) ** 2
            + o.effort_weight * (a**2).sum()
            + o.stroke_weight * ((x2 - x1) / o.stroke_scale) ** 2
        )
        # Four products of a few factors each, all of one sign.
        assert reward == pytest.approx(expected, rel=1e-14)
        if terminated:
            env.reset()


def test_observation_is_the_scaled_state_of_the_last_frames(env):
    o, stretch = BOTH.objective, BOTH.actuation.stretch
    frames = []
    for action in random_actions(60):
        observation, _, terminated, _, info = env.step(action)
        x1, x2, v1, v2 = info["state"]
        middle = (stretch.maximum + stretch.minimum) / 2
        frames.append(
            [
                x1 / o.displacement_scale,
                x2 / o.displacement_scale,
                (x2 - x1) / o.stroke_scale,
                v1 / o.velocity_scale,
                v2 / o.velocity_scale,
                (v2 - v1) / o.velocity_scale,
                (info["applied"][1] - middle) / (stretch.maximum - middle),
            ]
        )
        if len(frames) >= 3:
            # Rounded to single precision, 6e-8.
            assert observation == pytest.approx(np.concatenate(frames[-3:]), rel=1e-7, abs=1e-12)
        if terminated:
            env.reset()
            frames.clear()
    assert len(frames) >= 3


def test_episode_begins_with_its_first_frame_repeated(env):
    observation, _ = env.reset()
    first, second, third = observation.reshape(3, 7)
    assert np.array_equal(first, second)
    assert np.array_equal(second, third)


def test_actuators_keep_their_limits_and_rates(env):
    previous = np.array([0.0, 2.0])
    rate = np.array([120.0, 4.0]) * BOTH.control.time_step
    low, high = np.array([-3.0, 1.2]), np.array([3.0, 2.8])
    for action in np.repeat(random_actions(20), 5, axis=0):
        _, _, terminated, _, info = env.step(action)
        applied = info["applied"]
        a = np.clip(action.astype(float), -1.0, 1.0)
        wanted = np.array([3.0 * a[0], 2.0 + 0.8 * a[1]])
        reached = np.clip(wanted, previous - rate, previous + rate)
        assert applied == pytest.approx(np.clip(reached, low, high), rel=1e-14, abs=1e-14)
        previous = applied
        if terminated:
            env.reset()
            previous = np.array([0.0, 2.0])


def test_stretch_commanded_as_a_rate_integrates():
    scene = BOTH.replace(**{"actuation.stretch.command": "rate", "actuation.force": None})
    env = MovingMassEnv(scene)
    env.reset(seed=0)
    expected = 2.0
    for action in (0.5, 1.0, 1.0, -0.25, *[1.0] * 30, -1.0):
        _, _, _, _, info = env.step(np.array([action], np.float32))
        expected = min(max(expected + 0.04 * action, 1.2), 2.8)
        assert info["applied"][0] == pytest.approx(expected, rel=1e-14)


def test_episode_is_truncated_after_its_steps():
    env = MovingMassEnv(BOTH.replace(**{"objective.displacement_limit": None}))
    env.reset(seed=0, options={"initial.carriage_displacement": 0.0})
    for n in range(1, 121):
        _, _, terminated, truncated, _ = env.step(np.zeros(2, np.float32))
        assert not terminated
        assert truncated is (n == 120)


@pytest.mark.parametrize(
    ("field", "start", "terminates"),
    [
        ("displacement_limit", 0.0199, False),
        ("displacement_limit", -0.0201, True),
        ("displacement_limit", 0.0201, True),
        ("rail_half_length", 0.0199, False),
        ("rail_half_length", 0.0201, True),
        ("rail_half_length", -0.0201, True),
    ],
)
def test_episode_terminates_beyond_its_limits(field, start, terminates):
    # In a step of 1e-6 s nothing moves by more than 1e-8 m.
    scene = Scene(
        actuation={"force": {}}, objective={field: 0.02}, control={"time_step": 1e-6, "steps": 5}
    )
    env = MovingMassEnv(scene)
    name = "carriage_displacement" if field == "displacement_limit" else "sphere_offset"
    env.reset(seed=0, options={f"initial.{name}": start})
    _, _, terminated, truncated, _ = env.step(np.zeros(1, np.float32))
    assert terminated is terminates
    assert truncated is False


def test_environment_moves_as_the_simulation_does(env):
    env.reset(seed=5)
    start = env.state
    actions = np.clip(random_actions(30), -1, 1).astype(np.float64)
    states = [start]
    for action in actions:
        _, _, terminated, _, info = env.step(action)
        assert not terminated
        states.append(info["state"])
    wanted = actions * [3.0, 0.8] + [0.0, 2.0]
    scene = BOTH.replace(**{"initial.carriage_displacement": float(start[0])})
    trajectory = simulate(scene, action=wanted, duration=0.3)
    # The same kernels; only the wanted stretch is rounded twice.
    assert np.abs(trajectory.state - states).max() <= 1e-14
