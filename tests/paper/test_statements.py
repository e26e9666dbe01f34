"""Does what the paper says of its systems, in words, hold for the scenes, and where not?"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mm_gym import Scene, SceneError, simulate
from mm_gym.analysis import (
    asymptotic_offset,
    bifurcation,
    critical_reference_velocity,
    frequency_response,
    modes,
)
from mm_gym.paper import scene
from mm_gym.paper.figures import FRICTION_VELOCITIES, linear_twin
from mm_gym.paper.scenes import CHI, FIGURE_2, RATIOS, STATIC

VELOCITY = "interface.reference_velocity"


def slip(trajectory):
    return trajectory.state[:, 3] - trajectory.state[:, 2]


def fine(name, duration, time_step=1e-4):
    return simulate(scene(name).replace(**{"control.time_step": time_step}), duration=duration)


def test_every_parameter_of_the_captions_is_in_the_scenes():
    figure_6 = scene("fig6d")
    assert (figure_6.carriage.mass, figure_6.sphere.mass) == (0.10, 0.04)
    assert (figure_6.carriage.stiffness, figure_6.carriage.damping) == (400.0, 1.0)
    assert (figure_6.carriage.linear_coefficient, figure_6.carriage.cubic_coefficient) == (1.0, 2e6)
    for name, chi in (("fig8", 0.1), ("fig9", 0.1), ("fig10", 0.1)):
        friction = scene(name).interface
        assert friction.static_coefficient == {"fig8": 0.509, "fig9": 0.5097, "fig10": 0.51}[name]
        assert friction.kinetic_coefficient == 0.5 * friction.static_coefficient
        assert (friction.normal_force, friction.slip_damping) == (0.3924, chi)
        assert friction.reference_velocity == 0.2
    for name in ("fig12a", "fig12d"):
        springs, initial = scene(name).springs, scene(name).initial
        assert (springs.stiffness, springs.stretch) == (50.0, 1.5)
        assert (initial.carriage_displacement, initial.sphere_offset) == (0.01, 0.0)
    experiment = scene("fig5b")
    assert (experiment.carriage.mass, experiment.sphere.mass) == (0.478, 0.152)
    assert (experiment.carriage.stiffness, experiment.carriage.damping) == (10.0, 0.2)
    assert experiment.interface.damping == 0.06
    assert scene("fig5a").interface.kind == "none"


def test_the_initial_states_are_those_of_equations_6_and_12_and_of_figure_5():
    wanted = dict.fromkeys(FIGURE_2, (0.01, 0.03)) | {
        "fig6a": (0.01, 0.03),
        "fig6d": (0.01, 0.03),
        "fig8": (0.01, 0.03),
        "fig10": (0.01, 0.03),
        "fig9": (0.005, 0.025),
        "fig12a": (0.01, 0.01),
        "fig5a": (-0.025, -0.004),
        "fig5b": (0.03, 0.03),
    }
    for name, (x1, x2) in wanted.items():
        start = simulate(scene(name), times=[0.0]).state[0]
        assert start == pytest.approx([x1, x2, 0.0, 0.0], abs=1e-17)


def test_the_reaction_of_the_sphere_brakes_a_carriage_without_a_damper():
    # System 2C: its force on the carriage, -m2 a2, takes all of the initial energy, k1 x1^2 / 2.
    trajectory = fine("fig2c", 2.0)
    power = scene("fig2c").interface.damping * slip(trajectory) * trajectory.state[:, 2]
    work = np.trapezoid(power, trajectory.time)
    # The trapezoidal rule's error is h^2 / 12 times the change of the power's slope: 2e-10 J.
    assert work == pytest.approx(-0.5 * 400.0 * 0.01**2, abs=1e-9)
    first = trajectory.time <= 0.5
    assert (power[first] < 0.0).mean() > 0.9


def test_a_free_sphere_on_a_viscous_interface_is_lanchesters_damper():
    # Without a spring for the sphere the smallest peak of |x1| is 1 + 2 / mu times the static
    # displacement, at a damping ratio of 1 / sqrt(2 (1 + mu) (2 + mu)).
    mass, stiffness, ratio = 0.1, 400.0, 0.4
    best = 2.0 * ratio * mass * np.sqrt(stiffness / mass) / np.sqrt(2 * (1 + ratio) * (2 + ratio))
    frequencies = np.linspace(20.0, 90.0, 20001)

    def peak(damping):
        system = Scene(
            carriage={"mass": mass, "stiffness": stiffness, "damping": 0.0},
            sphere={"mass": ratio * mass},
            interface={"kind": "viscous", "damping": damping},
        )
        return stiffness * np.abs(frequency_response(system, frequencies).force[:, 0]).max()

    # The nearest of the frequencies misses a maximum by less than 1e-6 of it.
    assert peak(best) == pytest.approx(1.0 + 2.0 / ratio, rel=1e-6)
    assert min(peak(0.9 * best), peak(1.1 * best)) > 1.005 * peak(best)


def test_a_carriage_of_vanishing_mass_returns_without_oscillation():
    displacement = fine("fig2d", 0.5).state[1:, 0]
    assert np.all(modes(scene("fig2d")).eigenvalues.imag == 0.0)
    assert (np.diff(np.sign(displacement)) != 0.0).sum() == 1
    assert displacement.min() == pytest.approx(-0.19e-3, abs=1e-5)


def test_the_offset_changes_abruptly_where_the_interface_loses_its_damping():
    offsets = bifurcation(scene("fig2a"), "interface.damping", [0.0, 1e-15, 1e-3, 1.0])
    assert offsets == pytest.approx([0.03, 0.02, 0.02, 0.02], rel=1e-14)


def test_the_offset_returns_whatever_the_start_and_the_sphere():
    for name, values in {
        "initial.carriage_displacement": [-0.05, 0.0, 1.0],
        "sphere.mass": [1e-3, 1e3],
        "interface.damping": [1e-12, 1e3],
    }.items():
        assert bifurcation(scene("fig2a"), name, values) == pytest.approx([0.02] * len(values))
    offsets = [-0.05, 0.0, 0.01, 0.1]
    assert bifurcation(scene("fig2a"), "initial.sphere_offset", offsets) == pytest.approx(offsets)


def test_only_the_damping_of_the_interface_brings_the_offset_back():
    undamped = scene("fig2c")
    assert undamped.carriage.damping == 0.0
    assert asymptotic_offset(undamped) == pytest.approx(0.02)
    assert asymptotic_offset(scene("fig2e")) == pytest.approx(0.03)


def test_without_any_damping_the_carriage_is_a_centre_and_the_sphere_is_free():
    system = scene("fig2a_caption").replace(**{"carriage.damping": 0.0, "interface.damping": 0.0})
    assert modes(system).eigenvalues == pytest.approx(np.array([0, 0, -1j, 1j]) * np.sqrt(4000.0))
    with pytest.raises(SceneError, match="never comes to rest"):
        asymptotic_offset(system)


def test_a_free_sphere_does_not_notice_a_shaken_carriage():
    force = {"kind": "harmonic", "amplitude": 5.0, "frequency": 40.0}
    trajectory = simulate(scene("fig2e").replace(excitation=[force]), duration=3.0)
    assert np.ptp(trajectory.state[:, 1]) == 0.0
    assert np.ptp(trajectory.state[:, 0]) > 0.005


def test_all_spheres_of_the_experiment_recover_their_offset():
    masses = np.array([0.067, 0.152, 0.288])
    assert masses[[0, 2]] / 0.478 == pytest.approx([0.140, 0.603], abs=1e-3)
    for offset in (0.0, 0.021):
        system = scene("fig5b").replace(**{"initial.sphere_offset": offset})
        assert bifurcation(system, "sphere.mass", masses) == pytest.approx([offset] * 3, abs=1e-16)
        found = bifurcation(system, "carriage.stiffness", [5.0, 10.0, 40.0])
        assert found == pytest.approx([offset] * 3, abs=1e-16)


def test_air_drag_is_small_but_by_how_much_depends_on_the_friction_meant():
    # A steel sphere of 30 mm and air of 1.8e-5 Pa s. E14: the printed expression is no force.
    diameter, velocities = 0.03, np.array([0.1, 1.0])
    weight = 7850.0 * np.pi / 6.0 * diameter**3 * 9.81
    stokes = 3.0 * np.pi * 1.8e-5 * diameter
    coefficients = np.array([[0.1], [0.5]])
    printed = 2.0 * weight * coefficients / diameter / (stokes * velocities)
    sliding = weight * coefficients / (stokes * velocities)
    assert np.log10([printed.min(), printed.max()]) == pytest.approx([6.15, 7.85], abs=0.01)
    assert np.log10([sliding.min(), sliding.max()]) == pytest.approx([4.33, 6.03], abs=0.01)
    assert stokes == pytest.approx(5.1e-6, rel=0.01)
    assert scene("fig5b").interface.damping / stokes == pytest.approx(1.2e4, rel=0.02)
    assert velocities[0] * diameter / 1.5e-5 == pytest.approx(200.0)  # Reynolds number


def test_the_cubic_spring_keeps_the_binary_behaviour():
    end = simulate(
        scene("fig6d").replace(**{"control.time_step": 0.01, "solver.tolerance": 1e-12}),
        duration=12.0,
    ).state[-1]
    assert end[1] - end[0] == pytest.approx(0.02, abs=1e-12)
    still = fine("fig6a", 1.0)
    assert np.ptp(still.state[:, 1]) == 0.0


def test_friction_slips_three_times_within_the_first_fifth_of_a_second():
    trajectory = fine("fig8", 1.0, 1e-5)
    changes = trajectory.time[np.flatnonzero(np.diff(np.abs(slip(trajectory)) > 0.2))]
    wanted = [0.00582, 0.03919, 0.05352, 0.09076, 0.11532, 0.12803]
    assert changes == pytest.approx(wanted, abs=2e-5)


def test_the_slips_of_figure_8_end_within_a_fifth_of_a_second_whatever_the_slip_damping():
    for chi in (0.0, 0.3, 1.0, 3.0, 10.0, 100.0):
        system = scene("fig8").replace(**{"interface.slip_damping": chi})
        trajectory = simulate(system.replace(**{"control.time_step": 1e-4}), duration=1.0)
        slips = trajectory.time[np.abs(slip(trajectory)) > 0.2]
        assert 0.0 < slips.max() < 0.2


def test_the_offset_under_friction_depends_on_the_slip_damping_that_figure_8_omits():
    offsets = bifurcation(scene("fig8"), "interface.slip_damping", [0.0, 0.1, 1.0])
    assert offsets == pytest.approx([0.021936, 0.021186, 0.019236], abs=5e-6)


def test_two_slip_dampings_would_bring_figure_8_to_the_linear_offset():
    values = np.append(np.linspace(0.0, 6.0, 601), np.geomspace(6.1, 1e3, 200))
    beyond = np.sign(bifurcation(scene("fig8"), "interface.slip_damping", values) - 0.02)
    assert np.diff(beyond).nonzero()[0].size == 2
    found = bifurcation(scene("fig8"), "interface.slip_damping", [0.30779, 1.85488])
    # The offset changes by 0.011 and 0.88 mm per N s/m there.
    assert found == pytest.approx([0.02, 0.02], abs=1e-7)
    end = simulate(scene("fig8").replace(**{"interface.slip_damping": 1.85488}), duration=12.0)
    assert end.state[-1, 1] - end.state[-1, 0] == pytest.approx(found[1], abs=1e-12)


def test_figure_9_is_linear_since_it_never_slips():
    friction, linear = (
        fine("fig9", 0.5),
        simulate(linear_twin(scene("fig9")).replace(**{"control.time_step": 1e-4}), duration=0.5),
    )
    assert np.abs(slip(friction)).max() == pytest.approx(0.19145, abs=1e-5)
    assert np.abs(friction.state - linear.state).max() < 1e-13
    # The slip of a linear motion is proportional to its release, which can be 5.223 mm at most.
    furthest = 0.005 * 0.2 / np.abs(slip(friction)).max()
    assert furthest == pytest.approx(0.005223, abs=1e-6)
    offsets = bifurcation(
        scene("fig9"), "initial.carriage_displacement", [0.999 * furthest, 1.001 * furthest]
    )
    assert offsets[0] == pytest.approx(0.02, rel=1e-14)
    assert abs(offsets[1] - 0.02) > 1e-4


@pytest.fixture(scope="module")
def diagrams():
    """Return the curves of figure 10: by chi, and by the ratio of the coefficients."""
    system = scene("fig10")
    by_chi = {chi: system.replace(**{"interface.slip_damping": chi}) for chi in CHI}
    by_ratio = {
        ratio: system.replace(**{"interface.kinetic_coefficient": STATIC * ratio})
        for ratio in RATIOS
    }
    return tuple(
        {key: bifurcation(one, VELOCITY, FRICTION_VELOCITIES) for key, one in curves.items()}
        for curves in (by_chi, by_ratio)
    )


def test_figure_10_has_the_velocities_of_its_caption():
    assert FRICTION_VELOCITIES[0] == 1e-6
    assert np.diff(FRICTION_VELOCITIES) == pytest.approx(1e-3)
    assert 0.999 < FRICTION_VELOCITIES[-1] <= 1.0
    assert (len(CHI), len(RATIOS)) == (7, 5)


def test_above_the_critical_velocity_every_curve_is_the_linear_one(diagrams):
    critical = critical_reference_velocity(scene("fig10"))
    assert round(critical, 4) == 0.4635
    above = critical < FRICTION_VELOCITIES
    for curves in diagrams:
        for offsets in curves.values():
            # Round-off of some hundred steps: 0.02 m has units of 3e-18 m.
            assert np.abs(offsets[above] - 0.02).max() < 1e-15
            assert np.abs(offsets[~above] - 0.02).max() > 1e-4


def test_below_it_the_linear_offset_is_met_at_a_few_velocities_only(diagrams):
    below = critical_reference_velocity(scene("fig10")) > FRICTION_VELOCITIES
    for curves in diagrams:
        for offsets in curves.values():
            beyond = np.sign(offsets[below] - 0.02)
            assert (np.diff(beyond) != 0.0).sum() <= 4


def test_the_jumps_of_figure_10_shrink_as_the_coefficients_meet(diagrams):
    jumps = [np.abs(np.diff(offsets)).max() for offsets in diagrams[1].values()]
    assert list(diagrams[1]) == sorted(RATIOS)
    assert np.all(np.diff(jumps) < 0.0)
    assert jumps[0] == pytest.approx(2.5e-3, rel=0.01)
    # With one coefficient nothing jumps: a step of v_r by 1e-3 m/s moves the offset by 0.01 mm.
    assert jumps[-1] < 2e-5


def test_every_curve_jumps_at_the_critical_velocity_unless_the_coefficients_are_equal():
    critical = critical_reference_velocity(scene("fig10"))
    for chi, ratio in [(chi, 0.5) for chi in CHI] + [(0.1, ratio) for ratio in RATIOS]:
        changes = {"slip_damping": chi, "kinetic_coefficient": STATIC * ratio}
        system = scene("fig10").replace(
            **{f"interface.{name}": value for name, value in changes.items()}
        )
        below, there = bifurcation(system, VELOCITY, [critical * (1.0 - 1e-12), critical])
        assert there == pytest.approx(0.02, rel=1e-14)
        if ratio == 1.0:
            assert below == pytest.approx(0.02, rel=1e-12)
        else:
            assert below > 0.02002


def coulomb_offset(static, kinetic):
    """Return the offset at rest [m] under Coulomb friction, v_r = 0, by an integrator with events.

    It shares nothing with the package. Slip is followed until w = 0; the sphere then is locked if
    the force that this takes is at most the static one.
    """
    m1, m2, k1, d, normal = 0.10, 0.04, 400.0, 1.0, 0.3924

    def locking(y):
        """Return the force on the carriage that locks the sphere [N]."""
        return m2 * (d * y[2] + k1 * y[0]) / (m1 + m2)

    def locked(_, y):
        a = (-d * y[2] - k1 * y[0]) / (m1 + m2)
        return [y[2], y[2], a, a]

    def slipping(_, y):
        force = sign * kinetic * normal
        return [y[2], y[3], (-d * y[2] - k1 * y[0] + force) / m1, -force / m2]

    def lock_breaks(_, y):
        return abs(locking(y)) - static * normal

    # With equal coefficients slip begins with w = w' = 0: round-off decides both signs, so w = 0
    # ends it only where w decreases. (m1 + m2) / (m1 m2) w' is what locking exceeds friction by.
    def slip_ends(_, y):
        return max(sign * (y[3] - y[2]), sign * locking(y) - kinetic * normal)

    lock_breaks.terminal, lock_breaks.direction = True, 1.0
    slip_ends.terminal, slip_ends.direction = True, -1.0

    def follow(motion, end):
        found = solve_ivp(
            motion, (time, 10.0), state, "DOP853", rtol=1e-12, atol=1e-15, events=end, max_step=1e-3
        )
        return found.y[:, -1], found.t[-1]

    state, time = np.array([0.01, 0.03, 0.0, 0.0]), 0.0
    for _ in range(100):
        if abs(locking(state)) <= static * normal:
            state, time = follow(locked, lock_breaks)
        if time == 10.0:
            return state[1] - state[0]
        # A lock that broke slips, whatever round-off says of the force at which it broke.
        sign = np.sign(locking(state))
        state, time = follow(slipping, slip_ends)
        state[3] = state[2]
    return np.nan


@pytest.mark.parametrize(("ratio", "wanted"), [(1.0, 0.0181104), (0.5, 0.0219383)])
def test_a_vanishing_reference_velocity_is_coulomb_friction(ratio, wanted):
    # mu1 = 0.51, chi = 0. The creep of stick ends in the limit, and the offset differs from it by
    # about v_r times the duration of the motion.
    system = scene("fig10").replace(
        **{"interface.slip_damping": 0.0, "interface.kinetic_coefficient": STATIC * ratio}
    )
    offsets = bifurcation(system, VELOCITY, [1e-15, 1e-12, 1e-9, 1e-6])
    assert offsets == pytest.approx([coulomb_offset(STATIC, STATIC * ratio)] * 4, abs=1e-7)
    assert offsets[:2] == pytest.approx([wanted] * 2, abs=1e-7)
    assert offsets[0] == pytest.approx(offsets[1], abs=1e-12)


def test_springs_bring_the_sphere_to_the_middle_however_soft_they_are():
    # The limit of no stiffness is not the system without springs.
    system = scene("fig12d").replace(**{"initial.sphere_offset": 0.02})
    for stiffness in (50.0, 1.0, 1e-12):
        assert asymptotic_offset(system.replace(**{"springs.stiffness": stiffness})) == 0.0
    assert asymptotic_offset(system.replace(springs={"kind": "none"})) == pytest.approx(0.02)


def test_pre_stretch_lowers_the_resonance_of_a_damped_interface_and_raises_an_undamped_ones():
    frequencies = np.linspace(1.0, 300.0, 20001)

    def peak(damping, stretch):
        changes = {"interface": {"kind": "viscous", "damping": damping}}
        changes |= {"springs.stretch": stretch} if stretch else {"springs": {"kind": "none"}}
        response = frequency_response(scene("fig12d").replace(**changes), frequencies)
        return 1e3 * np.abs(response.force[:, 0]).max()

    damped = [peak(1.0, stretch) for stretch in (1.0, 1.5, 2.0, 3.0)]
    assert damped == pytest.approx([16.24, 10.50, 8.14, 6.94], abs=0.01)  # mm/N
    assert peak(1.0, None) == pytest.approx(8.87, abs=0.01)
    undamped = [peak(0.0, stretch) for stretch in (1.0, 1.5, 2.0, 3.0)]
    assert undamped == pytest.approx([20.03, 21.62, 22.69, 23.56], abs=0.01)
    assert peak(0.0, None) == pytest.approx(15.86, abs=0.01)


def test_both_masses_on_springs_return_to_rest_and_not_to_where_they_started():
    for name in ("fig12a", "fig12d"):
        end = simulate(scene(name), duration=20.0).state[-1]
        assert np.abs(end).max() < 1e-12
