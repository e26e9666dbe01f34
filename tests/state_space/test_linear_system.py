"""Is a plant's linear system the environment's own motion, with lag, delay and filter?"""

import sys

import numpy as np
import pytest
from tasks import TASKS

from mm_gym import (
    CompileError,
    DesignError,
    MovingMassEnv,
    Scene,
    SceneError,
    compile_scene,
    load_scene,
    simulate,
)
from mm_gym.analysis import frequency_response
from mm_gym.excitation import noise
from mm_gym.lanes import layout
from mm_gym.step.channels import CHANNELS

LINEAR = [name for name in TASKS if "Duffing" not in name and "Friction" not in name]
"""Tasks that are linear while the stretch is held."""


def held(name):
    """Return a task whose stretch is held, with lag, delay, all channels and one sample a step."""
    scene = TASKS[name]
    springs = {"kind": "none"}
    channels = [channel for channel in CHANNELS if channel not in ("stretch", "damping", "voltage")]
    if scene.springs.kind != "none":
        springs = {"kind": "small_on_large", "stretch": 1.7}
    else:
        channels.remove("spring_force")
    # An impulse is no motion of the system; the noise's envelope would make it vary in time.
    excitation = [
        {**part.model_dump(), "rise": 0.0, "plateau": None, "decay": 1.0}
        if part.kind == "kanai_tajimi"
        else part.model_dump()
        for part in scene.excitation
        if part.kind != "impulse"
    ]
    for part in excitation:
        if "sample_time" in part:
            part["sample_time"] = scene.control.time_step
    return Scene.of(
        scene.model_dump(mode="json")
        | {
            "springs": springs,
            "actuation": {"force": {"limit": 4.0, "lag": 0.013}},
            "sensors": {"channels": channels, "delay": 2},
            "initial": {"carriage_displacement": 0.004, "sphere_velocity": -0.1},
            "excitation": excitation,
        }
    )


def states_of(env):
    """Return the states of the linear system but for the delay's, from the environment's lane."""
    support, row = env.plant.support, env._lanes.values[:, 0]
    found = [*row[:4], row[layout.FORCE]]
    for j in range(len(support.ground)):
        first = layout.HARMONICS + layout.HARMONIC_ROWS * j
        found += [row[first + layout.COSINE], row[first + layout.SINE]]
    for k, part in enumerate(env.scene.excitation):
        if part.kind in {"noise", "kanai_tajimi"}:
            first = support.names[f"excitation.{k}.rms"] + noise.STATE - noise.RMS
            order = 4 if getattr(part, "low_frequency", 0.0) else 2
            found += list(row[first : first + order])
    return np.array(found)


def episode(env, steps=60):
    """Return the system at the episode's values, its states, the forces and the observations."""
    env.reset(seed=4)
    lane = env.get_state()["values"][:, 0]
    system = env.plant.state_space(sampled=True, at=lane)
    rng, states, forces, seen = np.random.default_rng(1), [states_of(env)], [], []
    for _ in range(steps):
        action = rng.uniform(-1.0, 1.0, 1).astype(np.float32)
        seen.append(env.step(action)[0])
        forces.append([4.0 * float(action[0])])
        states.append(states_of(env))
    return system, np.array(states), np.array(forces), np.array(seen)


@pytest.mark.parametrize("name", LINEAR)
def test_sampled_system_is_the_motion_of_the_environment(name):
    system, states, forces, _ = episode(MovingMassEnv(held(name)))
    n = states.shape[1]
    a, b = system.A[:n, :n], system.B[:n]
    added = states[1:] - states[:-1] @ a.T - forces @ b.T
    spread = system.process_noise[:n, :n]
    random = [k for k in range(n) if ".filter" in system.states[k].name]
    if random:  # the noise of the filter's states says what the motion is given
        given = added[:, random] @ np.linalg.solve(spread[np.ix_(random, random)], spread[random])
        assert np.abs(given[:, :4]).max() > 1e-8
        added = added - given
    # One step of the plant and one product of matrices: a few roundings of the largest state.
    assert np.abs(added / np.abs(states).max(axis=0)).max() <= 1e-12
    assert not np.any(system.drift)


@pytest.mark.parametrize("name", LINEAR)
def test_outputs_are_the_late_observations(name):
    env = MovingMassEnv(held(name))
    system, states, forces, seen = episode(env)
    n, delay = states.shape[1], 2
    # The states of the delay, from those of the plant: what it showed one and two steps before.
    one = system.A[n : n + len(system.outputs), :n]
    shown = states @ one.T
    factor = np.array([channel.factor for channel in env.plant.observed])
    late = shown[: len(seen) + 1 - delay] * factor
    # Observations are in single precision.
    np.testing.assert_allclose(seen[delay - 1 :], late, rtol=2e-6, atol=2e-6)
    # And the whole system, run by itself, shows them too.
    if not np.any(system.process_noise):
        x = np.concatenate([states[0], shown[0], shown[0]])
        outputs = []
        for force in forces:
            x = system.A @ x + system.B @ force
            outputs.append(system.C @ x)
        np.testing.assert_allclose(seen, np.array(outputs) * factor, rtol=1e-5, atol=2e-6)


def test_several_samples_a_step_compose_the_map_of_one():
    scene = held("mm_gym/Hybrid-v0")
    many = compile_scene(scene.replace(**{"excitation.0.sample_time": 0.0025}))
    one = compile_scene(
        scene.replace(**{"excitation.0.sample_time": 0.0025, "control.time_step": 0.0025})
    )
    whole, part = (plant.state_space(["ground"], ["x1"], sampled=True) for plant in (many, one))
    power = np.linalg.matrix_power(part.A, 4)
    noise_of_four = sum(
        np.linalg.matrix_power(part.A, k) @ part.process_noise @ np.linalg.matrix_power(part.A, k).T
        for k in range(4)
    )
    np.testing.assert_allclose(whole.A, power, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(whole.process_noise, noise_of_four, rtol=1e-11, atol=1e-20)


def test_covariance_of_the_noise_is_that_of_the_environment():
    # 4,000 independent steps: a variance has a relative standard deviation of sqrt(2 / 4000).
    env = MovingMassEnv(held("mm_gym/PreStretchNoise-v0").replace(**{"control.steps": 5000}))
    system, states, forces, _ = episode(env, steps=4000)
    n = states.shape[1]
    added = states[1:] - states[:-1] @ system.A[:n, :n].T - forces @ system.B[:n].T
    sample, expected = added.T @ added / len(added), system.process_noise[:n, :n]
    size = np.sqrt(np.diag(expected))
    some = size > 0.0
    relative = (sample - expected)[np.ix_(some, some)] / np.outer(size[some], size[some])
    assert np.abs(relative).max() <= 5.0 * np.sqrt(2.0 / len(added))


def test_random_impulses_have_the_variance_and_mean_of_a_poisson_process():
    scene = TASKS["mm_gym/PreStretchShock-v0"].replace(
        excitation=[{"kind": "impulse", "size": [0.01, 0.04], "rate": 50.0}]
    )
    plant = compile_scene(scene)
    system = plant.state_space([], ["x1"], sampled=True)
    ends = []
    envs = [simulate(plant, duration=plant.time_step, seed=seed).state[-1] for seed in range(400)]
    ends = np.array(envs)
    deviation = np.sqrt(np.diag(system.process_noise))
    assert np.abs((ends.mean(axis=0) - system.drift) / deviation).max() <= 5.0 / np.sqrt(400.0)
    assert np.abs(ends.std(axis=0) / deviation - 1.0).max() <= 0.35


def test_lag_of_the_continuous_system_is_that_of_the_sampled_one():
    plant = compile_scene(held("mm_gym/CarriageForce-v0").replace(**{"sensors.delay": 0}))
    continuous, sampled = (plant.state_space(["force"], ["x1"], sampled=s) for s in (False, True))
    force = [signal.name for signal in continuous.states].index("force")
    assert continuous.A[force, force] == pytest.approx(-1.0 / 0.013, rel=1e-12)
    assert sampled.A[force, force] == pytest.approx(np.exp(-plant.time_step / 0.013), rel=1e-12)


def test_frequency_response_is_that_of_the_analysis():
    scene = held("mm_gym/Hybrid-v0")
    w = np.geomspace(1.0, 500.0, 40)
    expected = frequency_response(scene, w)
    plant = compile_scene(scene)
    found = plant.state_space(["disturbance", "ground"], ["x1", "x2"]).frequency_response(w)
    np.testing.assert_allclose(found[:, 0].T, expected.force, rtol=1e-10)
    np.testing.assert_allclose(found[:, 1].T, expected.ground, rtol=1e-10)


@pytest.mark.parametrize("sampled", [False, True])
@pytest.mark.parametrize("name", LINEAR)
def test_frequency_response_equals_that_of_python_control(monkeypatch, name, sampled):
    control = pytest.importorskip("control")
    # With Slycot it takes a faster routine of eight digits.
    monkeypatch.setattr(control.StateSpace, "slycot_laub", None)
    scene = held(name) if sampled else held(name).replace(**{"sensors.delay": 0})
    system = compile_scene(scene).state_space(["force", "disturbance", "ground"], sampled=sampled)
    theirs = system.to_control()
    assert theirs.dt == (scene.control.time_step if sampled else 0.0)
    w = np.geomspace(1.0, 200.0, 15)
    expected = theirs(np.exp(1j * w * theirs.dt) if sampled else 1j * w)
    found = system.frequency_response(w)
    scale = np.abs(expected).max(axis=2, keepdims=True)
    assert np.abs((found - expected) / np.where(scale > 0.0, scale, 1.0)).max() <= 1e-10


def test_dead_time_is_in_the_response_and_refused_by_control():
    pytest.importorskip("control")
    scene = held("mm_gym/CarriageForce-v0")
    late = compile_scene(scene).state_space(outputs=["carriage_velocity"])
    early = compile_scene(scene).state_space(outputs=["v1"])
    turn = late.frequency_response([30.0]) / early.frequency_response([30.0])
    assert late.dead_time.tolist() == [2 * scene.control.time_step]
    assert np.angle(turn).item() == pytest.approx(-60.0 * scene.control.time_step)
    with pytest.raises(DesignError, match=r"sensors\.delay"):
        late.to_control()


def test_without_python_control_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    system = compile_scene(TASKS["mm_gym/CarriageForce-v0"]).state_space()
    with pytest.raises(ImportError, match="extra `agents`"):
        system.to_control()


def test_free_sphere_is_not_controllable_and_the_reduction_is():
    control = pytest.importorskip("control")
    plant = compile_scene(TASKS["mm_gym/CarriageForce-v0"])
    full = plant.state_space(outputs=["x1", "v1"])
    part = full.controllable()
    assert len(part.A) == 3
    w = np.geomspace(1.0, 200.0, 20)
    np.testing.assert_allclose(part.frequency_response(w), full.frequency_response(w), rtol=1e-10)
    gain, _, poles = control.lqr(part.A, part.B, part.C.T @ part.C, [[1e-6]])
    assert np.all(poles.real < 0.0)
    assert np.all(np.linalg.eigvals(part.A - part.B @ gain).real < 0.0)
    # x1 and v1 do not show where the sphere is: the states keep their names.
    seen = full.observable()
    assert [signal.name for signal in seen.states] == ["x1", "v1", "v2"]
    np.testing.assert_allclose(seen.frequency_response(w), full.frequency_response(w), rtol=1e-10)


def test_controllable_part_keeps_what_noise_reaches_if_asked():
    plant = compile_scene(held("mm_gym/PreStretchNoise-v0").replace(**{"sensors.delay": 0}))
    full = plant.state_space(["force"], ["x1"], sampled=True)
    names = [signal.name for signal in full.states]
    assert names[5:] == [f"excitation.0.filter{k}" for k in range(1, 5)]
    assert [signal.name for signal in full.controllable().states] == names[:5]
    assert [signal.name for signal in full.controllable(noise=True).states] == names
    harmonic = compile_scene(held("mm_gym/PreStretch-v0")).state_space(["force"], ["x1"])
    assert [s.name for s in harmonic.states][-2:] == ["excitation.0.cosine", "excitation.0.sine"]
    assert len(harmonic.controllable(noise=True).states) == 5


NONLINEAR = {
    "cubic": {"carriage.cubic_coefficient": 2e4},
    "finite": {
        "springs": {
            "kind": "finite_stretch",
            "stiffness": 35.0,
            "stretch": 1.4,
            "rest_length": 0.05,
        }
    },
    "slip": {
        "interface": {
            "kind": "dry_friction",
            "static_coefficient": 0.5,
            "kinetic_coefficient": 0.3,
            "reference_velocity": 0.05,
            "slip_damping": 0.1,
        }
    },
    "small": {"springs": {"kind": "small_on_large", "stiffness": 35.0, "stretch": 1.4}},
}


@pytest.mark.parametrize("kind", NONLINEAR)
def test_nonlinear_plant_moves_as_its_system_near_the_point(kind):
    point = np.array([0.004, 0.011, 0.1, 0.3])
    names = ("carriage_displacement", "carriage_velocity", "sphere_velocity")
    initial = dict(zip(names, point[[0, 2, 3]], strict=True))
    scene = Scene(
        initial=initial | {"sphere_offset": point[1] - point[0]},
        actuation={"force": {"limit": 4.0}},
        control={"time_step": 1e-5, "steps": 1},
        solver={"tolerance": 1e-12} if kind in {"cubic", "finite"} else {},
    ).replace(**NONLINEAR[kind])
    plant = compile_scene(scene)
    system = plant.state_space(["force"], ["carriage_acceleration"], sampled=True, about=point)
    base = simulate(plant, action=0.0).state[-1] - point
    # The drift is that of the tangent: the curvature adds the third power of the step.
    np.testing.assert_allclose(system.drift[:4], base, rtol=1e-4, atol=1e-10)
    for k, name in enumerate(["carriage_displacement", "sphere_offset", *names[1:]]):
        step = 1e-6
        moved = scene.replace(**{f"initial.{name}": getattr(scene.initial, name) + step})
        slope = (simulate(moved, action=0.0).state[-1] - point - base) / step
        column = system.A[:4, k] + (system.A[:4, 1] if k == 0 else 0.0)
        np.testing.assert_allclose(column, slope, rtol=1e-3, atol=2e-5)


def test_stretch_drives_the_system_about_a_point():
    springs = {"kind": "small_on_large", "stiffness": 35.0, "stretch": 1.4}
    for kind in ({}, {"kind": "finite_stretch", "rest_length": 0.05}):
        scene = Scene(
            springs=springs | kind,
            initial={"sphere_offset": 0.01},
            actuation={"stretch": {"lag": 0.0}},
            control={"time_step": 1e-3, "steps": 1},
        )
        plant = compile_scene(scene)
        system = plant.state_space(
            sampled=True, outputs=["spring_force", "stretch"], about=[0, 0.01, 0, 0]
        )
        ends = [simulate(plant, action=1.4 + step).state[-1] for step in (-1e-4, 0.0, 1e-4)]
        np.testing.assert_allclose(system.B[:4, 0], (ends[2] - ends[0]) / 2e-4, rtol=1e-2)
        assert system.outputs[1].point == system.inputs[0].point == 1.4
        assert plant.state_space(outputs=["stretch"]).outputs[0].point == 1.4
        rest = plant.state_space()
        assert not np.any(rest.B)
        with pytest.raises(DesignError, match="stretch move nothing"):
            rest.controllable()


@pytest.mark.parametrize(
    "name", ["sensors.delay", "sensors.noise.carriage_velocity", "actuation.force.lag"]
)
def test_sensors_and_actuators_have_the_middle_of_their_ranges(name):
    plant = compile_scene(load_scene("mm_gym/CarriageForceRobust-v0"))
    with pytest.raises(SceneError, match=rf"at\.{name}: got 0\.0; allowed: .* the middle"):
        plant.state_space(at={name: 0.0})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"inputs": ["force1"]}, "inputs: got 'force1'; did you mean 'force'"),
        ({"inputs": ["force", "force"]}, "listed more than once"),
        ({"outputs": ["x3"]}, "outputs: got 'x3'"),
        (
            {"at": {"excitation.0.frequency": 1.0}},
            "frequency: got 1.0; allowed: 44",
        ),
        ({"at": {"carriage.mas": 1.0}}, "did you mean 'carriage.mass'"),
        ({"at": {"carriage.mass": "1"}}, "at.carriage.mass: got '1'"),
        ({"at": {"initial.sphere_offset": 0.1}}, "about = "),
        ({"at": np.zeros(3)}, r"at: got shape \(3,\)"),
        ({"about": [0.0, 0.0]}, r"about: got shape \(2,\)"),
        ({"about": [0.0, 0.0, np.nan, 0.0]}, "about: got NaN"),
    ],
)
def test_wrong_arguments_are_refused(arguments, message):
    plant = compile_scene(TASKS["mm_gym/PreStretch-v0"])
    with pytest.raises(SceneError, match=message):
        plant.state_space(**arguments)


def test_massless_carriage_and_wrong_frequencies_are_refused():
    with pytest.raises(CompileError, match=r"carriage\.mass"):
        compile_scene(Scene(carriage={"mass": 0.0})).state_space(["force"])
    system = compile_scene(Scene(interface={"kind": "none"})).state_space(["force"], ["x2"])
    with pytest.raises(DesignError, match="eigenvalue"):
        system.frequency_response([0.0])
    for wrong in ([np.nan], ["1"], None):
        with pytest.raises(DesignError, match=r"frequencies: got .*numbers"):
            system.frequency_response(wrong)
    with pytest.raises(DesignError, match="show nothing"):
        compile_scene(Scene()).state_space(["force"], ["disturbance_force"]).observable()


@pytest.mark.parametrize("stretch", [0.5, np.nan, np.inf, "2", [1.5, 2.0]])
def test_a_stretch_that_is_no_number_of_at_least_1_is_refused(stretch):
    plant = compile_scene(TASKS["mm_gym/PreStretch-v0"])
    for matrices in (plant.linear, plant.discrete):
        with pytest.raises(SceneError, match=r"stretch: got .*; allowed: "):
            matrices(stretch)
