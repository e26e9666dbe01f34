"""Does the analysis of bistable, softening and unstable carriages say where they end, or refuse?"""

import numpy as np
import pytest
import wells
from wells import FRICTION, PLACE

from mm_gym import SceneError, SimulationError, simulate
from mm_gym.analysis import (
    asymptotic_offset,
    bifurcation,
    critical_reference_velocity,
    frequency_response,
    modes,
)
from mm_gym.analysis.asymptotes import Spring

BISTABLE, UNSTABLE = (
    scene.replace(**{"initial.carriage_displacement": 0.015})
    for scene in (wells.BISTABLE, wells.UNSTABLE)
)
SOFTENING = wells.SOFTENING.replace(**{"initial.carriage_displacement": 0.008})
SPRINGS = {"kind": "small_on_large", "stiffness": 35.0, "stretch": 1.5}
FREE = {"kind": "none"}


@pytest.mark.parametrize("scene", [BISTABLE, SOFTENING], ids=["bistable", "softening"])
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"initial.sphere_velocity": 0.3},
        {"interface": FREE},
        {"interface": FRICTION},
        {"springs": SPRINGS, "initial.sphere_offset": 0.005},
        {"springs": SPRINGS, "interface": FRICTION, "initial.sphere_offset": 0.005},
    ],
)
def test_asymptotic_offset_is_that_of_a_long_motion(scene, changes):
    scene = scene.replace(**changes, **{"solver.tolerance": 1e-13})
    x1, x2, v1, v2 = simulate(scene, duration=8.0).state[-1]
    # The slowest motion, of the sphere on its springs, has decayed by exp(-40).
    assert max(abs(v1), abs(v2)) < 1e-9
    assert asymptotic_offset(scene) == pytest.approx(x2 - x1, abs=1e-9)


@pytest.mark.parametrize(("start", "well"), [(0.005, 1.0), (-0.005, -1.0), (0.022, -1.0)])
def test_a_free_sphere_stays_while_the_carriage_falls_into_a_well(start, well):
    scene = BISTABLE.replace(interface=FREE, **{"initial.carriage_displacement": start})
    end = simulate(scene, duration=8.0).state[-1]
    assert np.sign(end[0]) == well or start == 0.022  # from far out, whichever the motion finds
    rest = start + 0.02 - np.sign(end[0]) * PLACE
    assert asymptotic_offset(scene) == pytest.approx(rest, rel=1e-12)


def test_without_a_spring_a_free_carriage_drifts_to_its_momentum_over_its_damping():
    slow = {"carriage.linear_coefficient": 0.0, "initial.carriage_velocity": 0.5}
    scene = BISTABLE.replace(interface=FREE, **slow, **{"carriage.cubic_coefficient": 0.0})
    x1, x2, *_ = simulate(scene, duration=8.0).state[-1]
    assert asymptotic_offset(scene) == pytest.approx(x2 - x1, rel=1e-12)


@pytest.mark.parametrize("interface", [{"kind": "viscous"}, FREE, FRICTION])
def test_an_escape_and_a_spring_without_a_well_have_no_asymptote(interface):
    escapes = SOFTENING.replace(interface=interface, **{"initial.carriage_displacement": 0.012})
    with pytest.raises(SimulationError, match="escape"):
        asymptotic_offset(escapes)
    for scene in (UNSTABLE, escapes.replace(**{"carriage.linear_coefficient": -1.0})):
        with pytest.raises(SceneError, match="the carriage has no stable equilibrium"):
            asymptotic_offset(scene.replace(interface=interface))


def test_a_diagram_over_the_linear_coefficient_crosses_zero():
    values = [-1.0, -0.1, 0.5, 1.0]
    scene = BISTABLE.replace(interface=FRICTION)
    got = bifurcation(scene, "carriage.linear_coefficient", values)
    want = [
        asymptotic_offset(scene.replace(**{"carriage.linear_coefficient": value}))
        for value in values
    ]
    assert np.array_equal(got, want)


def test_the_critical_velocity_of_an_unstable_carriage_is_refused():
    with pytest.raises(SceneError, match=r"carriage.linear_coefficient: got -1.0; allowed"):
        critical_reference_velocity(UNSTABLE.replace(interface=FRICTION))


def test_modes_about_the_middle_show_the_instability_and_those_of_a_well_are_as_documented():
    middle = modes(BISTABLE.replace(interface=FREE))
    # m1 s^2 + d s - k1 = 0 of the carriage alone
    want = np.sort(np.roots([0.1, 1.0, -400.0]))
    carriage = np.sort(middle.eigenvalues[middle.eigenvalues != 0.0].real)
    assert carriage == pytest.approx(want, rel=1e-13)
    assert np.nanmin(middle.damping_ratios) == -1.0
    assert modes(BISTABLE).closed_form == pytest.approx(modes(BISTABLE).eigenvalues, rel=1e-9)
    well = BISTABLE.replace(
        **{"carriage.linear_coefficient": 2.0, "carriage.cubic_coefficient": 0.0}
    )
    near = BISTABLE.replace(
        **{"initial.carriage_displacement": PLACE * (1.0 + 1e-6), "solver.tolerance": 1e-14}
    )
    linear = well.replace(**{"initial.carriage_displacement": PLACE * 1e-6})
    about = simulate(near, duration=0.2).state[:, 0] - PLACE
    # The next term of the spring's force is 1.5 x1 / PLACE of the linear one.
    assert about == pytest.approx(simulate(linear, duration=0.2).state[:, 0], abs=5e-6 * 1e-8)


def test_the_formal_response_about_the_middle_solves_the_equations():
    w = np.array([20.0, 60.0])
    got = frequency_response(BISTABLE.replace(interface=FREE), w).force[:, 0]
    assert got == pytest.approx(1.0 / (-400.0 - 0.1 * w**2 + 1j * w), rel=1e-13)


@pytest.mark.parametrize("scene", [BISTABLE, SOFTENING, UNSTABLE])
@pytest.mark.parametrize("interface", [{"kind": "viscous"}, FRICTION])
@pytest.mark.parametrize("springs", [{"kind": "none"}, SPRINGS])
def test_the_energy_balance_closes_whatever_the_signs(scene, interface, springs):
    harmonic = {"kind": "harmonic", "amplitude": 0.5, "frequency": 57.0}
    near = {"initial.carriage_displacement": 0.003, "initial.sphere_offset": 0.004}
    if scene is not UNSTABLE:  # it is propagated exactly
        near["solver.tolerance"] = 1e-13
    scene = scene.replace(interface=interface, springs=springs, excitation=[harmonic])
    motion = simulate(scene.replace(**near), duration=0.3)
    balance = motion.energy - motion.energy[0] - motion.work.total
    assert np.abs(balance / motion.work.throughput).max() < 1e-10


def test_the_work_of_a_fall_from_the_hill_is_measured_by_the_depth_of_the_well():
    scene = BISTABLE.replace(**{"initial.carriage_displacement": 1e-9})
    motion = simulate(scene, duration=3.0)
    depth = 0.25 * 400.0 * PLACE**2
    assert motion.energy[-1] == pytest.approx(-depth, rel=1e-6)
    assert motion.work.dissipated[-1] == pytest.approx(depth, rel=1e-6)
    assert motion.work.throughput[-1] >= depth


@pytest.mark.parametrize(("alpha", "beta"), [(-1.0, 1e4), (1.0, -1e4), (1.0, 1e4), (1.0, 0.0)])
def test_the_largest_force_in_a_well_bounds_that_of_every_place_with_the_energy(alpha, beta):
    spring = Spring(400.0, alpha, beta)
    x1 = np.linspace(-2.0, 2.0, 4001) * PLACE
    if spring.beta < 0.0:
        x1 = x1[np.abs(x1) < PLACE]
    energies = np.array([spring.energy(x) for x in x1])
    forces = np.abs([spring.force(x) for x in x1])
    for part in (0.01, 0.3, 0.9, 0.999):
        least, top = spring.least_energy, 0.25 * 400.0 * PLACE**2
        energy = least + part * top
        assert spring.holds(0.5 * PLACE, energy)
        seen = forces[energies <= energy].max()
        assert seen <= spring.largest_force(energy) * (1.0 + 1e-12)
        if alpha * beta < 0.0:  # and is the least bound, but for the grid's 10 um
            assert seen == pytest.approx(spring.largest_force(energy), rel=0.03)
