"""Is dry friction eq. 9 of the paper, but for the point |w| = v_r, where this project sticks?"""

import numpy as np
import pytest

from mm_gym import MovingMassEnv, MovingMassVectorEnv, simulate
from mm_gym.analysis import asymptotic_offset, critical_reference_velocity
from mm_gym.paper import scene
from mm_gym.paper.figures import linear_twin
from mm_gym.paper.scenes import friction_of

from .friction import friction_force

VELOCITY = "interface.reference_velocity"
SYSTEM = scene("fig8").replace(
    sensors={"channels": ["sphere_acceleration"]},
    actuation={"force": {"limit": 1.0}},
    initial={"sphere_offset": 0.02},
)
LAW = friction_of(SYSTEM)
V_R = LAW.reference_velocity
# What an observed acceleration of 1 is: velocity scale squared over displacement scale.
ACCELERATION = SYSTEM.objective.velocity_scale**2 / SYSTEM.objective.displacement_scale


def force_at(slip_velocity):
    """Return the friction force [N] on the carriage, from the sphere's observed acceleration."""
    env = MovingMassEnv(SYSTEM.replace(**{"initial.sphere_velocity": slip_velocity}))
    observation, info = env.reset(seed=0)
    assert info["state"][3] - info["state"][2] == slip_velocity
    return -SYSTEM.sphere.mass * ACCELERATION * observation[0]


def test_the_printed_law_is_that_of_the_motion():
    drawn = SYSTEM.replace(**{"initial.sphere_velocity": [-3.0 * V_R, 3.0 * V_R]})
    envs = MovingMassVectorEnv(drawn, num_envs=4096)
    observations, infos = envs.reset(seed=0)
    slip = infos["state"][:, 3] - infos["state"][:, 2]
    found = -SYSTEM.sphere.mass * ACCELERATION * observations[:, 0]
    # Observations are in single precision: 6e-8 of the largest force.
    assert np.abs(found - friction_force(LAW, slip)).max() < 1e-7 * np.abs(found).max()
    assert np.count_nonzero(slip > V_R) > 1000 < np.count_nonzero(slip < -V_R)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_at_exactly_the_reference_velocity_the_sphere_sticks(sign):
    highest = LAW.static_coefficient * LAW.normal_force
    assert force_at(sign * V_R) == pytest.approx(sign * highest, rel=1e-7)
    # The Heaviside step of the paper is 1 at 0, so that its law slips there.
    lowest = LAW.kinetic_coefficient * LAW.normal_force
    assert friction_force(LAW, sign * V_R) == pytest.approx(sign * lowest)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_on_either_side_of_the_reference_velocity_both_laws_agree(sign):
    for slip in (np.nextafter(V_R, 0.0), np.nextafter(V_R, 1.0)):
        printed = friction_force(LAW, sign * slip)
        assert force_at(sign * float(slip)) == pytest.approx(printed, rel=1e-7)


def test_a_start_at_the_reference_velocity_slips_only_if_the_carriage_pulls_away():
    # The force at the one instant of |w| = v_r moves nothing: what follows depends on where w goes.
    for displacement, slips in ((0.0, False), (0.01, True)):
        changes = {"initial.sphere_velocity": V_R, "initial.carriage_displacement": displacement}
        states = simulate(SYSTEM.replace(**changes), times=[1e-4, 2e-4]).state
        assert np.all((states[:, 3] - states[:, 2] > V_R) == slips)


def test_where_the_slip_touches_the_reference_velocity_two_motions_obey_the_law():
    # At the critical velocity w rises to v_r in stick, which is linear, and turns back there. At
    # that instant the acceleration of slip points outwards: to slip from there obeys the law too.
    system = scene("fig10")
    critical = critical_reference_velocity(system)
    system = system.replace(**{VELOCITY: critical, "control.time_step": 1e-5})
    stick = linear_twin(system)
    law, m1, m2 = friction_of(system), system.carriage.mass, system.sphere.mass
    states = simulate(stick, duration=0.05).state
    touching = states[np.argmax(np.abs(states[:, 3] - states[:, 2]))]
    x1, x2, v1, v2 = touching
    # The nearest of the instants misses the maximum by less than 1e-6 of it.
    assert v2 - v1 == pytest.approx(critical, rel=1e-6)
    carriage = -system.carriage.damping * v1 - system.carriage.stiffness * x1

    def outwards(force):
        return -force / m2 - (carriage + force) / m1

    static, kinetic = (
        one * law.normal_force for one in (law.static_coefficient, law.kinetic_coefficient)
    )
    jump = (static - kinetic) * (m1 + m2) / (m1 * m2)
    # w'' is some 1e3 m/s^3 and the instant half a step away: 5e-3 m/s^2.
    assert outwards(static) == pytest.approx(0.0, abs=0.02)
    assert outwards(kinetic) == pytest.approx(jump, abs=0.02)
    assert jump > 1.0
    # Which of the two goes on is decided by less than 1e-5 of v_r.
    ends = [
        asymptotic_offset(
            system.replace(
                initial={
                    "carriage_displacement": x1,
                    "sphere_offset": x2 - x1,
                    "carriage_velocity": v1,
                    "sphere_velocity": v1 + factor * critical,
                }
            )
        )
        for factor in (1.0 - 1e-5, 1.0 + 1e-5)
    ]
    assert ends == pytest.approx([0.020000, 0.020746], abs=2e-6)
