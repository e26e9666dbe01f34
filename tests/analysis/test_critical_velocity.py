"""Does the critical reference velocity hold at its own value, and is it the smallest that does?"""

import numpy as np
import pytest

from mm_gym import simulate
from mm_gym.analysis import asymptotic_offset, bifurcation, critical_reference_velocity

from .conftest import friction_scene

FRICTION = friction_scene({"mu1": "0.51", "mu2_over_mu1": "0.5", "vr": "0.2", "chi": "0.1"})
VELOCITY = "interface.reference_velocity"


def with_static_coefficient(value):
    changes = {"static_coefficient": value, "kinetic_coefficient": 0.5 * value}
    return FRICTION.replace(**{f"interface.{name}": number for name, number in changes.items()})


def random_scene(rng):
    """Return a light or heavy carriage released at random, its sphere free or on springs."""

    def between(low, high):
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    on_springs = rng.random() < 0.4
    stiffness = between(0.1, 1e3)
    static = between(0.05, 2.0)
    return FRICTION.replace(
        springs={"kind": "small_on_large", "stiffness": stiffness}
        if on_springs
        else {"kind": "none"},
        **{
            "carriage.mass": between(0.03, 3.0),
            "carriage.stiffness": between(30.0, 3e3),
            "carriage.damping": between(0.1, 30.0),
            "sphere.mass": between(0.03, 3.0),
            "interface.static_coefficient": static,
            "interface.kinetic_coefficient": static * float(rng.uniform(0.1, 0.9)),
            "interface.slip_damping": float(rng.uniform(0.0, 2.0)),
            "interface.normal_force": None,
            "initial.carriage_displacement": float(rng.normal(scale=0.02)),
            "initial.sphere_offset": float(rng.normal(scale=0.02)),
            "initial.sphere_velocity": float(rng.normal(scale=0.3)) if rng.random() < 0.5 else 0.0,
        },
    )


def rest_without_slip(scene):
    """Return the offset [m] at which a motion that sticks throughout ends."""
    friction = scene.interface
    normal = scene.sphere.mass * 9.81 if friction.normal_force is None else friction.normal_force
    slope = friction.static_coefficient * normal / friction.reference_velocity
    momentum = scene.sphere.mass * scene.initial.sphere_velocity
    return scene.initial.sphere_offset + momentum / slope if scene.springs.kind == "none" else 0.0


@pytest.mark.parametrize("static", [0.51, 0.509])
def test_nothing_slips_at_the_critical_velocity_itself(static):
    scene = with_static_coefficient(static)
    critical = critical_reference_velocity(scene)
    offset = asymptotic_offset(scene.replace(**{VELOCITY: critical}))
    assert offset == pytest.approx(0.02, rel=1e-15)


@pytest.mark.parametrize("static", [0.51, 0.509])
def test_a_little_below_the_critical_velocity_the_sphere_slips_and_loses_its_offset(static):
    # At the returned velocity 20.000 mm, just below 20.747 mm: a jump, because the slip that begins
    # with touching v_r does not end at once.
    scene = with_static_coefficient(static)
    critical = critical_reference_velocity(scene)
    offset = asymptotic_offset(scene.replace(**{VELOCITY: critical * (1.0 - 1e-12)}))
    assert offset == pytest.approx(0.02074, abs=1e-5)


def test_simulations_too_stick_at_the_critical_velocity():
    critical = critical_reference_velocity(FRICTION)
    slope = 0.51 * 0.3924 / critical
    for time_step in (1e-4, 1e-3, 3.7e-3, 0.01, 0.1):
        changes = {VELOCITY: critical, "control.time_step": time_step}
        x1, x2, _, v2 = simulate(FRICTION.replace(**changes), duration=1.0).state[-1]
        # The first integral from the start on: any slip would have changed it by 1e-4 m.
        assert x2 - x1 + 0.04 * v2 / slope == pytest.approx(0.02, rel=1e-12)


def test_nothing_slips_at_the_critical_velocity_of_random_scenes():
    rng = np.random.default_rng(13)
    found = 0
    for _ in range(60):
        scene = random_scene(rng)
        critical = critical_reference_velocity(scene)
        if critical == 0.0:
            continue
        found += 1
        at = scene.replace(**{VELOCITY: critical})
        # The longest motions end with an energy of 1e-11 m; a slip changes the offset by far more.
        assert asymptotic_offset(at) == pytest.approx(rest_without_slip(at), rel=1e-9, abs=1e-11)
    assert found > 30


def test_the_critical_velocity_of_random_scenes_is_the_smallest_that_holds():
    rng = np.random.default_rng(14)
    slipped = 0
    for _ in range(40):
        # From rest, since a start at w = v_r is no maximum: its slip vanishes continuously.
        changes = {"initial.sphere_velocity": 0.0}
        scene = random_scene(rng).replace(springs={"kind": "none"}, **changes)
        critical = critical_reference_velocity(scene)
        if critical == 0.0:
            continue
        below = scene.replace(**{VELOCITY: critical * (1.0 - 1e-6)})
        assert asymptotic_offset(below) != pytest.approx(rest_without_slip(below), rel=1e-9)
        slipped += 1
    assert slipped > 20


def test_slip_that_is_faster_with_damping_than_without_is_not_overlooked():
    # A heavy carriage carries a light sphere along by friction and meets it on its way back: the
    # fastest slip is 5 % above that of the free sphere, and so is the critical velocity.
    scene = FRICTION.replace(
        **{
            "carriage.mass": 5.0,
            "carriage.stiffness": 350.0,
            "carriage.damping": 0.1,
            "sphere.mass": 0.03,
            "interface.normal_force": None,
            "interface.static_coefficient": 0.02,
            "interface.kinetic_coefficient": 0.01,
            "initial.carriage_displacement": 0.03,
        }
    )
    critical = critical_reference_velocity(scene)
    free = scene.replace(interface={"kind": "none"}, **{"control.time_step": 1e-3})
    states = simulate(free, duration=2.0).state
    assert critical > 1.01 * np.abs(states[:, 3] - states[:, 2]).max()
    velocities = critical * np.array([1.0 - 1e-9, 1.0, 1.001, 1.01, 1.1, 2.0])
    below, *above = bifurcation(scene, VELOCITY, velocities)
    assert above == pytest.approx([0.02] * 5, rel=1e-14)
    assert abs(below - 0.02) > 1e-5
