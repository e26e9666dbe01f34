"""Does each plant agree with its neighbour in the limit of a parameter?"""

from __future__ import annotations

import numpy as np
import pytest
from oracle import error

from mm_gym import CompileError, Scene, compile_scene, simulate
from mm_gym.precision.oracle import Oracle
from mm_gym.scene.excitation import Harmonic
from mm_gym.scene.mechanics import (
    Carriage,
    DryFriction,
    FiniteStretch,
    NoInterface,
    SmallOnLarge,
    Viscous,
)
from mm_gym.scene.scene import Control, Initial

START = Initial(carriage_displacement=0.01, sphere_offset=0.02)
BASE = Scene(initial=START, control=Control(time_step=1e-2))
DRY = {
    "kind": "dry_friction",
    "static_coefficient": 0.5,
    "kinetic_coefficient": 0.5,
    "reference_velocity": 0.1,
}
HARMONICS = [
    Harmonic(amplitude=3.0, frequency=50.0, phase=0.3).model_dump(),
    Harmonic(target="ground", amplitude=20.0, frequency=37.0, phase=-1.0).model_dump(),
]
FORCES = np.random.default_rng(4).uniform(-20.0, 20.0, 50)
DRIVEN = BASE.replace(
    excitation=HARMONICS,
    springs=SmallOnLarge(stiffness=35.0).model_dump(),
    **{"actuation.force": {"limit": 20.0}},
)


def _driven(scene: Scene) -> np.ndarray:
    return simulate(scene, duration=0.5, action=FORCES).state


def test_massless_carriage_meets_the_oracle() -> None:
    scene = DRIVEN.replace(**{"carriage.mass": 0.0})
    plant = compile_scene(scene)
    assert plant.kind == "massless carriage"
    want = Oracle(scene).solve(np.arange(1, 51) * 0.01, forces=FORCES)
    # v1 jumps with the force; both return it before the jump.
    assert error(_driven(scene)[1:], want) <= 1e-11


@pytest.mark.parametrize("damping", [0.0, 1.0])
def test_small_mass_meets_the_massless_carriage(damping: float) -> None:
    scene = DRIVEN.replace(**{"interface.damping": damping})
    limit = _driven(scene.replace(**{"carriage.mass": 0.0}))[1:]
    errors = [
        error(_driven(scene.replace(**{"carriage.mass": mass}))[1:], limit)
        for mass in (1e-5, 1e-6, 1e-7, 1e-80)
    ]
    # The difference is of first order in m1, until only round-off is left.
    assert errors[1] / errors[0] == pytest.approx(0.1, rel=0.1)
    assert errors[2] / errors[1] == pytest.approx(0.1, rel=0.1)
    assert errors[3] <= 1e-12


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"carriage.damping": 0.0, "interface": {"kind": "none"}}, "damping > 0"),
        ({"carriage.cubic_coefficient": 1.0}, "linear springs"),
        ({"interface": DRY}, "viscous"),
        ({"randomization": {"sphere.mass": (0.1, 0.2)}}, "have one value"),
    ],
)  # fmt: skip
def test_massless_carriage_outside_its_domain_is_refused(
    changes: dict[str, object], reason: str
) -> None:
    with pytest.raises(CompileError, match=rf"carriage.mass: 0 .*{reason}"):
        compile_scene(BASE.replace(**{"carriage.mass": 0.0}, **changes))


def test_normal_force_of_a_sphere_of_random_mass_must_be_stated() -> None:
    changes = {"interface": DRY, "randomization": {"sphere.mass": (0.02, 0.04)}}
    with pytest.raises(CompileError, match=r"interface.normal_force: missing"):
        compile_scene(BASE.replace(**changes))
    assert compile_scene(BASE.replace(**changes | {"interface": DRY | {"normal_force": 0.3}}))


def test_massless_carriage_has_a_sampled_system_but_no_continuous_one() -> None:
    plant = compile_scene(BASE.replace(**{"carriage.mass": 0.0}))
    ad, bd = plant.discrete()
    assert (ad.shape, bd.shape) == ((4, 4), (4, 1))
    assert not ad[:, 2].any()
    with pytest.raises(CompileError, match="three states"):
        plant.linear()


@pytest.mark.parametrize("damping", [1e9, 1e12, 1e14])
@pytest.mark.parametrize("time_step", [1e-6, 1e-2, 10.0])
def test_linear_plant_holds_its_bound_up_to_a_rigid_lock(damping: float, time_step: float) -> None:
    scene = BASE.replace(
        **{
            "interface.damping": damping,
            "control.time_step": time_step,
            "initial.sphere_velocity": 1.0,
        }
    )
    got = simulate(scene, duration=20 * time_step).state[1:]
    # Locked, the masses move as one of m1 + m2 with their common momentum. The slip decays within
    # m / c.
    together = Scene(
        carriage=Carriage(mass=0.14),
        interface=NoInterface(),
        initial=Initial(carriage_displacement=0.01, carriage_velocity=0.04 / 0.14),
        control=Control(time_step=time_step),
    )
    want = simulate(together, duration=20 * time_step).state[1:]
    scale = np.array([0.03, 0.03, 0.6, 0.6])
    # The remaining slip is of the order of k1 x1 / c, its effect before the lock of m2 / c.
    bound = 1e-12 + 100.0 / damping
    assert error(got[:, [0, 0, 2, 2]], want[:, [0, 0, 2, 2]], scale) <= bound
    assert error(got[:, [3, 3, 3, 3]], want[:, [2, 2, 2, 2]], scale) <= bound
    assert np.abs(got[:, 1] - got[:, 0] - 0.02).max() <= 1e-12 + 1.0 / damping
    # The first integral m2 v2 + c offset holds to round-off of the stronger term.
    drift = 0.04 * (got[:, 3] - 1.0) / damping + (got[:, 1] - got[:, 0] - 0.02)
    assert np.abs(drift).max() <= 1e-15


def test_offset_decays_over_the_long_time_of_a_weak_interface() -> None:
    # With c = 1e-12 the offset returns over m2 / c = 4e10 s.
    scene = BASE.replace(
        **{"interface.damping": 1e-12, "control.time_step": 1e10, "control.steps": 20}
    )
    offset = np.diff(simulate(scene).state[:, :2], axis=1).ravel()
    rate = 1e-12 / 0.04
    want = 0.02 + 0.01 * np.exp(-rate * 1e10 * np.arange(1, 21))
    assert offset[1:] == pytest.approx(want, rel=1e-9)


def _friction(**changes: float) -> Scene:
    values = {
        "static_coefficient": 0.509,
        "kinetic_coefficient": 0.2545,
        "reference_velocity": 0.2,
        "slip_damping": 0.1,
    }
    return BASE.replace(interface=DryFriction(**values | changes).model_dump())


def test_vanishing_friction_recovers_the_free_sphere() -> None:
    free = simulate(BASE.replace(interface={"kind": "none"}), duration=0.5).state
    errors = []
    for mu in (1e-6, 1e-8):
        scene = _friction(static_coefficient=mu, kinetic_coefficient=mu, slip_damping=0.0)
        errors.append(
            error(
                simulate(scene.replace(**{"solver.method": "switched"}), duration=0.5).state, free
            )
        )
    assert errors[1] / errors[0] == pytest.approx(0.01, rel=0.01)
    assert errors[1] <= 1e-6


def test_friction_without_a_kink_is_viscous() -> None:
    # With mu1 = mu2 and chi = mu1 F_N / v_r, slip continues stick.
    damping = 0.5 * 0.04 * 9.81 / 0.2
    scene = _friction(static_coefficient=0.5, kinetic_coefficient=0.5, slip_damping=damping)
    viscous = BASE.replace(interface=Viscous(damping=damping).model_dump())
    assert compile_scene(scene).kind == "switched linear"
    assert (
        error(simulate(scene, duration=0.5).state, simulate(viscous, duration=0.5).state) <= 1e-12
    )


def test_vanishing_cubic_coefficient_recovers_the_linear_plant() -> None:
    tight = DRIVEN.replace(**{"solver.tolerance": 1e-14, "carriage.cubic_coefficient": 1e-12})
    assert compile_scene(tight).method.name == "taylor"
    assert error(_driven(tight), _driven(DRIVEN)) <= 1e-12


def test_long_springs_of_finite_stretch_recover_the_small_on_large_ones() -> None:
    errors = []
    for length in (1.0, 10.0):
        springs = FiniteStretch(stiffness=35.0, rest_length=length).model_dump()
        errors.append(
            error(
                _driven(DRIVEN.replace(springs=springs, **{"solver.tolerance": 1e-14})),
                _driven(DRIVEN),
            )
        )
    # The pair is symmetric, so the first correction is of order (offset / rest_length)^2.
    assert errors[1] / errors[0] == pytest.approx(0.01, rel=0.1)


def test_carriage_alone_leaves_the_sphere_in_free_flight() -> None:
    scene = BASE.replace(interface={"kind": "none"}, **{"initial.sphere_velocity": 0.3})
    plant = compile_scene(scene)
    assert "nothing joins" in plant.explain()
    states = simulate(plant, duration=1.0)
    assert states.state[:, 1] == pytest.approx(0.03 + 0.3 * states.time, rel=1e-14)
