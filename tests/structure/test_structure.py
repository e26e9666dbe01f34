"""Matrices, modes and their reduction to the carriage."""

import numpy as np
import pytest
from scipy.linalg import eigh

from mm_gym.errors import SceneError
from mm_gym.structure import Structure, StructureError, example, rayleigh_damping

FRAME = Structure.of_storeys([3.0, 2.0, 1.5], [900.0, 700.0, 400.0], [0.02, 0.03, 0.04])
EPS = np.finfo(float).eps


def uniform(floors, mass=2.0, stiffness=500.0, damping=0.05):
    return Structure.of_storeys([mass] * floors, [stiffness] * floors, damping)


@pytest.mark.parametrize("floors", [1, 2, 5, 20])
def test_frequencies_of_a_uniform_shear_building_are_those_of_its_formula(floors):
    # Of equal masses on equal storeys; round-off of K is relative to its largest eigenvalue.
    k = np.arange(1, floors + 1)
    formula = 2.0 * np.sqrt(500.0 / 2.0) * np.sin((2 * k - 1) * np.pi / (4 * floors + 2))
    squares = uniform(floors).frequencies ** 2
    assert np.abs(squares - formula**2).max() < 100 * EPS * squares.max()


def test_modes_are_those_of_scipy_and_satisfy_their_equation():
    squares, shapes = eigh(FRAME.stiffness, FRAME.mass)
    frequencies, own = FRAME.modes
    np.testing.assert_allclose(frequencies**2, squares, rtol=1e-14)
    np.testing.assert_allclose(np.abs(own), np.abs(shapes), rtol=1e-12)
    left, right = FRAME.stiffness @ own, FRAME.mass @ own * frequencies**2
    np.testing.assert_allclose(left, right, atol=1e-12 * np.abs(left).max())
    np.testing.assert_allclose(FRAME.damping_ratios, [0.02, 0.03, 0.04], rtol=1e-13)


def test_one_storey_is_its_own_reduction():
    reduced = Structure.of_storeys([7.0], [50.0], 0.1).reduce(1)
    assert (reduced.mass, reduced.stiffness, reduced.participation) == (7.0, 50.0, 1.0)
    assert reduced.damping == pytest.approx(2.0 * 0.1 * np.sqrt(7.0 * 50.0), rel=1e-15)
    assert reduced.effective_mass_ratio == pytest.approx(1.0, rel=1e-15)


@pytest.mark.parametrize("mode", [1, 2, 3])
def test_carriage_has_frequency_and_damping_ratio_of_the_mode(mode):
    reduced = FRAME.reduce(3, mode)
    assert reduced.shape[2] == 1.0
    w = FRAME.frequencies[mode - 1]
    assert np.sqrt(reduced.stiffness / reduced.mass) == pytest.approx(w, rel=1e-13)
    ratio = reduced.damping / (2.0 * np.sqrt(reduced.stiffness * reduced.mass))
    assert ratio == pytest.approx([0.02, 0.03, 0.04][mode - 1], rel=1e-12)
    assert reduced.damping_ratio == pytest.approx(ratio, rel=1e-12)


def test_effective_masses_add_up_and_participations_make_the_rigid_motion():
    every = [FRAME.reduce(3, mode) for mode in (1, 2, 3)]
    assert sum(one.effective_mass_ratio for one in every) == pytest.approx(1.0, rel=1e-14)
    # r = sum of Gamma times shape, whatever the shapes are scaled by.
    rigid = sum(one.participation * one.shape for one in every)
    np.testing.assert_allclose(rigid, FRAME.influence, rtol=1e-13)


@pytest.mark.parametrize("factor", [1e-6, 3.0, 1e9])
def test_heavier_structures_have_the_same_modes(factor):
    one, other = (
        FRAME.reduce(2),
        Structure(factor * FRAME.mass, factor * FRAME.stiffness, factor * FRAME.damping).reduce(2),
    )
    for name in ("mass", "stiffness", "damping"):
        assert getattr(other, name) == pytest.approx(factor * getattr(one, name), rel=1e-12)
    for name in ("frequency", "participation", "effective_mass_ratio", "damping_ratio"):
        assert getattr(other, name) == pytest.approx(getattr(one, name), rel=1e-12)


def test_faster_time_leaves_shape_and_damping_ratio():
    one = FRAME.reduce(3)
    other = Structure(FRAME.mass, 4.0 * FRAME.stiffness, 2.0 * FRAME.damping).reduce(3)
    assert other.frequency == pytest.approx(2.0 * one.frequency, rel=1e-13)
    assert other.damping_ratio == pytest.approx(one.damping_ratio, rel=1e-12)
    assert other.participation == pytest.approx(one.participation, rel=1e-12)


def test_another_place_of_the_device_only_scales_the_mode():
    top, first = FRAME.reduce(3), FRAME.reduce(1)
    share = top.shape[0]  # of the top's displacement at the first floor
    assert first.mass == pytest.approx(top.mass / share**2, rel=1e-12)
    assert first.participation == pytest.approx(top.participation * share, rel=1e-12)
    assert first.effective_mass_ratio == pytest.approx(top.effective_mass_ratio, rel=1e-12)


def test_numbering_of_the_degrees_of_freedom_does_not_matter():
    order = [2, 0, 1]
    other = Structure(
        *(m[np.ix_(order, order)] for m in (FRAME.mass, FRAME.stiffness, FRAME.damping))
    )
    one, same = FRAME.reduce(3), other.reduce(1)
    np.testing.assert_allclose(same.shape, one.shape[order], rtol=1e-12)
    assert same.mass == pytest.approx(one.mass, rel=1e-12)
    assert same.participation == pytest.approx(one.participation, rel=1e-12)


def test_rayleigh_damping_has_its_ratios_in_two_modes():
    c = rayleigh_damping(FRAME.mass, FRAME.stiffness, [0.02, 0.05], [1, 3])
    ratios = Structure(FRAME.mass, FRAME.stiffness, c).damping_ratios
    assert ratios[[0, 2]] == pytest.approx([0.02, 0.05], rel=1e-12)
    assert FRAME.reduce(3).damping_coupling < 1e-12


def test_damping_matrix_may_couple_the_modes():
    coupled = example("three_storeys").reduction
    _, shapes = coupled.structure.modes
    c = shapes.T @ coupled.structure.damping @ shapes
    expected = np.abs(c[0, 1:]) / np.sqrt(c[0, 0] * np.diag(c)[1:])
    assert coupled.damping_coupling == pytest.approx(expected.max(), rel=1e-12)
    assert expected.max() > 0.4


GOOD = np.diag([2.0, 3.0])
STIFF = np.array([[5.0, -2.0], [-2.0, 2.0]])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ([[1.0, 2.0], [0.0, 1.0]], STIFF, 0.0),
            ["structure.mass", "row 1, column 2", "symmetric"],
        ),
        ((np.diag([1.0, 0.0]), STIFF, 0.0), ["structure.mass", "positive definite", "condense"]),
        ((np.diag([1.0, -1.0]), STIFF, 0.0), ["structure.mass", "eigenvalue -1"]),
        ((np.ones((2, 3)), STIFF, 0.0), ["structure.mass", "(2, 3)", "(n, n)"]),
        (([1.0, 2.0], STIFF, 0.0), ["structure.mass", "(2,)"]),
        (([[1.0, 2.0], [3.0]], STIFF, 0.0), ["structure.mass", "not an array"]),
        ((np.zeros((0, 0)), STIFF, 0.0), ["structure.mass", "(0, 0)"]),
        ((GOOD, np.eye(3), 0.0), ["structure.stiffness", "(3, 3)", "(2, 2)"]),
        ((GOOD, [[1.0, -1.0], [-1.0, 1.0]], 0.0), ["structure.stiffness", "positive definite"]),
        ((GOOD, [[1.0, np.nan], [0.0, 1.0]], 0.0), ["structure.stiffness", "NaN"]),
        (
            (GOOD, [["a", "b"], ["c", "d"]], 0.0),
            ["structure.stiffness", "got type <U1; allowed: numbers"],
        ),
        ((GOOD, STIFF, [0.1, 0.1, 0.1]), ["structure.damping", "3 damping ratios", "2 of them"]),
        ((GOOD, STIFF, -0.1), ["structure.damping", "-0.1", "below 1"]),
        ((GOOD, STIFF, 5.0), ["structure.damping", "5", "below 1"]),
        ((GOOD, STIFF, -np.eye(2)), ["structure.damping", "semidefinite"]),
        ((GOOD, STIFF, np.eye(3)), ["structure.damping", "(3, 3)"]),
    ],
)
def test_bad_matrices_are_named(arguments, words):
    with pytest.raises(StructureError) as caught:
        Structure(*arguments)
    assert all(word in str(caught.value) for word in words), str(caught.value)
    assert isinstance(caught.value, SceneError)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Structure(GOOD, STIFF, 0.0, influence=[1.0]), ["structure.influence", "(1,)"]),
        (lambda: Structure(GOOD, STIFF, 0.0, influence=[0, 0]), ["structure.influence", "zeros"]),
        (lambda: Structure.of_storeys([1.0, -2.0], [1.0, 1.0], 0.0), ["masses", "-2 in storey 2"]),
        (lambda: Structure.of_storeys([1.0, 2.0], [1.0], 0.0), ["stiffnesses", "got 1", "2"]),
        (lambda: Structure.of_storeys([], [], 0.0), ["masses", "(0,)"]),
        (lambda: FRAME.reduce(0), ["structure.device", "got 0", "1 to 3"]),
        (lambda: FRAME.reduce(4), ["structure.device", "got 4", "1 to 3"]),
        (lambda: FRAME.reduce(3, 4), ["structure.mode", "got 4", "1 to 3"]),
        (lambda: FRAME.reduce(3, 1.5), ["structure.mode", "got 1.5"]),
        (lambda: FRAME.reduce(True), ["structure.device", "got True"]),
        (lambda: rayleigh_damping(GOOD, STIFF, [0.1, 0.1], [1, 1]), ["structure.modes"]),
        (lambda: rayleigh_damping(GOOD, STIFF, [0.1, 0.1], 2), ["structure.modes", "got 2"]),
        (lambda: rayleigh_damping(GOOD, STIFF, [0.1], [1, 2]), ["structure.ratios"]),
        (lambda: rayleigh_damping(GOOD, STIFF, [0.1, 0.1], [1, 3]), ["structure.modes", "got 3"]),
        (
            lambda: rayleigh_damping(GOOD, STIFF, [np.nan, 0.1]),
            ["structure.ratios", "got NaN", "finite"],
        ),
        (
            lambda: rayleigh_damping(GOOD, STIFF, ["a", 0.1]),
            ["structure.ratios", "got type <U32; allowed: numbers"],
        ),
        (lambda: rayleigh_damping(GOOD, STIFF, 0.1), ["structure.ratios", "got 0.1", "two"]),
        (
            lambda: rayleigh_damping(GOOD, GOOD, [0.1, 0.1]),
            ["structure.modes", "(1, 2), both of 1 rad/s", "different frequencies"],
        ),
        (lambda: example("five_storey"), ["example", "did you mean 'five_storeys'?"]),
    ],
)
def test_bad_arguments_are_named(make, words):
    with pytest.raises(StructureError) as caught:
        make()
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_a_device_at_a_node_is_refused_and_the_best_place_named():
    # Two equal masses on both sides of a third: the second mode leaves the middle at rest.
    chain = Structure(np.eye(3), 2.0 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1), 0.01)
    with pytest.raises(StructureError, match=r"device: got 2, a node of mode 2.*largest at [13]"):
        chain.reduce(2, 2)
    assert chain.reduce(1, 2).mass == pytest.approx(2.0)


def test_modes_of_one_frequency_are_refused():
    with pytest.raises(StructureError, match=r"structure.mode: got 1; another mode has the same"):
        Structure(np.eye(2), np.eye(2), 0.01).reduce(1)


def test_arrays_of_a_structure_cannot_be_changed_behind_its_back():
    given = np.diag([2.0, 3.0])
    structure = Structure(given, STIFF, 0.01)
    given[0, 0] = 100.0
    assert structure.mass[0, 0] == 2.0
    with pytest.raises(ValueError, match="read-only"):
        structure.mass[0, 0] = 1.0
