"""Are motions right about wells, hills and barriers: alpha and beta of any sign?"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from oracle import error
from wells import BISTABLE, FRICTION, PLACE, SOFTENING, UNSTABLE

from mm_gym import (
    CompileError,
    MovingMassEnv,
    MovingMassVectorEnv,
    Scene,
    SimulationError,
    compile_scene,
    simulate,
)
from mm_gym.lanes import layout
from mm_gym.precision.oracle import Oracle
from mm_gym.simulation.lanes import Lanes
from mm_gym.simulation.recording import blank, run

from .conftest import assert_lanes_equal_single
from .decimal_series import ControlStep

SCENES = {
    "bistable": BISTABLE,
    "softening": SOFTENING,
    "both negative": SOFTENING.replace(**{"carriage.linear_coefficient": -1.0}),
}
FORCED = {"actuation.force": {"limit": 4.0}}
RATE = np.sqrt(400.0 / 0.1)
"""Growth about the unstable middle without damping, and the wells' scale of rates [1/s]."""


def random_scene(rng: np.random.Generator) -> Scene:
    """Return a scene with a spring of random signs, begun within twice its place."""
    signs = ((-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 0.0))
    alpha, beta = (sign * rng.uniform(0.2, 2.0) for sign in signs[rng.integers(4)])
    interfaces = ({"kind": "none"}, {"kind": "viscous", "damping": 0.3}, FRICTION)
    springs = (
        {"kind": "none"},
        {"kind": "small_on_large"},
        {"kind": "finite_stretch", "rest_length": 0.2},
    )
    place = np.sqrt(abs(alpha / beta)) * PLACE if beta else PLACE
    start = float(rng.choice([0.0, 1e-12, 0.5, 1.0 - 1e-9, 1.0 + 1e-9, 1.9])) * place
    harmonic = {"kind": "harmonic", "amplitude": 2.0, "frequency": float(rng.uniform(10.0, 90.0))}
    return Scene(
        carriage={
            "linear_coefficient": float(alpha),
            "cubic_coefficient": float(beta) * PLACE**-2,
            "damping": float(rng.choice([0.0, 1.0])),
        },
        interface=interfaces[rng.integers(3)],
        springs=springs[rng.integers(3)],
        excitation=[harmonic][: rng.integers(2)],
        initial={
            "carriage_displacement": start,
            "sphere_offset": 0.01,
            "carriage_velocity": float(rng.choice([0.0, 0.5])),
        },
        control={"time_step": float(rng.uniform(0.05, 4.0)) / RATE, "steps": STEPS},
        solver={"method": "taylor", "tolerance": float(10.0 ** rng.uniform(-13.0, -3.0))},
    )


STEPS, CHECKED = 8, (0, 3, 7)
"""Control steps of each episode, and those of them that the reference follows."""


def excess(seed: int) -> float:
    """Return the largest error of a random scene's control steps over its tolerance.

    To the tolerance comes round-off, which a motion about an unstable place lets grow; see
    `mm_gym.plant.compile.MOST_GROWTH`. Where that is not enough, ten times the effect of rounding
    the reference's state to doubles is allowed as well: a spring of finite stretch that is nearly
    shortened to nothing magnifies it.
    """
    scene = random_scene(np.random.default_rng(seed))
    plant, worst = compile_scene(scene), 0.0
    growth = np.exp(plant.support.growth_rate * plant.time_step)
    lanes = Lanes(plant, 1)
    lanes.restart()
    recording = blank(plant, lanes.values[:, 0].copy(), STEPS)
    for n in range(STEPS):
        try:
            run(lanes, np.array([[0.0, lanes.values[layout.STRETCH, 0]]]), recording, n)
        except SimulationError:  # an escape, or a spring of length 0
            break
        if n not in CHECKED:
            continue
        start, applied = recording.starts[n], (float(x) for x in recording.applied[n])
        step = ControlStep(scene, n * plant.time_step, *applied)
        want, scale = step.end(start)
        difference = error(recording.states[n + 1], want, scale)
        allowed = scene.solver.tolerance + 2.0**-52 * growth
        if difference > allowed:
            rounded, _ = replace(step, rounded=True).end(start)
            allowed += 10.0 * error(rounded, want, scale)
        worst = max(worst, difference / allowed)
    return worst


def test_every_control_step_keeps_its_tolerance_whatever_the_signs() -> None:
    worst = {seed: excess(seed) for seed in range(12)}
    assert {seed: ratio for seed, ratio in worst.items() if not ratio <= 1.0} == {}


def test_every_control_step_of_three_hundred_scenes_keeps_its_tolerance() -> None:
    worst = {seed: excess(seed) for seed in range(300)}
    assert {seed: ratio for seed, ratio in worst.items() if not ratio <= 1.0} == {}


def _tight(scene: Scene, **changes: object) -> Scene:
    return scene.replace(**{"solver.tolerance": 1e-14} | changes)


@pytest.mark.parametrize(
    ("start", "well"), [(0.002, 1.0), (-0.002, -1.0), (0.0141, 1.0), (0.02, 1.0), (-0.02, -1.0)]
)
def test_a_bistable_carriage_meets_scipy_in_both_wells_and_across_the_hill(
    start: float, well: float
) -> None:
    scene = _tight(BISTABLE, **{"initial.carriage_displacement": start})
    motion = simulate(scene, duration=0.6)
    # DOP853 at 1e-13 has errors of some 1e-12 over ten periods.
    assert error(motion.state, Oracle(scene).solve(motion.time)) <= 1e-10
    still = simulate(scene, duration=4.0).state[-1]
    crossings = np.count_nonzero(np.diff(np.sign(motion.state[:, 0])))
    assert crossings == (0 if abs(start) < np.sqrt(2.0) * PLACE else 2)
    assert still[0] == pytest.approx(well * PLACE, rel=1e-9)
    assert still[1] - still[0] == pytest.approx(0.02, rel=1e-9)  # the first integral


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_nudge_of_a_picometre_chooses_the_well(side: float) -> None:
    start = {"initial.carriage_displacement": side * 1e-12, "carriage.damping": 0.0}
    scene = _tight(BISTABLE, **start, interface={"kind": "none"})
    motion = simulate(scene, duration=0.2)
    # While it is small the motion is linear, x1 = start cosh(rate t), but for a cubic part of
    # (x1 / PLACE)^2 of it.
    want = side * 1e-12 * np.cosh(RATE * motion.time)
    assert np.all(abs(motion.state[:, 0] / want - 1.0) <= 1e-12 + (want / PLACE) ** 2)
    damped = simulate(scene.replace(**{"carriage.damping": 1.0}), duration=5.0).state[-1]
    assert damped[0] == pytest.approx(side * PLACE, rel=1e-9)


def test_the_unstable_middle_itself_is_a_place_of_rest() -> None:
    for scene in (*SCENES.values(), UNSTABLE):
        still = scene.replace(**{"initial.carriage_displacement": 0.0})
        assert not simulate(still, duration=5.0).state[:, [0, 2, 3]].any()


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_energy_a_billionth_from_the_barrier_decides_between_staying_and_escaping(
    side: float,
) -> None:
    energy = 0.25 * 400.0 * PLACE**2 * (1.0 + side * 1e-9)
    free = {"initial.carriage_displacement": 0.0, "carriage.damping": 0.0}
    scene = _tight(SOFTENING, **free, interface={"kind": "none"})
    scene = scene.replace(**{"initial.carriage_velocity": float(np.sqrt(2.0 * energy / 0.1))})
    if side < 0.0:
        motion = simulate(scene, duration=1.0)
        # Its turning point is at 1 - x1^2 / PLACE^2 = sqrt(1e-9) from the barrier.
        assert np.abs(motion.state[:, 0]).max() < PLACE
        assert motion.energy == pytest.approx(energy, rel=1e-12)
        return
    with pytest.raises(SimulationError, match=r"escape .* = 0.01 m"):
        simulate(scene, duration=1.0)


@pytest.mark.parametrize("beta", [-1e4, -2e6, -2e12])
def test_a_softening_spring_of_any_strength_meets_scipy_inside_its_barrier(beta: float) -> None:
    place = np.sqrt(-1.0 / beta)
    changes = {"carriage.cubic_coefficient": beta, "initial.sphere_offset": 2.0 * place}
    scene = _tight(SOFTENING, **changes, **{"initial.carriage_displacement": 0.9 * place})
    motion = simulate(scene, duration=0.5)
    # SciPy's absolute tolerance of 1e-17 m is up to 1e-10 of the motion here.
    assert error(motion.state, Oracle(scene).solve(motion.time)) <= 1e-10 + 1e-15 / place


@pytest.mark.parametrize("method", ["rk4", "semi_implicit_euler"])
@pytest.mark.parametrize("name", ["bistable", "softening"])
def test_fixed_step_methods_converge_to_the_series(method: str, name: str) -> None:
    want = simulate(_tight(SCENES[name]), duration=0.2).state
    order = 4.0 if method == "rk4" else 1.0
    errors = [
        error(
            simulate(
                SCENES[name].replace(solver={"method": method, "substeps": substeps}), duration=0.2
            ).state,
            want,
        )
        for substeps in (8, 16)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.25)


@pytest.mark.parametrize("method", ["taylor", "rk4", "semi_implicit_euler"])
@pytest.mark.parametrize("beta", [-1e4, -2e12])
@pytest.mark.parametrize("alpha", [1.0, 0.0, -1.0])
def test_an_escape_is_named_with_place_and_time_by_every_method(
    alpha: float, beta: float, method: str
) -> None:
    place = np.sqrt(-1.0 / beta)
    scene = SOFTENING.replace(
        **{
            "carriage.linear_coefficient": alpha,
            "carriage.cubic_coefficient": beta,
            "initial.carriage_displacement": 1.2 * place,
            "solver.method": method,
            "actuation.force": {"limit": 4.0},
        }
    )
    what = f"= {place:.6g} m" if alpha > 0.0 else "no potential well"
    with pytest.raises(SimulationError, match=f"{method}: escape .* until t = .* s: .*{what}"):
        simulate(scene, duration=5.0)
    env = MovingMassEnv(scene)
    for _ in range(2):  # and again after a reset
        env.reset(seed=0)
        with pytest.raises(SimulationError, match=f"{method}: escape"):
            _drift(env, 400)


def _drift(env: MovingMassEnv | MovingMassVectorEnv, steps: int) -> None:
    """Step without control; all observations are finite."""
    for _ in range(steps):
        assert np.isfinite(env.step(np.zeros(env.action_space.shape, np.float32))[0]).all()


def test_an_escape_is_timed_to_the_control_step() -> None:
    scene = SOFTENING.replace(**{"initial.carriage_displacement": 0.0101, **FORCED})
    with pytest.raises(SimulationError, match=r"until t = 0.08 s"):
        simulate(scene)
    # The motion is finite until the step before.
    assert np.isfinite(simulate(scene, duration=0.07).state).all()
    env = MovingMassVectorEnv(scene, 3)
    env.reset(seed=0, options={"initial.carriage_displacement": np.array([0.001, 0.0101, 0.0])})
    with pytest.raises(SimulationError, match=r"taylor, lane 1: escape .* until t = 0.08 s"):
        _drift(env, 20)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("method", ["taylor", "rk4"])
def test_a_displacement_limit_ends_the_episode_of_an_escaped_carriage(
    method: str, mode: str
) -> None:
    limit = {"objective.displacement_limit": 0.012, "solver.method": method}
    scene = SOFTENING.replace(**limit, **FORCED, **{"control.time_step": 0.05})
    env = MovingMassVectorEnv(scene, 3, autoreset_mode=mode)
    env.reset(seed=0, options={"initial.carriage_displacement": np.array([0.001, 0.0119, 0.0])})
    for _ in range(4):
        observations, rewards, terminated, truncated, _ = env.step(np.zeros((3, 1), np.float32))
        assert np.isfinite(observations).all()
        assert np.isfinite(rewards).all()
        if terminated.any():
            break
    assert list(terminated) == [False, True, False]
    assert not truncated.any()
    for _ in range(3):  # the restarted lane goes on
        assert not env.step(np.zeros((3, 1), np.float32))[2].any()


def test_lanes_equal_single_episodes_where_ranges_cross_zero() -> None:
    ranges = {
        "carriage.linear_coefficient": (-1.0, 1.0),
        "carriage.cubic_coefficient": (-1e3, 1e4),
    }
    scene = BISTABLE.replace(randomization=ranges, **FORCED, **{"control.time_step": 1e-3})
    plant = compile_scene(scene)
    assert "x1 = 0 is unstable" in plant.explain()
    assert "escapes beyond the barrier" in plant.explain()
    assert_lanes_equal_single(plant, 40)


def test_plain_instability_grows_as_the_matrix_exponential_says() -> None:
    motion = simulate(UNSTABLE.replace(interface={"kind": "none"}), duration=1.0)
    # m1 s^2 + d s - k1 = 0
    s = np.roots([0.1, 1.0, -400.0])
    weights = np.linalg.solve([[1.0, 1.0], s], [0.002, 0.0])
    want = (weights * np.exp(np.outer(motion.time, s))).sum(axis=1)
    assert motion.state[:, 0] == pytest.approx(want, rel=1e-12)
    with pytest.raises(SimulationError, match="largest double from t = ") as caught:
        simulate(UNSTABLE, duration=20.0)
    assert "lets motions grow as exp(" in str(caught.value)
    env = MovingMassEnv(UNSTABLE.replace(**FORCED, **{"control.steps": 10_000}))
    env.reset(seed=0)
    with pytest.raises(SimulationError, match=r"lets motions grow as exp\("):
        _drift(env, 10_000)


@pytest.mark.parametrize("interface", [{"kind": "viscous"}, FRICTION])
@pytest.mark.parametrize("mass", [0.1, 0.0])
def test_every_method_of_an_unstable_linear_plant_meets_scipy(
    mass: float, interface: dict[str, object]
) -> None:
    if mass == 0.0 and interface is FRICTION:
        return  # refused: a massless carriage needs a viscous interface
    scene = UNSTABLE.replace(
        interface=interface, **{"carriage.mass": mass, "carriage.damping": 9.0}
    )
    # With fixed and with varying parameters other methods follow the motion.
    several = scene.replace(randomization={"carriage.damping": (9.0, 9.0 + 1e-14)})
    for each in (scene, several) if mass else (scene,):
        motion = simulate(each, duration=0.1)
        assert error(motion.state[1:], Oracle(scene, max_step=1e-3).solve(motion.time[1:])) <= 1e-10


def test_a_control_step_in_which_round_off_outgrows_the_bound_is_refused_by_name() -> None:
    for scene in SCENES.values():
        with pytest.raises(CompileError, match=r"control.time_step: .* allowed: exp\(9\)"):
            compile_scene(scene.replace(**{"control.time_step": 0.2}))
        compile_scene(scene.replace(**{"control.time_step": 0.1}))


def test_friction_that_may_slip_is_not_taken_for_viscous() -> None:
    # At rest on the hill no energy is left, but its depth lets the sphere slip.
    loose = FRICTION | {"reference_velocity": 0.4}
    scene = BISTABLE.replace(interface=loose, **{"initial.carriage_displacement": 1e-6})
    assert compile_scene(scene).kind == "switched nonlinear"
    held = scene.replace(interface=FRICTION | {"reference_velocity": 3.0})
    assert compile_scene(held).kind == "smooth nonlinear"
    soft = held.replace(**{"carriage.linear_coefficient": 1.0, "carriage.cubic_coefficient": -1e4})
    assert compile_scene(soft).kind == "switched nonlinear"


@pytest.mark.parametrize("excess_energy", [1e-3, 1e-4, 1e-6, -1e-4])
def test_a_step_that_climbs_the_hill_and_leaves_it_keeps_its_tolerance(
    excess_energy: float,
) -> None:
    # Errors grow by up to exp(8.9) in this step; aimed at as on a stable spring, they would be
    # 1.2 times the tolerance.
    place, hill = 0.3 * PLACE, 0.25 * 400.0 * PLACE**2
    below = 400.0 * (0.5 * place**2 - 0.25 * place**4 / PLACE**2)
    velocity = -float(np.sqrt(2.0 * max(0.0, below + excess_energy * hill) / 0.1))
    scene = BISTABLE.replace(
        interface={"kind": "none"},
        **{
            "carriage.damping": 0.0,
            "initial.carriage_displacement": place,
            "initial.carriage_velocity": velocity,
            "control.time_step": 0.14,
            "solver.tolerance": 1e-3,
        },
    )
    start = np.array([place, place + 0.02, velocity, 0.0])
    want, scale = ControlStep(scene, 0.0, 0.0, 1.0).end(start)
    got = simulate(scene, duration=0.14).state[-1]
    assert error(got, want, scale) <= 0.1 * scene.solver.tolerance


RUNAWAYS = {
    "series of finite springs": {"springs": {"kind": "finite_stretch", "rest_length": 1.0}},
    "events of friction": {"interface": FRICTION},
    "series of friction and finite springs": {
        "interface": FRICTION,
        "springs": {"kind": "finite_stretch", "rest_length": 1.0},
    },
    "rk4": {"solver.method": "rk4", "solver.substeps": 4},
}


@pytest.mark.parametrize("changes", RUNAWAYS.values(), ids=list(RUNAWAYS))
def test_runaway_is_told_with_its_rate_its_place_and_the_remedy(changes) -> None:
    scene = UNSTABLE.replace(**changes, **{"carriage.damping": 0.5})
    growths = re.compile(
        r"linear_coefficient = -1 .* grow as exp\((.*) t\) forever.*: set a cub.* "
        r"objective.displacement_limit. The carriage is at x1 = .* until t = "
    )
    with pytest.raises(SimulationError, match=growths) as caught:
        simulate(scene, duration=60.0)
    assert "shorten control.time_step" not in str(caught.value)
    told = float(growths.search(str(caught.value))[1])
    # The rate is what a short motion shows once the slower modes are gone.
    near = simulate(scene.replace(initial={"carriage_displacement": 1e-9}), duration=0.2)
    shown = np.gradient(np.log(np.abs(near.state[:, 0])), near.time)[-2]
    assert told == pytest.approx(shown, rel=2e-2)


def test_growth_of_one_lane_among_many_is_named() -> None:
    scene = UNSTABLE.replace(
        springs={"kind": "finite_stretch", "rest_length": 1.0},
        randomization={"carriage.linear_coefficient": (-1.0, 1.0)},
        **FORCED,
    )
    env = MovingMassVectorEnv(scene.replace(**{"control.steps": 10_000}), 3)
    env.reset(seed=0, options={"carriage.linear_coefficient": [0.9, -0.9, 0.8]})
    with pytest.raises(SimulationError, match=r"lane 1: .*linear_coefficient = -0\.9 .* exp\("):
        _drift(env, 10_000)
