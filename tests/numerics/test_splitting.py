"""Does the extrapolated splitting keep its order, its tolerance and its lanes apart?"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import mpmath as mp
import numpy as np
import pytest
from oracle import error

from mm_gym import CompileError, Scene, compile_scene, simulate
from mm_gym.compiler.jit import plain
from mm_gym.lanes import layout
from mm_gym.lanes.simd import LANES
from mm_gym.law import springs
from mm_gym.methods.splitting import layout as slots
from mm_gym.methods.splitting import method
from mm_gym.methods.splitting.method import TIGHTEST, Plan, drifts_of, weights_of
from mm_gym.simulation.lanes import Lanes
from mm_gym.state_space.matrix_exponential import decimals, exponential

from .conftest import assert_lanes_equal_single

if TYPE_CHECKING:
    from mm_gym.plant.plant import Plant

FREE = Scene(
    carriage={"cubic_coefficient": 2e6},
    initial={"carriage_displacement": 0.004, "sphere_offset": 0.02, "carriage_velocity": 0.5},
    control={"time_step": 2e-3, "steps": 20},
    actuation={"force": {"limit": 4.0}},
)
SPRUNG = FREE.replace(
    springs={"kind": "small_on_large", "stiffness": 35.0},
    **{"actuation.stretch": {"minimum": 1.0, "maximum": 3.0}},
)
FINITE = SPRUNG.replace(
    springs={"kind": "finite_stretch", "stiffness": 35.0, "rest_length": 0.04, "stretch": 1.5}
)
LINEAR = FINITE.replace(**{"carriage.cubic_coefficient": 0.0, "control.time_step": 0.01})
DRAWN = {
    "carriage.mass": (0.08, 0.12),
    "carriage.damping": (0.5, 2.0),
    "sphere.mass": (0.03, 0.05),
    "interface.damping": (0.5, 2.0),
    "carriage.cubic_coefficient": (1e6, 3e6),
}
SHAKEN = {
    "excitation": [
        {"kind": "harmonic", "amplitude": 3.0, "frequency": 150.0, "phase": 0.4},
        {"kind": "harmonic", "target": "ground", "amplitude": 20.0, "frequency": 90.0},
        {"kind": "noise", "target": "ground", "rms": 5.0, "high_frequency": 80.0},
        {"kind": "impulse", "size": (-0.02, 0.02), "rate": 100.0},
    ]
}
SCENES = {
    name: scene.replace(**{"solver.method": "splitting"})
    for name, scene in (
        ("free", FREE),
        ("sprung", SPRUNG),
        ("drawn", FREE.replace(randomization=DRAWN)),
        ("shaken", FREE.replace(**SHAKEN)),
        ("drawn, shaken", SPRUNG.replace(randomization=DRAWN, **SHAKEN)),
        (
            "drawn, sprung",
            SPRUNG.replace(randomization=DRAWN | {"springs.stiffness": (20.0, 40.0)}),
        ),
        ("finite", FINITE),
        ("finite, linear", LINEAR),
        (
            "finite, drawn, shaken",
            FINITE.replace(randomization=DRAWN | {"springs.rest_length": (0.03, 0.05)}, **SHAKEN),
        ),
    )
}


def _end(plant: Plant, model: np.ndarray) -> np.ndarray:
    """Return the state after one control step from the start with a model's constants."""
    lane = Lanes(plant, 1)
    lane.restart()
    lane.values[layout.FORCE] = 3.0
    lane.raise_for(plant.entries.propagate(model, lane.values, 0, 1))
    return lane.values[:4, 0].copy()


@pytest.mark.parametrize("name", list(SCENES))
@pytest.mark.parametrize("columns", [1, 2, 3])
def test_each_column_adds_two_orders(
    name: str, columns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    plant = compile_scene(SCENES[name])
    exact = _end(plant, compile_scene(SCENES[name].replace(**{"solver.tolerance": 1e-12})).model)
    counts = np.array([3, 4, 6, 8]) if columns < 3 else np.array([2, 3, 4])
    monkeypatch.setattr(method, "_limit", lambda *_: np.inf)  # whatever the error is
    errors = []
    for first in counts:
        monkeypatch.setattr(method, "plan_of", lambda *_, first=first: Plan(int(first), columns))
        model = plant.method.model(plant.support, plant.settings)
        errors.append(error(_end(plant, model), exact, np.array([0.01, 0.01, 1.0, 1.0])))
    middle = counts + 0.5 * (columns - 1)
    slope = -np.polyfit(np.log(middle), np.log(errors), 1)[0]
    # Columns of n and n + 1 substeps are not one of n + 1/2: the slope is steeper by some percent.
    assert slope == pytest.approx(2 + 2 * columns, rel=0.15)


@pytest.mark.parametrize("name", list(SCENES))
@pytest.mark.parametrize("tolerance", [1e-1, 1e-3, 1e-6, 1e-9, 1e-12])
def test_splitting_meets_the_series(name: str, tolerance: float) -> None:
    scene = SCENES[name].replace(**{"solver.method": "splitting", "solver.tolerance": tolerance})
    series = scene.replace(**{"solver.method": "taylor", "solver.tolerance": 1e-15})
    actions = np.random.default_rng(1).uniform([-4.0, 1.0], [4.0, 3.0], (20, 2))
    actions = actions[:, : len(compile_scene(scene).actuators)]
    got, want = (simulate(one, action=actions).state for one in (scene, series))
    # Twenty errors add up, and grow with the amplitude's effect on the frequency.
    assert error(got, want, np.array([0.02, 0.02, 1.0, 1.0])) <= 40.0 * max(tolerance, 1e-15)


@pytest.mark.parametrize("name", list(SCENES))
@pytest.mark.parametrize("tolerance", [1e-2, 1e-7, 1e-10])
@pytest.mark.parametrize("count", [LANES + 5, 2 * LANES, 3])
def test_lane_in_a_vector_equals_lane_alone(name: str, tolerance: float, count: int) -> None:
    # From rest to ten times the energy that the plan is for: some lanes need more columns, some the
    # series.
    scene = SCENES[name].replace(
        **{
            "initial.carriage_displacement": (-0.003, 0.003),
            "solver.tolerance": tolerance,
            "actuation.force.limit": 60.0,
        }
    )
    assert_lanes_equal_single(compile_scene(scene), 20, count)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("name", list(SCENES))
def test_a_flight_through_the_middle_keeps_the_tolerance(name: str, tolerance: float) -> None:
    # There the springs hardly turn the motion, but their force changes along the way.
    scene = SCENES[name].replace(**{"solver.tolerance": tolerance, "control.time_step": 2e-4})
    series = scene.replace(**{"solver.method": "taylor", "solver.tolerance": 1e-15})
    starts = 0.01 * np.random.default_rng(0).uniform(-1.0, 1.0, (4, 2000))
    starts[2] = (np.random.default_rng(1).uniform(-1.0, 1.0, 2000) * 0.01 - starts[0]) / 2e-4
    ends = []
    for one in (compile_scene(scene), compile_scene(series)):
        lanes = Lanes(one, 2000)
        lanes.restart()
        lanes.values[:4] = starts
        lanes.raise_for(one.entries.propagate(one.model, lanes.values, 0, 2000))
        ends.append(lanes.values[:4].copy())
    sizes = np.maximum(abs(starts), abs(ends[1])).reshape(2, 2, 2000).max(1)
    assert (abs(ends[0] - ends[1]) / np.repeat(sizes, 2, axis=0)).max() <= tolerance


@pytest.mark.parametrize("name", list(SCENES))
def test_lane_that_misses_the_tolerance_is_redone_by_the_series(name: str) -> None:
    plant = compile_scene(SCENES[name])
    series = compile_scene(SCENES[name].replace(**{"solver.method": "taylor"}))
    assert (plant.method.name, series.method.name) == ("splitting", "taylor")
    ends = []
    for one in (plant, series):
        lanes = Lanes(one, LANES)
        lanes.restart()
        # Far out, and close to the end of springs of finite stretch.
        reach = 0.97 * lanes.values[layout.STRETCH, 5] * lanes.values[layout.L0, 5]
        lanes.values[[layout.X1, layout.X2], 5] = 0.05, 0.05 + reach
        lanes.raise_for(one.entries.propagate(one.model, lanes.values, 0, LANES))
        ends.append(lanes.values[:4].copy())
    assert np.array_equal(ends[0][:, 5], ends[1][:, 5])
    assert not np.array_equal(ends[0][:, 4], ends[1][:, 4])


def test_plan_does_not_know_how_many_lanes_a_vector_holds() -> None:
    assert not hasattr(method, "LANES")
    scene = LINEAR.replace(**{"solver.tolerance": 1e-4, "control.time_step": 5e-3})
    plant = compile_scene(scene)
    assert method.plan_of(plant.support, plant.settings) == Plan(3, 1)


def test_weights_extrapolate_an_error_in_even_powers() -> None:
    for first in (1, 2, 7):
        for columns in range(1, slots.MOST + 1):
            weights = weights_of(first, columns)[:columns]
            substeps = 1.0 / np.arange(first, first + columns)
            # Each sum loses as many digits as its terms cancel.
            for power in range(2, columns + 1):
                terms = weights * substeps ** (2 * power)
                assert abs(terms.sum()) <= 1e-14 * np.abs(terms).sum()
            assert abs(weights.sum() - 1.0) <= 1e-15 * np.abs(weights).sum()


def test_drifts_are_the_exponential_of_the_dampers() -> None:
    row = np.zeros(layout.HARMONICS)
    row[[layout.M1, layout.M2, layout.D, layout.C]] = 0.1, 0.04, 1.3, 0.7
    generator = np.zeros((4, 4))
    generator[:2, 2:] = np.eye(2)
    generator[2:, 2:] = [[-20.0, 7.0], [17.5, -17.5]]
    times = np.array([1e-4, 0.1])
    for time, drift in zip(times, drifts_of(row, times), strict=True):
        want = exponential(decimals(generator), time)
        assert np.abs(drift[:4] - want[:2, 2:].ravel()).max() <= 1e-15
        assert np.abs(drift[4:] - want[2:, 2:].ravel()).max() <= 1e-15


def test_slope_and_bend_of_springs_of_finite_stretch_are_derivatives_of_their_force() -> None:
    with mp.workdps(40):
        for stretch, shortened in ((1.5, 0.4), (2.0, -1.7), (1.0, 0.0)):

            def force(u: mp.mpf, stretch: float = stretch) -> mp.mpf:
                return u * (1 + 2 * stretch / (mp.mpf(stretch) ** 2 - u**2) ** 2)

            slope, third = mp.diff(force, shortened), mp.diff(force, shortened, 3)
            assert plain(springs.pair_slope)(stretch, shortened) == pytest.approx(float(slope))
            assert plain(springs.pair_bend)(stretch, shortened) == pytest.approx(float(third / 6))


def test_it_is_taken_above_the_default_tolerance_and_the_series_from_there_on() -> None:
    names = {
        tolerance: compile_scene(FREE.replace(**{"solver.tolerance": tolerance})).method.name
        for tolerance in (1e-2, 1.01e-9, 1e-9, 1e-12)
    }
    assert names == {1e-2: "splitting", 1.01e-9: "splitting", 1e-9: "taylor", 1e-12: "taylor"}
    plant = compile_scene(FREE)
    assert "over many lanes the splitting is faster" in plant.explain()
    # Asked for, it is taken at any tolerance that its round-off allows.
    assert compile_scene(SCENES["free"]).method.name == "splitting"


@pytest.mark.parametrize("name", list(SCENES))
def test_it_is_taken_whatever_is_drawn_and_excites(name: str) -> None:
    scene = SCENES[name].replace(solver={"tolerance": 1e-5})
    assert compile_scene(scene).method.name == "splitting"


def test_tight_tolerances_of_linear_carriages_are_left_to_the_runge_kutta_pairs() -> None:
    names = {
        tolerance: compile_scene(LINEAR.replace(**{"solver.tolerance": tolerance})).method.name
        for tolerance in (1e-3, 1e-5, 0.9e-5)
    }
    assert names == {1e-3: "splitting", 1e-5: "splitting", 0.9e-5: "runge_kutta"}


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"randomization": {"interface.damping": (90.0, 99.0)}}, "dampers that are drawn slow"),
        ({"control.time_step": 0.1}, "radians of the fastest oscillation"),
        ({"solver.tolerance": 0.5 * TIGHTEST}, "solver.tolerance is below 1e-12"),
        (
            {"control.time_step": 6e-3, "solver.tolerance": 1e-12},
            "its round-off is beyond solver.tolerance = 1e-12",
        ),
        (
            {"excitation": [{"kind": "harmonic", "amplitude": 1.0, "frequency": 500.0}]},
            "a harmonic turns by 1 rad in a sample interval",
        ),
        ({"carriage.linear_coefficient": -1.0}, "spring is negative"),
    ],
)
def test_what_it_does_not_cover_is_left_to_others(changes: dict, why: str) -> None:
    plant = compile_scene(FREE.replace(**changes))
    assert plant.method.name in {"runge_kutta", "taylor"}
    # A tight tolerance is named first, before what else it rules out.
    tight = "not extrapolated splitting: solver.tolerance is 1e-09 or less"
    assert why in plant.explain() or tight in plant.explain()
    with pytest.raises(CompileError, match=f"'splitting' does not apply.*{re.escape(why)}"):
        compile_scene(FREE.replace(**changes, **{"solver.method": "splitting"}))
