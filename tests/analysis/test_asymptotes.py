"""Do asymptotic offsets agree with golden values, long simulations and the oracle?"""

import numpy as np
import pytest

from mm_gym import Scene, SceneError, SimulationError, simulate
from mm_gym.analysis import asymptotic_offset, bifurcation, critical_reference_velocity
from mm_gym.precision.oracle import Oracle

from .conftest import friction_scene, golden, linear_scene

LINEAR, POINTS = golden("linear")["cases"], golden("friction")["asymptotes"]
RELEASE = {"carriage_displacement": 0.01, "sphere_offset": 0.02}
FRICTION = friction_scene({"mu1": "0.51", "mu2_over_mu1": "0.5", "vr": "0.2", "chi": "0.1"})
VELOCITY = "interface.reference_velocity"


@pytest.mark.parametrize("name", LINEAR)
def test_linear_asymptotes_equal_the_golden_ones(name):
    wanted = float(LINEAR[name].get("dx_inf", 0.0))  # springs bring it to zero
    assert asymptotic_offset(linear_scene(LINEAR[name])) == pytest.approx(wanted, rel=0, abs=1e-17)


@pytest.mark.parametrize("case", POINTS, ids=lambda case: f"{case['vr']}-{case['chi']}")
def test_friction_asymptotes_equal_the_golden_ones(case):
    # The bound for figure 10 is 1e-10; 1e-16 is measured.
    assert abs(asymptotic_offset(friction_scene(case)) - float(case["dx_inf"])) < 1e-15


def test_initial_velocity_moves_the_place_of_rest():
    scene = Scene(initial={"sphere_offset": 0.01, "sphere_velocity": 0.3})
    end = simulate(scene, times=[20.0]).state[0]
    assert asymptotic_offset(scene) == pytest.approx(0.01 + 0.04 * 0.3)
    assert end[1] - end[0] == pytest.approx(asymptotic_offset(scene), rel=1e-12)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"interface.reference_velocity": 1e-6},
        {"initial.sphere_velocity": 0.5},
        {"carriage.damping": 0.0},
        {"springs": {"kind": "small_on_large", "stiffness": 2.0}},
        {"carriage.cubic_coefficient": 2e6},
        {"carriage.cubic_coefficient": 2e4, "initial.sphere_velocity": 0.5},
    ],
)
def test_friction_asymptote_equals_a_long_simulation(changes):
    scene = FRICTION.replace(
        **changes, **{"solver.tolerance": 1e-13} if "carriage.cubic_coefficient" in changes else {}
    )
    end = simulate(scene, duration=12.0).state[-1]
    # A stick with v_r = 1e-6 m/s creeps by 1e-9 of the offset per second.
    assert end[1] - end[0] == pytest.approx(asymptotic_offset(scene), rel=1e-9, abs=1e-9)


def test_a_vanishing_cubic_stiffness_meets_the_linear_asymptote():
    nearly = FRICTION.replace(**{"carriage.cubic_coefficient": 1e-9, "solver.tolerance": 1e-13})
    assert asymptotic_offset(nearly) == pytest.approx(asymptotic_offset(FRICTION), rel=1e-12)


@pytest.mark.parametrize(
    ("scene", "field"),
    [
        (
            Scene(interface={"kind": "none"}, initial={"sphere_velocity": 0.1}),
            "initial.sphere_velocity",
        ),
        (
            Scene(carriage={"damping": 0.0}, interface={"kind": "none"}, initial=RELEASE),
            "carriage.damping",
        ),
        (
            Scene(
                carriage={"damping": 0.0},
                interface={"kind": "none"},
                springs={"kind": "small_on_large"},
                initial=RELEASE,
            ),
            "carriage.damping",
        ),
        (Scene(initial={"sphere_offset": (0.0, 0.1)}), "initial.sphere_offset"),
        (
            Scene(excitation=[{"kind": "harmonic", "amplitude": 1.0, "frequency": 1.0}]),
            "excitation",
        ),
    ],
)
def test_motion_that_never_settles_is_refused_by_name(scene, field):
    with pytest.raises(SceneError, match=field):
        asymptotic_offset(scene)


def test_a_final_stick_out_of_reach_is_refused_at_once():
    changes = {"carriage.mass": 74.0, "carriage.stiffness": 2e6, "carriage.damping": 4e-5}
    changes |= {"sphere.mass": 1e-4, "interface.normal_force": None, VELOCITY: 3e-3}
    with pytest.raises(SimulationError, match="too slow to come to rest"):
        asymptotic_offset(FRICTION.replace(**changes))


def test_critical_velocity_equals_the_golden_one():
    assert abs(critical_reference_velocity(FRICTION) - 0.46352342782555818) < 1e-12


def test_critical_velocity_depends_on_neither_kinetic_coefficient_nor_slip_damping():
    other = FRICTION.replace(
        **{"interface.kinetic_coefficient": 0.1, "interface.slip_damping": 1.0}
    )
    assert critical_reference_velocity(other) == critical_reference_velocity(FRICTION)


def test_sphere_slips_below_the_critical_velocity_and_not_above():
    critical = critical_reference_velocity(FRICTION)
    above, below = bifurcation(FRICTION, VELOCITY, [critical * (1 + 1e-12), critical * (1 - 1e-6)])
    assert above == pytest.approx(0.02, rel=1e-14)
    assert abs(below - 0.02) > 1e-4


def test_critical_velocity_of_a_motion_that_never_slips_is_zero():
    still = FRICTION.replace(**{"initial.carriage_displacement": 0.0})
    assert critical_reference_velocity(still) == 0.0
    gentle = FRICTION.replace(**{"initial.carriage_displacement": 1e-5})
    assert critical_reference_velocity(gentle) == 0.0


def test_critical_velocity_with_springs_is_the_peak_of_the_simulated_slip():
    scene = FRICTION.replace(springs={"kind": "small_on_large", "stiffness": 20.0})
    critical = critical_reference_velocity(scene)
    viscous = scene.replace(interface={"kind": "viscous", "damping": 0.51 * 0.3924 / critical})
    states = simulate(viscous.replace(**{"control.time_step": 1e-5}), duration=0.5).state
    # A sample is at most h / 2 from the peak: |w''| h^2 / 8 is 1e-8 of it.
    assert np.abs(states[:, 3] - states[:, 2]).max() == pytest.approx(critical, rel=1e-7)


@pytest.mark.parametrize(
    "changes",
    [{"interface": {"kind": "viscous"}}, {"carriage.cubic_coefficient": 1.0}],
)
def test_critical_velocity_needs_friction_and_a_linear_stick(changes):
    with pytest.raises(SceneError, match=next(iter(changes))):
        critical_reference_velocity(FRICTION.replace(**changes))


def test_bifurcation_points_equal_single_asymptotes():
    velocities = np.array([1e-6, 0.05, 0.2, 0.45, 0.463, 0.9])
    single = [asymptotic_offset(FRICTION.replace(**{VELOCITY: v})) for v in velocities]
    assert np.array_equal(bifurcation(FRICTION, VELOCITY, velocities), single)


@pytest.mark.parametrize(
    ("parameter", "values"),
    [
        ("initial.sphere_offset", [-0.01, 0.02]),
        ("initial.carriage_displacement", [0.002, 0.02]),
        ("sphere.mass", [0.02, 0.5]),
        ("carriage.mass", [0.01, 1.0]),
        ("interface.slip_damping", [0.0, 2.0]),
    ],
)
def test_any_number_of_the_scene_can_be_the_parameter(parameter, values):
    scene = FRICTION.replace(**{"interface.normal_force": None})
    single = [asymptotic_offset(scene.replace(**{parameter: value})) for value in values]
    assert np.array_equal(bifurcation(scene, parameter, values), single)


@pytest.mark.parametrize("scene", [Scene(), FRICTION])
def test_any_number_of_an_actuated_scene_can_be_the_parameter(scene):
    damped = "interface" if scene.interface.kind == "viscous" else "carriage"
    damper = {"of": damped, "minimum": 0.1, "maximum": 10.0}
    start = {"initial.sphere_velocity": 0.1, "initial.carriage_displacement": 0.01}
    scene = scene.replace(actuation={"damping": damper, "force": {}}, **start)
    parts = ("carriage.", "sphere.", "interface.", "springs.")
    names = [n for n in scene._drawable() if n.startswith(parts) and scene.value_of(n) is not None]
    for name in [*start, *names]:
        values = scene.value_of(name) * np.array([0.8, 1.0, 1.2])
        single = [asymptotic_offset(scene.replace(**{name: value})) for value in values]
        assert np.array_equal(bifurcation(scene, name, values), single), name
    assert f"{damped}.damping" in names


def test_bifurcation_without_friction_follows_the_first_integral():
    scene = Scene(initial={"sphere_velocity": 0.1})
    damping = np.array([0.5, 1.0, 2.0])
    assert bifurcation(scene, "interface.damping", damping) == pytest.approx(0.004 / damping)


def test_bifurcation_points_equal_the_oracle():
    rng = np.random.default_rng(4)
    for velocity in rng.uniform(0.05, 0.45, 3):
        scene = FRICTION.replace(**{VELOCITY: float(velocity)})
        end = Oracle(scene, max_step=1e-3).solve([2.0])[0]
        damping = 0.51 * 0.3924 / velocity
        rest = end[1] - end[0] + 0.04 * end[3] / damping
        assert abs(bifurcation(scene, VELOCITY, [velocity])[0] - rest) < 1e-10


def test_nonlinear_points_equal_single_asymptotes():
    scene = FRICTION.replace(**{"carriage.cubic_coefficient": 2e4})
    velocities = [0.1, 0.3]
    single = [asymptotic_offset(scene.replace(**{VELOCITY: v})) for v in velocities]
    assert np.array_equal(bifurcation(scene, VELOCITY, velocities), single)


def test_an_actuator_that_is_not_used_changes_nothing():
    springs = {"kind": "small_on_large", "stiffness": 2.0, "stretch": 1.5}
    scene = FRICTION.replace(springs=springs, **{"carriage.cubic_coefficient": 2e4})
    actuated = scene.replace(actuation={"force": {"limit": 4.0}, "stretch": {}})
    assert asymptotic_offset(actuated) == asymptotic_offset(scene)


def test_progress_is_shown_when_asked_for(capsys):
    pytest.importorskip("tqdm")
    bifurcation(FRICTION, VELOCITY, np.linspace(0.1, 0.4, 100), progress=True)
    assert "100/100" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("parameter", "values", "text"),
    [
        ("interface.refrence_velocity", [0.1], "reference_velocity"),
        (VELOCITY, [0.1, -1.0], "greater than 0"),
        (VELOCITY, [np.nan], "finite"),
        ("interface.kinetic_coefficient", [0.1, 0.6], "static_coefficient"),
    ],
)
def test_wrong_parameters_and_values_are_refused(parameter, values, text):
    with pytest.raises(SceneError, match=text):
        bifurcation(FRICTION, parameter, values)
