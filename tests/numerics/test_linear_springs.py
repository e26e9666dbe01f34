"""Are plain springs, with or without a cubic term, what their equation says, wherever they go?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mm_gym import (
    CompileError,
    MovingMassEnv,
    MovingMassVectorEnv,
    Scene,
    SceneError,
    SimulationError,
    compile_scene,
    simulate,
)
from mm_gym.analysis import asymptotic_offset, bifurcation, frequency_response, modes
from mm_gym.precision.oracle import Oracle
from mm_gym.scene.toml_file import toml_of
from mm_gym.simulation.lanes import Lanes
from mm_gym.tuning import DesignError, duffing_absorber, stretch_for, tune
from mm_gym.tuning.closed_forms import closed_form

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

pytestmark = pytest.mark.filterwarnings("ignore:solver.tolerance has no effect")

K2, BETA = 90.0, 2e4
VISCOUS = {"kind": "viscous", "damping": 0.3}
FRICTION = {
    "kind": "dry_friction",
    "static_coefficient": 0.5,
    "kinetic_coefficient": 0.3,
    "reference_velocity": 0.05,
    "slip_damping": 0.1,
}
STRIBECK = {
    "kind": "stribeck",
    "static_coefficient": 0.3,
    "kinetic_coefficient": 0.2,
    "reference_velocity": 0.02,
    "stribeck_velocity": 0.05,
}
BOUC_WEN = {"kind": "bouc_wen", "stiffness": 100.0, "yield_displacement": 0.004}
INTERFACES = [{"kind": "none"}, VISCOUS, FRICTION]
EXCITATION = [
    {"kind": "harmonic", "target": "force", "amplitude": 1.0, "frequency": 30.0, "phase": 0.3},
    {"kind": "harmonic", "target": "ground", "amplitude": 0.5, "frequency": 45.0},
]


def scene_of(interface: dict[str, Any], beta: float = 0.0, **changes: Any) -> Scene:
    base = {
        "interface": interface,
        "springs": {"kind": "linear", "stiffness": K2, "cubic_coefficient": beta},
        "initial": {"carriage_displacement": 0.01, "sphere_offset": 0.006},
        "actuation": {"force": {"limit": 5.0}},
        "control": {"time_step": 0.005, "steps": 60},
        "solver": {"tolerance": 1e-10},
    }
    return Scene.of(base | changes)


def field_of(scene: Scene, force: float, regime: int) -> Callable[..., list[float]]:
    """Return the equations of motion, written anew for SciPy, in a regime of friction."""
    carriage, m2, springs, one = scene.carriage, scene.sphere.mass, scene.springs, scene.interface

    def field(t: float, y: np.ndarray) -> list[float]:
        x1, x2, v1, v2 = y
        u, w, link = x2 - x1, v2 - v1, 0.0
        if one.kind == "viscous":
            link = one.damping * w
        if one.kind == "dry_friction":
            normal, vr = m2 * 9.81, one.reference_velocity
            link = one.static_coefficient * normal * w / vr
            if regime:
                slip = one.kinetic_coefficient * normal + one.slip_damping * (regime * w - vr)
                link = regime * slip
        link += springs.stiffness * (u + springs.cubic_coefficient * u**3)
        push, shake = force, 0.0
        for part in scene.excitation:
            value = part.amplitude * np.sin(part.frequency * t + part.phase)
            if part.target == "ground":
                shake += value
            else:
                push += value
        spring = carriage.stiffness * (x1 + carriage.cubic_coefficient * x1**3)
        a1 = (link - spring - carriage.damping * v1 + push) / carriage.mass - shake
        return [v1, v2, a1, -link / m2 - shake]

    return field


def reference(scene: Scene, force: float, times: np.ndarray) -> np.ndarray:
    """Return the states (n, 4) by SciPy, from one change of friction's regime to the next."""
    x1 = scene.initial.carriage_displacement
    vr = getattr(scene.interface, "reference_velocity", np.inf)
    start, state, regime = 0.0, np.array([x1, x1 + scene.initial.sphere_offset, 0.0, 0.0]), 0
    found = np.full((len(times), 4), np.nan)
    while True:

        def gap(_: float, y: np.ndarray, regime: int = regime) -> float:
            w = y[3] - y[2]
            return regime * w - vr if regime else vr - abs(w)

        gap.terminal, gap.direction = True, -1.0
        due = times >= start
        solution = solve_ivp(
            field_of(scene, force, regime),
            (start, times[-1]),
            state,
            "DOP853",
            events=gap if np.isfinite(vr) else None,
            dense_output=True,
            rtol=1e-13,
            atol=1e-17,
            max_step=5e-4,
        )
        due &= times <= solution.t[-1]
        if due.any():
            found[due] = solution.sol(times[due]).T
        if solution.status == 0:
            return found
        start, state = float(solution.t[-1]), solution.y[:, -1]
        regime = 0 if regime else int(np.sign(state[3] - state[2]))


CASES = [(one, 0.0) for one in INTERFACES] + [(one, BETA) for one in INTERFACES[:2]]
CASE_NAMES = [f"{one['kind']}-{'cubic' if beta else 'linear'}" for one, beta in CASES]


@pytest.mark.parametrize("excitation", [[], EXCITATION], ids=["free", "excited"])
@pytest.mark.parametrize("cubic", [0.0, 2e3], ids=["linear carriage", "cubic carriage"])
@pytest.mark.parametrize(("interface", "beta"), CASES, ids=CASE_NAMES)
def test_motion_is_that_of_the_equations(
    interface: dict[str, Any], beta: float, cubic: float, excitation: list[Any]
) -> None:
    carriage = {"cubic_coefficient": cubic}
    scene = scene_of(interface, beta, carriage=carriage, excitation=excitation)
    found = simulate(scene, action=[0.7])
    want = reference(scene, 0.7, found.time)
    scale = np.repeat(np.abs(want).reshape(-1, 2, 2).max(axis=(0, 2)), 2)
    # 60 steps of at most 1e-10 each, and SciPy's error of some 1e-11.
    assert (np.abs(found.state - want) / scale).max() <= 6e-9
    u = want[:, 1] - want[:, 0]
    force = K2 * (u + beta * u**3)
    assert np.abs(found.channel("spring_force") - force).max() <= 6e-9 * np.abs(force).max()


@pytest.mark.parametrize("interface", [STRIBECK, BOUC_WEN], ids=["stribeck", "bouc_wen"])
def test_the_cubic_term_acts_beside_any_interface_that_is_known_by_value(
    interface: dict[str, Any],
) -> None:
    """The springs' share of the acceleration is all that a harder spring adds."""
    soft, hard = (
        simulate(scene_of(interface, beta), times=[0.0], action=[0.0]) for beta in (1e-9, BETA)
    )
    added = hard.channel("spring_force") - soft.channel("spring_force")
    assert added == pytest.approx(K2 * BETA * 0.006**3, rel=1e-12)
    change = hard.acceleration - soft.acceleration
    assert change[0] == pytest.approx(added * np.array([1.0 / 0.1, -1.0 / 0.04]), rel=1e-12)


def test_linear_springs_are_springs_small_on_large_of_the_same_stiffness() -> None:
    """Stretched to 2 they have 2.5 k0, without a rounding."""
    springs = {"kind": "small_on_large", "stiffness": K2 / 2.5, "stretch": 2.0}
    for interface in (VISCOUS, FRICTION):
        plain = scene_of(interface, excitation=EXCITATION, control={"time_step": 0.005})
        paper = plain.replace(springs=springs)
        one, other = compile_scene(plain), compile_scene(paper)
        assert one.method is other.method
        assert one.linear()[0] == pytest.approx(other.linear()[0], rel=1e-15)
        motion, want = simulate(one, action=[0.5]), simulate(other, action=[0.5])
        # The stretch that stands for them rounds k2 once; over 60 steps of some 3 rad.
        assert motion.state == pytest.approx(want.state, rel=1e-13, abs=1e-14)
        assert motion.energy == pytest.approx(want.energy, rel=1e-13)
        state = [0.01, 0.014, 0.2, -0.1]
        names = ["springs.stiffness", "carriage.mass"]
        found, wanted = (plant.jacobian(state, [0.1], parameters=names) for plant in (one, other))
        assert found.state == pytest.approx(wanted.state, rel=1e-12, abs=1e-12)
        slope = wanted.parameters["springs.stiffness"] / 2.5
        assert found.parameters["springs.stiffness"] == pytest.approx(slope, rel=1e-10)
    assert modes(plain).frequencies == pytest.approx(modes(paper).frequencies, rel=1e-14)


@pytest.mark.parametrize(("interface", "beta"), CASES, ids=CASE_NAMES)
def test_energy_balances(interface: dict[str, Any], beta: float) -> None:
    scene = scene_of(interface, beta, excitation=EXCITATION, solver={"tolerance": 1e-12})
    motion = simulate(scene, action=[0.5])
    work, x, v = motion.work, motion.state[:, :2], motion.state[:, 2:]
    u = x[:, 1] - x[:, 0]
    own = 0.5 * (v**2 @ [0.1, 0.04] + 400.0 * x[:, 0] ** 2 + K2 * (u**2 + 0.5 * beta * u**4))
    assert motion.energy == pytest.approx(own, rel=1e-13)
    grown = motion.energy - motion.energy[0]
    assert np.abs(grown - work.total).max() <= 1e-9 * work.throughput[-1]
    assert np.diff(work.dissipated).min() >= -1e-12 * work.throughput[-1]


@pytest.mark.parametrize("beta", [0.0, BETA], ids=["linear", "cubic"])
def test_lanes_threads_and_a_lone_environment_agree_bitwise(beta: float) -> None:
    scene = scene_of(VISCOUS, beta, solver={"tolerance": 1e-6})
    plant, rng = compile_scene(scene), np.random.default_rng(1)
    many, threaded, lone = Lanes(plant, 70), Lanes(plant, 70, threads=2), Lanes(plant, 1)
    for lanes in (many, threaded, lone):
        lanes.seed(0)
        lanes.restart()
    many.values[:4] = threaded.values[:4] = rng.uniform(-0.02, 0.02, (4, 70))
    lone.values[:] = many.values[:, 41:42]
    for _ in range(30):
        actions = rng.uniform(-1.0, 1.0, 70)
        assert many.advance(actions) == threaded.advance(actions) == 0
        assert lone.advance(actions[41:42]) == 0
        assert many.values.tobytes() == threaded.values.tobytes()
        assert many.values[:4, 41].tobytes() == lone.values[:4, 0].tobytes()


@pytest.mark.parametrize(("interface", "beta"), CASES, ids=CASE_NAMES)
def test_jacobians_are_the_slopes_of_the_motion(interface: dict[str, Any], beta: float) -> None:
    carriage = {"cubic_coefficient": 1e3}
    scene = scene_of(interface, beta, carriage=carriage, solver={"tolerance": 1e-12})
    plant = compile_scene(scene)
    names = ["springs.stiffness", *(["springs.cubic_coefficient"] if beta else [])]
    state = np.array([0.004, 0.013, 0.2, 0.6])
    found = plant.jacobian(state, [0.3], parameters=names)

    def end(state: np.ndarray = state, plant: Any = plant) -> np.ndarray:
        return plant.jacobian(state, [0.3]).end[:4]

    for k in range(4):
        slope = _difference(lambda h, k=k: end(state + h * np.eye(4)[k]), 6e-5)
        assert slope == pytest.approx(found.state[:4, k], rel=1e-7, abs=1e-8)
    for name in names:
        value = float(plant.support.low[plant.support.names[name]])

        def moved(h: float, name: str = name, value: float = value) -> np.ndarray:
            return end(plant=compile_scene(scene.replace(**{name: value + h})))

        slope, want = _difference(moved, 1e-4 * value), found.parameters[name][:4]
        assert slope == pytest.approx(want, rel=1e-6, abs=1e-6 * abs(want).max()), name


def _difference(function: Callable[[float], np.ndarray], h: float) -> np.ndarray:
    """Return a central difference of sixth order: its error is some 1e-9 here, of rounding."""
    ends = [function(k * h) - function(-k * h) for k in (1, 2, 3)]
    return (45.0 * ends[0] - 9.0 * ends[1] + ends[2]) / (60.0 * h)


def test_drawn_springs_move_as_those_of_their_numbers() -> None:
    ranges = {"springs.stiffness": [50.0, 150.0], "springs.cubic_coefficient": [0.0, 4e4]}
    scene = scene_of(VISCOUS, randomization=ranges)
    channels = ["carriage_displacement", "spring_force"]
    env = MovingMassVectorEnv(scene.replace(**{"sensors.channels": channels}), 5)
    env.reset(seed=3)
    drawn = {name: env.drawn(name) for name in ranges}
    for name, (low, high) in ranges.items():
        assert ((low <= drawn[name]) & (drawn[name] <= high)).all()
        assert np.ptp(drawn[name]) > 0.0
    for _ in range(20):
        shown, *_, info = env.step(np.full((5, 1), 0.2, np.float32))
    for lane in range(5):
        own = {name: float(values[lane]) for name, values in drawn.items()}
        want = simulate(scene.replace(randomization={}, **own), duration=0.1, action=[1.0])
        scale = np.repeat(np.abs(want.state).reshape(-1, 2, 2).max(axis=(0, 2)), 2)
        assert (np.abs(info["state"][lane] - want.state[-1]) / scale).max() <= 1e-8
        force = want.channel("spring_force")[-1] / 4.0  # k1 times the displacement's scale
        assert shown[lane, 1] == pytest.approx(force, rel=1e-5, abs=1e-6)


def test_the_linear_plant_about_a_point_has_the_slope_of_the_cubic_spring() -> None:
    plant, u = compile_scene(scene_of(VISCOUS, BETA)), 0.004
    system = plant.state_space(about=[0.0, u, 0.0, 0.0], outputs=["spring_force"])
    slope = K2 * (1.0 + 3.0 * BETA * u**2)
    assert system.A[3, :2] * 0.04 == pytest.approx([slope, -slope], rel=1e-13)
    assert system.C[0] == pytest.approx([-slope, slope, 0.0, 0.0], rel=1e-13)
    rest = compile_scene(scene_of(VISCOUS))
    assert plant.linear()[0] == pytest.approx(rest.linear()[0], rel=1e-15)


def test_analysis_takes_linear_springs_and_refuses_a_cubic_term_by_name() -> None:
    free = scene_of(VISCOUS, actuation={})
    assert asymptotic_offset(free) == 0.0
    assert not bifurcation(free, "springs.stiffness", [10.0, 90.0]).any()
    with pytest.raises(SceneError, match=r"springs\.cubic_coefficient: got up to 20000 1/m"):
        asymptotic_offset(free.replace(**{"springs.cubic_coefficient": BETA}))


def test_the_oracle_knows_these_springs() -> None:
    scene = scene_of(VISCOUS, BETA, actuation={})
    times = np.array([0.05, 0.2])
    want = reference(scene, 0.0, times)
    assert Oracle(scene).solve(times) == pytest.approx(want, rel=1e-9, abs=1e-11)


@pytest.mark.parametrize("mu", [0.01, 0.1, 0.4])
def test_a_tuned_linear_spring_is_den_hartogs(mu: float) -> None:
    carriage = {"damping": 0.0}
    scene = scene_of(VISCOUS, carriage=carriage, sphere={"mass": 0.1 * mu})
    w1 = np.sqrt(400.0 / 0.1)
    optimum = closed_form("den_hartog", mu)
    assert optimum.stiffness(0.1 * mu, w1) == pytest.approx(0.1 * mu * (w1 / (1.0 + mu)) ** 2)
    k2, c = optimum.stiffness(0.1 * mu, w1), optimum.damping(0.1 * mu, w1)
    tuned = scene.replace(**{"springs.stiffness": k2, "interface.damping": c})
    # Both fixed points, at which the response does not depend on c, are at sqrt(1 + 2 / mu).
    r = np.sqrt((1.0 + np.array([-1.0, 1.0]) * np.sqrt(mu / (2.0 + mu))) / (1.0 + mu))
    static = 1.0 / 400.0
    for damping in (c, 3.0 * c):
        one = tuned.replace(**{"interface.damping": float(damping)})
        found = np.abs(frequency_response(one, w1 * r).force[:, 0]) / static
        assert found == pytest.approx(np.sqrt(1.0 + 2.0 / mu), rel=1e-9)
    exact = closed_form("nishihara_asami", mu)
    found = tune(scene)
    assert found.out_of_reach is None
    assert found.stretch is None
    assert found.after == found.free
    # The search ends where the peak is flat: a root of its relative accuracy.
    assert found.tuned.springs.stiffness == pytest.approx(exact.stiffness(0.1 * mu, w1), rel=1e-5)
    assert found.tuned.interface.damping == pytest.approx(exact.damping(0.1 * mu, w1), rel=1e-4)
    assert found.after.value == pytest.approx(exact.value, rel=1e-9)
    assert "nishihara_asami" in found.table()


def test_the_absorber_of_a_cubic_carriage_keeps_linear_springs_with_a_cubic_term() -> None:
    scene = scene_of(VISCOUS, carriage={"cubic_coefficient": 2e4}, sphere={"mass": 0.01})
    mu, found = 0.1, duffing_absorber(scene).springs
    assert found.kind == "linear"
    optimum = closed_form("nishihara_asami", mu)
    assert found.stiffness == pytest.approx(optimum.stiffness(0.01, np.sqrt(4000.0)))
    share = found.stiffness * found.cubic_coefficient / (400.0 * 2e4)
    assert share == pytest.approx(2.0 * mu**2 / (1.0 + 4.0 * mu))


def test_a_scene_file_and_a_picture_have_them(tmp_path: Path) -> None:
    scene = scene_of(VISCOUS, BETA)
    assert "cubic_coefficient = 20000" in toml_of(scene, tmp_path)
    pytest.importorskip("pygame")
    env = MovingMassEnv(scene, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(np.ones(1, np.float32))
    assert np.ptp(env.render()) > 0
    env.close()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"actuation": {"stretch": {}}},
            r"actuation\.stretch: .*springs\.kind: got 'linear'; allowed: 'small_on_large'",
        ),
        (
            {"sensors": {"channels": ["stretch"]}},
            r"sensors\.channels: 'stretch' needs springs with a stretch; .* got 'linear'",
        ),
        ({"springs": {"kind": "linear"}}, r"springs\.stiffness: missing"),
        (
            {"springs": {"kind": "linear", "stiffness": 1.0, "stretch": 2.0}},
            r"springs\.stretch: unknown key; allowed: kind, stiffness, cubic_coefficient",
        ),
        (
            {"springs": {"kind": "linear", "stiffness": 1.0, "cubic_coefficient": -1.0}},
            r"springs\.cubic_coefficient: got -1\.0; allowed: greater than or equal to 0",
        ),
        ({"randomization": {"springs.stretch": [1.0, 2.0]}}, r"randomization.*springs\.stretch"),
    ],
)
def test_what_they_do_not_have_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        scene_of(VISCOUS, **changes)


@pytest.mark.parametrize(
    ("interface", "changes", "message"),
    [
        (FRICTION, {}, r"springs\.cubic_coefficient: got up to 20000 1/m\^2; allowed: 0 with"),
        (VISCOUS, {"carriage": {"mass": 0.0}}, r"carriage\.mass: 0"),
        (VISCOUS, {"solver": {"method": "taylor"}}, "'taylor' does not apply"),
    ],
)
def test_what_no_method_covers_is_refused(
    interface: dict[str, Any], changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(CompileError, match=message):
        compile_scene(scene_of(interface, BETA, **changes))


def test_a_stretch_is_refused_where_there_is_none() -> None:
    scene = scene_of(VISCOUS)
    with pytest.raises(SceneError, match=r"stretch: springs\.kind = 'linear' has no stretch"):
        compile_scene(scene).linear(2.0)
    with pytest.raises(SceneError, match=r"stretch: springs\.kind = 'none' has no stretch"):
        compile_scene(scene.replace(springs={"kind": "none"})).discrete(2.0)
    with pytest.raises(
        SimulationError, match=r"'stretch'; springs\.kind = 'linear' has no stretch"
    ):
        simulate(scene, duration=0.01).channel("stretch")
    with pytest.raises(DesignError, match=r"springs\.kind: 'linear' has no stretch"):
        stretch_for(scene, 50.0)
    drawn = scene.replace(randomization={"springs.stiffness": [50.0, 90.0]})
    with pytest.raises(DesignError, match=r"randomization\.springs\.stiffness: a tuned field"):
        tune(drawn)
