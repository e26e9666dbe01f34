"""Observations and actuators, recomputed from the states that the environment returns."""

import subprocess
import sys
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest
from oracle import System

import mm_gym
from mm_gym import (
    CompileError,
    MovingMassEnv,
    MovingMassVectorEnv,
    Scene,
    SceneError,
    compile_scene,
    simulate,
)
from mm_gym.lanes import layout
from mm_gym.simulation.lanes import Lanes
from mm_gym.step.channels import CHANNELS

SHAKEN = Scene(
    carriage={"cubic_coefficient": 2e5},
    interface={
        "kind": "dry_friction",
        "static_coefficient": 0.51,
        "kinetic_coefficient": 0.4,
        "reference_velocity": 0.05,
        "slip_damping": 0.1,
    },
    springs={"kind": "finite_stretch", "rest_length": 0.05},
    excitation=[
        {"kind": "harmonic", "target": "ground", "amplitude": 3.0, "frequency": 50.0},
        {"kind": "noise", "rms": 1.0, "high_frequency": 80.0},
    ],
    initial={"carriage_displacement": [-0.01, 0.01]},
    actuation={"force": {"limit": 2.0}},
    sensors={
        "channels": [
            "carriage_acceleration",
            "sphere_acceleration",
            "spring_force",
            "disturbance_force",
            "ground_acceleration",
            "carriage_displacement",
        ]
    },
    control={"time_step": 0.01, "steps": 50},
)
QUIET = Scene(
    initial={"carriage_displacement": [-0.01, 0.01]},
    actuation={"force": {"limit": 2.0}},
    control={"time_step": 0.01, "steps": 50},
)


def rollout(scene, seed=1, steps=40):
    env = MovingMassEnv(scene)
    frames, infos = [], []
    observation, info = env.reset(seed=seed)
    rng = np.random.default_rng(0)
    for _ in range(steps):
        frames.append(observation)
        infos.append(info)
        observation, *_, info = env.step(rng.uniform(-1, 1, env.action_space.shape))
    return np.array(frames), infos


def test_shown_forces_and_accelerations_are_those_of_the_equations():
    frames, infos = rollout(SHAKEN)
    o, c = SHAKEN.objective, SHAKEN.carriage
    acceleration, force = o.velocity_scale**2 / o.displacement_scale, 400.0 * o.displacement_scale
    units = [acceleration, acceleration, force, force, acceleration, o.displacement_scale]
    a1, a2, springs, push, shake, _ = (frames * units).T
    # The same disturbance, from a simulation with the same seed.
    shown = simulate(SHAKEN, duration=0.4, seed=1).excitation[:40]
    assert np.abs(push - shown[:, 0]).max() < 1e-6 * np.abs(shown[:, 0]).max()
    assert np.abs(shake - shown[:, 1]).max() < 1e-6 * 3.0
    for k, info in enumerate(infos):
        x1, x2, v1, v2 = info["state"]
        xi, w, normal = x2 - x1, v2 - v1, 0.04 * 9.81
        long, short = 1.5 + xi / 0.05, 1.5 - xi / 0.05
        s = 35.0 * 0.05 * ((long - long**-2) - (short - short**-2))
        f = 0.51 * normal / 0.05 * w
        if abs(w) > 0.05:
            f = np.sign(w) * (0.4 * normal + 0.1 * (abs(w) - 0.05))
        outer = info["applied"][0] + push[k] - 1.0 * v1
        outer -= c.stiffness * (1.0 + c.cubic_coefficient * x1**2) * x1
        scale = 400.0 * 0.01
        # Observations are single precision.
        assert springs[k] == pytest.approx(s, abs=1e-6 * scale)
        assert a1[k] == pytest.approx((f + s + outer) / 0.1, abs=1e-6 * scale / 0.04)
        assert a2[k] == pytest.approx(-(f + s) / 0.04, abs=1e-6 * scale / 0.04)


def test_noise_is_normal_and_on_its_channel_only():
    noisy = QUIET.replace(**{"sensors.noise": {"carriage_velocity": 0.02}})
    envs = [MovingMassVectorEnv(scene, 4000) for scene in (QUIET, noisy)]
    plain, blurred = (env.reset(seed=3)[0] for env in envs)
    for _ in range(3):
        action = np.zeros((4000, 1), np.float32)
        plain, blurred = (env.step(action)[0] for env in envs)
    error = (blurred - plain) * QUIET.objective.velocity_scale
    assert not error[:, [0, 1, 3]].any()
    # 4000 samples: 1.1 % of the spread at one standard deviation, 3.5 % of skew, 7.7 % of kurtosis.
    z = error[:, 2] / 0.02
    assert abs(z.mean()) < 4 / np.sqrt(4000)
    assert abs(z.std() - 1.0) < 0.05
    assert abs((z**4).mean() - 3.0) < 0.4


def test_noise_is_new_in_every_step_and_episode():
    noisy = QUIET.replace(**{"sensors.noise": {"sphere_velocity": 0.02}, "initial": {}})
    env = MovingMassEnv(noisy)
    seen = [
        env.reset(seed=1)[0][3],
        env.step([0.0])[0][3],
        env.reset()[0][3],
        env.reset(seed=1)[0][3],
    ]
    assert len(set(seen[:3])) == 3
    assert seen[3] == seen[0]


@pytest.mark.parametrize("history", [1, 3])
def test_delayed_frames_are_those_of_earlier_steps(history):
    prompt, _ = rollout(QUIET)
    late, _ = rollout(QUIET.replace(**{"sensors.delay": 4, "sensors.history": history}))
    for k in range(4 + history, 40):
        frames = [prompt[k - 4 - age] for age in range(history - 1, -1, -1)]
        assert late[k].tobytes() == np.concatenate(frames).tobytes()
    assert late[0].tobytes() == np.tile(prompt[0], history).tobytes()


def test_lag_is_that_of_a_first_order_system():
    lagging = QUIET.replace(**{"actuation.force.lag": 0.025})
    env = MovingMassEnv(lagging)
    env.reset(seed=1)
    applied = [env.step([1.0])[-1]["applied"][0] for _ in range(20)]
    times = 0.01 * np.arange(1, 21)
    assert np.allclose(applied, 2.0 * -np.expm1(-times / 0.025), rtol=1e-14)
    assert simulate(lagging, action=2.0, duration=0.2).action[:20, 0] == pytest.approx(applied)


def test_rate_command_of_the_force_adds_up_within_its_limit():
    scene = QUIET.replace(
        **{"actuation.force": {"limit": 2.0, "rate_limit": 50.0, "command": "rate"}}
    )
    env = MovingMassEnv(scene)
    env.reset(seed=1)
    actions = [0.5, 1.0, 1.0, 1.0, 1.0, 1.0, -1.0, 0.0]
    applied = [env.step([a])[-1]["applied"][0] for a in actions]
    assert applied == pytest.approx([0.25, 0.75, 1.25, 1.75, 2.0, 2.0, 1.5, 1.5])


def test_lag_does_not_shrink_what_a_rate_commands():
    parts = {"limit": 2.0, "rate_limit": 50.0, "command": "rate", "lag": 0.03}
    env = MovingMassEnv(QUIET.replace(**{"actuation.force": parts}))
    env.reset(seed=1)
    for _ in range(2):
        env.step([1.0])
    for _ in range(47):
        info = env.step([0.0])[-1]
    assert info["applied"][0] == pytest.approx(1.0, rel=1e-5)


@pytest.mark.parametrize(
    ("fields", "finding"),
    [
        ({"sensors.noise": {"stretch": 0.1}}, "sensors.noise.stretch: has no effect"),
        ({"sensors.noise": {"carriage_velocty": 0.1}}, "sensors.noise"),
        ({"sensors.noise": {"carriage_velocity": -0.1}}, "sensors.noise.carriage_velocity"),
        ({"sensors.delay": -1}, "sensors.delay: got -1"),
        ({"actuation.force": {"command": "rate"}}, "actuation.force.rate_limit: missing"),
        ({"actuation.force": {"lag": -0.1}}, "actuation.force.lag: got -0.1"),
    ],
)
def test_findings_name_the_field(fields, finding):
    with pytest.raises(SceneError) as caught:
        QUIET.replace(**fields)
    assert finding in str(caught.value)


def test_a_massless_carriage_shows_no_acceleration():
    scene = QUIET.replace(**{"carriage.mass": 0.0, "sensors.channels": ["carriage_acceleration"]})
    with pytest.raises(CompileError, match=r"sensors\.channels: a carriage of mass 0"):
        MovingMassEnv(scene)


@pytest.mark.parametrize("noise", [{}, {"sphere_velocity": 0.02}])
def test_an_episode_does_not_depend_on_whether_its_frames_are_seen(noise):
    plant = compile_scene(QUIET.replace(**{"sensors.noise": noise}))
    seen, unseen = Lanes(plant, 3), Lanes(plant, 3)
    for lanes in (seen, unseen):
        lanes.seed(1)
        lanes.restart(seen=lanes is seen)
    assert np.array_equal(seen.values, unseen.values)
    assert np.array_equal(seen.streams, unseen.streams)


def test_documentation_lists_the_table_of_channels():
    text = (Path(__file__).parents[2] / "docs" / "excitation.md").read_text("utf-8")
    rows = [
        f"| `{name}` | {channel.meaning} | {channel.unit} | {channel.scale} |"
        for name, channel in CHANNELS.items()
    ]
    assert "\n|---|---|---|---|\n" + "\n".join(rows) + "\n\n" in text


def test_plant_says_how_its_channels_are_scaled():
    env = MovingMassEnv(SHAKEN.replace(**{"sensors.noise": {"spring_force": 0.1}}))
    plant = compile_scene(env.scene)
    assert tuple(channel.name for channel in plant.observed) == plant.channels
    spring, _, ground, carriage = plant.observed[2:]
    assert (spring.unit, spring.zero, spring.noise) == ("N", 0.0, 0.1)
    assert spring.one == pytest.approx(400.0 * SHAKEN.objective.displacement_scale, rel=1e-15)
    assert (ground.unit, carriage.unit) == ("m/s^2", "m")
    observation, info = env.reset(seed=2)
    assert observation[-1] == np.float32(info["state"][0] * carriage.factor)


def test_a_scale_that_rounds_to_zero_is_replaced_by_a_positive_one():
    scene = QUIET.replace(**{"carriage.stiffness": 5e-324, "sensors.channels": ["spring_force"]})
    (spring,) = compile_scene(scene).observed
    assert np.isfinite(spring.factor)


NEW_CHANNEL = """
import sys, types

package = types.ModuleType("mm_gym")  # so that the table alone is imported
package.__path__ = [sys.argv[1]]
sys.modules["mm_gym"] = package
from mm_gym.lanes import layout
from mm_gym.step.channels import CHANNELS, Channel
CHANNELS["push"] = Channel(
    layout.FORCE, layout.NO_ROW, "N", "force", "control force on the carriage"
)
del sys.modules["mm_gym"]

import json, mm_gym, numpy as np
from mm_gym.scene.schema import scene_schema
scene = mm_gym.Scene(
    actuation={"force": {"limit": 3.0}},
    sensors={"channels": ["carriage_displacement", "push"], "noise": {"push": 0.0}},
)
(_, push), unit = mm_gym.compile_scene(scene).observed, 400.0 * 0.01
assert push == ("push", "N", 1.0 / unit, 0.0, 0.0)
env = mm_gym.MovingMassEnv(scene)
env.reset(seed=0)
observation, *_, info = env.step([0.5])
assert info["applied"] == [1.5]
assert observation[1] == np.float32(1.5 / unit)
schema = json.loads(scene_schema())["$defs"]["Sensors"]["properties"]
assert "push" in schema["channels"]["items"]["enum"]
assert "push" in schema["noise"]["propertyNames"]["enum"]
try:
    mm_gym.Scene(sensors={"channels": ["pusch"]})
except mm_gym.SceneError as error:
    assert "did you mean 'push'?" in str(error)
"""


def test_one_row_of_the_table_makes_a_channel():
    package = str(Path(mm_gym.__file__).parent)
    done = subprocess.run(
        [sys.executable, "-c", NEW_CHANNEL, package], capture_output=True, check=False, text=True
    )
    assert done.returncode == 0, done.stderr


LIGHT = Scene(
    initial={"carriage_displacement": 0.01},
    sensors={"channels": ["carriage_acceleration"]},
    control={"time_step": 0.01, "steps": 50},
)


@pytest.mark.parametrize(
    "changes",
    [
        {"carriage.mass": 1e-80},
        {"carriage.mass": 1e-11},
        {"interface.damping": 1e12},
    ],
)
def test_acceleration_that_cancellation_leaves_no_digits_of_is_refused(changes):
    with pytest.raises(CompileError, match=r"sensors\.channels: carriage_acceleration") as caught:
        compile_scene(LIGHT.replace(**changes))
    assert "carriage.mass of at least" in str(caught.value)
    compile_scene(LIGHT.replace(**changes, **{"sensors.channels": ["sphere_acceleration"]}))


@pytest.mark.parametrize(
    ("mass", "damping"), [(2e-11, 1.0), (1e-8, 1.0), (0.1, 1e10), (0.1, 1e8), (0.1, 1.0)]
)
def test_acceleration_that_is_not_refused_is_right(mass, damping):
    scene = LIGHT.replace(**{"carriage.mass": mass, "interface.damping": damping})
    lanes = Lanes(compile_scene(scene), 1)
    lanes.seed(0)
    lanes.restart()
    system = System(m1=mass, c=damping)
    got, expected = [], []
    for n in range(1, 31):
        lanes.advance(np.zeros(0, np.float32))
        got.append(lanes.values[layout.CARRIAGE_ACCELERATION, 0])
        with mp.workdps(60):
            free = system.sampled(0.01 * n)[:, :4] * mp.matrix([0.01, 0.01, 0, 0])
            expected.append(float((system.matrix() * free)[2]))
    assert np.abs(np.subtract(got, expected)).max() <= 1e-6 * np.abs(expected).max()
