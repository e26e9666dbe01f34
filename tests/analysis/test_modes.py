"""Do numerical modes agree with the closed form and golden values, and responses with the plant?"""

import numpy as np
import pytest

from mm_gym import Scene, SceneError, compile_scene, simulate
from mm_gym.analysis import frequency_response, modes

from .conftest import golden, linear_scene

CASES = golden("modes")["cases"]


def eigenvalues(case):
    texts = (text.replace(" ", "").strip("()") for text in case["eigenvalues"])
    return np.array([complex(text) for text in texts])


def distance(found, wanted):
    """Return the largest distance between matched eigenvalues, relative to the largest of them."""
    left, worst = list(found), 0.0
    for value in wanted:
        nearest = left.pop(int(np.argmin([abs(other - value) for other in left])))
        worst = max(worst, abs(nearest - value))
    return worst / np.abs(wanted).max()


@pytest.mark.parametrize("name", CASES)
def test_both_forms_equal_the_golden_eigenvalues(name):
    found, wanted = modes(linear_scene(CASES[name])), eigenvalues(CASES[name])
    # A backward stable solver has errors of some eps times the norm; 100 eps for either form.
    assert distance(found.eigenvalues, wanted) < 2e-14
    assert distance(found.closed_form, wanted) < 2e-14


@pytest.mark.parametrize("name", CASES)
def test_shapes_are_eigenvectors_of_the_plant(name):
    scene = linear_scene(CASES[name])
    found, (a, _) = modes(scene), compile_scene(scene).linear()
    for value, shape in zip(found.eigenvalues, found.shapes.T, strict=True):
        assert np.abs(shape).max() == 1.0
        state = np.concatenate([shape, value * shape])
        assert np.abs(a @ state - value * state).max() < 1e-12 * np.abs(a).max()


def test_a_free_sphere_is_defective_and_its_zero_eigenvalue_double():
    found = modes(linear_scene(CASES["fig2E_swapped"]))
    assert found.defective
    assert list(found.eigenvalues[:2]) == [0.0, 0.0]
    assert not modes(linear_scene(CASES["fig2A_swapped"])).defective


@pytest.mark.parametrize("mass", [1e-80, 0.0])
def test_a_vanishing_carriage_mass_leaves_the_slow_modes(mass):
    scene = Scene(carriage={"mass": mass}, sphere={"mass": 0.1})
    found = modes(scene)
    # The roots of m2 (c + d) s^2 + (c d + m2 k1) s + c k1, and zero.
    slow = np.sort(np.append(np.roots([0.2, 1.0 + 0.1 * 400.0, 400.0]), 0.0))
    for values in (found.eigenvalues, found.closed_form):
        assert np.allclose(np.sort(values[:3].real), slow, rtol=1e-14, atol=0.0)
    assert len(found.eigenvalues) == (4 if mass else 3)
    if mass:
        assert found.eigenvalues[3] == pytest.approx(-2.0 / mass, rel=1e-12)


def test_closed_form_survives_coinciding_eigenvalues():
    # Critical damping without coupling: a double eigenvalue.
    scene = Scene(
        carriage={"mass": 1.0, "stiffness": 100.0, "damping": 20.0}, interface={"kind": "none"}
    )
    found = modes(scene)
    assert np.allclose(found.closed_form.real[2:], -10.0, rtol=1e-6)


def test_frequencies_and_damping_ratios_of_a_single_oscillator():
    found = modes(Scene(interface={"kind": "none"}))
    assert found.frequencies[2:] == pytest.approx(np.sqrt(4000.0))
    assert found.hertz * 6.283185307179586 == pytest.approx(found.frequencies)
    assert found.damping_ratios[2:] == pytest.approx(1.0 / (2.0 * np.sqrt(40.0)))
    assert np.isnan(found.damping_ratios[:2]).all()


@pytest.mark.parametrize("name", CASES)
def test_receptance_equals_the_transfer_function_of_the_plant(name):
    scene = linear_scene(CASES[name])
    a, b = compile_scene(scene).linear()
    frequencies = np.array([0.3, 30.0, 3000.0])
    found = frequency_response(scene, frequencies)
    for w, force, ground in zip(frequencies, found.force, found.ground, strict=True):
        stiffness = 1j * w * np.eye(4) - a
        for got, load in ((force, b[:, 0]), (ground, [0.0, 0.0, -1.0, -1.0])):
            wanted = np.linalg.solve(stiffness, load)[:2]
            assert np.abs(got - wanted).max() < 1e-12 * np.abs(wanted).max()


@pytest.mark.parametrize("target", ["force", "ground"])
def test_simulated_steady_state_has_the_amplitude_of_the_response(target):
    scene = Scene(
        springs={"kind": "small_on_large"},
        excitation=[{"kind": "harmonic", "target": target, "amplitude": 2.0, "frequency": 50.0}],
        control={"time_step": 0.001, "steps": 3000},
    )
    trajectory = simulate(scene)
    response = 2.0 * getattr(frequency_response(scene, 50.0), target)[0]
    # The slowest mode decays as exp(-4 t): 1e-5 of the start is left after 3 s.
    steady = np.imag(response * np.exp(50j * trajectory.time[-200:, None]))
    assert np.abs(trajectory.state[-200:, :2] - steady).max() < 2e-4 * np.abs(response).max()


def test_carriage_all_but_stays_while_the_sphere_creeps_back():
    # The sphere creeps at s = -k2 / c, and the force of its inertia moves the carriage.
    damper, springs = {"kind": "viscous", "damping": 800.0}, {"kind": "linear", "stiffness": 6.0}
    carriage, sphere = {"mass": 0.25, "stiffness": 2e6, "damping": 200.0}, {"mass": 0.004}
    scene = Scene(carriage=carriage, sphere=sphere, interface=damper, springs=springs)
    found = modes(scene)
    assert found.eigenvalues[0] == pytest.approx(-6.0 / 800.0, rel=1e-6)
    expected = -0.004 * (6.0 / 800.0) ** 2 / 2e6
    assert found.shapes[1, 0] == 1.0
    assert abs(found.shapes[0, 0] - expected) < 1e-14


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, [[1.0]], None, "1"])
def test_frequencies_must_be_positive(bad):
    with pytest.raises(SceneError, match="frequencies"):
        frequency_response(Scene(), bad)
