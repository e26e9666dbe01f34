"""Are elementary functions right to a double's digits, and rounded alike in any lane?"""

import ast
import itertools
from pathlib import Path

import mpmath
import numba
import numpy as np

import mm_gym
from mm_gym.lanes import elementary

FOLDER = Path(mm_gym.__file__).parent
VECTORISED = {"sin", "cos", "tan", "exp", "log", "log2", "log10", "pow", "hypot", "atan2"}
"""Functions of which Intel's library has a version for vectors."""

ONE_AT_A_TIME = {
    "extended.logarithm_of_ratio": {"log"},  # next to a call that no loop is vectorised over
    "filters._halvings_of": {"log2"},  # never inlined into a loop
    "impulse_process._wait": {"log"},  # within a loop that ends early
    "bounds.largest_eigenvalue": {"hypot"},  # for a bound of the rates
    "tangents._cosine": {"cos"},  # whose overloads they are: they call `cosine_and_sine`
    "tangents._sine": {"sin"},
}
"""Kernels that call such functions in no loop that can be vectorised."""


@numba.njit(error_model="numpy")
def evaluate(x, logarithms, exponentials, cosines, sines):
    for i in range(x.shape[0]):
        logarithms[i], exponentials[i] = elementary.logarithm(x[i]), elementary.exponential(-x[i])
        cosines[i], sines[i] = elementary.on_circle(min(x[i], 0.5))


EXACT = (
    mpmath.log,
    lambda t: mpmath.exp(-t),
    lambda t: mpmath.cospi(min(t, 0.5) / 2),
    lambda t: mpmath.sinpi(min(t, 0.5) / 2),
)


def test_polynomials_have_the_digits_of_a_double():
    x = 2.0 ** np.random.default_rng(0).uniform(-53.0, 9.4, 1000)
    x = np.concatenate([x, [2.0**-53, 0.5, np.sqrt(0.5), 1.0 - 2.0**-53, 1.0, 1.0 + 2.0**-52]])
    got = np.empty((len(EXACT), len(x)))
    evaluate(x, *got)
    with mpmath.workdps(40):
        for values, exact in zip(got, EXACT, strict=True):
            for t, value in zip(x, values, strict=True):
                want = exact(mpmath.mpf(float(t)))
                # Some roundings of half a unit each, 1.1e-16.
                assert abs(mpmath.mpf(float(value)) - want) <= 4e-16 * abs(want)


def test_exponential_of_zero_is_one_and_of_far_numbers_hardly_anything():
    got = np.empty((4, 2))
    evaluate(np.array([2.0**-1022, 1e300]), *got)
    assert got[1, 0] == 1.0
    assert 0.0 < got[1, 1] < 1e-300


def test_vectorised_polynomials_are_those_of_a_lone_number():
    x = np.random.default_rng(1).uniform(0.01, 3.0, 37)
    together = np.empty((4, 37))
    evaluate(x, *together)
    for i in range(37):
        alone = np.empty((4, 1))
        evaluate(x[i : i + 1], *alone)
        np.testing.assert_array_equal(alone[:, 0], together[:, i])


def library_calls(path):
    """Yield function and name of every call of a library's function in a module of kernels."""
    for function in ast.walk(ast.parse(path.read_text())):
        if isinstance(function, ast.FunctionDef):
            for node in ast.walk(function):
                match node:
                    case ast.Attribute(ast.Name("math" | "np"), name) if name in VECTORISED:
                        yield f"{path.stem}.{function.name}", name


def test_no_loop_over_lanes_can_take_functions_from_a_vector_library():
    found = {}
    rooms = "lanes/*.py", "law/*.py", "excitation/*.py", "step/*.py", "methods/*/*kernel.py"
    for path in itertools.chain(*(FOLDER.glob(room) for room in rooms)):
        if path.name != "elementary.py":
            for function, name in library_calls(path):
                found.setdefault(function, set()).add(name)
    assert found == ONE_AT_A_TIME
