"""Harmonic excitation against the closed form: complex dynamic stiffness plus free motion."""

import mpmath as mp
import numpy as np
import pytest
from oracle import System, error, scale_of

from mm_gym import Scene, compile_scene, simulate

FREQUENCY, PHASE, STEPS = 57.5, 0.7, 400

# Each of 400 steps rounds the state and the excitation's phase a few times by 1.1e-16. Errors of
# the state decay within 20 steps, those of the phase add up: about 400 * 2.2e-16 = 9e-14.
BOUND = 3e-13

START = (0.01, -0.005, -0.3, 0.2)
AT_GRID = 0.01 * np.array([1, 2, 7, 50, 173, 399, 400])
OFF_GRID = AT_GRID - 0.0037


def scene_of(system, *, target="force", time_step=0.01, **more):
    data = {
        "carriage": {"mass": system.m1, "stiffness": system.k1, "damping": system.d},
        "sphere": {"mass": system.m2},
        "interface": {"kind": "viscous", "damping": system.c},
        "excitation": [
            {
                "kind": "harmonic",
                "target": target,
                "amplitude": 1.5,
                "frequency": FREQUENCY,
                "phase": PHASE,
            }
        ],
        "initial": {
            "carriage_displacement": START[0],
            "sphere_offset": START[1] - START[0],
            "carriage_velocity": START[2],
            "sphere_velocity": START[3],
        },
        "control": {"time_step": time_step, "steps": STEPS},
    }
    if system.k2:
        data["springs"] = {"kind": "small_on_large", "stiffness": 35.0, "stretch": 1.5}
    for name, value in more.items():
        data[name] = data.get(name, {}) | value
    return Scene(**data)


def expected_motion(system, times, *, target="force", frequency=FREQUENCY):
    steady = system.steady_state(frequency, PHASE, amplitude=1.5, ground=target == "ground")
    return system.motion(START, times, steady)


FREE_MASS = System()
SPRUNG = System(c=0.1).with_springs(35.0, 1.5)


@pytest.mark.parametrize("times", [AT_GRID, OFF_GRID], ids=["at steps", "between steps"])
@pytest.mark.parametrize("target", ["force", "ground"])
@pytest.mark.parametrize("system", [FREE_MASS, SPRUNG], ids=["free mass", "springs"])
def test_linear_plant_follows_the_closed_form(system, target, times):
    scene = scene_of(system, target=target)
    assert compile_scene(scene).kind == "linear"
    state = simulate(scene, times=times).state
    expected = expected_motion(system, times, target=target)
    assert error(state, expected, scale_of(expected, START)) <= BOUND


@pytest.mark.parametrize("times", [AT_GRID, OFF_GRID], ids=["at steps", "between steps"])
@pytest.mark.parametrize("target", ["force", "ground"])
def test_plant_with_actuated_stretch_follows_the_closed_form(target, times):
    scene = scene_of(SPRUNG, target=target, actuation={"stretch": {}})
    assert compile_scene(scene).kind == "parametric linear"
    state = simulate(scene, times=times).state
    expected = expected_motion(SPRUNG, times, target=target)
    assert error(state, expected, scale_of(expected, START)) <= BOUND


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_randomised_frequency_follows_the_closed_form_of_its_draw(seed):
    scene = scene_of(FREE_MASS, randomization={"excitation.0.frequency": [44.0, 71.0]})
    plant = compile_scene(scene)
    trajectory = simulate(plant, times=AT_GRID, seed=seed)
    frequency = trajectory.parameters[plant.support.row_of("excitation.0.frequency")]
    assert 44.0 <= frequency <= 71.0
    expected = expected_motion(FREE_MASS, AT_GRID, frequency=frequency)
    assert error(trajectory.state, expected, scale_of(expected, START)) <= BOUND


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_randomised_parameters_follow_the_closed_form_of_their_draw(seed):
    ranges = {"carriage.mass": [0.05, 0.2], "interface.damping": [0.1, 5.0]}
    plant = compile_scene(scene_of(FREE_MASS, randomization=ranges))
    trajectory = simulate(plant, times=AT_GRID, seed=seed)
    m1, c = (float(trajectory.parameters[plant.support.row_of(name)]) for name in ranges)
    expected = expected_motion(System(m1=m1, c=c), AT_GRID)
    assert error(trajectory.state, expected, scale_of(expected, START)) <= BOUND


@pytest.mark.parametrize("time_step", [1e-6, 1e-3, 0.1, 10.0])
def test_control_step_does_not_change_the_answer(time_step):
    # Ten steps, each advancing the phase by up to 575 rad, which is rounded by 6e-14 rad.
    times = time_step * np.arange(1, 11)
    state = simulate(scene_of(FREE_MASS, time_step=time_step), times=times).state
    expected = expected_motion(FREE_MASS, times)
    assert error(state, expected, scale_of(expected, START)) <= 1e-12


def test_several_harmonics_add_up():
    harmonics = [
        {"kind": "harmonic", "amplitude": 1.0, "frequency": 50.0},
        {"kind": "harmonic", "amplitude": -0.5, "frequency": 0.0, "phase": 1.0},
        {"kind": "harmonic", "amplitude": 2.0, "frequency": 31.0, "phase": 0.4, "target": "ground"},
    ]
    together = simulate(Scene(excitation=harmonics)).state
    apart = sum(simulate(Scene(excitation=[harmonic])).state for harmonic in harmonics)
    assert error(together, apart) <= BOUND


@pytest.mark.parametrize("frequency", [57.0, 1e5])
def test_phase_does_not_drift_over_a_million_steps(frequency):
    # Phases are computed anew every 1024 sample intervals; in between, the rotation's rounding
    # turns them by up to 1.4e-16 each, and the state's round-off comes on top.
    steps = 1_000_000
    harmonic = {"kind": "harmonic", "amplitude": 1.5, "frequency": frequency, "phase": PHASE}
    scene = scene_of(SPRUNG).replace(initial={"sphere_offset": 0.0}, excitation=[harmonic])
    state = simulate(scene, duration=0.01 * steps).state[[steps - 600, steps]]
    with mp.workdps(40):
        steady = SPRUNG.steady_state(frequency, PHASE, amplitude=1.5)
        times = [mp.mpf(0.01) * n for n in (steps - 600, steps)]
        expected = np.array([[float(v) for v in steady(t)] for t in times])
    scale = scale_of(expected)
    # A position is the sum of velocities times steps: at 1e5 rad/s a thousand times its own size.
    scale[:2] = np.maximum(scale[:2], 0.01 * scale[2:])
    assert error(state, expected, scale) <= 1024 * 1.4e-16 + BOUND
