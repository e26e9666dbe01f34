"""Long motions, and motions of extreme systems."""

import numpy as np
import pytest
from oracle import System, error, scale_of

from mm_gym import Scene, SimulationError, simulate

START = (0.01, 0.03, 0.0, 0.0)


def motion(system, time_step, steps):
    scene = Scene(
        carriage={"mass": system.m1, "stiffness": system.k1, "damping": system.d},
        sphere={"mass": system.m2},
        interface={"kind": "viscous", "damping": system.c},
        initial={"carriage_displacement": START[0], "sphere_offset": START[1] - START[0]},
        control={"time_step": time_step, "steps": steps},
    )
    return simulate(scene)


@pytest.mark.parametrize("time_step", [1e-6, 0.01, 10.0])
@pytest.mark.parametrize("c", [0.0, 1e-12, 1.0, 1e9])
@pytest.mark.parametrize("ratio", [1e-6, 1.0, 1e6])
def test_bound_holds_at_extreme_mass_ratios_dampings_and_steps(ratio, c, time_step):
    system = System(m2=0.1 * ratio, c=c)
    trajectory = motion(system, time_step, 50)
    rows = [1, 10, 50]
    expected = system.motion(START, trajectory.time[rows])
    assert error(trajectory.state[rows], expected, scale_of(expected, START)) <= 1e-12


def test_undamped_motion_keeps_amplitude_and_phase_for_a_thousand_seconds():
    # The rounding of the transition matrix turns the phase by up to 2.2e-16 in each of 1e5 steps.
    system = System(c=0.0, d=0.0)
    trajectory = motion(system, 0.01, 100_000)
    rows = [99_990, 100_000]
    expected = system.motion(START, trajectory.time[rows])
    assert error(trajectory.state[rows], expected, scale_of(expected, START)) <= 1e5 * 2.2e-16
    assert trajectory.energy[-1] == pytest.approx(trajectory.energy[0], rel=1e5 * 4.4e-16)


def test_state_beyond_the_largest_double_is_an_error_not_infinity():
    scene = Scene(
        initial={"carriage_displacement": 1e308, "carriage_velocity": 1e308},
        carriage={"stiffness": 1e12},
    )
    with pytest.raises(SimulationError, match=r"largest double from t = 0\.\d+ s"):
        simulate(scene)


def test_results_repeat_to_the_last_bit():
    one, other = (motion(System(), 0.01, 300) for _ in range(2))
    assert np.array_equal(one.state, other.state)
