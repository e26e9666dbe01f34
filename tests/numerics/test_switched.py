"""Is dry friction propagated exactly, with every change of regime found?"""

from __future__ import annotations

import numpy as np
import pytest
from oracle import error

from mm_gym import Scene, compile_scene, load_scene, simulate
from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.lanes import layout
from mm_gym.lanes.memory import on_cache_line
from mm_gym.lanes.simd import LANES
from mm_gym.lanes.simd_memory import rows_of
from mm_gym.law.events import NONE, first_exit
from mm_gym.methods.switched import lanes_kernel
from mm_gym.methods.switched import layout as slots
from mm_gym.precision.oracle import Oracle
from mm_gym.scene.excitation import Harmonic
from mm_gym.scene.mechanics import DryFriction, SmallOnLarge
from mm_gym.scene.scene import Control, Initial
from mm_gym.simulation.lanes import Lanes

from .conftest import assert_lanes_equal_single

FIG8 = DryFriction(
    static_coefficient=0.509, kinetic_coefficient=0.2545, reference_velocity=0.2, slip_damping=0.1
)
START = Initial(carriage_displacement=0.01, sphere_offset=0.02)
BASE = Scene(interface=FIG8, initial=START, control=Control(time_step=1e-3))
HARMONICS = (
    Harmonic(amplitude=3.0, frequency=50.0, phase=0.3),
    Harmonic(target="ground", amplitude=20.0, frequency=37.0, phase=-1.0),
)
SCENES = {
    "free": BASE,
    "springs": BASE.replace(springs=SmallOnLarge(stiffness=35.0, stretch=1.5).model_dump()),
    "harmonics": BASE.replace(excitation=[harmonic.model_dump() for harmonic in HARMONICS]),
    "force": BASE.replace(**{"actuation.force": {"limit": 20.0}}),
    "no jump": BASE.replace(**{"interface.kinetic_coefficient": 0.509}),
    "creep": BASE.replace(**{"interface.reference_velocity": 1e-3}),
}

DRAWN = SCENES["force"].replace(
    **{
        "control.time_step": 5e-3,
        "springs": SmallOnLarge(stiffness=35.0, stretch=1.5).model_dump(),
        "randomization": {
            "carriage.mass": (0.05, 0.2),
            "interface.kinetic_coefficient": (0.15, 0.25),
        },
    }
)
"""Every lane has regimes of its own."""

NOISE = {
    "kind": "noise",
    "rms": 5.0,
    "low_frequency": 44.0,
    "high_frequency": 71.0,
    "sample_time": 5e-3,
}
SWEEP = {
    "kind": "sweep",
    "target": "ground",
    "amplitude": 20.0,
    "start_frequency": 5.0,
    "end_frequency": 60.0,
    "duration": 1.0,
}
FAST = HARMONICS[0].model_dump() | {"frequency": 1000.0}
IMPULSE = {"kind": "impulse", "target": "ground", "size": 0.3, "time": 0.0337}
EXCITATIONS = [harmonic.model_dump() for harmonic in HARMONICS], [NOISE], [SWEEP], [IMPULSE]

# SciPy finds events to some 1e-12 of its step, and each step has an error of 1e-13.
ORACLE = 1e-10


def _forces(name: str, steps: int) -> np.ndarray | None:
    return np.random.default_rng(1).uniform(-20.0, 20.0, steps) if name == "force" else None


def _as_series(scene: Scene) -> Scene:
    """Return the same scene with a parameter randomised by round-off only."""
    chi = scene.interface.slip_damping
    return scene.replace(randomization={"interface.slip_damping": (chi, chi * (1.0 + 1e-15))})


@pytest.mark.parametrize("time_step", [1e-3, 1e-2, 0.1])
@pytest.mark.parametrize("name", list(SCENES))
def test_trajectory_meets_the_oracle(name: str, time_step: float) -> None:
    scene = SCENES[name].replace(**{"control.time_step": time_step})
    steps = round(0.5 / time_step)
    forces = _forces(name, steps)
    got = simulate(scene, duration=0.5, action=forces)
    want = Oracle(scene, max_step=1e-3).solve(got.time, forces=forces)
    assert compile_scene(scene).kind == "switched linear"
    assert error(got.state, want) <= ORACLE


@pytest.mark.parametrize("time_step", [1e-3, 1e-2, 0.1])
@pytest.mark.parametrize("name", list(SCENES))
def test_series_alone_meets_the_transition_matrices(name: str, time_step: float) -> None:
    scene = SCENES[name].replace(**{"control.time_step": time_step})
    forces = _forces(name, round(0.5 / time_step))
    plant = compile_scene(_as_series(scene))
    assert plant.kind == "parametric switched linear"
    # Both are exact to round-off, which the crossings amplify a little.
    assert (
        error(
            simulate(plant, duration=0.5, action=forces).state,
            simulate(scene, duration=0.5, action=forces).state,
        )
        <= 1e-12
    )


@pytest.mark.parametrize("name", ["free", "springs", "no jump", "creep"])
def test_one_long_step_equals_many_short_ones(name: str) -> None:
    scene = SCENES[name]
    short, long = (
        scene.replace(**{"control.time_step": 1e-4}),
        scene.replace(**{"control.time_step": 0.5}),
    )
    assert (
        error(
            simulate(long, duration=0.5).state[-1],
            simulate(short, duration=0.5).state[-1],
            np.array([0.03, 0.03, 0.6, 0.6]),
        )
        <= 1e-12
    )


def test_mirrored_start_gives_the_mirrored_trajectory() -> None:
    mirrored = BASE.replace(
        **{"initial.carriage_displacement": -0.01, "initial.sphere_offset": -0.02}
    )
    assert np.array_equal(
        simulate(BASE, duration=0.5).state, -simulate(mirrored, duration=0.5).state
    )


def test_both_crossings_within_one_step_are_found() -> None:
    # Slip lasts 4.5 ms here; without it the sphere would come to rest elsewhere, by 1.0e-3 m.
    interface = DryFriction(
        static_coefficient=0.51,
        kinetic_coefficient=0.255,
        reference_velocity=0.463,
        slip_damping=0.1,
    )
    for time_step in (1e-2, 0.04, 0.5):
        scene = BASE.replace(interface=interface.model_dump(), **{"control.time_step": time_step})
        x1, x2, _, v2 = simulate(scene, duration=4.0).state[-1]
        assert x2 - x1 + 0.04 * v2 * 0.463 / (0.51 * 0.3924) == pytest.approx(
            0.02104317184609508, rel=1e-12
        )


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_first_of_several_exits_is_found(sign: float) -> None:
    # (t - 0.3)(t - 0.31)(t - 0.9) leaves through a dip of 1e-5 only.
    roots = np.polynomial.polynomial.polyfromroots([0.3, 0.31, 0.9])
    series = np.zeros(8)
    series[:4] = -sign * roots
    gap = -roots[0]
    assert first_exit(series, 0, 7, gap, sign) == pytest.approx(0.3, rel=1e-12)
    assert first_exit(series, 0, 7, gap, sign) < 0.3 + 1e-12
    assert first_exit(series, 0, 7, 10.0, sign) == NONE


def test_touching_without_crossing_is_no_exit() -> None:
    series = np.zeros(8)
    series[:3] = 0.25, -1.0, 1.0  # (t - 1/2)^2
    assert first_exit(series, 0, 7, 0.25 + 1e-12, 1.0) == NONE
    assert first_exit(series, 0, 7, 0.25 - 1e-12, 1.0) == pytest.approx(0.5 - 1e-6, abs=1e-9)


@pytest.mark.parametrize("name", ["force", "harmonics"])
@pytest.mark.parametrize("time_step", [1e-3, 1e-2])
def test_lane_among_many_equals_lane_alone(name: str, time_step: float) -> None:
    changes = {"initial.carriage_displacement": (-0.01, 0.01), "actuation.force": {"limit": 20.0}}
    scene = SCENES[name].replace(**{"control.time_step": time_step}, **changes)
    assert_lanes_equal_single(compile_scene(scene), 100)
    assert_lanes_equal_single(compile_scene(_as_series(scene)), 20)


@pytest.mark.parametrize(
    ("tolerance", "name"), [(1e-2, "series"), (1e-8, "series"), (1e-9, "switched")]
)
@pytest.mark.parametrize("changes", [{}, {"excitation": [NOISE]}], ids=["held", "noise"])
def test_auto_takes_a_series_where_parameters_are_drawn(changes, tolerance, name) -> None:
    plant = compile_scene(DRAWN.replace(**{"solver.tolerance": tolerance}, **changes))
    assert plant.method.name == name


@pytest.mark.parametrize(
    "excitation", [[], *EXCITATIONS], ids=["held", "harmonics", "noise", "sweep", "impulse"]
)
@pytest.mark.parametrize("velocity", [0.2, 2e-3])
def test_drawn_lanes_meet_the_series_that_follows_them_alone(velocity, excitation) -> None:
    scene = DRAWN.replace(excitation=excitation, **{"interface.reference_velocity": velocity})
    want, crossings = _played(scene, "taylor", 1e-15)
    assert crossings >= 20  # at the ends of control steps; within them there are more
    scale = np.repeat(np.abs(want.reshape(-1, 2, 2, want.shape[-1])).max(axis=(0, 2, 3)), 2)
    for name, tolerance in ("switched", 1e-9), ("series", 1e-2), ("series", 1e-5), ("series", 1e-9):
        got, _ = _played(scene, name, tolerance)
        # Some 100 steps and pieces, each with an error of round-off; tolerances are bounds.
        assert error(got, want, scale[:, None]) <= (1e-11 if name == "switched" else tolerance)


def _played(scene: Scene, name: str, tolerance: float) -> tuple[np.ndarray, int]:
    """Return the states (steps, 4, lanes) under random actions, and how often lanes crossed."""
    lanes = Lanes(
        compile_scene(scene.replace(**{"solver.method": name, "solver.tolerance": tolerance})), 20
    )
    lanes.seed(0)
    lanes.restart()
    rng, states, slips, crossings = np.random.default_rng(0), [], _slips(lanes), 0
    for _ in range(30):
        lanes.advance(rng.uniform(-1.0, 1.0, 20))
        states.append(lanes.values[:4].copy())
        crossings += np.count_nonzero(_slips(lanes) != slips)
        slips = _slips(lanes)
    return np.array(states), crossings


def test_lanes_that_cross_again_and_again_meet_the_series_alone() -> None:
    scene = load_scene("mm_gym/CarriageForceFriction-v0")
    many, series = (Lanes(compile_scene(one), 300) for one in (scene, _as_series(scene)))
    for lanes in (many, series):
        lanes.seed(0)
        lanes.restart()
    series.values[:4] = many.values[:4]
    rng = np.random.default_rng(0)
    slips, largest, crossings = _slips(many), np.abs(many.values[:4]).max(axis=1), 0
    for _ in range(60):
        actions = rng.uniform(-1.0, 1.0, 300)
        many.advance(actions)
        series.advance(actions)
        crossings += np.count_nonzero(_slips(many) != slips)
        slips = _slips(many)
        largest = np.maximum(largest, np.abs(many.values[:4]).max(axis=1))
    assert crossings >= 2000
    # Round-off of 1e-16 a step, which crossings amplify a little.
    assert (np.abs(many.values[:4] - series.values[:4]) <= 1e-12 * largest[:, None]).all()


def _slips(lanes: Lanes) -> np.ndarray:
    return np.abs(lanes.values[layout.V2] - lanes.values[layout.V1]) > lanes.values[layout.VR]


def test_a_motion_that_grazes_the_reference_velocity_is_followed_alone() -> None:
    scene = load_scene("mm_gym/CarriageForceFriction-v0")
    plant = compile_scene(scene)
    lanes, series = Lanes(plant, 1), Lanes(compile_scene(_as_series(scene)), 1)
    for one in (lanes, series):
        one.restart()
    # From this x1 on (to 1e-15) the slip velocity, 0.19 m/s at first, reaches 0.2 m/s in the step.
    for distance, is_left in ((0.0, True), (1e-9, True), (-1e-9, True), (1e-3, False)):
        start = np.array([[0.004802109913185396 * (1.0 + distance)], [0.0], [-0.55], [-0.36]])
        lanes.values[:4] = series.values[:4] = start
        lanes.values[layout.FORCE] = 0.0
        which = np.zeros(1, np.int64)
        model = plant.model[int(plant.model[slots.SERIES]) :]
        assert lanes_kernel.advance(model, lanes.values, which) == is_left
        assert np.array_equal(lanes.values[:4], start) == is_left
        if distance == 0.0:
            continue  # round-off decides whether it slips
        lanes.values[:4] = start
        for one in (lanes, series):
            one.advance(np.zeros(1))
        # Where w' is small, 1e-16 in w is some 1e-11 of the interval, in which it changes by 0.1.
        assert np.allclose(lanes.values[:4], series.values[:4], rtol=0.0, atol=1e-12)


def test_friction_that_cannot_slip_is_a_viscous_interface() -> None:
    scene = BASE.replace(**{"interface.reference_velocity": 2.0})
    plant = compile_scene(scene)
    assert plant.kind == "linear"
    assert "never slips" in plant.explain()
    as_switched = simulate(scene.replace(**{"solver.method": "switched"}), duration=0.5)
    assert error(simulate(plant, duration=0.5).state, as_switched.state) <= 1e-12
    faster = scene.replace(**{"initial.carriage_velocity": 10.0})
    assert compile_scene(faster).kind == "switched linear"


def test_actuated_stretch_with_friction_meets_the_oracle() -> None:
    scene = SCENES["springs"].replace(
        **{"actuation.stretch": {"minimum": 1.0, "maximum": 3.0}, "control.time_step": 1e-2}
    )
    stretches = np.random.default_rng(2).uniform(1.0, 3.0, 50)
    got = simulate(scene, duration=0.5, action=stretches)
    assert (
        error(got.state, Oracle(scene, max_step=1e-3).solve(got.time, stretches=stretches))
        <= ORACLE
    )


def test_linear_system_of_friction_is_that_of_stick() -> None:
    a, _ = compile_scene(BASE).linear()
    assert a[3, 2] * 0.04 == pytest.approx(0.509 * 0.3924 / 0.2, rel=1e-14)


@pytest.mark.filterwarnings("ignore:solver.tolerance has no effect")
@pytest.mark.parametrize("tolerance", [1e-9, 1e-3])
@pytest.mark.parametrize(
    ("changes", "title"),
    [
        ({}, "transition matrices"),
        ({"interface.reference_velocity": 2e-3}, "a series"),
        ({"interface.reference_velocity": 1e-5}, "transition matrices"),
        ({"excitation": [harmonic.model_dump() for harmonic in HARMONICS]}, "a series"),
        ({"randomization": {"carriage.mass": (0.09, 0.11)}, "excitation": [FAST]}, "a series"),
    ],
    ids=["plain", "stiff", "stiffer", "harmonics", "fast harmonic, drawn"],
)
def test_the_name_means_the_same_at_every_tolerance(changes, title, tolerance) -> None:
    scene = SCENES["force"].replace(**{"solver.method": "switched", "control.time_step": 5e-3})
    plant = compile_scene(scene.replace(**{"solver.tolerance": tolerance}, **changes))
    assert plant.method.title.startswith(title)


@borrowing_kernel
def _left(model, lanes, numbers):
    return lanes_kernel._advance(model, lanes, rows_of(numbers), 0, LANES)


@pytest.mark.parametrize("time_step", [0.3, 1.0])
def test_long_steps_leave_no_lane_alone(time_step) -> None:
    scene = DRAWN.replace(**{"control.time_step": time_step, "solver.method": "switched"})
    lanes, rng = Lanes(compile_scene(scene), LANES), np.random.default_rng(0)
    lanes.seed(0)
    lanes.restart()
    numbers = on_cache_line(lanes_kernel._SIZE * LANES)
    for _ in range(30):
        lanes.values[layout.FORCE] = rng.uniform(-20.0, 20.0, LANES)
        assert _left(lanes.plant.model, lanes.values, numbers) == 0


def test_a_lane_that_is_not_finite_has_diverged_alone() -> None:
    lanes = Lanes(compile_scene(DRAWN), 3)
    lanes.seed(0)
    lanes.restart()
    lanes.values[layout.V2, 1] = np.nan
    assert lanes.advance(np.zeros(3)) == layout.DIVERGED
    assert np.isfinite(lanes.values[:4, [0, 2]]).all()
