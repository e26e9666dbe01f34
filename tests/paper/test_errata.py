"""Is the paper wrong where docs/model.md says so, and its appendix right elsewhere?"""

from pathlib import Path

import mpmath
import numpy as np
import pytest
from mpmath import mpf, polyroots

from mm_gym import compile_scene
from mm_gym.analysis import modes
from mm_gym.analysis.linear import linear_values
from mm_gym.paper import scene

from . import appendix

PAGE = (Path(__file__).parents[2] / "docs" / "model.md").read_text(encoding="utf-8")
FREE = ("fig2a", "fig2b", "fig2c", "fig2a_caption", "fig2b_caption", "fig5b")
ON_SPRINGS = ("fig12a", "fig12d")


@pytest.fixture(autouse=True)
def _digits():
    with mpmath.workdps(50):
        yield


def system_of(name):
    m1, m2, k1, k2, c, d = linear_values(scene(name))
    return appendix.System(*(mpf(repr(value)) for value in (m1, m2, k1, k2, c, d)))


def roots_of(system):
    coefficients = list(reversed(appendix.coefficients(system)))
    if system.k2 == 0:  # the last coefficient is zero, and so is a root
        return [mpf(0), *polyroots(coefficients[:-1], maxsteps=200, extraprec=200)]
    return polyroots(coefficients, maxsteps=200, extraprec=200)


def distance(found, wanted):
    """Return the largest distance between matched roots, relative to the largest of them."""
    left, worst = list(found), mpf(0)
    for value in wanted:
        nearest = min(left, key=lambda other: abs(other - value))
        left.remove(nearest)
        worst = max(worst, abs(nearest - value))
    return worst / max(abs(value) for value in wanted)


@pytest.mark.parametrize("name", FREE)
def test_equation_20_needs_the_product_in_g(name):
    system = system_of(name)
    wanted = roots_of(system)
    # 50 digits, some of which cancel in the cube root.
    assert distance(appendix.eigenvalues_of_20(system, mend=True), wanted) < 1e-40
    assert distance(appendix.eigenvalues_of_20(system, mend=False), wanted) > 1e-3


@pytest.mark.parametrize("name", ON_SPRINGS)
def test_equation_24_needs_all_of_its_corrections(name):
    system = system_of(name)
    wanted = roots_of(system)
    assert distance(appendix.eigenvalues_of_24(system), wanted) < 1e-38
    for missing in ("E2", "E3", "E4"):
        mends = [mend for mend in ("E2", "E3", "E4") if mend != missing]
        assert distance(appendix.eigenvalues_of_24(system, mends), wanted) > 1e-3


@pytest.mark.parametrize("name", FREE)
def test_the_letters_of_equation_21_are_those_of_cardano(name):
    system = system_of(name)
    g, h, i, linear = appendix.letters_of_21(system, mend=True)
    _, g1, g2, g3, g4 = appendix.coefficients(system)
    assert mpmath.almosteq(i, g3 / (3 * g4), 1e-45)
    assert mpmath.almosteq(linear, (3 * g4 * g2 - g3**2) / (3 * g4**2), 1e-45)
    assert mpmath.almosteq(h, (9 * g4 * g3 * g2 - 27 * g4**2 * g1 - 2 * g3**3) / g4**3, 1e-45)
    assert mpmath.almosteq(g, h**2 + 108 * linear**3, 1e-40)


@pytest.mark.parametrize("factor", [2, 10])
def test_the_units_of_g_show_the_error(factor):
    # With dampings times f and stiffnesses times f^2 every rate is f times as large. G has the unit
    # of a rate to the sixth: the printed sum breaks that, the product does not.
    m1, m2, k1, k2, c, d = system_of("fig2a")
    faster = appendix.System(m1, m2, factor**2 * k1, factor**2 * k2, factor * c, factor * d)
    right, wrong = (
        appendix.letters_of_21(faster, mend=mend)[0]
        / appendix.letters_of_21(system_of("fig2a"), mend=mend)[0]
        for mend in (True, False)
    )
    assert mpmath.almosteq(right, factor**6, 1e-40)
    assert abs(wrong / factor**6 - 1) > 1e-3


@pytest.mark.parametrize("name", [*FREE, *ON_SPRINGS])
def test_the_eigenvectors_are_right_as_printed(name):
    system = system_of(name)
    m1, m2, k1, k2, c, d = system
    matrix = mpmath.matrix(
        [
            [0, 0, 1, 0],
            [0, 0, 0, 1],
            [-(k1 + k2) / m1, k2 / m1, -(c + d) / m1, c / m1],
            [k2 / m2, -k2 / m2, c / m2, -c / m2],
        ]
    )
    form = appendix.eigenvectors_of_27 if k2 else appendix.eigenvectors_of_22
    for value in roots_of(system):
        vector, norm = form(system, value)
        column = mpmath.matrix(vector)
        assert mpmath.norm(matrix * column - value * column) < 1e-35 * (1 + abs(value)) ** 2
        # M and R are the root of the sum of squares, without complex conjugates.
        assert mpmath.almosteq(sum((part * norm) ** 2 for part in vector), norm**2, 1e-40)


@pytest.mark.parametrize("name", [*FREE, *ON_SPRINGS])
def test_the_closed_form_of_the_package_is_the_corrected_one_of_the_paper(name):
    system = system_of(name)
    form = appendix.eigenvalues_of_24 if system.k2 else appendix.eigenvalues_of_20
    # Doubles: a few hundred units of round-off of the largest eigenvalue.
    assert distance(list(modes(scene(name)).closed_form), form(system)) < 1e-13


def test_a_free_sphere_has_one_mode_too_few():
    # c = 0: the zero eigenvalue is double, and A has rank 3 where a basis of modes needs rank 2.
    m1, m2, k1, _, c, d = (float(value) for value in system_of("fig2e"))
    matrix = [[0, 0, 1, 0], [0, 0, 0, 1], [-k1 / m1, 0, -(c + d) / m1, 0], [0, 0, 0, 0]]
    assert m2 > 0.0
    assert np.linalg.matrix_rank(matrix) == 3
    assert list(modes(scene("fig2e")).eigenvalues[:2]) == [0.0, 0.0]


def test_equation_22_says_nothing_of_the_carriages_modes_beside_a_free_sphere():
    # c = 0: at the carriage's two eigenvalues its components and its norm are 0 together.
    system = system_of("fig2e")
    oscillating = [value for value in roots_of(system) if mpmath.im(value) != 0]
    assert len(oscillating) == 2
    for value in oscillating:
        x1, x2, norm = (
            system.c * value,
            system.k1 + value * (system.c + system.d + system.m1 * value),
            appendix.norm_of_23(system, value),
        )
        assert x1 == 0
        # 50 digits of k1 = 400; the norm is the root of what cancels.
        assert abs(x2) < 1e-45
        assert abs(norm) < 1e-19
        # Any c > 0 has a limit: the shape in which only the carriage moves.
        near = system._replace(c=mpf("1e-12"))
        nearest = min(roots_of(near), key=lambda other, value=value: abs(other - value))
        shape, _ = appendix.eigenvectors_of_22(near, nearest)
        assert abs(shape[1] / shape[0]) < 1e-10


def critical_damping(system):
    return 2.0 * np.sqrt(system.carriage.mass * system.carriage.stiffness)


def test_what_the_text_says_of_figure_2_needs_the_swapped_masses():
    # Text: m1 < m2, d above critical in B, and B overdamped.
    text, caption = scene("fig2b"), scene("fig2b_caption")
    assert text.carriage.mass < text.sphere.mass
    assert critical_damping(text) == pytest.approx(8.0)
    assert np.all(modes(text).eigenvalues.imag == 0.0)
    assert caption.carriage.mass > caption.sphere.mass
    assert critical_damping(caption) == pytest.approx(12.649, abs=1e-3)
    pair = modes(caption).eigenvalues
    pair = pair[pair.imag > 0.0][0]
    assert pair == pytest.approx(-52.72316 + 24.57522j, abs=1e-5)
    assert -pair.real / abs(pair) == pytest.approx(0.906, abs=1e-3)


def test_the_other_figures_have_the_masses_of_figure_2s_caption():
    masses = {(scene(name).carriage.mass, scene(name).sphere.mass) for name in ("fig6a", "fig12a")}
    caption = scene("fig2a_caption")
    assert masses == {(caption.carriage.mass, caption.sphere.mass)}


def test_a_carriage_of_vanishing_mass_is_never_below_its_critical_damping():
    for name in ("fig2d", "fig2d_caption"):
        assert critical_damping(scene(name)) < 1e-38 < scene(name).carriage.damping


@pytest.mark.parametrize("mass", ["0.1", "0.04"])
def test_a_carriage_of_vanishing_mass_oscillates_for_dampings_between_two_bounds(mass):
    # E9: with c = d, from sqrt(2) - 1 to sqrt(2) + 1 times sqrt(k1 m2). The paper's 1 is less.
    scale = mpmath.sqrt(400 * mpf(mass))

    def oscillates(damping):
        system = appendix.System(mpf("1e-80"), mpf(mass), mpf(400), mpf(0), damping, damping)
        coefficients = list(reversed(appendix.coefficients(system)))[:-1]
        roots = polyroots(coefficients, maxsteps=500, extraprec=2000)
        return any(abs(mpmath.im(root)) > 1e-9 * abs(root) for root in roots)

    below, above = (mpmath.sqrt(2) - 1) * scale, (mpmath.sqrt(2) + 1) * scale
    for damping, wanted in (
        (mpf(1), False),
        (below * mpf("0.999"), False),
        (below * mpf("1.001"), True),
        (above * mpf("0.999"), True),
        (above * mpf("1.001"), False),
    ):
        assert oscillates(damping) == wanted


def test_the_dampings_of_the_page_make_a_massless_carriage_oscillate():
    system = scene("fig2d").replace(**{"carriage.damping": 6.32, "interface.damping": 6.32})
    pair = modes(system).eigenvalues
    assert pair[pair.imag > 0.0] == pytest.approx([-31.6 + 31.6j], abs=0.05)


def test_the_text_compares_panels_of_unlike_damping():
    # E10: 2A with 6A and 2E with 6D in the text; c and d of 2E are those of 6A, and 2A's of 6D.
    dampings = {
        name: (linear_values(scene(name)).c, linear_values(scene(name)).d)
        for name in ("fig2a", "fig2e", "fig6a", "fig6d")
    }
    assert dampings["fig2e"] == dampings["fig6a"] != dampings["fig2a"] == dampings["fig6d"]


def test_the_sphere_alone_is_no_oscillator():
    # E15: eq. 8 next to a carriage that stands still.
    system = scene("fig6d")
    m2, c = system.sphere.mass, system.interface.damping
    matrix = compile_scene(system).linear()[0][np.ix_([1, 3], [1, 3])]
    assert np.sort(np.linalg.eigvals(matrix)) == pytest.approx([-c / m2, 0.0])


def test_every_erratum_has_its_own_label():
    labels = [line.split("|")[1].strip() for line in PAGE.splitlines() if line.startswith("| E")]
    assert labels == [f"E{number}" for number in range(1, len(labels) + 1)]
    assert labels
