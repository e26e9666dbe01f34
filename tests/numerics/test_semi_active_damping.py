"""A damping coefficient under control: a semi-active device, which only takes energy out."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from mm_gym import (
    CompileError,
    MovingMassEnv,
    MovingMassVectorEnv,
    Scene,
    SceneError,
    compile_scene,
    simulate,
)
from mm_gym.lanes import layout
from mm_gym.metrics import response
from mm_gym.precision.episode import record, truth_of

from .by_scipy import motion
from .test_force_between_masses import (
    EXCITATION,
    GROUND,
    INITIAL,
    INTERFACES,
    ROUND_OFF,
    SPRINGS,
    STEPS,
    STRETCH,
    require_balance,
)

LOW, HIGH = 0.2, 6.0
DAMPERS = [("interface", "viscous"), *(("carriage", kind) for kind in INTERFACES)]
"""Which damper is actuated, and the interface."""


def scene_of(of="interface", carriage="linear", interface="viscous", springs="small", **changes):
    scene = Scene(
        carriage={"cubic_coefficient": 2e4 * (carriage == "cubic"), "damping": 1.0},
        interface=INTERFACES[interface],
        springs=SPRINGS[springs] if isinstance(springs, str) else springs,
        initial={
            "carriage_displacement": 0.004,
            "sphere_offset": 0.01,
            "carriage_velocity": 0.1,
            "sphere_velocity": -0.05,
        },
        actuation={"damping": {"of": of, "minimum": LOW, "maximum": HIGH}},
        control={"time_step": 0.005, "steps": STEPS},
    )
    return scene.replace(**changes)


def dampings(seed=0):
    """Return a random damping for each control step."""
    return np.random.default_rng(seed).uniform(LOW, HIGH, STEPS)


def is_exact(scene):
    return compile_scene(scene).method.name in ("exact", "switched")


@pytest.mark.parametrize("excitation", EXCITATION)
@pytest.mark.parametrize(
    ("damper", "carriage", "springs"), list(product(DAMPERS, ("linear", "cubic"), SPRINGS))
)
def test_motion_is_that_of_the_equations(damper, carriage, springs, excitation):
    of, interface = damper
    scene = scene_of(of, carriage, interface, springs, excitation=EXCITATION[excitation])
    held = dampings()
    found = simulate(scene, action=held[:, None])
    expected = motion(scene, **{of: held})
    bound = ROUND_OFF if is_exact(scene) else 3e-9  # three times the default tolerance
    assert (np.abs(found.state - expected) <= bound * np.abs(expected).max(axis=0)).all()
    require_balance(found)


@pytest.mark.parametrize(
    ("of", "carriage", "interface"),
    [
        ("interface", "linear", "viscous"),
        ("carriage", "linear", "friction"),
        ("interface", "cubic", "viscous"),
        ("carriage", "cubic", "friction"),
    ],
)
@pytest.mark.parametrize("ground", [None, GROUND], ids=["still", "ground"])
def test_force_and_stretch_stand_with_it(of, carriage, interface, ground):
    force = {"actuation.force": {"limit": 4.0, "between": "masses"}}
    scene = scene_of(of, carriage, interface, **force, **STRETCH)
    rng, held = np.random.default_rng(3), dampings(3)
    forces, stretches = rng.uniform(-2.0, 2.0, STEPS), rng.uniform(1.0, 3.0, STEPS)
    action = np.stack([forces, stretches, held], axis=1)
    found = simulate(scene, action=action, ground=ground)
    assert found.actuators == ("force", "stretch", "damping")
    expected = motion(scene, ground, force=forces, stretch=stretches, **{of: held})
    bound = 3e-9 if carriage == "cubic" else ROUND_OFF
    assert (np.abs(found.state - expected) <= bound * np.abs(expected).max(axis=0)).all()
    require_balance(found)
    pair = scene.replace(**{"actuation.stretch": None})
    env = MovingMassEnv(pair)
    env.reset(seed=0)
    *_, info = env.step(np.array([0.5, -1.0], np.float32))
    np.testing.assert_allclose(info["applied"], [2.0, LOW], rtol=1e-14)
    lanes = MovingMassVectorEnv(pair, 3)
    lanes.reset(seed=0)
    applied = lanes.step(np.tile(np.float32([0.5, -1.0]), (3, 1)))[4]["applied"]
    np.testing.assert_array_equal(applied, np.tile(info["applied"], (3, 1)))


@pytest.mark.parametrize("method", ["taylor", "splitting", "runge_kutta"])
@pytest.mark.parametrize("of", ["interface", "carriage"])
def test_every_method_for_cubic_springs_knows_it(of, method):
    solver = {"method": method, "tolerance": 1e-10}
    scene, held = scene_of(of, "cubic", solver=solver), dampings(1)
    expected = motion(scene, **{of: held})
    error = np.abs(simulate(scene, action=held[:, None]).state - expected)
    assert (error <= 3e-10 * np.abs(expected).max(axis=0)).all()


def test_interface_with_springs_that_harden_knows_it():
    springs = {"kind": "linear", "stiffness": 60.0, "cubic_coefficient": 5e4}
    scene, held = scene_of(solver={"tolerance": 1e-10}, springs=springs), dampings(4)
    found, expected = simulate(scene, action=held[:, None]), motion(scene, interface=held)
    assert found.recording.plant.kind == "general nonlinear"
    assert (np.abs(found.state - expected) <= 3e-10 * np.abs(expected).max(axis=0)).all()
    require_balance(found)


@pytest.mark.parametrize(
    ("of", "carriage", "interface"),
    [
        ("interface", "linear", "viscous"),
        ("carriage", "linear", "friction"),
        ("interface", "cubic", "viscous"),
    ],
)
def test_constant_command_is_a_scene_with_that_damping(of, carriage, interface):
    exact = {"tolerance": 1e-12} if carriage == "cubic" else {}
    scene = scene_of(of, carriage, interface, solver=exact)
    fixed = scene.replace(actuation={}, **{f"{of}.damping": 2.5})
    moved, still = simulate(scene, action=2.5), simulate(fixed)
    scale = np.abs(still.state).max(axis=0)
    assert (np.abs(moved.state - still.state) <= 2e-11 * scale).all()
    assert moved.work.dissipated[-1] == pytest.approx(still.work.dissipated[-1], rel=1e-9)
    np.testing.assert_allclose(
        moved.acceleration[1:], still.acceleration[1:], rtol=0, atol=1e-9 * 400.0
    )
    np.testing.assert_allclose(moved.base_force[1:], still.base_force[1:], rtol=0, atol=1e-9)
    one, other = response(moved), response(still)
    assert one.rms_base_force[0] == pytest.approx(other.rms_base_force[0], rel=1e-9)


@pytest.mark.parametrize("of", ["interface", "carriage"])
@pytest.mark.parametrize("interface", ["viscous", "friction"])
def test_device_never_puts_energy_in(of, interface):
    """In 10,000 control steps of many lanes energy falls in each, whatever the commands are."""
    if (of, interface) == ("interface", "friction"):
        return
    ranges = {f"initial.{name}": [-0.02, 0.02] for name in INITIAL[:2]}
    ranges |= {f"initial.{name}": [-0.5, 0.5] for name in INITIAL[2:]}
    limits = {"actuation.damping": {"of": of, "minimum": 0.0, "maximum": 40.0}}
    scene = scene_of(of, "linear", interface, **ranges, **limits, **{"control.steps": 100})
    lanes, steps = 250, 40
    env = MovingMassVectorEnv(scene, lanes, autoreset_mode="Disabled")
    state = env.reset(seed=0)[1]["state"].copy()
    rng, k2 = np.random.default_rng(0), 2.0 * 35.0 * (1.0 + 2.0 / 1.4**3)

    def energy(state):
        x1, x2, v1, v2 = state.T
        kinetic = scene.carriage.mass * v1**2 + scene.sphere.mass * v2**2
        return 0.5 * (kinetic + scene.carriage.stiffness * x1**2 + k2 * (x2 - x1) ** 2)

    before = energy(state)
    for _ in range(steps):
        actions = rng.choice([-1.0, 1.0, 0.3], (lanes, 1)).astype(np.float32)
        after = energy(env.step(actions)[4]["state"])
        assert (after <= before * (1.0 + 1e-13)).all()
        before = after
    assert (before < 0.5 * energy(state)).all()


def test_dissipation_is_that_of_its_power():
    scene, held = scene_of("carriage", "cubic", solver={"tolerance": 1e-12}), dampings(5)
    times = np.linspace(0.0, STEPS * 0.005, 12 * 400 + 1)
    found = simulate(scene, times=times, action=held[:, None])
    v1, w = found.state[:, 2], found.state[:, 3] - found.state[:, 2]
    each = np.repeat(held, 400)
    power = [each * v1[side] ** 2 + 0.7 * w[side] ** 2 for side in (slice(-1), slice(1, None))]
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[0] + power[1]) * np.diff(times))])
    # The trapezium rule errs by h^2 / 12 of the power's second derivative.
    assert np.abs(found.work.dissipated - work).max() <= 1e-6 * work[-1]
    assert (np.diff(found.work.dissipated) > 0.0).all()


@pytest.mark.parametrize(
    ("of", "carriage", "interface"),
    [
        ("interface", "linear", "viscous"),
        ("carriage", "linear", "friction"),
        ("interface", "cubic", "viscous"),
        ("carriage", "cubic", "friction"),
    ],
)
def test_lanes_are_single_environments_to_the_last_bit(of, carriage, interface):
    ranges = {
        "initial.sphere_offset": [-0.01, 0.01],
        "randomization": {f"{of}.damping": [1.0, 3.0]},
    }
    limited = {"actuation.damping.rate_limit": 300.0, "actuation.damping.lag": 0.004}
    channels = ["damping", "carriage_acceleration", "sphere_acceleration"]
    limited |= {"sensors.channels": channels, "control.steps": 4}
    scene, count = scene_of(of, carriage, interface, **ranges, **limited), 19
    many, one = MovingMassVectorEnv(scene, count, autoreset_mode="SameStep"), MovingMassEnv(scene)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (4, count, 1)).astype(np.float32)
    first, info = many.reset(seed=5)
    begins = info["state"].copy(), many.unwrapped.get_state()["values"][layout.DAMPING].copy()
    shown = [first.copy()]
    states = []
    for action in actions[:3]:
        observation, *_, info = many.step(action)
        shown.append(observation.copy())
        states.append((info["state"].copy(), info["applied"].copy()))
    assert len(set(begins[1])) == count
    for lane in (0, 7, 18):
        observation, _ = one.reset(seed=5 + lane)
        np.testing.assert_array_equal(observation, shown[0][lane])
        for k, action in enumerate(actions[:3]):
            observation, *_, info = one.step(action[lane])
            np.testing.assert_array_equal(info["state"], states[k][0][lane])
            np.testing.assert_array_equal(info["applied"], states[k][1][lane])
            np.testing.assert_array_equal(observation, shown[k + 1][lane])
    many.step(actions[3])  # all episodes end and begin anew, each with a damping of its own
    values = many.unwrapped.get_state()["values"]
    row = layout.C if of == "interface" else layout.D
    np.testing.assert_array_equal(values[layout.DAMPING], values[row])
    assert ((values[row] >= 1.0) & (values[row] <= 3.0)).all()
    assert (values[row] != begins[1]).all()


@pytest.mark.parametrize(
    "names", [("force", "damping"), ("stretch", "damping"), ("force", "stretch", "damping")]
)
@pytest.mark.parametrize("command", ["position", "rate"])
def test_each_actuator_has_an_action_of_its_own_that_costs(names, command):
    rated = {"command": "rate", "rate_limit": 40.0} if command == "rate" else {}
    limits = {
        "force": {"limit": 4.0, "between": "masses"},
        "stretch": {"minimum": 1.2, "maximum": 3.0},
        "damping": {"of": "interface", "minimum": LOW, "maximum": HIGH},
    }
    weights = {"displacement_weight": 0.0, "effort_weight": 0.3}
    actuation = {name: limits[name] | rated for name in names}
    scene, count = scene_of(actuation=actuation, objective=weights), 5
    env = MovingMassVectorEnv(scene, count)
    env.reset(seed=0)
    actions = np.random.default_rng(1).uniform(-1.3, 1.3, (count, len(names)))
    _, rewards, _, _, info = env.step(actions)
    clipped = np.clip(actions, -1.0, 1.0)
    np.testing.assert_allclose(rewards, -0.3 * (clipped**2).sum(axis=1), rtol=1e-13)
    begun = {"force": 0.0, "stretch": 1.4, "damping": scene.interface.damping}
    for k, name in enumerate(names):
        low, high = (-4.0, 4.0) if name == "force" else (1.2, 3.0)
        low, high = (LOW, HIGH) if name == "damping" else (low, high)
        wanted = 0.5 * (low + high) + 0.5 * (high - low) * clipped[:, k]
        if command == "rate":
            wanted = np.clip(begun[name] + 40.0 * 0.005 * clipped[:, k], low, high)
        np.testing.assert_allclose(info["applied"][:, k], wanted, rtol=1e-13)
    one = MovingMassEnv(scene)
    one.reset(seed=3)
    _, reward, *_ = one.step(actions[3])
    assert reward == rewards[3]


def test_rate_limit_lag_and_rate_commands_move_it():
    scene = scene_of(**{"actuation.damping.rate_limit": 100.0})
    found = simulate(scene, action=HIGH).action[:, 0]
    start = scene.interface.damping
    np.testing.assert_allclose(found[:5], start + 0.5 * np.arange(1, 6), rtol=1e-14)
    late = simulate(scene_of(**{"actuation.damping.lag": 0.01}), action=HIGH).action[:, 0]
    times = 0.005 * np.arange(1, 6)
    np.testing.assert_allclose(late[:5], HIGH + (start - HIGH) * np.exp(-times / 0.01), rtol=1e-13)
    both = {"actuation.damping.lag": 0.01, "actuation.damping.rate_limit": 100.0}
    expected = [start]
    for _ in range(STEPS):  # the lag first, then the limit
        wanted = -np.expm1(-0.005 / 0.01) * (HIGH - expected[-1])
        expected.append(expected[-1] + min(wanted, 0.5))
    found = simulate(scene_of(**both), action=HIGH).action[:, 0]
    np.testing.assert_allclose(found[:STEPS], expected[1:], rtol=1e-13)
    rated = {"actuation.damping.rate_limit": 100.0, "actuation.damping.command": "rate"}
    env = MovingMassEnv(scene_of(**rated))
    env.reset(seed=0)
    applied = [env.step(np.array([a], np.float32))[4]["applied"][0] for a in (1.0, 0.5, -1.0)]
    np.testing.assert_allclose(applied, start + np.array([0.5, 0.75, 0.25]), rtol=1e-14)


def test_state_is_restored_and_observed():
    scene = scene_of(**{"sensors.channels": ["damping", "carriage_velocity"]})
    env = MovingMassEnv(scene)
    observation, _ = env.reset(seed=0, options={"interface.damping": 2.0})
    half, middle = 0.5 * (HIGH - LOW), 0.5 * (HIGH + LOW)
    assert observation[0] == pytest.approx((2.0 - middle) / half, rel=1e-6)
    env.step(np.array([0.4], np.float32))
    snapshot = env.get_state()
    after = [env.step(np.array([-0.3], np.float32))[4]["state"].copy() for _ in range(3)]
    env.set_state(snapshot)
    again = [env.step(np.array([-0.3], np.float32))[4]["state"].copy() for _ in range(3)]
    np.testing.assert_array_equal(after, again)
    wrong = {**snapshot, "values": snapshot["values"].copy()}
    wrong["values"][layout.C] = 3.0
    with pytest.raises(SceneError, match="allowed: the same as in row"):
        env.set_state(wrong)
    assert env.observation_space.contains(env.reset(seed=1)[0])


@pytest.mark.parametrize(
    ("of", "carriage", "interface", "springs"),
    [
        ("interface", "linear", "viscous", "small"),
        ("carriage", "linear", "friction", "small"),
        ("carriage", "linear", "stribeck", "small"),
        ("interface", "cubic", "viscous", "none"),
        ("carriage", "cubic", "friction", "finite"),
    ],
)
def test_jacobians_are_slopes_of_the_motion(of, carriage, interface, springs):
    exact = carriage == "linear" and interface != "stribeck"
    solver = {} if exact else {"tolerance": 1e-12}
    scene = scene_of(of, carriage, interface, springs, solver=solver)
    plant, start = compile_scene(scene), np.array([0.004, 0.012, 0.1, 0.3])
    found = plant.jacobian(start, [0.2], parameters=["sphere.mass"])
    assert found.names == ("x1", "x2", "v1", "v2", *("z",) * (interface == "none"), "damping")
    middle, half = 0.5 * (HIGH + LOW), 0.5 * (HIGH - LOW)

    def end(state, action, **changes):
        ranges = {f"initial.{name}": value for name, value in zip(INITIAL, state, strict=True)}
        ranges["initial.sphere_offset"] = state[1] - state[0]
        moved = scene.replace(**ranges, **changes)
        return simulate(moved, duration=0.005, action=middle + half * action).state[-1]

    for k, size in enumerate((1e-6, 1e-6, 1e-4, 1e-4)):
        both = [end(start + sign * size * np.eye(4)[k], 0.2) for sign in (1.0, -1.0)]
        column = (both[0] - both[1]) / (2.0 * size)
        assert (np.abs(column - found.state[:4, k]) <= 2e-6 * np.abs(column).max()).all()
    both = [end(start, 0.2 + size) for size in (1e-3, -1e-3)]
    tuned = (both[0] - both[1]) / 2e-3
    assert (np.abs(tuned - found.action[:4, 0]) <= 2e-6 * np.abs(tuned).max()).all()
    assert np.abs(tuned).max() > 1e-6
    assert found.action[-1, 0] == pytest.approx(half)
    both = [end(start, 0.2, **{"sphere.mass": 0.04 + size}) for size in (1e-7, -1e-7)]
    slope = (both[0] - both[1]) / 2e-7
    error = np.abs(slope - found.parameters["sphere.mass"][:4])
    assert (error <= 1e-5 * np.abs(slope).max()).all()


def test_state_space_has_the_slope_over_it():
    scene = scene_of(**{"interface.damping": 2.0})
    plant, (m1, m2) = compile_scene(scene), (scene.carriage.mass, scene.sphere.mass)
    system = plant.state_space(outputs=["damping"], about=[0.0, 0.0, 0.1, 0.4])
    np.testing.assert_allclose(system.B[:, 0], [0.0, 0.0, 0.3 / m1, -0.3 / m2], rtol=1e-14)
    assert system.inputs[0].unit == "N s/m"
    np.testing.assert_allclose(system.A[2, 3], 2.0 / m1, rtol=1e-14)
    still = plant.state_space(outputs=["x1"])
    assert not still.B.any()
    moved = plant.state_space(outputs=["x1"], at={"interface.damping": 5.0})
    np.testing.assert_allclose(moved.A[2, 3], 5.0 / m1, rtol=1e-14)
    own = compile_scene(scene_of("carriage")).state_space(about=[0.0, 0.0, 0.1, 0.4], outputs=[])
    np.testing.assert_allclose(own.B[:, 0], [0.0, 0.0, -0.1 / m1, 0.0], rtol=1e-14)


@pytest.mark.parametrize("of", ["interface", "carriage"])
def test_linear_plant_has_the_middle_of_what_an_episode_begins_with(of):
    drawn = compile_scene(scene_of(of, randomization={f"{of}.damping": [0.5, 1.5]}))
    fixed = compile_scene(scene_of(of, **{f"{of}.damping": 1.0}))
    np.testing.assert_array_equal(drawn.linear()[0], fixed.linear()[0])


def test_errors_are_measured_against_an_oracle_that_knows_it():
    scene = scene_of(**{"control.steps": 6})
    plant = compile_scene(scene)
    episode = record(plant, 3)
    truth = truth_of(scene, plant, [episode])
    (_, n), states = truth.places[0], episode.recording.states
    assert len(set(episode.recording.applied[:, 2])) == 6
    assert np.abs(states[n + 1] - truth.states[0]).max() <= 1e-12 * np.abs(states).max()


def test_regulators_refuse_it_by_name():
    errors = pytest.importorskip("agents.controllers.lqr")
    weights = {"objective.effort_weight": 0.1}
    for force in ({}, {"actuation.force": {"limit": 4.0}}):
        with pytest.raises(errors.DesignError, match="damping"):
            errors.design(scene_of(**weights, **force))


def test_controllers_hold_it_and_search_the_best():
    baselines = pytest.importorskip("agents.controllers.tuned")
    constant = pytest.importorskip("agents.controllers.constant")
    scene = scene_of(**{"initial.sphere_offset": [-0.01, 0.01]})
    held = constant.no_control(scene)
    actions, _ = held.action(held.begin(2), np.zeros((2, 4)), np.full((2, 1), 1.5))
    np.testing.assert_allclose(actions, (1.5 - 0.5 * (HIGH + LOW)) / (0.5 * (HIGH - LOW)))
    best = baselines.best_constant(scene)
    assert best.law.name.startswith("constant damping")
    assert LOW <= best.law.value <= HIGH


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"interface": {"kind": "none"}}, r"actuation.damping.of: got 'interface'; allowed: 'carr"),
        ({"interface.damping": 20.0}, r"interface.damping: got 20.0; allowed: within actuation"),
        ({"actuation.damping.minimum": -1.0}, r"actuation.damping.minimum: got -1.0; allowed"),
        ({"actuation.damping.minimum": 9.0}, r"actuation.damping.minimum: got 9.0; allowed: less"),
        ({"actuation.damping.of": "carriag"}, r"did you mean 'carriage'\?"),
        ({"randomization": {"interface.damping": [1.0, 9.0]}}, r"randomization.interface.damping"),
        ({"actuation.damping.command": "rate"}, r"actuation.damping.rate_limit: missing"),
    ],
)
def test_wrong_devices_are_refused(changes, message):
    scene = scene_of()
    with pytest.raises(SceneError, match=message):
        scene.replace(**changes)


def test_what_cannot_be_compiled_is_refused():
    with pytest.raises(SceneError, match=r"'damping' needs an actuator; set actuation\.damping"):
        scene_of(actuation={"force": {}}, **{"sensors.channels": ["damping"]})
    with pytest.raises(CompileError, match=r"carriage\.mass: 0 needs parameters"):
        compile_scene(scene_of(**{"carriage.mass": 0.0, "initial.carriage_velocity": 0.0}))
