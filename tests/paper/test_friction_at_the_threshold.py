"""Is dry friction eq. 9 of the paper, but for the point |w| = v_r, where this project sticks?"""

import numpy as np
import pytest

from mm_gym import MovingMassEnv, MovingMassVectorEnv, SceneError, simulate
from mm_gym.paper import scene
from mm_gym.paper.printed import friction_force, friction_of, normal_force, stick_slope

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
    highest = LAW.static_coefficient * normal_force(LAW)
    assert force_at(sign * V_R) == pytest.approx(sign * highest, rel=1e-7)
    # The Heaviside step of the paper is 1 at 0, so that its law slips there.
    lowest = LAW.kinetic_coefficient * normal_force(LAW)
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


def test_the_printed_law_needs_a_stated_weight_and_dry_friction():
    with pytest.raises(SceneError, match="normal_force"):
        stick_slope(friction_of(SYSTEM.replace(**{"interface.normal_force": None})))
    with pytest.raises(SceneError, match=r"interface\.kind"):
        friction_of(scene("fig2a"))
