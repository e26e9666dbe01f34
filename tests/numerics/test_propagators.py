"""Transition matrices against mpmath, to the last bit where possible."""

from decimal import Decimal

import mpmath as mp
import numpy as np
import pytest
from oracle import System
from tasks import PRE_STRETCH

from mm_gym import CompileError, Scene, SceneError, compile_scene
from mm_gym.state_space.matrix_exponential import exponential

SYSTEMS = {
    "the default": System(),
    "overdamped": System(d=100.0),
    "a defective matrix": System(c=0.0),
    "undamped": System(c=0.0, d=0.0),
    "stiff": System(k1=1e12),
    "nearly locked": System(c=1e9),
    "hardly coupled": System(c=1e-12),
    "a massless carriage": System(m1=1e-80),
    "a heavy sphere": System(m2=1e5),
    "a light sphere": System(m2=4e-8),
    "springs": System(c=0.1).with_springs(35.0, 1.5),
}


def scene_of(system, time_step):
    data = {
        "carriage": {"mass": system.m1, "stiffness": system.k1, "damping": system.d},
        "sphere": {"mass": system.m2},
        "interface": {"kind": "viscous", "damping": system.c},
        "control": {"time_step": time_step},
    }
    if system.k2:
        data["springs"] = {"kind": "small_on_large", "stiffness": 35.0, "stretch": 1.5}
    return Scene(**data)


def assert_rounded_once(got, expected):
    """Assert errors below half a unit in the last place, plus 1e-25 of the largest entry."""
    with mp.workdps(60):
        largest = max(abs(entry) for entry in expected)
        for entry, exact in zip(np.ravel(got), expected, strict=True):
            half = mp.mpf(float(np.spacing(abs(float(exact))))) / 2
            error = abs(mp.mpf(float(entry)) - exact)
            assert error <= half * (1 + mp.mpf(10) ** -9) + largest * mp.mpf(10) ** -25


@pytest.mark.parametrize("time_step", [1e-6, 0.01, 10.0])
@pytest.mark.parametrize("name", SYSTEMS)
def test_sampled_plant_is_the_exponential_rounded_once(name, time_step):
    system = SYSTEMS[name]
    expected = system.sampled(time_step)
    both = np.hstack(compile_scene(scene_of(system, time_step)).discrete())
    assert_rounded_once(both, expected)


def test_exponential_of_a_nilpotent_matrix_is_its_finite_series():
    zero, one = Decimal(0), Decimal(1)
    matrix = np.array([[zero, one, zero], [zero, zero, one], [zero, zero, zero]])
    expected = [[1.0, 3.0, 4.5], [0.0, 1.0, 3.0], [0.0, 0.0, 1.0]]
    assert exponential(matrix, 3.0).tolist() == expected


def test_exponential_over_no_time_is_the_identity():
    matrix = np.array([[Decimal(5), Decimal(-7)], [Decimal("1e80"), Decimal(3)]])
    assert exponential(matrix, 0.0).tolist() == [[1.0, 0.0], [0.0, 1.0]]


def test_exponential_refuses_a_matrix_that_would_take_minutes():
    with pytest.raises(OverflowError, match=r"at most 1e200"):
        exponential(np.array([[Decimal("1e3000")]]), 1.0)


@pytest.mark.parametrize("stretch", [0.5, 0.0, -1.0, np.nan, np.inf])
def test_stretch_that_springs_do_not_have_is_refused(stretch):
    plant = compile_scene(PRE_STRETCH)
    for equations in (plant.linear, plant.discrete, plant.system):
        with pytest.raises(SceneError, match=r"stretch: got .* allowed: a finite number of at"):
            equations(stretch)


def test_linear_is_the_derivative_of_discrete():
    # exp(A h) = 1 + A h + O(h^2 |A|^2 / 2); |A| <= 1e4 here, so 1e-9 s leaves 1e-5 of an entry.
    plant = compile_scene(scene_of(System(), 1e-9))
    (a, b), (ad, bd) = plant.linear(), plant.discrete()
    slope = (ad - np.eye(4)) / 1e-9
    assert np.abs(slope - a).max() <= 1e-4 * np.abs(a).max()
    assert np.abs(bd / 1e-9 - b).max() <= 1e-4 * np.abs(b).max()


def test_plant_with_changing_parameters_refuses_a_scene_too_stiff_for_it():
    scene = Scene(
        carriage={"stiffness": 1e20},
        springs={"kind": "small_on_large"},
        actuation={"stretch": {}},
    )
    with pytest.raises(CompileError, match=r"control\.time_step: a sample interval of 0\.01 s"):
        compile_scene(scene)


@pytest.mark.parametrize("values", [{"c": 1e100}, {"k1": 1e100}, {"d": 1e100}, {"m2": 1e-100}])
def test_parameters_beyond_physics_are_right_or_refused(values):
    system = System(**values)
    try:
        both = np.hstack(compile_scene(scene_of(system, 0.01)).discrete())
    except CompileError as error:
        assert "control.time_step" in str(error)  # noqa: PT017 - both outcomes are right
    else:
        assert_rounded_once(both, system.sampled(0.01))
