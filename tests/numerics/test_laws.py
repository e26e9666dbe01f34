"""Is each force law written once, and right?"""

import ast
import math
import re
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

from mm_gym import MovingMassVectorEnv, Scene
from mm_gym.compiler.cache import sources
from mm_gym.compiler.jit import plain
from mm_gym.lanes import layout
from mm_gym.law import bounds, carriage_spring, dry_friction, springs
from mm_gym.plant.compile import compile_scene
from mm_gym.simulation.lanes import Lanes

FRICTION = {
    "kind": "dry_friction",
    "static_coefficient": 0.509,
    "kinetic_coefficient": 0.2545,
    "reference_velocity": 0.2,
    "slip_damping": 0.1,
    "normal_force": 0.3924,
}
K0, L0, STRETCH = 35.0, 0.05, 1.5
EPS = 2.0**-53


def files_that(contain):
    """The files of kernels but for those of Jacobians, which hold derivatives of the laws."""
    files = [file for file in sources() if file.parent.name != "sensitivity"]
    return [file for file in files if contain(file.read_text("utf-8"))]


def cubes_a_stretch(text):
    """Whether a product of three equal factors, or a third power, is one of a stretch."""
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.BinOp(ast.BinOp(a, ast.Mult(), b), ast.Mult(), c):
                cubed = ast.dump(a) == ast.dump(b) == ast.dump(c)
            case ast.BinOp(
                a, ast.Pow(), ast.Constant(3) | ast.UnaryOp(ast.USub(), ast.Constant(3))
            ):
                cubed = True
            case _:
                continue
        if cubed and "stretch" in ast.unparse(a).lower():
            return True
    return False


@pytest.mark.parametrize("row", ["MU1", "MU2", "FN"])
def test_coefficients_of_friction_are_read_in_one_compiled_file(row):
    assert [file.name for file in files_that(re.compile(rf"\blayout\.{row}\b").search)] == [
        "dry_friction.py"
    ]


def test_the_stretch_is_cubed_in_one_compiled_file():
    assert cubes_a_stretch("2 / (stretch[i] * stretch[i] * stretch[i])")
    assert cubes_a_stretch("lanes[layout.STRETCH, i] ** 3")
    assert [file.name for file in files_that(cubes_a_stretch)] == ["springs.py"]


def test_stiffness_is_exact_in_decimals():
    got = plain(springs.stiffness)(Decimal(35), Decimal("1.25"))
    assert got == Decimal(35) * 2 * (1 + Decimal(2) * Decimal("0.512"))
    assert plain(dry_friction.stick_slope)(Decimal("0.5"), Decimal(3), Decimal("0.25")) == 6


@pytest.mark.parametrize("offset", [-0.07, 1e-9, 0.02, 0.07])
def test_pair_force_is_that_of_two_neo_hookean_springs(offset):
    k0, l0, stretch, x = (Fraction(value) for value in (K0, L0, STRETCH, offset))
    longer, shorter = stretch + x / l0, stretch - x / l0
    exact = k0 * l0 * ((longer - longer**-2) - (shorter - shorter**-2))
    got = springs.spring_force(K0, L0, STRETCH, offset)
    # The difference of the squares loses what it is smaller by, at most 3 here, and enters squared.
    assert abs(Fraction(got) - exact) <= 24 * EPS * abs(exact)


def test_pair_has_the_stiffness_of_springs_small_on_large_at_the_middle():
    # The next term of the force is smaller by (offset / l0)^2, 4e-16 here.
    got = springs.spring_force(K0, L0, STRETCH, 1e-9) / 1e-9
    assert got == pytest.approx(springs.stiffness(K0, STRETCH), rel=8 * EPS)


@pytest.mark.parametrize("l0", [0.0, L0])
def test_force_of_the_springs_is_the_slope_of_their_energy(l0):
    energy, x, h = plain(springs.spring_energy), 0.02, 1e-7
    slope = (energy(K0, l0, STRETCH, x + h) - energy(K0, l0, STRETCH, x - h)) / (2.0 * h)
    # Round-off of the energies is some eps E / h = 3e-11 N of 2 N; h^2 E''' / 6 = 3e-12 N.
    assert slope == pytest.approx(springs.spring_force(K0, l0, STRETCH, x), rel=1e-10)


def test_force_of_the_carriages_spring_is_the_slope_of_its_energy():
    energy, law, x, h = plain(carriage_spring.carriage_energy), (400.0, 0.9, 2e6), 0.004, 1e-8
    slope = (energy(*law, x + h) - energy(*law, x - h)) / (2.0 * h)
    # eps E / h = 1e-10 N of 53 N; h^2 E''' / 6 = 3e-10 N.
    assert slope == pytest.approx(carriage_spring.carriage_force(*law, x), rel=1e-10)


@pytest.mark.parametrize("w", [-0.5, -0.2, -0.1, 0.0, 0.1, 0.2, math.nextafter(0.2, 1.0), 0.5])
def test_interface_force_is_equation_9_of_the_paper(w):
    mu1, mu2, vr, chi, normal = 0.509, 0.2545, 0.2, 0.1, 0.3924
    if abs(w) <= vr:
        expected = mu1 * normal / vr * w
    else:
        expected = math.copysign(mu2 * normal + chi * (abs(w) - vr), w)
    c, kinetic = dry_friction.stick_slope(mu1, normal, vr), dry_friction.kinetic_force(mu2, normal)
    assert dry_friction.interface_force(c, vr, kinetic, chi, w) == expected
    regime = 0.0 if abs(w) <= vr else math.copysign(1.0, w)
    slope, constant = dry_friction.interface_line(
        regime, c, chi, dry_friction.slip_intercept(kinetic, chi, vr)
    )
    assert slope * w + constant == pytest.approx(expected, rel=4 * EPS, abs=0.0)


def test_every_episode_has_the_friction_of_its_own_coefficients():
    drawn = {"static_coefficient": (0.4, 0.6), "kinetic_coefficient": (0.1, 0.3)}
    drawn |= {"reference_velocity": (0.1, 0.3), "normal_force": (0.2, 0.5)}
    ranges = {f"interface.{name}": ends for name, ends in drawn.items()}
    lanes = Lanes(compile_scene(Scene(interface=FRICTION, randomization=ranges)), 8)

    def check():
        p = lanes.values
        assert np.array_equal(p[layout.C], p[layout.MU1] * p[layout.FN] / p[layout.VR])
        assert np.array_equal(p[layout.KINETIC_FORCE], p[layout.MU2] * p[layout.FN])

    check()  # before the first episode
    lanes.seed(0)
    lanes.restart()
    check()
    assert np.ptp(lanes.values[layout.C]) > 0.0
    lanes.restart(
        np.arange(0, 8, 3), lanes.checked({"interface.static_coefficient": np.full(8, 0.45)})
    )
    check()


def test_friction_does_not_depend_on_neighbours_that_have_not_begun():
    scene = Scene(
        interface=FRICTION, initial={"carriage_displacement": 0.05}, actuation={"force": {}}
    )

    def motion(mask):
        env = MovingMassVectorEnv(scene, 4)
        env.reset(seed=0, options={"reset_mask": mask})
        return env.step(np.zeros((4, 1), np.float32))[4]["state"][-1]

    together = motion(np.ones(4, np.bool_))
    assert abs(together[3] - together[2]) > FRICTION["reference_velocity"]
    assert np.array_equal(motion(np.arange(4) == 3), together)


def test_fastest_rate_bounds_the_norm_of_the_generator():
    rng = np.random.default_rng(0)
    for _ in range(200):
        m1, m2, k1, k2, c, d = 10.0 ** rng.uniform(-3.0, 3.0, 6)
        stiffness = np.array([[k1 + k2, -k2], [-k2, k2]])
        damping, mass = np.array([[c + d, -c], [-c, c]]), np.diag([m1, m2])
        zero, one = np.zeros((2, 2)), np.eye(2)
        a = np.block(
            [[zero, one], [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)]]
        )
        root = np.linalg.cholesky(np.block([[stiffness, zero], [zero, mass]])).T
        norm = np.linalg.norm(root @ a @ np.linalg.inv(root), 2)
        # The condition of the root, up to 1e6, costs the norm as much of its precision.
        assert norm <= bounds.fastest_rate(m1, m2, k1, k2, c, d) * (1.0 + 1e-9)
