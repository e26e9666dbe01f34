"""Accelerations, base force and channels of a trajectory, and a ground motion given as an array."""

from pathlib import Path

import numpy as np
import pytest

from mm_gym import MovingMassEnv, Scene, SceneError, SimulationError, compile_scene, simulate
from mm_gym.step.channels import CHANNELS

MOTION = Path(__file__).parents[1] / "data" / "motion.csv"
FRICTION = {
    "kind": "dry_friction",
    "static_coefficient": 0.5,
    "kinetic_coefficient": 0.3,
    "reference_velocity": 0.05,
    "slip_damping": 0.1,
}
FINITE = {"kind": "finite_stretch", "stiffness": 35.0, "stretch": 1.4, "rest_length": 0.08}
KINDS = {
    "linear": {},
    "friction": {"interface": FRICTION},
    "finite": {"springs": FINITE, "carriage.cubic_coefficient": 1e4},
    "free": {"interface": {"kind": "none"}, "springs": {"kind": "none"}},
}


def driven(kind):
    """Return a rig under forces and ground motion, of which the ground's is smooth."""
    return Scene(
        springs={"kind": "small_on_large", "stiffness": 35.0, "stretch": 1.4},
        initial={"carriage_displacement": 0.005, "sphere_offset": 0.01},
        excitation=[
            {"kind": "harmonic", "amplitude": 1.0, "frequency": 40.0},
            {"kind": "harmonic", "target": "ground", "amplitude": 3.0, "frequency": 55.0},
        ],
        actuation={"force": {"limit": 4.0}},
        solver={"tolerance": 1e-12} if kind == "finite" else {},
    ).replace(**KINDS[kind])


@pytest.mark.parametrize("kind", KINDS)
def test_acceleration_is_the_slope_of_the_velocity_and_the_grounds(kind):
    step, middle = 1e-5, np.arange(0.0071, 0.3, 0.01)
    times = np.sort(np.concatenate([middle - step, middle, middle + step]))
    found = simulate(driven(kind), times=times, action=0.7)
    slope = (found.state[2::3, 2:] - found.state[0::3, 2:]) / (2.0 * step)
    absolute = slope + found.channel("ground_acceleration")[1::3, None]
    error = np.abs(absolute - found.acceleration[1::3])
    # A central difference errs by h^2 / 6 of the third derivative, here below 1e7 m/s^4; where
    # friction changes between the two instants there is no slope.
    assert np.sort(error.max(axis=1))[-3] <= 1e-3
    assert np.abs(found.acceleration).max() > 1.0


@pytest.mark.parametrize("kind", KINDS)
def test_base_force_balances_the_momentum(kind):
    scene = driven(kind)
    found = simulate(scene, action=0.7)
    inertia = found.acceleration @ [scene.carriage.mass, scene.sphere.mass]
    outer = found.channel("disturbance_force") - found.base_force
    np.testing.assert_allclose(inertia, outer, atol=1e-12 * np.abs(outer).max())
    own = found.base_force + found.applied[:, 0]
    carriage, (x1, _, v1, _) = scene.carriage, found.state.T
    spring = (carriage.linear_coefficient + carriage.cubic_coefficient * x1**2) * x1
    expected = carriage.stiffness * spring + carriage.damping * v1
    np.testing.assert_allclose(own, expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("kind", KINDS)
def test_channels_are_those_that_an_environment_observes(kind):
    scene = driven(kind)
    springs = scene.springs.kind != "none"
    lacking = {"damping", "voltage"} | (set() if springs else {"stretch", "spring_force"})
    names = [name for name in CHANNELS if name not in lacking]
    env = MovingMassEnv(scene.replace(**{"sensors.channels": names, "control.steps": 40}))
    env.reset(seed=0)
    seen = [env.step(np.array([0.25], np.float32))[0] for _ in range(40)]
    found = simulate(env.plant, action=1.0)
    for k, channel in enumerate(env.plant.observed):
        expected = (found.channel(channel.name)[1:] - channel.zero) * channel.factor
        size = max(np.abs(expected).max(), 1e-3)
        np.testing.assert_allclose(np.array(seen)[:, k], expected, atol=1e-6 * size)


def test_peak_and_rms_are_over_time():
    scene = Scene(
        excitation=[{"kind": "harmonic", "target": "ground", "amplitude": 2.0, "frequency": 50.0}]
    )
    # Uneven instants, of which one half has ten times as many.
    period = 2.0 * np.pi / 50.0
    times = np.concatenate([np.linspace(0, period, 4000), np.linspace(period, 2 * period, 400)[1:]])
    found = simulate(scene, times=times)
    assert found.peak("ground_acceleration") == pytest.approx(2.0, rel=1e-5)
    assert found.rms("ground_acceleration") == pytest.approx(np.sqrt(2.0), rel=1e-4)
    one = simulate(scene.replace(**{"initial.carriage_velocity": -0.3}), times=[0.0])
    assert one.rms("carriage_velocity") == one.peak("carriage_velocity") == 0.3


def test_ground_as_an_array_moves_as_its_record():
    record = {"kind": "record", "target": "ground", "file": str(MOTION), "unit": "m/s^2"}
    scene = driven("linear")
    expected = simulate(scene.replace(excitation=[*scene.excitation, record]))
    samples = np.loadtxt(MOTION, delimiter=",", skiprows=2)
    assert np.array_equal(simulate(scene, ground=samples).state, expected.state)
    # Also if the motion is longer than the simulation, without a warning.
    short = simulate(scene.replace(**{"control.steps": 5}), ground=samples)
    assert np.array_equal(short.state, expected.state[:6])


def test_wrong_names_grounds_and_masses_are_refused():
    found = simulate(Scene())
    with pytest.raises(SimulationError, match="did you mean 'carriage_velocity'"):
        found.peak("carriage_veloicity")
    with pytest.raises(SimulationError, match=r"ground: got shape \(3,\)"):
        simulate(Scene(), ground=[1.0, 2.0, 3.0])
    with pytest.raises(SimulationError, match="ground: got NaN"):
        simulate(Scene(), ground=[[0.0, np.nan], [1.0, 0.0]])
    for ground, message in (
        ([[0.0, 1.0], [0.0, 2.0]], "^ground: row 2: time: got 0; allowed: at least 1e-09 s more"),
        ([[-1.0, 1.0], [0.0, 2.0]], "^ground: row 1: time: got -1; allowed: at least 0 s"),
        ([[0.0, 1.0], [1.0, -1e13]], r"^ground: row 2: got -1e\+13; allowed: "),
        (np.zeros((2**20, 2)) + np.arange(2**20)[:, None], "^ground: got 1048576 rows; allowed: "),
    ):
        with pytest.raises(SceneError, match=message):
            simulate(Scene(), ground=ground)
    with pytest.raises(SimulationError, match="pass the scene"):
        simulate(compile_scene(Scene()), ground=[[0.0, 1.0], [1.0, 0.0]])
    with pytest.raises(SimulationError, match=r"carriage\.mass"):
        _ = simulate(Scene(carriage={"mass": 0.0})).acceleration
