"""Does the project move by the equations that the paper prints?"""

import numpy as np
import pytest

from mm_gym import MovingMassVectorEnv, Scene, SceneError, compile_scene
from mm_gym.analysis.linear import characteristic, linear_values
from mm_gym.paper import scene

from . import appendix
from .friction import friction_force


@pytest.mark.parametrize("name", ["fig2a", "fig2b_caption", "fig5b", "fig12a", "fig12d"])
def test_the_linear_plant_has_the_matrix_of_equations_3_and_16(name):
    m1, m2, k1, k2, c, d = linear_values(scene(name))
    wanted = [
        [0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 1.0],
        [-(k1 + k2) / m1, k2 / m1, -(c + d) / m1, c / m1],
        [k2 / m2, -k2 / m2, c / m2, -c / m2],
    ]
    matrix, _ = compile_scene(scene(name)).linear()
    assert matrix == pytest.approx(np.array(wanted), rel=1e-15)


@pytest.mark.parametrize("name", ["fig2a", "fig12d"])
def test_the_characteristic_polynomial_is_that_of_equations_4_17_and_26(name):
    values = linear_values(scene(name))
    m1, m2, k1, k2, c, d = values
    printed = [
        m1 * m2,
        c * (m1 + m2) + d * m2,
        c * d + k1 * m2 + (m1 + m2) * k2,
        c * k1 + d * k2,
        k1 * k2,
    ]
    assert characteristic(values) == pytest.approx(printed, rel=1e-15)
    assert appendix.coefficients(appendix.System(*values))[::-1] == pytest.approx(printed)


def observed(system):
    """Return states (n, 4) and accelerations (n, 2) of random starts."""
    channels = ["carriage_acceleration", "sphere_acceleration"]
    ranges = {
        "carriage_displacement": [-0.02, 0.02],
        "sphere_offset": [-0.02, 0.02],
        "carriage_velocity": [-0.5, 0.5],
        "sphere_velocity": [-0.5, 0.5],
    }
    task = {"sensors": {"channels": channels}, "actuation": {"force": {"limit": 1.0}}}
    envs = MovingMassVectorEnv(system.replace(initial=ranges, **task), num_envs=500)
    observations, infos = envs.reset(seed=3)
    objective = system.objective
    unit = objective.velocity_scale**2 / objective.displacement_scale
    return infos["state"], unit * observations.astype(np.float64)


@pytest.mark.parametrize("name", ["fig2a", "fig6d", "fig8", "fig12d"])
def test_every_motion_obeys_its_printed_equations(name):
    # Eqs 1 and 2, 7 and 8, 10 and 11, 13 and 14: they differ in the spring and in f.
    system = scene(name)
    states, accelerations = observed(system)
    x1, x2, v1, v2 = states.T
    carriage, sphere, law = system.carriage, system.sphere, system.interface
    spring = carriage.stiffness * (1.0 + carriage.cubic_coefficient * x1**2) * x1
    slip = v2 - v1
    force = law.damping * slip if law.kind == "viscous" else friction_force(law, slip)
    if system.springs.kind != "none":
        force = force + 2.0 * 50.0 * (1.0 + 2.0 * 1.5**-3) * (x2 - x1)
    wanted = np.column_stack(
        [(-carriage.damping * v1 - spring + force) / carriage.mass, -force / sphere.mass]
    )
    # Observations are in single precision.
    assert np.abs(accelerations - wanted).max() < 2e-7 * np.abs(wanted).max()


def test_the_weight_is_the_normal_force():
    friction = {"kind": "dry_friction", "static_coefficient": 0.5, "kinetic_coefficient": 0.25}
    interface = friction | {"reference_velocity": 0.2}
    stated = scene("fig10").interface.normal_force
    assert stated == pytest.approx(scene("fig10").sphere.mass * 9.81, rel=1e-15)
    default = Scene(sphere={"mass": 0.04}, interface=interface)
    assert linear_values(default).c == pytest.approx(0.5 * stated / 0.2, rel=1e-15)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("fig8", {"interface.kinetic_coefficient": 0.6}),
        ("fig8", {"interface.slip_damping": -0.1}),
        ("fig8", {"interface.reference_velocity": 0.0}),
        ("fig12a", {"springs.stretch": 0.9}),
        ("fig12a", {"springs.stiffness": 0.0}),
        ("fig2a", {"carriage.stiffness": 0.0}),
    ],
)
def test_what_the_model_excludes_is_refused_by_name(name, changes):
    with pytest.raises(SceneError, match=next(iter(changes)).rpartition(".")[2]):
        scene(name).replace(**changes)
