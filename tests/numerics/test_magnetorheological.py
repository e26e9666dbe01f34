"""Is the damper that a voltage drives that of Spencer, Dyke, Sain and Carlson (1997)?"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mm_gym import (
    MovingMassEnv,
    MovingMassVectorEnv,
    Scene,
    SceneError,
    compile_scene,
    simulate,
)
from mm_gym.compiler.jit import plain
from mm_gym.lanes import layout
from mm_gym.law import magnetorheological
from mm_gym.methods.base import Settings
from mm_gym.methods.runge_kutta.method import plan_of
from mm_gym.metrics import response
from mm_gym.simulation.energy import quadrature
from mm_gym.simulation.lanes import Lanes

from .test_interfaces import EXCITATION, FAST, SPRINGS, _difference

STEPS = 60
PUBLISHED = {
    "damping": 21.0,
    "damping_per_volt": 3.50,
    "series_damping": 283.0,
    "series_damping_per_volt": 2.95,
    "hysteresis": 140.0,
    "hysteresis_per_volt": 695.0,
    "stiffness": 46.9,
    "accumulator_stiffness": 5.00,
    "gain": 301.0,
    "gamma": 363.0,
    "beta": 363.0,
}
"""In N, cm, s and V."""
PRELOAD = 5.00 * 14.3  # k1 x0 [N]


def scene_of(**changes: Any) -> Scene:
    base = {
        "interface": {"kind": "magnetorheological"},
        "initial": {
            "carriage_displacement": 0.01,
            "sphere_offset": 0.006,
            "sphere_velocity": 0.2,
        },
        "actuation": {"voltage": {"lag": 0.0}},
        "control": {"time_step": 0.005, "steps": STEPS},
        "solver": {"tolerance": 1e-10},
    }
    return Scene.of(base).replace(**changes)


def voltages(seed: int = 0) -> np.ndarray:
    """Return a random voltage for each control step."""
    return np.random.default_rng(seed).uniform(0.0, 2.25, STEPS)


def device(p: dict[str, float], u: float, x: float, v: float, own: np.ndarray) -> tuple[float, ...]:
    """Return force, y' and z' of the published equations but for x0, written anew."""
    y, z = own
    c0 = p["damping"] + p["damping_per_volt"] * u
    c1 = p["series_damping"] + p["series_damping_per_volt"] * u
    alpha = p["hysteresis"] + p["hysteresis_per_volt"] * u
    flow = (alpha * z + c0 * v + p["stiffness"] * (x - y)) / (c0 + c1)
    sheared = v - flow
    bent = -p["gamma"] * abs(sheared) * z * abs(z) - p["beta"] * sheared * z**2
    force = c1 * flow + p["accumulator_stiffness"] * x
    return force, flow, bent + p["gain"] * sheared


def reference(scene: Scene, held: np.ndarray) -> np.ndarray:
    """Return the states (n, 6) by SciPy, from control step to control step."""
    carriage, m2, springs = scene.carriage, scene.sphere.mass, scene.springs
    p = scene.interface.model_dump(exclude={"kind"})
    x0, step = p["accumulator_offset"], scene.control.time_step

    def rates(t: float, state: np.ndarray, u: float) -> list[float]:
        x1, x2, v1, v2 = state[:4]
        x = x2 - x1
        link, *own = device(p, u, x, v2 - v1, state[4:])
        link -= p["accumulator_stiffness"] * x0
        if springs.kind == "small_on_large":
            link += 2.0 * springs.stiffness * (1.0 + 2.0 / springs.stretch**3) * x
        if springs.kind == "finite_stretch":
            one, other = (springs.stretch + s * x / springs.rest_length for s in (1, -1))
            pair = one - one**-2 - other + other**-2
            link += springs.stiffness * springs.rest_length * pair
        push, shake = 0.0, 0.0
        for part in scene.excitation:
            value = part.amplitude * np.sin(part.frequency * t + part.phase)
            is_push = part.target == "force"
            push, shake = push + value * is_push, shake + value * (not is_push)
        spring = carriage.stiffness * (x1 + carriage.cubic_coefficient * x1**3)
        a1 = (link - spring - carriage.damping * v1 + push) / carriage.mass - shake
        return [v1, v2, a1, -link / m2 - shake, *own]

    start = scene.initial
    x1, v1 = start.carriage_displacement, start.carriage_velocity
    states = [np.array([x1, x1 + start.sphere_offset, v1, start.sphere_velocity, 0.0, 0.0])]
    for n, u in enumerate(held):
        times = n * step, (n + 1) * step
        found = solve_ivp(
            *(rates, times, states[-1], "DOP853"),
            *(None, False, None, False, (u,)),
            rtol=1e-12,
            atol=1e-17,
            max_step=2e-4,  # sees every kink, where z and the shear change their signs
        )
        states.append(found.y[:, -1])
    return np.array(states)


@pytest.mark.parametrize("excitation", [[], EXCITATION, FAST], ids=["free", "excited", "fast"])
@pytest.mark.parametrize(
    ("springs", "cubic", "own"),
    [
        (SPRINGS[0], 0.0, {}),
        (SPRINGS[1], 2e3, {}),
        (SPRINGS[2], 0.0, {"interface.gamma": 4e5, "interface.beta": 1e5}),
        (SPRINGS[1], 0.0, {"interface.accumulator_offset": 0.143, "interface.beta": -1e6}),
        (SPRINGS[2], 2e3, {}),
    ],
)
def test_motion_is_that_of_the_equations(
    springs: dict[str, Any], cubic: float, own: dict[str, float], excitation: list[Any]
) -> None:
    changes = {"springs": springs, "carriage.cubic_coefficient": cubic, "excitation": excitation}
    scene, held = scene_of(**changes, **own), voltages()
    found, want = simulate(scene, action=held[:, None]), reference(scene, held)
    scale = np.repeat(np.abs(want[:, :4]).reshape(-1, 2, 2).max(axis=(0, 2)), 2)
    # 60 steps of at most 1e-10 each; SciPy's own error is some 1e-11, at the kinks.
    assert (np.abs(found.state - want[:, :4]) / scale).max() <= 6e-9
    own_scale = np.abs(want[:, 4:]).max(axis=0)
    assert (np.abs(found.interface_state - want[:, 4:]) / own_scale).max() <= 6e-9


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
def test_control_steps_keep_the_tolerance(tolerance: float) -> None:
    scene, rng = scene_of(springs=SPRINGS[1], excitation=EXCITATION), np.random.default_rng(2)
    plants = [
        compile_scene(scene.replace(**{"solver.tolerance": goal})) for goal in (tolerance, 1e-12)
    ]
    coarse, fine = (Lanes(plant, 32) for plant in plants)
    for lanes in (coarse, fine):
        lanes.seed(0)
        lanes.restart()
    fine.values[:4] = rng.uniform(-1.0, 1.0, (4, 32)) * np.array([[0.01, 0.01, 0.5, 0.5]]).T
    for _ in range(20):
        actions = rng.uniform(-1.0, 1.0, 32)
        coarse.values[:] = fine.values
        assert coarse.advance(actions) == fine.advance(actions) == 0
        scale = np.abs(fine.values[:4]).reshape(2, 2, -1).max(axis=1).repeat(2, axis=0)
        assert (np.abs(coarse.values[:4] - fine.values[:4]) <= tolerance * scale).all()


def test_loose_steps_are_of_low_order() -> None:
    """Its shear turns round within micrometres: a pair of high order takes longer there."""
    hardening = {"kind": "linear", "stiffness": 60.0, "cubic_coefficient": 1e3}
    for springs in ({}, {"springs": hardening}):
        support = compile_scene(scene_of(**springs)).support
        for tolerance, is_high in ((1e-2, False), (1e-3, False), (1e-9, True)):
            plan = plan_of(support, Settings(tolerance, substeps=1))
            assert plan is not None
            assert plan.tableau.is_combined is is_high


@pytest.mark.parametrize("seed", [6, 20, 24, 31, 34])
def test_episodes_begin_from_rest_at_every_tolerance(seed: int) -> None:
    """Both masses move alike at first: of the slip velocity few digits are left."""
    quake = {"kind": "kanai_tajimi", "rms": 0.3, "ground_frequency": 25.0, "sample_time": 0.005}
    scene = Scene(
        carriage={"mass": 10.0, "stiffness": 4000.0, "damping": 4.0},
        sphere={"mass": 1.0},
        interface={"kind": "magnetorheological"},
        springs={"kind": "linear", "stiffness": 330.0},
        excitation=[quake],
        actuation={"voltage": {}},
        control={"time_step": 0.01},
    )
    ends = []
    for tolerance in (1e-12, 1e-10, 1e-9, 1e-7, 1e-6, 1e-3):
        lanes = Lanes(compile_scene(scene.replace(**{"solver.tolerance": tolerance})), 1)
        lanes.seed(seed)
        lanes.restart()
        assert lanes.advance(np.array([1.0])) == 0
        ends.append(lanes.values[:4, 0].copy())
        scale = np.abs(ends[0]).reshape(2, 2).max(axis=1).repeat(2)
        assert (np.abs(ends[-1] - ends[0]) <= tolerance * scale).all()


@pytest.mark.parametrize(
    ("voltage", "largest", "least"),
    [(0.0, 478, -622), (0.75, 840, -984), (1.5, 1196, -1340), (2.25, 1547, -1691)],
)
def test_forces_are_those_of_the_damper_in_the_testing_machine(
    voltage: float, largest: float, least: float
) -> None:
    """2.5 Hz, 1.5 cm: loops of Spencer et al. at four voltages, up to some 1,550 N.

    The ends were computed from the published equations and parameters, by LSODA at 1e-10 and apart
    from this package; the paper shows the loops as figures, without numbers.
    """
    names = magnetorheological.PARAMETERS
    values = {"voltage": voltage, "accumulator_offset": 14.3} | PUBLISHED
    p = [values[name] for name in names]
    force, rates = plain(magnetorheological.force), plain(magnetorheological.rates)
    turn = 2.0 * np.pi * 2.5

    def motion(t: float) -> tuple[float, float]:
        return 1.5 * np.sin(turn * t), 1.5 * turn * np.cos(turn * t)

    def field(t: float, own: np.ndarray) -> tuple[float, float]:
        return rates(p, *motion(t), tuple(own))

    times = np.linspace(1.2, 1.6, 401)
    found = solve_ivp(field, (0.0, 1.6), [0.0, 0.0], "LSODA", times, rtol=1e-9, atol=1e-12)
    forces = [force(p, *motion(t), own) for t, own in zip(times, found.y.T, strict=True)]
    assert max(forces) == pytest.approx(largest, abs=1.0)  # whole newtons, at 401 instants
    assert min(forces) == pytest.approx(least, abs=1.0)
    for t, own, value in zip(times, found.y.T, forces, strict=True):
        want = device(PUBLISHED, voltage, *motion(t), own)
        assert value == pytest.approx(want[0] - PRELOAD, rel=1e-12)
        assert field(t, own) == pytest.approx(want[1:], rel=1e-10, abs=1e-9)


def test_defaults_are_the_published_parameters_with_a_thousandth_of_the_forces() -> None:
    """In SI: 1 N/cm is 100 N/m, and 1 cm^-2 is 1e4 m^-2."""
    own = scene_of().interface
    for name, value in PUBLISHED.items():
        factor = {"gamma": 1e4, "beta": 1e4}.get(name, 0.1)
        factor = 1.0 if name == "gain" else factor
        assert getattr(own, name) == pytest.approx(factor * value, rel=1e-12), name
    assert Scene.of({"interface": {"kind": "magnetorheological"}}).actuation.voltage is None


def test_voltage_is_held_over_a_step_behind_lag_and_rate_limit() -> None:
    limits = {"lag": 0.01, "rate_limit": 100.0, "maximum": 2.0}
    scene = scene_of(actuation={"voltage": limits}, **{"interface.voltage": 0.5})
    env = MovingMassEnv(scene)
    env.reset(seed=0)
    applied, asked = 0.5, np.array([1.0, 1.0, -1.0, 0.2, -0.3, -1.0, -1.0], np.float32)
    for action in asked:
        wanted = 1.0 + float(action)
        change = -np.expm1(-0.5) * (wanted - applied)
        applied = np.clip(applied + np.clip(change, -0.5, 0.5), 0.0, 2.0)
        info = env.step(np.array([action]))[-1]
        assert info["applied"] == pytest.approx([applied], rel=1e-7)
    constant = scene_of(actuation={}, **{"interface.voltage": 1.3})
    moved, still = simulate(scene_of(), action=1.3), simulate(constant)
    assert moved.state == pytest.approx(still.state, rel=1e-7, abs=1e-10)
    assert moved.acceleration[1:] == pytest.approx(still.acceleration[1:], rel=1e-6, abs=1e-7)
    assert response(moved).rms_base_force == pytest.approx(response(still).rms_base_force, rel=1e-7)


@pytest.mark.parametrize("springs", SPRINGS, ids=[s["kind"] for s in SPRINGS])
def test_energy_balances_and_the_device_only_loses_it(springs: dict[str, Any]) -> None:
    """But for the work of changing the voltage, which is at most that at the largest z."""
    tight = {"solver.tolerance": 1e-12, "springs": springs, "excitation": EXCITATION}
    scene, held = scene_of(**tight), voltages(1)
    motion = simulate(scene, action=held[:, None])
    work, own = motion.work, scene.interface
    grown = motion.energy - motion.energy[0]
    # The motion's own 1e-12 a step, and the quadrature's, are of the throughput.
    assert np.abs(grown - work.total).max() <= 1e-9 * work.throughput[-1]
    assert np.diff(work.dissipated).min() >= -1e-12 * work.throughput[-1]
    largest = own.gain / (own.gamma + own.beta)  # of z^2
    jumps = 0.5 * own.hysteresis_per_volt * np.abs(np.diff(held)) * largest / own.gain
    assert (np.abs(np.diff(work.stretch)[:-1]) <= 1.0001 * jumps).all()
    assert np.abs(work.stretch).max() > 0.0


def test_power_goes_into_its_springs_dashpots_and_yield() -> None:
    """The balance of an episode would not tell: what is stored is taken off what is dissipated."""
    force, rates, energy = (
        plain(getattr(magnetorheological, name)) for name in ("force", "rates", "energy")
    )
    rng = np.random.default_rng(0)
    for _ in range(50):
        values = dict(zip(magnetorheological.PARAMETERS, rng.uniform(0.5, 1.0, 13), strict=True))
        p = list(values.values())
        x, v, *own = rng.uniform(-1.0, 1.0, 4)
        flow, bent = rates(p, x, v, own)

        def stored(h: float, motion: Any = (x, v, own, flow, bent), p: Any = p) -> float:
            x, v, (y, z), flow, bent = motion
            return energy(p, x + h * v, v, (y + h * flow, z + h * bent))

        u, z, sheared = values["voltage"], own[1], v - flow
        c0 = values["damping"] + u * values["damping_per_volt"]
        c1 = values["series_damping"] + u * values["series_damping_per_volt"]
        alpha = values["hysteresis"] + u * values["hysteresis_per_volt"]
        yielding = values["gamma"] * abs(sheared) * abs(z) + values["beta"] * sheared * z
        lost = c0 * sheared**2 + c1 * flow**2 + alpha / values["gain"] * yielding * z**2
        rate = stored(0.5) - stored(-0.5)  # exact: it is of second order
        assert force(p, x, v, own) * v == pytest.approx(rate + lost, rel=1e-10, abs=1e-10)


def test_slopes_that_lengths_of_steps_follow_from_are_those_of_the_force() -> None:
    rng, names = np.random.default_rng(5), magnetorheological.PARAMETERS
    force, (x, v, z), h = plain(magnetorheological.force), (0.3, -0.2, 0.1), 0.25
    for _ in range(20):
        p = rng.uniform(0.5, 1.0, len(names))
        slope = (force(p, x, v + h, (0.0, z)) - force(p, x, v, (0.0, z))) / h
        # The force is linear in all that changes here: what is left is round-off.
        assert magnetorheological.damping(p) == pytest.approx(slope, rel=1e-13)
        # With a rigid dashpot in series y stays, and z follows the offset until it yields. It is
        # rigid but for c0 / c1, 1e-9.
        p[names.index("series_damping")] = 1e9
        gain = p[names.index("gain")]
        before, after = (force(p, at, 0.0, (0.0, gain * at)) for at in (x, x + h))
        assert magnetorheological.stiffness(p) == pytest.approx((after - before) / h, rel=1e-8)


def test_energy_balances_where_the_tightest_tolerance_takes_too_many_steps() -> None:
    names, soft = ("hysteresis", "gamma", "beta"), scene_of().interface
    stiff = {f"interface.{name}": 10.0 * getattr(soft, name) for name in names}
    plant = compile_scene(scene_of(**stiff, **{"sphere.mass": 0.02, "solver.tolerance": 1e-6}))
    tightest = Settings(quadrature.TOLERANCE, None)
    assert plant.method.failing(plant.support, tightest) is not None
    motion = simulate(plant, duration=0.2, seed=0)
    gap = np.abs(motion.energy - motion.energy[0] - motion.work.total).max()
    # The motion's own error of 1e-6 a step is its promise; the balance shows 6e-12.
    assert gap <= 1e-9 * motion.work.throughput[-1]


def test_interval_that_no_plan_exists_for_is_refused() -> None:
    plant = compile_scene(scene_of())
    lanes = Lanes(plant, 3)
    lanes.seed(0)
    lanes.restart()
    longer = plant.at_interval(20.0)
    assert plan_of(longer.support, longer.settings) is None
    status = plant.entries.propagate(longer.model, lanes.values, 0, 3)
    assert status == layout.TOO_MANY_STEPS


@pytest.mark.parametrize("voltage", [0.0, 2.25])
def test_device_never_puts_energy_in_at_a_constant_voltage(voltage: float) -> None:
    """What it stores counts: in 4,000 control steps of many lanes, the sum falls in each."""
    ranges = {f"initial.{name}": [-0.02, 0.02] for name in ("carriage_displacement",)}
    ranges |= {"initial.sphere_offset": [-0.02, 0.02], "initial.sphere_velocity": [-1.0, 1.0]}
    tight = {"solver.tolerance": 1e-9, "interface.voltage": voltage}
    scene = scene_of(**ranges, **tight)
    env = MovingMassVectorEnv(scene, 100, autoreset_mode="Disabled")
    env.reset(seed=0)
    rows, own = env.plant.support.state_rows, scene.interface
    alpha = own.hysteresis + own.hysteresis_per_volt * voltage

    def energy() -> np.ndarray:
        x1, x2, v1, v2, y, z = np.asarray(env.get_state()["values"])[rows]
        stored = own.stiffness * (x2 - x1 - y) ** 2 + own.accumulator_stiffness * (x2 - x1) ** 2
        stored += alpha / own.gain * z**2 + scene.carriage.stiffness * x1**2
        return 0.5 * (stored + scene.carriage.mass * v1**2 + scene.sphere.mass * v2**2)

    before = energy()
    actions = np.full((100, 1), 2.0 * voltage / 2.25 - 1.0, np.float32)
    for _ in range(40):
        env.step(actions)
        after = energy()
        assert (after <= before * (1.0 + 1e-8)).all()  # squares, at a tolerance of 1e-9
        before = after


def test_jacobians_are_the_slopes_of_the_motion() -> None:
    changes = {"springs": SPRINGS[2], "excitation": EXCITATION, "solver.tolerance": 1e-12}
    scene = scene_of(**changes, **{"carriage.cubic_coefficient": 1e3})
    plant, rng = compile_scene(scene), np.random.default_rng(0)
    names = [f"interface.{name}" for name in (*PUBLISHED, "accumulator_offset")]
    names += ["carriage.mass", "sphere.mass", "springs.stiffness", "excitation.0.phase"]
    for _ in range(3):
        state = rng.uniform(-1.0, 1.0, 6) * np.array([0.01, 0.01, 0.1, 0.1, 1e-3, 3e-3])
        found = plant.jacobian(state, [0.3], parameters=names)
        assert found.names == ("x1", "x2", "v1", "v2", "y", "z", "voltage")

        def end(state: np.ndarray = state, action: float = 0.3, plant: Any = plant) -> np.ndarray:
            return plant.jacobian(state, [action]).end

        sizes = 1e-4 * np.array([0.01, 0.01, 0.1, 0.1, 0.01, 0.003])
        for k, size in enumerate(sizes):
            slope = _difference(lambda h, k=k: end(state + h * np.eye(6)[k]), size)  # noqa: B023
            scale = np.abs(found.state[:, k]).max()
            assert slope == pytest.approx(found.state[:, k], rel=1e-6, abs=1e-6 * scale)
        slope = _difference(lambda h: end(action=0.3 + h), 1e-3)
        assert slope == pytest.approx(found.action[:, 0], rel=1e-6, abs=1e-9)
        for name in names:
            value = float(plant.support.low[plant.support.names[name]])

            def moved(h: float, name: str = name, value: float = value) -> np.ndarray:
                return end(plant=compile_scene(scene.replace(**{name: value + h})))

            down = {"interface.beta", "interface.gamma"}  # beta is gamma at most
            if name in down:
                continue
            slope = _difference(moved, 1e-4 * max(abs(value), 0.1))
            want = found.parameters[name]
            assert slope == pytest.approx(want, rel=1e-5, abs=1e-5 * abs(want).max() + 1e-12), name


def test_linear_plant_is_that_of_slow_small_motions() -> None:
    """Below its yield the damper is c1 and the accumulator: all else follows the offset."""
    own = {"interface.voltage": 0.7, "initial": {}}
    scene = scene_of(springs=SPRINGS[1], **own)
    plant, interface = compile_scene(scene), scene.interface
    c = interface.series_damping + 0.7 * interface.series_damping_per_volt
    k = interface.accumulator_stiffness + 2.0 * 35.0 * (1.0 + 2.0 / 1.5**3)
    viscous = {"kind": "viscous", "damping": c}
    pair = {"kind": "linear", "stiffness": k}
    alike = scene.replace(interface=viscous, springs=pair, actuation={}, solver={})
    moved = plant.linear()[0]
    assert moved == pytest.approx(compile_scene(alike).linear()[0], rel=1e-9, abs=1e-9)
    at = [0.002, 0.006, 0.0, 0.0]
    system = plant.state_space(about=at)
    assert [signal.name for signal in system.inputs] == ["voltage"]

    def forces(u: float) -> np.ndarray:
        own = interface.model_dump(exclude={"kind"})
        link = device(own, u, at[1] - at[0], 0.0, np.zeros(2))[0]
        return np.array([link / scene.carriage.mass, -link / scene.sphere.mass])

    slope = (forces(0.7 + 1e-4) - forces(0.7 - 1e-4)) / 2e-4
    assert slope == pytest.approx(system.B[2:4, 0], rel=1e-6)
    with pytest.raises(SceneError, match=r"slip velocity of 0\.2 m/s"):
        plant.state_space(about=[0.0, 0.0, 0.0, 0.2])


def test_lanes_threads_snapshots_and_a_lone_environment_agree_bitwise() -> None:
    scene = scene_of(
        springs=SPRINGS[1],
        excitation=EXCITATION,
        randomization={"interface.hysteresis": [7.0, 21.0], "carriage.mass": [0.08, 0.12]},
        sensors={"channels": ["carriage_displacement", "slip_velocity", "voltage"]},
        **{"solver.tolerance": 1e-3},
    )
    rng = np.random.default_rng(1)
    env, threaded = MovingMassVectorEnv(scene, 70), MovingMassVectorEnv(scene, 70, threads=2)
    lone = MovingMassEnv(scene)
    first, also, alone = env.reset(seed=5), threaded.reset(seed=5), lone.reset(seed=5 + 41)
    assert np.array_equal(first[0], also[0])
    assert np.array_equal(first[0][41], alone[0])
    for step in range(30):
        if step == 10:
            saved = env.get_state()
        actions = rng.uniform(-1.0, 1.0, (70, 1)).astype(np.float32)
        seen, reward, *_, info = env.step(actions)
        assert np.array_equal(threaded.step(actions)[0], seen)
        own = lone.step(actions[41])
        assert np.array_equal(own[0], seen[41])
        assert own[1] == reward[41]
        if step == 10:
            kept, after = actions.copy(), info["state"].copy()
    rows = env.plant.support.state_rows
    assert np.asarray(saved["values"])[rows[4:]].any()
    env.set_state(saved)
    assert np.array_equal(env.step(kept)[-1]["state"], after)
    assert np.abs(seen[:, 2]).max() <= 1.0
    lone.close()


def test_picture_shows_the_voltage() -> None:
    env = MovingMassEnv(scene_of(), render_mode="rgb_array")
    env.reset(seed=0)
    env.step(np.array([-1.0], np.float32))
    dark = env.render()
    env.reset(seed=0)
    env.step(np.array([1.0], np.float32))
    assert (env.render() != dark).any()
    env.close()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"interface": {"kind": "viscous"}}, r"actuation\.voltage: .*'magnetorheological'"),
        ({"actuation.damping": {"of": "carriage"}}, r"voltage: not allowed with damping"),
        ({"interface.voltage": 3.0}, r"interface\.voltage: got 3\.0; allowed: within"),
        ({"interface.beta": 4e6}, r"beta: got 4000000\.0; allowed: at most gamma"),
        ({"actuation": {}, "sensors": {"channels": ["voltage"]}}, r"set actuation\.voltage"),
        ({"randomization": {"interface.voltage": [0.0, 3.0]}}, r"interface\.voltage: got .*within"),
    ],
)
def test_what_does_not_fit_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        scene_of(**changes)
