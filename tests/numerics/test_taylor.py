"""Do the methods for nonlinear plants agree with the oracle, their tolerance and their order?"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
import pytest
from oracle import error

from mm_gym import CompileError, Scene, SimulationError, compile_scene, simulate
from mm_gym.lanes import layout
from mm_gym.lanes.simd import LANES
from mm_gym.methods.taylor import layout as taylor_layout
from mm_gym.methods.taylor.blocks_kernel import FEWEST_LANES
from mm_gym.methods.taylor.method import TIGHTEST
from mm_gym.precision.oracle import Oracle
from mm_gym.scene.excitation import Harmonic
from mm_gym.scene.mechanics import Carriage, DryFriction, FiniteStretch, SmallOnLarge
from mm_gym.scene.scene import Control, Initial, Solver
from mm_gym.simulation.lanes import Lanes

from .conftest import assert_lanes_equal_single

if TYPE_CHECKING:
    from mm_gym.plant.plant import Plant

START = Initial(carriage_displacement=0.01, sphere_offset=0.02, carriage_velocity=0.2)
CUBIC = Scene(
    carriage=Carriage(cubic_coefficient=2e6), initial=START, control=Control(time_step=1e-2)
)
FRICTION = DryFriction(
    static_coefficient=0.509, kinetic_coefficient=0.2545, reference_velocity=0.2, slip_damping=0.1
)
HARMONICS = (
    Harmonic(amplitude=3.0, frequency=50.0, phase=0.3),
    Harmonic(target="ground", amplitude=20.0, frequency=37.0, phase=-1.0),
)
FINITE = CUBIC.replace(
    **{"carriage.cubic_coefficient": 0.0},
    springs=FiniteStretch(stiffness=35.0, stretch=1.2, rest_length=0.03).model_dump(),
)
SCENES = {
    "cubic": CUBIC,
    "cubic with springs": CUBIC.replace(springs=SmallOnLarge(stiffness=35.0).model_dump()),
    "cubic with harmonics": CUBIC.replace(
        excitation=[harmonic.model_dump() for harmonic in HARMONICS]
    ),
    "cubic with friction": CUBIC.replace(interface=FRICTION.model_dump()),
    "finite stretch": FINITE,
    "finite stretch with friction": FINITE.replace(interface=FRICTION.model_dump()),
    "everything": FINITE.replace(
        interface=FRICTION.model_dump(),
        excitation=[harmonic.model_dump() for harmonic in HARMONICS],
        **{"carriage.cubic_coefficient": 1e5},
    ),
}
TIGHT = {"solver.tolerance": 1e-14}
SPRINGS_AND_HARMONICS = Scene(
    springs=SmallOnLarge(stiffness=35.0),
    excitation=HARMONICS,
    initial=START,
    control=Control(time_step=1e-2),
)


@pytest.mark.parametrize("time_step", [1e-3, 1e-2, 0.5])
@pytest.mark.parametrize("name", list(SCENES))
def test_trajectory_meets_the_oracle(name: str, time_step: float) -> None:
    scene = SCENES[name].replace(**TIGHT, **{"control.time_step": time_step})
    times = np.array([0.0, 0.1, 0.2, 0.35, 0.5])
    got = simulate(scene, times=times).state
    # SciPy has rtol = 1e-13 and finds events to some 1e-12 of its step.
    assert error(got, Oracle(scene, max_step=1e-3).solve(times)) <= 1e-10


def test_held_force_and_actuated_stretch_meet_the_oracle() -> None:
    changes = {
        "actuation.force": {"limit": 20.0},
        "actuation.stretch": {"minimum": 1.0, "maximum": 3.0},
    }
    scene = SCENES["finite stretch with friction"].replace(
        **TIGHT, **changes, **{"springs.rest_length": 0.2}
    )
    actions = np.random.default_rng(3).uniform([-20.0, 1.0], [20.0, 3.0], (50, 2))
    got = simulate(scene, duration=0.5, action=actions)
    want = Oracle(scene, max_step=1e-3).solve(
        got.time, forces=actions[:, 0], stretches=actions[:, 1]
    )
    assert error(got.state, want) <= 1e-10


@pytest.mark.parametrize("name", list(SCENES))
def test_error_over_a_control_step_is_below_the_tolerance(name: str) -> None:
    exact = simulate(SCENES[name].replace(**TIGHT), duration=0.5)
    for tolerance in (1e-3, 1e-6, 1e-9, 1e-12):
        plant = compile_scene(SCENES[name].replace(**{"solver.tolerance": tolerance}))
        # Each control step begins in the exact state.
        worst = 0.0
        for n in range(0, 50, 7):
            start = exact.state[n]
            one = _one_step(plant, start, n)
            scale = np.repeat(
                [np.abs(exact.state[:, :2]).max(), np.abs(exact.state[:, 2:]).max()], 2
            )
            worst = max(worst, error(one, exact.state[n + 1], scale))
        assert worst <= tolerance


def _one_step(plant: Plant, start: np.ndarray, n: int) -> np.ndarray:
    lane = Lanes(plant, 1)
    lane.restart()
    lane.values[:4, 0] = start
    for harmonic in range(layout.HARMONICS, len(lane.values), layout.HARMONIC_ROWS):
        angle = (
            lane.values[harmonic + layout.PHASE, 0]
            + lane.values[harmonic + layout.FREQUENCY, 0] * n * plant.time_step
        )
        lane.values[harmonic + layout.COSINE, 0], lane.values[harmonic + layout.SINE, 0] = (
            np.cos(angle),
            np.sin(angle),
        )
    lane.raise_for(plant.entries.propagate(plant.model, lane.values, 0, 1))
    return lane.values[:4, 0].copy()


@pytest.mark.parametrize("kind", ["viscous", "dry friction", "harmonics"])
def test_series_meets_the_exact_plants(kind: str) -> None:
    scene = {
        "viscous": CUBIC.replace(**{"carriage.cubic_coefficient": 0.0}),
        "dry friction": CUBIC.replace(
            interface=FRICTION.model_dump(), **{"carriage.cubic_coefficient": 0.0}
        ),
        "harmonics": SPRINGS_AND_HARMONICS,
    }[kind]
    asked = scene.replace(**TIGHT, **{"solver.method": "taylor"})
    assert compile_scene(asked).method.name == "taylor"
    assert error(simulate(asked, duration=1.0).state, simulate(scene, duration=1.0).state) <= 1e-12


@pytest.mark.parametrize("name", ["cubic", "everything"])
def test_one_long_step_equals_many_short_ones(name: str) -> None:
    scene = SCENES[name].replace(**TIGHT)
    long = simulate(scene.replace(**{"control.time_step": 0.5}), duration=0.5).state[-1]
    assert (
        error(simulate(scene, duration=0.5).state[-1], long, np.array([0.03, 0.03, 5.0, 5.0]))
        <= 1e-12
    )


@pytest.mark.parametrize("name", ["cubic with harmonics", "everything"])
def test_lane_among_many_equals_lane_alone(name: str) -> None:
    changes = {"initial.carriage_displacement": (-0.01, 0.01), "actuation.force": {"limit": 20.0}}
    assert_lanes_equal_single(compile_scene(SCENES[name].replace(**changes)), 50)


@pytest.mark.parametrize("seed", range(6))
def test_lane_in_a_vector_equals_lane_alone(seed: int) -> None:
    # From rest to fast motion, in long and short control steps: lanes side by side need series of
    # different orders and numbers. There are more lanes than in a vector, and parts of one.
    rng = np.random.default_rng(seed)
    scene = CUBIC.replace(
        springs={"kind": "none"} if seed % 2 else SmallOnLarge(stiffness=35.0).model_dump(),
        **{
            "randomization": {
                "carriage.cubic_coefficient": (0.0, float(10.0 ** rng.uniform(2.0, 7.0))),
                "carriage.mass": (0.05, 0.2),
                "carriage.linear_coefficient": (0.0, 1.0),
                "sphere.mass": (0.02, 0.1),
            },
            "initial.carriage_displacement": (-0.02, 0.02),
            "initial.carriage_velocity": (0.0, 1.0),
            "actuation.force": {"limit": 20.0},
            "control.time_step": float(10.0 ** rng.uniform(-4.0, -0.5)),
            "solver.tolerance": float(10.0 ** rng.uniform(-15.0, -2.0)),
        },
    )
    plant = compile_scene(scene)
    for count in (LANES + 5, 2 * LANES, FEWEST_LANES):
        assert_lanes_equal_single(plant, 20, count)


def test_lane_that_diverges_among_many_is_an_error() -> None:
    lanes = Lanes(compile_scene(CUBIC), LANES)
    lanes.restart()
    lanes.values[layout.V1, 3] = np.nan
    with pytest.raises(SimulationError, match="no longer finite"):
        lanes.raise_for(lanes.plant.entries.propagate(lanes.plant.model, lanes.values, 0, 16))


@pytest.mark.parametrize(("method", "order"), [("rk4", 4), ("semi_implicit_euler", 1)])
@pytest.mark.parametrize("name", ["cubic with harmonics", "finite stretch", "linear"])
def test_order_of_the_fixed_step_methods(method: str, order: int, name: str) -> None:
    scene = SPRINGS_AND_HARMONICS if name == "linear" else SCENES[name]
    if name == "cubic with harmonics":
        scene = scene.replace(**{"carriage.cubic_coefficient": 1e4})
    exact = simulate(scene.replace(**TIGHT) if name != "linear" else scene, duration=0.2).state
    counts = np.array([16, 32, 64, 128]) * (1 if order == 4 else 8)
    errors = [
        error(
            simulate(
                scene.replace(**{"solver.method": method, "solver.substeps": int(n)}), duration=0.2
            ).state,
            exact,
        )
        for n in counts
    ]
    slope = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert slope == pytest.approx(order, abs=0.2)


def test_unstable_fixed_step_method_stops_with_an_error() -> None:
    with pytest.raises(SimulationError, match="no longer finite"):
        simulate(
            CUBIC.replace(**{"solver.method": "rk4", "initial.carriage_displacement": 1.0}),
            duration=1.0,
        )


@pytest.mark.parametrize("method", ["rk4", "semi_implicit_euler", "exact"])
def test_method_outside_its_domain_is_refused(method: str) -> None:
    with pytest.raises(CompileError, match=r"solver.method: .* allowed: 'auto', 'taylor'"):
        compile_scene(SCENES["cubic with friction"].replace(**{"solver.method": method}))


def test_option_without_effect_warns() -> None:
    with pytest.warns(UserWarning, match=r"solver.substeps has no effect") as caught:
        compile_scene(CUBIC.replace(**{"solver.substeps": 3}))
    assert caught[0].filename == __file__
    with pytest.warns(UserWarning, match=r"solver.tolerance has no effect"):
        compile_scene(CUBIC.replace(**{"solver.tolerance": 1e-3, "solver.method": "rk4"}))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        compile_scene(CUBIC.replace(**{"solver.substeps": 3, "solver.method": "rk4"}))
        compile_scene(CUBIC.replace(**TIGHT))


def test_offset_that_collapses_a_spring_is_refused() -> None:
    with pytest.raises(
        CompileError, match=r"initial.sphere_offset: .* less than stretch \* rest_length"
    ):
        compile_scene(FINITE.replace(**{"initial.sphere_offset": 0.04}))


@pytest.mark.parametrize("time_step", [1e-2, 0.1])
def test_terms_that_vanish_by_symmetry_do_not_hide_the_others(time_step: float) -> None:
    # From the origin, under the cubic spring alone, every fourth term differs from zero.
    carriage = Carriage(linear_coefficient=0.0, cubic_coefficient=2e6, damping=0.0)
    start = Initial(carriage_velocity=3.0, sphere_velocity=1.0)
    scene = Scene(carriage=carriage, initial=start, control=Control(time_step=time_step))
    scene = scene.replace(interface={"kind": "none"})
    got = simulate(scene, duration=0.2)
    # Over a hundred radians, a relative error of the frequency causes an error of the phase a
    # hundred times as large.
    assert error(got.state, Oracle(scene).solve(got.time), np.array([0.2, 0.2, 3.0, 3.0])) <= 1e-8


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9, 1e-12, 1e-14])
def test_held_force_on_a_cubic_spring_at_rest_keeps_the_first_integral(tolerance: float) -> None:
    # One term in six differs from zero.
    carriage = Carriage(linear_coefficient=0.0, cubic_coefficient=2e6, damping=0.0)
    scene = Scene(
        carriage=carriage,
        control=Control(time_step=0.01, steps=10),
        interface={"kind": "none"},
        actuation={"force": {"limit": 50.0}},
        solver={"tolerance": tolerance},
    )
    state = simulate(scene, action=20.0).state
    x, v = state[:, 0], state[:, 2]
    work = 20.0 * x
    stored = 0.5 * carriage.mass * v**2 + 0.25 * carriage.stiffness * 2e6 * x**4
    assert np.abs(stored - work).max() <= 20.0 * max(tolerance, 1e-14) * np.abs(work).max()


def test_rest_stays_at_rest() -> None:
    still = CUBIC.replace(initial={})
    assert not simulate(still, duration=1.0).state.any()


def test_force_on_a_system_at_rest_keeps_the_tolerance() -> None:
    scene = CUBIC.replace(initial={}, excitation=[HARMONICS[0].model_dump()], **TIGHT)
    loose = simulate(scene.replace(**{"solver.tolerance": 1e-9}), duration=0.05).state
    assert error(loose, Oracle(scene).solve(np.arange(6) * 0.01)) <= 5e-9


def test_longest_series_fits_its_rows() -> None:
    # Kernels do not check bounds.
    tightest = Scene(
        carriage=Carriage(cubic_coefficient=1.0), solver=Solver(tolerance=TIGHTEST / 1e3)
    )
    assert compile_scene(tightest).model[taylor_layout.ORDER] < taylor_layout.WIDTH
