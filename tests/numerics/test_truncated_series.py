"""Does the truncated series keep its order, its domain and its lanes apart?"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from oracle import error

from mm_gym import CompileError, Scene, compile_scene, load_scene, simulate
from mm_gym.lanes import layout
from mm_gym.lanes.simd import LANES
from mm_gym.methods.linear_series import kernel
from mm_gym.methods.linear_series.method import TIGHTEST, degree_of, rate_of
from mm_gym.simulation.lanes import Lanes

from .conftest import assert_lanes_equal_single

PRE_STRETCH = load_scene("mm_gym/PreStretch-v0")
SHOCK = load_scene("mm_gym/PreStretchShock-v0")
PUSHED = PRE_STRETCH.replace(randomization={}, excitation=[], **{"actuation.force": {"limit": 2.0}})
DRAWN = PUSHED.replace(
    randomization={
        "carriage.mass": (0.05, 0.2),
        "sphere.mass": (0.02, 0.08),
        "carriage.stiffness": (200.0, 800.0),
        "carriage.damping": (0.0, 2.0),
        "interface.damping": (0.05, 1.0),
        "springs.stiffness": (20.0, 70.0),
    }
)
MASS_DRAWN = Scene(
    interface={"kind": "viscous"},
    springs={"kind": "small_on_large"},
    actuation={"force": {"limit": 2.0}},
    randomization={"carriage.mass": (0.05, 0.2)},
    control={"time_step": 4e-3},  # of degree 5 at 1e-3
)
NOISE = {"kind": "noise", "rms": 1.0, "high_frequency": 60.0, "sample_time": 0.005}
SWAY = {"kind": "harmonic", "target": "ground", "amplitude": 3.0, "frequency": 50.0, "phase": 1.0}
SCENES = {
    "harmonic": PRE_STRETCH,
    "impulses": SHOCK,
    "pushed": PUSHED,
    "all parameters drawn": DRAWN,
    "carriage's mass drawn": MASS_DRAWN,
    "noise": DRAWN.replace(excitation=[NOISE, NOISE | {"target": "ground"}]),
    "harmonic of the ground": PRE_STRETCH.replace(randomization={}, excitation=[SWAY]),
    "all at once": DRAWN.replace(excitation=[SWAY, SWAY | {"target": "force"}, NOISE]),
    "long steps": DRAWN.replace(excitation=[SWAY], **{"control.time_step": 0.1}),
}
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
    # 100 s^-1 times 1 ms: each further degree takes a factor of some tenth off. Two are compared
    # together, because a single term may nearly vanish on its way from one sign to the other.
    scene = SCENES[name].replace(**{"control.time_step": 1e-3})
    plant = compile_scene(_as_series(scene, 1e-12))
    ends = []
    for degree in (2, 3, 4, 5, kernel.MOST):
        lane = Lanes(plant, 1)
        lane.seed(2)
        lane.restart()
        lane.values[layout.FORCE], lane.values[:4, 0] = 2.0, [0.01, -0.01, 0.5, 0.3]
        model = plant.model.copy()
        model[kernel.DEGREE] = degree
        lane.raise_for(plant.method.entries.propagate(model, lane.values, 0, 1))
        ends.append(lane.values[:4, 0].copy())
    errors = [error(end, ends[-1], SCALE) for end in ends[:-1]]
    ratios = np.array(errors[2:]) / np.array(errors[:-2])
    # Degree n leaves out the term n + 1, and the n-th term is that of degree n - 1 times rate and
    # step over n; slow motions have less.
    assert (ratios < 0.1**2 / np.array([4.0 * 5.0, 5.0 * 6.0])).all()
    assert (ratios > 0.001**2).all()


@pytest.mark.parametrize("degree", kernel.SHORT)
@pytest.mark.parametrize("between", ["ground", "masses"])
def test_a_loop_of_few_terms_moves_lanes_as_that_of_any_degree_does(
    degree: int, between: str
) -> None:
    scene = MASS_DRAWN.replace(**{"actuation.force.between": between})
    plant, ends = compile_scene(_as_series(scene, 1e-3)), []
    for varies in (True, False):  # of the sphere's mass; lanes that differ in it too have no loop
        lanes = Lanes(plant, 2 * LANES + 5)
        lanes.seed(2)
        lanes.restart()
        lanes.values[layout.FORCE] = 2.0
        lanes.values[layout.V1], lanes.values[layout.V2] = 0.5, -0.3
        model = plant.model.copy()
        model[kernel.DEGREE], model[kernel.VARIES + 1] = degree, varies
        lanes.raise_for(plant.method.entries.propagate(model, lanes.values, 0, 2 * LANES + 5))
        ends.append(lanes.values[:4].copy())
    # Twice the sums of a dozen products, each rounded to 2^-53.
    np.testing.assert_allclose(ends[1] / SCALE[:, None], ends[0] / SCALE[:, None], atol=1e-14)
    assert (ends[1] != ends[0]).any()  # they did take turns


@pytest.mark.parametrize("name", list(SCENES))
@pytest.mark.parametrize("count", [3, LANES, 2 * LANES + 5])
def test_lane_in_a_vector_equals_lane_alone(name: str, count: int) -> None:
    assert_lanes_equal_single(compile_scene(_as_series(SCENES[name], 1e-3)), 20, count)


def test_degree_is_the_lowest_that_keeps_the_bound() -> None:
    # By hand: 0.1^3 / 4! = 4.167e-5 is left of the third degree, times 1 / (1 - 0.1 / 5).
    assert degree_of(0.1, 4.0 * 4.3e-5) == 3
    assert degree_of(0.1, 4.0 * 4.2e-5) == 4
    # Velocities that grow with t^2 are 2! / 0.1 times smaller, and so is what may be cut off.
    assert degree_of(0.1, 4.0 * 8.6e-4, 2) == 3
    assert degree_of(0.1, 4.0 * 8.4e-4, 2) == 4
    assert degree_of(2.0, TIGHTEST) <= kernel.MOST


def test_rate_is_the_norm_of_an_undamped_motion_and_of_its_damping_together() -> None:
    # A damped carriage alone has [[0, w], [-w, -s]], w = 60 and s = 80: at most 40 + sqrt(40^2 +
    # 60^2). Small coefficients of the rest change the seventh digit.
    scene = Scene(
        carriage={"mass": 1.0, "stiffness": 3600.0, "damping": 80.0},
        sphere={"mass": 1.0},
        interface={"kind": "viscous", "damping": 1e-6},
    )
    expected = 40.0 + np.hypot(40.0, 60.0)
    assert rate_of(compile_scene(scene).support) == pytest.approx(expected, rel=1e-6)


def test_auto_takes_it_above_the_default_tolerance_only() -> None:
    names = {
        tolerance: compile_scene(PRE_STRETCH.replace(**{"solver.tolerance": tolerance})).method.name
        for tolerance in (1e-1, 1.01e-9)
    }
    assert set(names.values()) == {"series"}
    plant = compile_scene(PRE_STRETCH)
    assert plant.method.name == "exact"
    assert "not the truncated series: solver.tolerance is 1e-09 or less" in plant.explain()


def test_below_its_smallest_tolerance_an_exact_method_stands_in() -> None:
    scene = DRAWN.replace(**{"solver.tolerance": 0.5 * TIGHTEST})
    with pytest.raises(CompileError, match="'series' does not apply"):
        compile_scene(scene.replace(**{"solver.method": "series"}))
    with pytest.warns(UserWarning, match=r"solver.tolerance has no effect"):
        plant = compile_scene(scene)
    assert plant.method.name == "exact"
    assert "not the truncated series: solver.tolerance is 1e-09 or less" in plant.explain()


@pytest.mark.parametrize(("changes", "intervals"), [({}, 1), ({"excitation": [NOISE]}, 400)])
def test_pieces_and_sample_intervals_share_the_tolerance(
    changes: dict[str, Any], intervals: int
) -> None:
    plant = compile_scene(_as_series(DRAWN.replace(**{"control.time_step": 2.0}, **changes), 1e-3))
    pieces, support = plant.model[kernel.PIECES], plant.support
    phase = rate_of(support) * support.sample_interval / pieces
    assert support.intervals_per_step == intervals
    own = degree_of(phase, 1e-3 / (pieces * intervals)) + max(support.terms - 1, 0)
    assert plant.model[kernel.DEGREE] == own > degree_of(phase, 1e-3)


def test_rows_with_one_value_are_read_once() -> None:
    """What a scene does not draw is no part of the lanes' own parameters."""
    own = {
        "carriage.mass": layout.M1,
        "sphere.mass": layout.M2,
        "carriage.stiffness": layout.K1,
        "carriage.damping": layout.D,
        "interface.damping": layout.C,
        "springs.stiffness": layout.K0,
    }
    for name, row in own.items():
        scene = Scene(
            interface={"kind": "viscous"},
            springs={"kind": "small_on_large"},
            randomization={name: DRAWN.randomization[name]},
        )
        plant = compile_scene(_as_series(scene, 1e-3))
        varies = plant.model[kernel.VARIES : kernel.WEIGHTS] > 0.0
        assert [row in rows for rows in kernel.GROUPS] == varies.tolist()
