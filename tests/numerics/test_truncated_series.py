"""Does the truncated series keep its order, its domain and its lanes apart?"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from oracle import error

from mm_gym import CompileError, Scene, compile_scene, load_scene, simulate
from mm_gym.lanes import layout as at
from mm_gym.lanes.simd import LANES
from mm_gym.methods.linear_series import kernel
from mm_gym.methods.linear_series.method import TIGHTEST, degree_of
from mm_gym.simulation.lanes import Lanes

from .conftest import assert_lanes_equal_single

PRE_STRETCH = load_scene("mm_gym/PreStretch-v0")
SHOCK = load_scene("mm_gym/PreStretchShock-v0")
PUSHED = PRE_STRETCH.replace(randomization={}, excitation=[], **{"actuation.force": {"limit": 2.0}})
SCENES = {"harmonic": PRE_STRETCH, "impulses": SHOCK, "pushed": PUSHED}
SCALE = np.array([0.01, 0.01, 1.0, 1.0])


def _as_series(scene: Scene, tolerance: float) -> Scene:
    return scene.replace(solver={"method": "series", "tolerance": tolerance})


@pytest.mark.parametrize("name", list(SCENES))
@pytest.mark.parametrize("tolerance", [1e-1, 1e-3, 1e-6, 1e-12])
def test_series_meets_the_exact_method(name: str, tolerance: float) -> None:
    scene = SCENES[name]
    count = len(compile_scene(scene).actuators)
    actions = np.random.default_rng(1).uniform([-2.0, 1.0], [2.0, 3.0], (20, 2))[:, -count:]
    got, want = (
        simulate(one, action=actions, seed=3, duration=20 * scene.control.time_step).state
        for one in (_as_series(scene, tolerance), scene)
    )
    # Twenty errors add up; 1e-12 is the round-off of both.
    assert error(got, want, SCALE) <= 20.0 * max(tolerance, 1e-13)


@pytest.mark.parametrize("name", ["harmonic", "pushed"])
def test_error_falls_with_the_degree_as_the_first_term_left_out(name: str) -> None:
    # 100 s^-1 times 1 ms: each further degree takes a factor of some tenth off.
    scene = SCENES[name].replace(**{"control.time_step": 1e-3})
    plant = compile_scene(_as_series(scene, 1e-12))
    ends = []
    for degree in (2, 3, 4, 5, kernel.MOST):
        lane = Lanes(plant, 1)
        lane.seed(2)
        lane.restart()
        lane.values[at.FORCE], lane.values[:4, 0] = 2.0, [0.01, -0.01, 0.5, 0.3]
        model = plant.model.copy()
        model[kernel.DEGREE] = degree
        lane.raise_for(plant.method.entries.propagate(model, lane.values, 0, 1))
        ends.append(lane.values[:4, 0].copy())
    errors = [error(end, ends[-1], SCALE) for end in ends[:-1]]
    ratios = np.array(errors[1:]) / np.array(errors[:-1])
    # The n-th term is that of degree n - 1 times rate and step over n; slow motions have less.
    assert (ratios < 0.1 / np.array([2.0, 3.0, 4.0])).all()
    assert (ratios > 0.001).all()


@pytest.mark.parametrize("name", list(SCENES))
@pytest.mark.parametrize("count", [3, LANES, 2 * LANES + 5])
def test_lane_in_a_vector_equals_lane_alone(name: str, count: int) -> None:
    assert_lanes_equal_single(compile_scene(_as_series(SCENES[name], 1e-3)), 20, count)


def test_degree_is_the_lowest_that_keeps_the_bound() -> None:
    # By hand: 2 * 0.1^2 / 4! = 8.33e-4 is left of the third degree, times 1 / (1 - 0.1 / 5).
    assert degree_of(0.1, 4.0 * 8.6e-4) == 3
    assert degree_of(0.1, 4.0 * 8.4e-4) == 4
    assert degree_of(2.0, TIGHTEST) <= kernel.MOST


def test_auto_takes_it_above_the_default_tolerance_only() -> None:
    names = {
        tolerance: compile_scene(PRE_STRETCH.replace(**{"solver.tolerance": tolerance})).method.name
        for tolerance in (1e-1, 1.01e-9)
    }
    assert set(names.values()) == {"series"}
    plant = compile_scene(PRE_STRETCH)
    assert plant.method.name == "exact"
    assert "not the truncated series: solver.tolerance is 1e-09 or less" in plant.explain()


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"randomization": {"sphere.mass": (0.03, 0.05)}}, "sphere.mass is randomised"),
        ({"control.time_step": 0.1}, "fastest rate times sample interval is"),
        ({"solver.tolerance": 0.5 * TIGHTEST}, "solver.tolerance is 1e-09 or less"),
        (
            {"excitation": [{"kind": "noise", "rms": 1.0, "high_frequency": 60.0}]},
            "it takes only impulses and one",
        ),
        (
            {"excitation.0.target": "ground", "excitation.0.amplitude": 1.0},
            "it takes only impulses and one harmonic force",
        ),
    ],
)
def test_what_it_does_not_cover_is_left_to_an_exact_method(
    changes: dict[str, Any], why: str
) -> None:
    scene = PRE_STRETCH.replace(randomization={}, **{"solver.tolerance": 1e-3}).replace(**changes)
    with pytest.raises(CompileError, match="'series' does not apply"):
        compile_scene(scene.replace(**{"solver.method": "series"}))
    with pytest.warns(UserWarning, match=r"solver.tolerance has no effect"):
        plant = compile_scene(scene)
    assert plant.method.name == "exact"
    assert "not the truncated series: " in plant.explain()
    assert why in plant.explain()
