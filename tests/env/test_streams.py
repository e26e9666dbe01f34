"""Is a seed's disturbance the same whatever the sensors: alone, side by side and simulated?"""

import numpy as np
import pytest

from mm_gym import MovingMassEnv, MovingMassVectorEnv, Scene, load_scene, simulate
from mm_gym.tasks import ids

STEPS, SEED = 12, 7

EXCITATIONS = {
    "none": [],
    "harmonic": [{"kind": "harmonic", "amplitude": 1.0, "frequency": 50.0}],
    "sweep": [
        {
            "kind": "sweep",
            "amplitude": 1.0,
            "start_frequency": 20.0,
            "end_frequency": 60.0,
            "duration": 0.1,
        }
    ],
    "low-pass": [{"kind": "noise", "rms": 1.0, "low_frequency": 0.0, "high_frequency": 70.0}],
    "band-pass": [{"kind": "noise", "rms": 1.0, "low_frequency": 30.0, "high_frequency": 70.0}],
    "kanai_tajimi": [{"kind": "kanai_tajimi", "rms": 1.0, "ground_frequency": 60.0}],
    "clough_penzien": [
        {
            "kind": "clough_penzien",
            "rms": 1.0,
            "ground_frequency": 60.0,
            "filter_frequency": 6.0,
        }
    ],
    "impulse": [{"kind": "impulse", "size": [-0.04, 0.04], "rate": 40.0, "time": 0.0}],
}
EXCITATIONS["several"] = [
    part
    for kind in ("harmonic", "sweep", "band-pass", "kanai_tajimi", "impulse")
    for part in EXCITATIONS[kind]
]
SOIL = {"excitation.0.ground_frequency": [50.0, 90.0]}
DRAWN = {
    "start": {},
    "mass": {"sphere.mass": [0.03, 0.05]},
    "filter": {"excitation.0.high_frequency": [60.0, 80.0]},
    "soil": SOIL,
    "both": {"sphere.mass": [0.03, 0.05], **SOIL},
}
CASES = [(kind, drawn) for kind in EXCITATIONS for drawn in ("start", "mass")] + [
    ("low-pass", "filter"),
    ("band-pass", "filter"),
    ("kanai_tajimi", "soil"),
    ("clough_penzien", "both"),
]
CHANNELS = ("carriage_displacement", "sphere_offset", "carriage_velocity", "sphere_velocity")


def scene_of(kind, drawn, noisy=0):
    return Scene(
        springs={"kind": "small_on_large"},
        excitation=EXCITATIONS[kind],
        initial={"carriage_displacement": [-0.01, 0.01], "stretch": [1.0, 3.0]},
        actuation={"stretch": {"minimum": 1.0, "maximum": 3.0, "command": "rate", "rate_limit": 4}},
        randomization=DRAWN[drawn],
        sensors={"channels": CHANNELS, "noise": dict.fromkeys(CHANNELS[:noisy], 1e-4)},
        control={"time_step": 0.01, "steps": STEPS},
    )


def episodes(env, seed, count=2):
    """Return observations and all rows of the lanes from each step of some episodes."""
    seen, rows, action = [], [], np.zeros(env.action_space.shape, np.float32)
    for n in range(count):
        seen.append(env.reset(seed=None if n else seed)[0])
        rows.append(env.get_state()["values"])
        for _ in range(STEPS):
            seen.append(env.step(action)[0])
            rows.append(env.get_state()["values"])
    return np.array(seen), np.array(rows)


@pytest.mark.parametrize(("kind", "drawn"), CASES)
def test_disturbance_and_parameters_of_a_seed_do_not_depend_on_the_sensors(kind, drawn):
    clear, rows = episodes(MovingMassEnv(scene_of(kind, drawn)), SEED)
    for noisy in (1, 2, 3, 4):
        env = MovingMassEnv(scene_of(kind, drawn, noisy))
        seen, same = episodes(env, SEED)
        np.testing.assert_array_equal(same, rows)
        assert (seen[:, :noisy] != clear[:, :noisy]).all()
        np.testing.assert_array_equal(seen[:, noisy:], clear[:, noisy:])


@pytest.mark.parametrize("noisy", [0, 2, 3])
@pytest.mark.parametrize(("kind", "drawn"), CASES)
def test_simulation_of_a_seed_is_the_episode_of_an_environment_with_the_seed(kind, drawn, noisy):
    scene = scene_of(kind, drawn, noisy)
    _, rows = episodes(MovingMassEnv(scene), SEED, 1)
    motion = simulate(scene, seed=SEED)
    np.testing.assert_array_equal(motion.state, rows[:, :4, 0])
    jets = motion.recording.jets[-1]
    support = motion.recording.plant.support
    np.testing.assert_array_equal(jets, rows[-1, support.jets : support.jets + len(jets), 0])


@pytest.mark.parametrize("noisy", [1, 3])
@pytest.mark.parametrize(("kind", "drawn"), [("several", "mass"), *CASES[-4:]])
def test_noise_of_lanes_is_that_of_single_environments_on_any_number_of_threads(kind, drawn, noisy):
    scene, count = scene_of(kind, drawn, noisy), 19
    alone = [episodes(MovingMassEnv(scene), SEED + i)[0] for i in (0, count - 1)]
    for threads in (1, 2):
        env = MovingMassVectorEnv(scene, count, threads=threads, autoreset_mode="Disabled")
        seen, _ = episodes(env, SEED)
        np.testing.assert_array_equal(seen[:, 0], alone[0])
        np.testing.assert_array_equal(seen[:, -1], alone[1])


def test_sensors_own_noise_is_normal_and_differs_in_every_frame_channel_and_lane():
    scene = scene_of("band-pass", "start", 4).replace(**{"control.steps": 250})
    count, seen = 40, []
    for each in (scene, scene.replace(**{"sensors.noise": {}})):
        env = MovingMassVectorEnv(each, count, autoreset_mode="Disabled")
        steps, actions = [env.reset(seed=0)[0]], np.zeros((count, 1), np.float32)
        steps += [env.step(actions)[0] for _ in range(250)]
        seen.append(np.array(steps, np.float64))
    scale = np.array([channel.factor for channel in env.plant.observed]) * 1e-4
    first = (seen[0] - seen[1]) / scale
    n = first.size
    # Four standard errors of mean, variance and correlation, and what float32 rounds.
    assert abs(first.mean()) < 4.0 / np.sqrt(n) + 1e-3
    assert abs(first.var() - 1.0) < 4.0 * np.sqrt(2.0 / n) + 1e-2
    for axis in range(3):
        shifted = np.roll(first, 1, axis)
        assert abs((first * shifted).mean()) < 4.0 / np.sqrt(n) + 1e-2


@pytest.mark.parametrize("task", ids())
def test_episodes_of_the_tasks_do_not_depend_on_the_sensors(task):
    scene = load_scene(task)
    channels = scene.sensors.channels
    for noise in ({}, dict.fromkeys(channels, 1e-3)):
        other = scene.replace(**{"sensors.noise": noise})
        (_, rows), (_, same) = (episodes(MovingMassEnv(each), SEED, 1) for each in (scene, other))
        np.testing.assert_array_equal(rows, same)
