"""Do response and effort equal what quadrature and closed forms give?"""

from __future__ import annotations

from dataclasses import fields
from functools import cache

import numpy as np
import pytest
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from scipy.integrate import simpson
from tasks import CARRIAGE_FORCE, CARRIAGE_FORCE_FRICTION, HYBRID, PRE_STRETCH, TASKS

from mm_gym import (
    DesignError,
    MovingMassVectorEnv,
    Scene,
    SceneError,
    SimulationError,
    compile_scene,
    metrics,
    simulate,
)
from mm_gym.analysis import frequency_response, spring_stiffness
from mm_gym.metrics.response import Cubic

FINE = 100  # instants a control step at which the motion is looked at for comparison

SCENES = {
    "force": CARRIAGE_FORCE,
    "cubic spring": TASKS["mm_gym/CarriageForceDuffing-v0"],
    "friction": CARRIAGE_FORCE_FRICTION,
    "stretch": PRE_STRETCH.replace(**{"control.steps": 60}),
    "noise": TASKS["mm_gym/PreStretchNoise-v0"].replace(**{"control.steps": 20}),
    "both, shaken": HYBRID.replace(
        **{"control.steps": 40, "sensors.noise": {}, "carriage.damping": 5.0}
    ),
}


@cache
def commands(name):
    """Forces and stretches that change in every step."""
    scene = SCENES[name].replace(**{"control.steps": 12})
    plant = compile_scene(scene)
    draw = np.random.default_rng(4)
    columns = {
        "force": draw.uniform(-1.0, 1.0, plant.steps),
        "stretch": draw.uniform(1.0, 3.0, plant.steps),
    }
    if scene.actuation.force is not None:
        columns["force"] *= scene.actuation.force.limit
    return scene, np.column_stack([columns[actuator] for actuator in plant.actuators])


@cache
def fine_motion(name):
    """The motion within control steps, and what is held in each: (steps, FINE + 1, …)."""
    scene, action = commands(name)
    steps, step = len(action), scene.control.time_step
    inner = np.linspace(0.0, 1.0, FINE + 1)[1:-1]
    times = step * (np.arange(steps)[:, None] + [[0.0, *inner]]).ravel()
    motion = simulate(scene, times=[*times, steps * step], action=action, seed=3)
    starts = np.arange(0, steps * FINE, FINE)[:, None] + np.arange(FINE + 1)
    return scene, motion, starts


@pytest.mark.parametrize("name", SCENES)
def test_peaks_and_root_mean_squares_are_those_of_the_motion_looked_at_closely(name):
    scene, motion, rows = fine_motion(name)
    found = metrics.response(motion)
    step = scene.control.time_step
    force = motion.applied[rows[:, 0], 0]
    quantities = {
        "displacement": motion.state[rows, 0],
        "stroke": (motion.state[:, 1] - motion.state[:, 0])[rows],
        # An instant shows the force that is held from then on; an interval's end has its own.
        "base_force": (motion.base_force + motion.applied[:, 0])[rows] - force[:, None],
    }
    for quantity, values in quantities.items():
        mean = simpson(values**2, dx=step / FINE).sum() / (len(rows) * step)
        # Eight pieces a step of at most 0.9 rad of the fastest mode: (0.11)^4 / 384 = 4e-7 of a
        # smooth vibration; at a kink of the friction the rate of the force on the base jumps.
        tolerance = 1e-4 if name == "friction" else 1e-5
        assert getattr(found, f"rms_{quantity}")[0] == pytest.approx(mean**0.5, rel=tolerance)
        peak = np.abs(values).max()
        assert getattr(found, f"peak_{quantity}")[0] == pytest.approx(peak, rel=tolerance)
    velocity = motion.state[rows, 2]
    assert found.peak_velocity[0] == pytest.approx(np.abs(velocity).max(), rel=1e-4)
    power = force[:, None] * velocity
    assert found.peak_power[0] == pytest.approx(np.abs(power).max(), rel=1e-4)
    # |u v1| has a corner where v1 changes its sign: trapezes of 1/100 of a step.
    energy = np.trapezoid(np.abs(power), dx=step / FINE).sum()
    assert found.control_energy[0] == pytest.approx(energy, rel=1e-4)
    assert found.control_work[0] == pytest.approx(motion.work.control[-1], rel=1e-9, abs=1e-15)
    assert found.rms_force[0] == pytest.approx(np.sqrt(np.mean(force**2)), rel=1e-12)
    assert found.peak_force[0] == np.abs(force).max()


@pytest.mark.parametrize("name", SCENES)
def test_acceleration_is_that_of_newtons_second_law(name):
    scene, motion, rows = fine_motion(name)
    found = metrics.response(motion)
    # Mean accelerations over 1/100 of a step, ground included, where nothing jumps.
    step = scene.control.time_step / FINE
    change = np.diff(motion.state[rows, 2], axis=1) / step
    ground = 0.5 * (motion.excitation[rows[:, :-1], 1] + motion.excitation[rows[:, 1:], 1])
    absolute = change + ground
    # A line over a piece: (0.11)^2 / 8 = 1.5e-3 of the vibration; the friction's kinks are steps.
    tolerance = 0.02 if name == "friction" else 4e-3
    assert found.peak_acceleration[0] == pytest.approx(np.abs(absolute).max(), rel=tolerance)
    mean = np.mean(absolute**2)
    assert found.rms_acceleration[0] == pytest.approx(np.sqrt(mean), rel=tolerance)


def test_energy_of_stiffening_is_that_of_the_springs_at_each_change():
    scene, motion, rows = fine_motion("stretch")
    found = metrics.response(motion)
    stretches = np.array([motion.parameters[5], *motion.applied[rows[:, 0], 1]])
    offset = (motion.state[:, 1] - motion.state[:, 0])[rows[:, 0]]
    k0 = scene.springs.stiffness
    jumps = 0.5 * np.diff(spring_stiffness(stretches, k0)) * offset**2
    assert found.injected[0] == pytest.approx(jumps[jumps > 0.0].sum(), rel=1e-12)
    assert found.withdrawn[0] == pytest.approx(-jumps[jumps < 0.0].sum(), rel=1e-12)
    assert found.injected[0] > 0.0
    assert found.withdrawn[0] > 0.0


def shaken(w: float, amplitude: float = 0.7) -> Scene:
    """A damped sphere on springs under a harmonic force, which begins in its steady motion."""
    scene = PRE_STRETCH.replace(
        actuation={},
        randomization={},
        initial={},
        excitation=[{"kind": "harmonic", "amplitude": amplitude, "frequency": w}],
        **{"springs.stretch": 1.5, "control.time_step": 2.0 * np.pi / w / 20.0},
    )
    x1, x2 = (frequency_response(scene, [w]).force[0] * amplitude).tolist()
    start = {
        "carriage_displacement": x1.imag,  # the force is the imaginary part of exp(i w t)
        "sphere_offset": (x2 - x1).imag,
        "carriage_velocity": (1j * w * x1).imag,
        "sphere_velocity": (1j * w * x2).imag,
    }
    return scene.replace(initial=start)


def test_steady_motion_has_the_amplitudes_of_the_frequency_response():
    w, amplitude = 55.0, 0.7
    scene = shaken(w, amplitude)
    periods = 3
    found = metrics.response(simulate(scene, duration=periods * 2.0 * np.pi / w, seed=0), pieces=16)
    x1, x2 = np.abs(frequency_response(scene, [w]).force[0] * amplitude)
    complex1, complex2 = frequency_response(scene, [w]).force[0] * amplitude
    stroke = abs(complex2 - complex1)
    base = abs(complex1 * (scene.carriage.stiffness + 1j * w * scene.carriage.damping))
    expected = {
        "displacement": x1,
        "acceleration": w * w * x1,
        "stroke": stroke,
        "base_force": base,
    }
    assert x2 > 0.0
    for name, value in expected.items():
        # 320 pieces a period: lines miss (2 pi / 320)^2 / 8 = 5e-5 of the acceleration.
        tolerance = 1e-4 if name == "acceleration" else 1e-8
        assert getattr(found, f"peak_{name}")[0] == pytest.approx(value, rel=tolerance)
        assert getattr(found, f"rms_{name}")[0] == pytest.approx(value / 2**0.5, rel=tolerance)
    assert found.peak_velocity[0] == pytest.approx(w * x1, rel=1e-6)
    assert found.duration[0] == pytest.approx(periods * 2.0 * np.pi / w, rel=1e-12)


def test_reaction_of_the_actuator_is_part_of_the_base_shear():
    """A force that holds the carriage against its spring leaves the base without a force."""
    scene = Scene(
        interface={"kind": "none"},
        actuation={"force": {"limit": 8.0}},
        initial={"carriage_displacement": 0.01},
        control={"time_step": 0.01, "steps": 20},
    )
    held, released = (simulate(scene, action=force) for force in (4.0, 0.0))
    assert metrics.response(held).peak_base_force[0] <= 1e-12
    assert np.abs(held.base_force).max() <= 1e-12
    assert metrics.response(released).peak_base_force[0] == pytest.approx(4.0, rel=1e-6)
    env = MovingMassVectorEnv(scene, 2, autoreset_mode="Disabled")
    env.reset(seed=0)
    lanes = metrics.LaneResponse(env)
    for _ in range(20):
        env.step(np.array([[0.5], [0.0]]))
        lanes.add()
    found = lanes.response()
    assert found.peak_base_force[0] <= 1e-12
    assert found.peak_base_force[1] == pytest.approx(4.0, rel=1e-2)
    assert found.rms_base_force[0] <= 1e-12 < found.rms_base_force[1]


def test_a_held_force_on_a_spring_gives_and_takes_in_closed_form():
    scene = Scene(
        carriage={"mass": 0.1, "stiffness": 400.0, "damping": 0.0},
        interface={"kind": "none"},
        actuation={"force": {"limit": 4.0}},
        control={"time_step": 0.01, "steps": 100},
    )
    force, k, w = 1.5, 400.0, (400.0 / 0.1) ** 0.5
    periods = 2
    found = metrics.response(simulate(scene, duration=periods * 2.0 * np.pi / w, action=force))
    # x1 = u / k (1 - cos w t) goes 2 u / k there and back in each period.
    assert found.control_energy[0] == pytest.approx(force * periods * 4.0 * force / k, rel=1e-6)
    assert found.control_work[0] == pytest.approx(0.0, abs=1e-12)
    assert found.peak_power[0] == pytest.approx(force * force / k * w, rel=1e-6)
    assert found.peak_displacement[0] == pytest.approx(2.0 * force / k, rel=1e-6)


@pytest.mark.parametrize("name", ["force", "cubic spring", "friction", "stretch"])
def test_lanes_have_the_response_of_the_simulation(name):
    scene, action = commands(name)
    seeds = [3, 8]
    env = MovingMassVectorEnv(scene, 2, autoreset_mode="Disabled")
    env.reset(seed=seeds)
    record = metrics.LaneResponse(env)
    for command in action:
        env.step(np.tile(action_of(scene, command), (2, 1)))
        record.add()
    found = record.response()
    for lane, seed in enumerate(seeds):
        expected = metrics.response(simulate(scene, action=action, seed=seed), pieces=1)
        for field in fields(metrics.Response):
            one, other = getattr(found, field.name)[lane], getattr(expected, field.name)[0]
            # The environment takes actions in [-1, 1], which rounds the commands.
            assert one == pytest.approx(other, rel=1e-9, abs=1e-15)


KICK = {"kind": "impulse", "size": 0.1, "time": 0.0}
KICKED = CARRIAGE_FORCE.replace(initial={}, randomization={}, excitation=[KICK])


@pytest.mark.parametrize(
    ("scene", "most"), [(TASKS["mm_gym/PreStretchShock-v0"], 0.08), (KICKED, 0.323)]
)
def test_lanes_miss_the_peak_velocity_at_an_impulse_by_what_is_stated(scene, most):
    seeds = range(6)
    lanes = metrics.uncontrolled_response(scene, seeds)
    each = [metrics.response(simulate(scene, seed=seed)) for seed in seeds]
    for name in ("displacement", "base_force", "stroke"):
        expected = [getattr(one, f"peak_{name}")[0] for one in each]
        assert getattr(lanes, f"peak_{name}") == pytest.approx(expected, rel=1e-3)
    missed = 1.0 - lanes.peak_velocity / [one.peak_velocity[0] for one in each]
    assert 0.97 * most < missed.max() < most


def test_lanes_miss_of_integrals_after_impulses_what_is_stated():
    kicks = [KICK | {"size": 0.04}, KICK | {"size": -0.03, "time": 0.015}]
    scene = KICKED.replace(excitation=kicks)
    motion = simulate(scene, action=lambda _, x: -5.0 * x[2])
    env = MovingMassVectorEnv(scene, 1, autoreset_mode="Disabled")
    env.reset()
    lanes = metrics.LaneResponse(env)
    for force in motion.applied[:-1, 0]:
        env.step(np.array([[force / scene.actuation.force.limit]]))
        lanes.add()
    found, expected = lanes.response(), metrics.response(motion)
    # An integration by SciPy's DOP853 gives the same.
    stated = {"control_energy": 0.123, "rms_displacement": 0.039, "rms_base_force": 0.030}
    for name, most in stated.items():
        missed = 1.0 - getattr(found, name) / getattr(expected, name)
        assert missed == pytest.approx(most, abs=5e-4)


@pytest.mark.parametrize("parts", [(0.4,), (0.0, 0.4, 0.7)])
def test_peak_velocity_is_that_just_after_impulses_within_a_step(parts):
    step = KICKED.control.time_step
    times = [(3.0 + part) * step for part in parts]
    kicks = [KICK | {"time": time, "size": 0.1 / len(times)} for time in times]
    scene = KICKED.replace(excitation=kicks, carriage={"mass": 0.1, "stiffness": 1e-6})
    found = metrics.response(simulate(scene, duration=4.0 * step, seed=0))
    # Nothing but friction acts on the carriage, which is fastest just after the last impulse.
    near = simulate(scene, times=[times[-1] * (1.0 + 1e-9), 4.0 * step], seed=0).state[0]
    assert found.peak_velocity[0] == pytest.approx(near[2], rel=1e-7)
    end = simulate(scene, duration=4.0 * step, seed=0).state[-1]
    assert found.peak_displacement[0] == pytest.approx(end[0], rel=1e-9)


def action_of(scene, command):
    """The action in [-1, 1] that commands a force [N] and a stretch [-]."""
    force, stretch = scene.actuation.force, scene.actuation.stretch
    values = list(command)
    action = [] if force is None else [values.pop(0) / force.limit]
    if stretch is not None:
        low, high = stretch.minimum, stretch.maximum
        action.append((2.0 * values.pop(0) - low - high) / (high - low))
    return action


def test_indices_of_a_reference_over_itself_are_one():
    still = metrics.uncontrolled_response(SCENES["stretch"], [1, 2, 3])
    found = metrics.indices(still, still, sensors=4, controller_states=2)
    for name in ("j1", "j2", "j3", "j4", "j5", "j6", "stroke", "rms_stroke"):
        np.testing.assert_array_equal(getattr(found, name), 1.0)
    for name in ("j11", "j13", "j14", "rms_force", "injected"):
        np.testing.assert_array_equal(getattr(found, name), 0.0)
    assert (found.j16, found.j17) == (4, 2)


def test_indices_are_those_of_their_definitions():
    scene = CARRIAGE_FORCE.replace(**{"control.steps": 30})
    action = np.linspace(-1.0, 1.0, 30)[:, None]
    pushed = metrics.response(simulate(scene, action=action, seed=2))
    still = metrics.response(simulate(scene, seed=2))
    found = metrics.indices(pushed, still)
    weight = (scene.carriage.mass + scene.sphere.mass) * 9.81
    furthest = still.peak_displacement[0]
    expected = {
        "j1": pushed.peak_displacement[0] / furthest,
        "j2": pushed.peak_acceleration[0] / still.peak_acceleration[0],
        "j3": pushed.peak_base_force[0] / still.peak_base_force[0],
        "j4": pushed.rms_displacement[0] / still.rms_displacement[0],
        "j5": pushed.rms_acceleration[0] / still.rms_acceleration[0],
        "j6": pushed.rms_base_force[0] / still.rms_base_force[0],
        "j11": 1.0 / weight,
        "j12": pushed.peak_stroke[0] / furthest,
        "j13": pushed.peak_power[0] / (still.peak_velocity[0] * weight),
        "j14": pushed.control_energy[0] / (furthest * weight),
        "rms_force": np.sqrt(np.mean(action**2)) / weight,
        "stroke": pushed.peak_stroke[0] / still.peak_stroke[0],
        "rms_stroke": pushed.rms_stroke[0] / still.rms_stroke[0],
    }
    for name, value in expected.items():
        assert getattr(found, name)[0] == pytest.approx(value, rel=1e-12), name


def test_one_motion_may_be_the_reference_of_many():
    many = metrics.uncontrolled_response(SCENES["stretch"], [1, 2, 3])
    one = metrics.uncontrolled_response(SCENES["stretch"], [2])
    found = metrics.indices(many, one)
    assert found.j1[1] == 1.0
    assert found.j1[0] != 1.0


def test_the_passive_reference_has_the_same_episodes():
    scene = PRE_STRETCH.replace(**{"control.steps": 20})
    passive, stretch = metrics.passive_scene(scene)
    assert passive.interface.damping != scene.interface.damping
    first, second = (MovingMassVectorEnv(one, 3) for one in (scene, passive))
    for env in (first, second):
        env.reset(seed=[4, 5, 6])
    name = "excitation.0.frequency"
    np.testing.assert_array_equal(first.drawn(name), second.drawn(name))
    found = metrics.passive_response(scene, [4, 5, 6])
    low, high = scene.actuation.stretch.minimum, scene.actuation.stretch.maximum
    second.reset(seed=[4, 5, 6], options={"initial.stretch": stretch})
    record = metrics.LaneResponse(second)
    for _ in range(20):
        second.step(np.full((3, 1), (2.0 * stretch - low - high) / (high - low)))
        record.add()
    np.testing.assert_array_equal(record.response().peak_displacement, found.peak_displacement)
    assert np.all(found.injected == 0.0)


def test_a_stretch_that_is_not_drawn_is_set_in_the_passive_scene():
    scene = PRE_STRETCH.replace(**{"initial.stretch": 2.0, "control.steps": 5})
    passive, stretch = metrics.passive_scene(scene)
    assert passive.initial.stretch == stretch != 2.0
    assert np.all(metrics.passive_response(scene, [1]).injected == 0.0)


def test_lanes_that_do_not_count_keep_what_they_have():
    env = MovingMassVectorEnv(CARRIAGE_FORCE, 2, autoreset_mode="Disabled")
    env.reset(seed=1)
    record = metrics.LaneResponse(env)
    for step in range(6):
        env.step(np.full((2, 1), 0.5))
        record.add(np.array([True, step < 3]))
    found = record.response()
    assert found.duration[1] == pytest.approx(0.5 * found.duration[0], rel=1e-12)
    short = simulate(CARRIAGE_FORCE, seed=2, action=2.0, duration=3 * 0.01)
    expected = metrics.response(short, pieces=1)
    assert found.rms_displacement[1] == pytest.approx(expected.rms_displacement[0], rel=1e-12)
    assert found.peak_acceleration[1] == pytest.approx(expected.peak_acceleration[0], rel=1e-12)


def test_a_cubic_is_measured_exactly():
    draw = np.random.default_rng(7)
    s = np.linspace(0.0, 1.0, 20_001)
    for coefficients in [*draw.normal(size=(50, 4)), (0, 0, 0, 0), (1, 2, 0, 0), (0, 1, -1, 0)]:
        cubic = Cubic(*np.array(coefficients, float)[:, None])
        values = cubic.at(s)
        # The grid misses a peak by at most (2.5e-5)^2 / 2 of the curvature, which is below 30.
        assert cubic.peak()[0] == pytest.approx(np.abs(values).max(), abs=1e-8)
        assert cubic.variation()[0] == pytest.approx(np.abs(np.diff(values)).sum(), abs=1e-7)
        mean = simpson(values**2, x=s)
        assert cubic.mean_square()[0] == pytest.approx(mean, rel=1e-9, abs=1e-12)


def test_what_cannot_be_measured_is_refused():
    motion = simulate(CARRIAGE_FORCE, duration=0.05)
    with pytest.raises(SimulationError, match=r"pieces: got 1\.5; allowed: an integer from"):
        metrics.response(motion, pieces=1.5)
    for pieces in (0, 1001, True):
        allowed = "an integer from 1 to 1000"
        with pytest.raises(SimulationError, match=f"pieces: got {pieces}; allowed: {allowed}"):
            metrics.response(motion, pieces=pieces)
    with pytest.raises(SimulationError, match="trajectory: got 'x'; allowed: a Trajectory"):
        metrics.response("x")
    with pytest.raises(SimulationError, match="got one instant, t = 0 s"):
        metrics.response(simulate(CARRIAGE_FORCE, times=[0.0]))
    massless = CARRIAGE_FORCE.replace(**{"carriage.mass": 0.0})
    with pytest.raises(SimulationError, match="0 has no finite acceleration"):
        metrics.response(simulate(massless, duration=0.05))
    env = MovingMassVectorEnv(CARRIAGE_FORCE, 2)
    env.reset(seed=0)
    record = metrics.LaneResponse(env)
    with pytest.raises(SimulationError, match=r"no control step was added yet: call add\(\)"):
        record.response()
    wrapped = RecordEpisodeStatistics(env)
    with pytest.raises(SimulationError, match="env: got RecordEpisodeStatistics; allowed: a Mov"):
        metrics.LaneResponse(wrapped)
    with pytest.raises(SceneError, match="seeds: got 5; allowed: a sequence of integers"):
        metrics.uncontrolled_response(CARRIAGE_FORCE, 5)
    with pytest.raises(SceneError, match="options: got 3; allowed: a dictionary"):
        metrics.passive_response(CARRIAGE_FORCE, [1], 3)
    with pytest.raises(SceneError, match=r"options: initial\.stretch: got 2\.0; allowed: none, as"):
        metrics.passive_response(PRE_STRETCH, [1], {"initial.stretch": 2.0})
    env.step(np.zeros((2, 1)))
    with pytest.raises(SimulationError, match=r"got bool of shape \(3,\); allowed: booleans of"):
        record.add(np.ones(3, np.bool_))
    three, two = (metrics.uncontrolled_response(CARRIAGE_FORCE, range(n)) for n in (3, 2))
    with pytest.raises(SimulationError, match="reference: got 2 motions; allowed: 3"):
        metrics.indices(three, two)
    for name, pair in {"response": ("x", two), "reference": (two, None)}.items():
        with pytest.raises(SimulationError, match=rf"{name}: got .*; allowed: a Response"):
            metrics.indices(*pair)
    for name in ("sensors", "controller_states"):
        for wrong in (-1, 1.5, True, "2"):
            with pytest.raises(SimulationError, match=f"{name}: got .*; allowed: an integer of at"):
                metrics.indices(two, two, **{name: wrong})
    rest = CARRIAGE_FORCE.replace(initial={})
    with pytest.raises(SimulationError, match="a carriage that does not move"):
        metrics.indices(three, metrics.uncontrolled_response(rest, [1]))
    with pytest.raises(DesignError, match="dry_friction"):
        metrics.passive_scene(CARRIAGE_FORCE_FRICTION)


def test_lanes_that_begin_anew_in_the_same_step_are_refused():
    env = MovingMassVectorEnv(CARRIAGE_FORCE, 2, autoreset_mode="SameStep")
    env.reset(seed=0)
    with pytest.raises(SimulationError, match="autoreset_mode: got SameStep"):
        metrics.LaneResponse(env)
