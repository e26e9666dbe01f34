"""A control force between the masses: u on the carriage, -u on the sphere."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

from mm_gym import MovingMassEnv, MovingMassVectorEnv, Scene, SceneError, compile_scene, simulate
from mm_gym.metrics import LaneResponse, response
from mm_gym.precision.oracle import Oracle

from .by_scipy import motion

STEPS = 12
FRICTION = {
    "kind": "dry_friction",
    "static_coefficient": 0.5,
    "kinetic_coefficient": 0.3,
    "reference_velocity": 0.05,
    "slip_damping": 0.1,
    "normal_force": 0.4,
}
INTERFACES = {
    "none": {"kind": "none"},
    "viscous": {"kind": "viscous", "damping": 0.7},
    "friction": FRICTION,
    "stribeck": {**FRICTION, "kind": "stribeck", "stribeck_velocity": 0.1},
}
SPRINGS = {
    "none": {"kind": "none"},
    "small": {"kind": "small_on_large", "stiffness": 35.0, "stretch": 1.4},
    "finite": {"kind": "finite_stretch", "stiffness": 35.0, "stretch": 1.4, "rest_length": 0.08},
}
EXCITATION = {
    "still": [],
    "excited": [
        {"kind": "harmonic", "amplitude": 0.6, "frequency": 40.0, "phase": 0.3},
        {"kind": "harmonic", "target": "ground", "amplitude": 2.0, "frequency": 55.0},
    ],
}
GROUND = np.array([[0.0, 0.0], [0.013, 1.5], [0.03, -2.0], [0.041, 0.7], [0.2, 0.0]])
STRETCH = {"actuation.stretch": {"minimum": 1.0, "maximum": 3.0}}

# What the methods promise, over twelve control steps and relative to the largest state. Where the
# bound is round-off, SciPy's own error of some 1e-13 is in it.
ROUND_OFF, TOLERANCE = 2e-12, 1e-10
METHODS = {
    "auto": {},
    "taylor": {"method": "taylor", "tolerance": 1e-13},
    "splitting": {"method": "splitting", "tolerance": TOLERANCE},
    "runge_kutta": {"method": "runge_kutta", "tolerance": TOLERANCE},
    "series": {"method": "series", "tolerance": TOLERANCE},
}


def scene_of(
    carriage="linear", interface="viscous", springs="small", excitation="still", **changes
):
    scene = Scene(
        carriage={"cubic_coefficient": 2e4 * (carriage == "cubic"), "damping": 1.0},
        interface=INTERFACES[interface],
        springs=SPRINGS[springs],
        excitation=EXCITATION[excitation],
        initial={
            "carriage_displacement": 0.004,
            "sphere_offset": 0.01,
            "carriage_velocity": 0.1,
            "sphere_velocity": -0.05,
        },
        actuation={"force": {"limit": 4.0, "between": "masses"}},
        control={"time_step": 0.005, "steps": STEPS},
    )
    return scene.replace(**changes)


def commands(seed=0):
    """Return random forces and stretches, one for each control step."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-2.0, 2.0, STEPS), rng.uniform(1.0, 3.0, STEPS)


def require_balance(found):
    """The energy that comes in is what the energy grows by; the methods' own error is in it."""
    gap = np.abs(found.energy - found.energy[0] - found.work.total)
    assert gap.max() <= 1e-9 * found.work.throughput.max()


@pytest.mark.parametrize("excitation", EXCITATION)
@pytest.mark.parametrize(
    ("carriage", "interface", "springs"),
    list(product(("linear", "cubic"), INTERFACES, SPRINGS)),
)
def test_motion_is_that_of_the_equations(carriage, interface, springs, excitation):
    scene, (forces, _) = scene_of(carriage, interface, springs, excitation), commands()
    found = simulate(scene, action=forces[:, None])
    expected = motion(scene, force=forces)
    exact = compile_scene(scene).method.name in ("exact", "switched")
    bound = ROUND_OFF if exact else 3e-9  # three times the default tolerance, over all steps
    assert (np.abs(found.state - expected) <= bound * np.abs(expected).max(axis=0)).all()
    require_balance(found)


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("ground", [None, GROUND], ids=["still", "ground"])
@pytest.mark.parametrize("carriage", ["linear", "cubic"])
@pytest.mark.parametrize("interface", ["viscous", "friction"])
def test_every_method_knows_it_with_a_stretch_that_moves(name, ground, carriage, interface):
    applies = {
        "splitting": carriage == "cubic" and interface == "viscous" and ground is None,
        "runge_kutta": interface == "friction" or carriage == "cubic",
        "series": carriage == "linear" and interface == "viscous",
    }
    if not applies.get(name, True):
        return
    scene = scene_of(carriage, interface, solver=METHODS[name], **STRETCH)
    forces, stretches = commands(1)
    found = simulate(scene, action=np.stack([forces, stretches], 1), ground=ground)
    expected = motion(scene, ground, force=forces, stretch=stretches)
    bound = 3e-9 if name == "auto" else 3.0 * TOLERANCE
    assert (np.abs(found.state - expected) <= bound * np.abs(expected).max(axis=0)).all()
    require_balance(found)


def test_drawn_parameters_and_carriages_without_mass_know_it():
    forces, _ = commands(2)
    drawn = scene_of(randomization={"carriage.damping": [1.0, np.nextafter(1.0, 2.0)]})
    found = simulate(drawn, action=forces[:, None])
    assert found.recording.plant.kind == "parametric linear"
    expected = motion(scene_of(), force=forces)
    assert (np.abs(found.state - expected) <= ROUND_OFF * np.abs(expected).max(axis=0)).all()
    massless = {"carriage.mass": 0.0, "initial.carriage_velocity": 0.0}
    alone = simulate(scene_of(**massless), action=forces[:, None])
    # A thousandth of a gram is 1e-6 / 0.04 of the sphere's mass.
    light = simulate(scene_of(**massless | {"carriage.mass": 1e-6}), action=forces[:, None])
    assert np.abs(alone.state[:, :2] - light.state[:, :2]).max() <= 1e-6
    assert np.abs(alone.state[:, 1] - simulate(scene_of(**massless)).state[:, 1]).max() > 1e-3
    require_balance(alone)


@pytest.mark.parametrize("mass", [0.0, 0.1], ids=["massless", "with mass"])
def test_the_oracle_knows_it(mass):
    scene, (forces, _) = scene_of(**{"carriage.mass": mass}), commands(3)
    found = Oracle(scene).solve(0.005 * np.arange(1, STEPS + 1), forces=forces)
    expected = simulate(scene, action=forces[:, None]).state[1:]
    # Without mass the carriage's velocity jumps with the force: at an end it is another step's.
    moved = [0, 1, 3]
    assert (np.abs(found - expected) <= ROUND_OFF * np.abs(expected).max(axis=0))[:, moved].all()


@pytest.mark.parametrize(
    ("carriage", "interface", "springs"),
    [
        ("linear", "viscous", "small"),
        ("linear", "friction", "small"),
        ("cubic", "viscous", "small"),
        ("cubic", "none", "none"),
        ("cubic", "friction", "finite"),
    ],
)
@pytest.mark.parametrize("tolerance", [1e-9, 1e-5])
def test_lanes_are_single_environments_to_the_last_bit(carriage, interface, springs, tolerance):
    solver = {} if carriage == "linear" else {"tolerance": tolerance}
    ranges = {"initial.sphere_offset": [-0.01, 0.01], "solver": solver}
    scene, count = scene_of(carriage, interface, springs, **ranges), 19
    many, one = MovingMassVectorEnv(scene, count), MovingMassEnv(scene)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (6, count, 1)).astype(np.float32)
    many.reset(seed=5)
    states = [many.step(action)[4]["state"].copy() for action in actions]
    for lane in (0, 7, 18):
        one.reset(seed=5 + lane)
        for action, state in zip(actions, states, strict=True):
            np.testing.assert_array_equal(one.step(action[lane])[4]["state"], state[lane])


def matrices(scene):
    """Return A (4, 4) and B (4, 1) from the masses' forces, linear in the state."""
    m1, m2, c, d = scene.carriage.mass, scene.sphere.mass, 0.7, scene.carriage.damping
    k1, k2 = scene.carriage.stiffness, 2.0 * 35.0 * (1.0 + 2.0 / 1.4**3)
    stiffness = np.array([[k1 + k2, -k2], [-k2, k2]])
    damping = np.array([[c + d, -c], [-c, c]])
    inverse = np.diag([1.0 / m1, 1.0 / m2])
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ damping]])
    return a, np.concatenate([np.zeros(2), inverse @ [1.0, -1.0]])[:, None]


def sampled(a, b, step):
    both = np.zeros((5, 5))
    both[:4, :4], both[:4, 4:] = a, b
    moved = expm(both * step)
    return moved[:4, :4], moved[:4, 4:]


def test_linear_plant_and_state_space_have_it_on_both_masses():
    scene = scene_of()
    plant, (a, b) = compile_scene(scene), matrices(scene)
    np.testing.assert_allclose(plant.linear()[0], a, rtol=1e-13, atol=1e-9)
    np.testing.assert_allclose(plant.linear()[1], b, rtol=1e-14)
    system = plant.state_space(outputs=["carriage_acceleration", "sphere_acceleration"])
    np.testing.assert_allclose(system.B, b, rtol=1e-14)
    np.testing.assert_allclose(system.D, b[2:], rtol=1e-14)
    later = plant.state_space(outputs=["x1", "sphere_acceleration"], sampled=True)
    ad, bd = sampled(a, b, scene.control.time_step)
    np.testing.assert_allclose(later.B[:4], bd, rtol=1e-11, atol=1e-16)
    np.testing.assert_allclose(plant.discrete()[1], bd, rtol=1e-11)
    # The held force is a state, because the sphere's acceleration shows it.
    assert [signal.name for signal in later.states[4:]] == ["force"]
    np.testing.assert_allclose(later.C[1, 4], b[3, 0], rtol=1e-14)
    assert np.abs(ad).max() > 0.0


def test_regulator_is_that_of_an_own_riccati_equation():
    design = pytest.importorskip("agents.controllers.lqr").design
    scene = scene_of(**{"objective.stroke_weight": 0.1, "objective.effort_weight": 0.05})
    a, b = sampled(*matrices(scene), scene.control.time_step)
    objective, effort = scene.objective, np.array([[0.05 / 4.0**2]])
    stroke = objective.stroke_weight / objective.stroke_scale**2 * np.array([[1, -1], [-1, 1]])
    weight = np.zeros((4, 4))
    weight[:2, :2] = stroke
    weight[0, 0] += objective.displacement_weight / objective.displacement_scale**2
    weight[2, 2] = objective.velocity_weight / objective.velocity_scale**2
    cost = solve_discrete_are(a, b, weight, effort)
    gain = np.linalg.solve(effort + b.T @ cost @ b, b.T @ cost @ a)
    np.testing.assert_allclose(design(scene).gain, gain, rtol=1e-9, atol=1e-9 * np.abs(gain).max())


@pytest.mark.parametrize("excitation", EXCITATION)
@pytest.mark.parametrize(
    ("carriage", "interface", "springs"),
    [
        *(("linear", interface, "small") for interface in ("viscous", "friction", "stribeck")),
        *(("cubic", interface, "small") for interface in ("viscous", "friction")),
        ("cubic", "viscous", "none"),
        ("cubic", "friction", "finite"),
        ("linear", "none", "none"),
    ],
)
def test_jacobians_are_slopes_of_the_motion(carriage, interface, springs, excitation):
    solver = {} if carriage == "linear" and interface != "stribeck" else {"tolerance": 1e-12}
    scene = scene_of(carriage, interface, springs, excitation, solver=solver)
    plant, start = compile_scene(scene), np.array([0.004, 0.012, 0.1, 0.3])
    names = ("carriage.mass", "sphere.mass", "carriage.damping", "carriage.stiffness")
    names = (*names, "springs.stiffness") if springs != "none" else names
    found = plant.jacobian(start, [0.4], parameters=names)

    def end(state, action, **changes):
        ranges = {f"initial.{name}": value for name, value in zip(INITIAL, state, strict=True)}
        ranges["initial.sphere_offset"] = state[1] - state[0]
        moved = scene.replace(**ranges, **changes)
        return simulate(moved, duration=0.005, action=4.0 * action).state[-1]

    def slope(of, size):
        return (of(size) - of(-size)) / (2.0 * size)

    scale = np.abs(found.state[:4, :4]).max(axis=1)
    for k, size in enumerate((1e-6, 1e-6, 1e-4, 1e-4)):
        column = slope(lambda h, k=k: end(start + h * np.eye(4)[k], 0.4), size)
        assert (np.abs(column - found.state[:4, k]) <= 2e-6 * scale).all()
    pushed = slope(lambda h: end(start, 0.4 + h), 1e-3)
    assert (np.abs(pushed - found.action[:4, 0]) <= 2e-6 * np.abs(pushed).max()).all()
    assert pushed[3] < 0.0 < pushed[2]
    for name in names:
        part, field = name.split(".")
        value = getattr(getattr(scene, part), field)
        expected = slope(lambda h, n=name, v=value: end(start, 0.4, **{n: v + h}), 1e-5 * value)
        error = np.abs(expected - found.parameters[name][:4])
        assert (error <= 1e-5 * np.abs(expected).max() + 1e-9).all(), name


INITIAL = ("carriage_displacement", "sphere_offset", "carriage_velocity", "sphere_velocity")


@pytest.mark.parametrize("interface", INTERFACES)
def test_base_feels_nothing_of_it(interface):
    scene = scene_of("cubic", interface, excitation="excited", solver={"tolerance": 1e-12})
    found = simulate(scene, action=1.3)
    carriage, (x1, _, v1, _) = scene.carriage, found.state.T
    spring = carriage.linear_coefficient * x1 + carriage.cubic_coefficient * x1**3
    expected = carriage.stiffness * spring + carriage.damping * v1
    np.testing.assert_allclose(found.base_force, expected, rtol=1e-12)
    inertia = found.acceleration @ [carriage.mass, scene.sphere.mass]
    outer = found.channel("disturbance_force") - found.base_force
    np.testing.assert_allclose(inertia, outer, atol=1e-12 * np.abs(outer).max())
    assert found.acceleration[0, 1] != simulate(scene).acceleration[0, 1]


def test_its_work_is_that_of_the_relative_motion():
    scene = scene_of("cubic", excitation="excited", solver={"tolerance": 1e-12})
    times = np.linspace(0.0, STEPS * 0.005, 4001)
    found = simulate(scene, times=times, action=1.3)
    power = 1.3 * (found.state[:, 2] - found.state[:, 3])
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(times))])
    # The trapezium rule errs by h^2 / 12 of the power's second derivative: 1e-6 of it here.
    assert np.abs(found.work.control - work).max() <= 1e-5 * np.abs(work).max()
    effort = response(found)
    assert effort.control_work[0] == pytest.approx(work[-1], rel=1e-4)
    assert effort.peak_power[0] == pytest.approx(np.abs(power).max(), rel=1e-4)
    absolute = np.sum(0.5 * (np.abs(power[1:]) + np.abs(power[:-1])) * np.diff(times))
    assert effort.control_energy[0] == pytest.approx(absolute, rel=1e-4)
    assert effort.peak_base_force[0] == pytest.approx(np.abs(found.base_force).max(), rel=1e-4)


def test_channels_and_lanes_show_both_accelerations():
    names = ["carriage_acceleration", "sphere_acceleration", "applied_force"]
    scene = scene_of("cubic", "friction", "finite", "excited", **{"sensors.channels": names})
    env = MovingMassEnv(scene)
    env.reset(seed=0)
    seen = np.array([env.step(np.array([0.25], np.float32))[0] for _ in range(STEPS)])
    found = simulate(env.plant, action=1.0)
    for k, channel in enumerate(env.plant.observed):
        expected = (found.channel(channel.name)[1:] - channel.zero) * channel.factor
        np.testing.assert_allclose(seen[:, k], expected, rtol=1e-5, atol=1e-5)
    lanes = MovingMassVectorEnv(scene, 2, autoreset_mode="Disabled")
    lanes.reset(seed=0)
    effort = LaneResponse(lanes)
    for _ in range(STEPS):
        lanes.step(np.full((2, 1), 0.25, np.float32))
        effort.add()
    assert effort.response().control_work[0] == pytest.approx(found.work.control[-1], rel=1e-9)


def test_predictions_of_controllers_have_the_disturbance_on_the_carriage_alone():
    model = pytest.importorskip("agents.control.model").Model
    scene = scene_of("cubic", "friction", solver={"tolerance": 1e-12})
    state = np.array([[0.004, 0.012, 0.1, 0.3], [0.001, -0.01, 0.2, -0.1]])
    made = model(scene)
    made.begin(state)
    made.advance(np.array([[1.0], [-2.0]]), np.array([0.5, -0.3]))
    found = made.advance(np.array([[0.7], [0.2]]), np.array([0.0, 0.9]))[0]
    for lane, (forces, pushes) in enumerate([((1.0, 0.7), (0.5, 0.0)), ((-2.0, 0.2), (-0.3, 0.9))]):
        now = state[lane]
        for force, push in zip(forces, pushes, strict=True):
            changes = dict(zip((f"initial.{n}" for n in INITIAL), now, strict=True))
            changes["initial.sphere_offset"] = now[1] - now[0]
            held = {"kind": "harmonic", "amplitude": push, "frequency": 0.0, "phase": 0.5 * np.pi}
            one = scene.replace(excitation=[held], **changes)
            now = motion(one, force=np.array([force]))[-1]
        np.testing.assert_allclose(found[lane], now, atol=1e-10 * np.abs(now).max())


def test_where_it_acts_is_checked():
    with pytest.raises(SceneError, match=r"actuation.force.between.*'mases'.*'masses'"):
        scene_of(**{"actuation.force.between": "mases"})
    grounded = scene_of(**{"actuation.force.between": "ground"})
    assert grounded == scene_of(actuation={"force": {"limit": 4.0}})
