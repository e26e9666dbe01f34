"""Impulses: each comes at its own time, and every plant moves on from there exactly."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import chisquare, kstest, poisson

from mm_gym import CompileError, MovingMassEnv, Scene, compile_scene, simulate
from mm_gym.precision.oracle import Oracle

from .conftest import assert_lanes_equal_single

STEP = 0.01
BASE = Scene(initial={"carriage_displacement": 0.01}, control={"time_step": STEP, "steps": 40})
FRICTION = {
    "kind": "dry_friction",
    "static_coefficient": 0.51,
    "kinetic_coefficient": 0.4,
    "reference_velocity": 0.01,
}
SPRINGS = {"springs": {"kind": "small_on_large"}, "actuation": {"stretch": {}}}
PLANTS = {
    "linear": {},
    "massless": {"carriage.mass": 0.0},
    "cubic in the generator": SPRINGS,
    "parametric": {"randomization": {"sphere.mass": [0.04, 0.0400000000001]}},
    "friction": {"interface": FRICTION},
    "stiff friction": {"interface": FRICTION | {"reference_velocity": 1e-3}},
    "parametric friction": {"interface": FRICTION, **SPRINGS},
    "Duffing": {"carriage.cubic_coefficient": 2e6, "solver.tolerance": 1e-13},
    "Duffing with friction": {
        "interface": FRICTION,
        "carriage.cubic_coefficient": 2e6,
        "solver.tolerance": 1e-13,
    },
    "finite stretch": {
        "springs": {"kind": "finite_stretch", "rest_length": 0.05},
        "solver.tolerance": 1e-13,
    },
    "rk4": {"solver": {"method": "rk4", "substeps": 200}},
}
HARMONIC = {"kind": "harmonic", "amplitude": 0.3, "frequency": 33.0, "phase": 0.4}
SWEEP = {
    "kind": "sweep",
    "target": "ground",
    "amplitude": 3.0,
    "start_frequency": 20.0,
    "end_frequency": 45.0,
    "duration": 0.3,
}
RANDOM = {"kind": "impulse", "size": [-0.03, 0.05], "rate": 150.0}


def impulse(time, size, target="force"):
    return {"kind": "impulse", "time": time, "size": size, "target": target}


def excited(plant, *, sweep=False):
    """Return a scene with impulses at starts, together, alone and at random, and other sources."""
    scene = BASE.replace(**PLANTS[plant])
    parts = [impulse(0.0, 0.1, "ground"), impulse(0.0337, -0.2, "ground")]
    parts += [impulse(0.0337, -0.1, "ground"), impulse(7 * STEP, 0.15, "ground"), HARMONIC]
    if scene.carriage.mass > 0.0:
        parts += [impulse(0.0371, 0.04), impulse(0.0799999, -0.03), RANDOM]
    else:
        parts += [RANDOM | {"target": "ground"}]
    return scene.replace(excitation=[*parts, SWEEP] if sweep else parts)


def ground(time):
    """Return the sweep's acceleration."""
    rate = (SWEEP["end_frequency"] - SWEEP["start_frequency"]) / SWEEP["duration"]
    phase = SWEEP["start_frequency"] * time + 0.5 * rate * time**2
    return SWEEP["amplitude"] * np.sin(phase)


def jumps_of(trajectory):
    """Return times (k,) and jumps (k, 2) of v1 and v2 of all impulses."""
    recording = trajectory.recording
    step = recording.plant.support.sample_interval
    first = recording.starts[:, 2:] - recording.states[:-1, 2:]
    starts = np.flatnonzero(first.any(axis=1))
    inside = recording.impulses
    times = np.concatenate([step * starts, step * inside[:, 0] + inside[:, 1]])
    order = np.argsort(times, kind="stable")
    return times[order], np.concatenate([first[starts], inside[:, 2:]])[order]


def by_scipy(scene, trajectory, instants, *, sweep):
    """Return the states: SciPy from impulse to impulse; at an impulse, the one before it."""

    def disturbance(t, target):
        if target == "ground":
            return ground(t) if sweep else 0.0
        return HARMONIC["amplitude"] * np.sin(HARMONIC["frequency"] * t + HARMONIC["phase"])

    # SciPy sees a crossing of the reference velocity only between two of its steps.
    oracle = Oracle(scene, max_step=0.001, disturbance=disturbance)
    times, jumps = jumps_of(trajectory)
    inner = times <= instants[-1]
    state, now, states = oracle.initial_state(), 0.0, {}
    stops = sorted({*times[inner], *instants})
    for stop in stops:
        state = oracle.solve([stop], start=state, begin=now)[0] if stop > now else state
        states[stop] = state.copy()
        now = stop
        state[2:] += jumps[times == stop].sum(axis=0)
    return np.array([states[instant] for instant in instants])


@pytest.mark.parametrize("sweep", [False, True], ids=["", "sweep"])
@pytest.mark.parametrize("plant", PLANTS)
def test_plants_move_as_scipy_from_impulse_to_impulse(plant, sweep):
    scene = excited(plant, sweep=sweep)
    # Ends of control steps, instants next to impulses, and the instant of one.
    instants = np.array([0.01, 0.0336, 0.0337, 0.03375, 0.04, 0.0634, 0.08])
    trajectory = simulate(scene, times=instants, seed=2)
    times, _ = jumps_of(trajectory)
    _, in_one = np.unique(np.floor(times / STEP), return_counts=True)
    assert in_one.max() >= 3
    expected = by_scipy(scene, trajectory, instants, sweep=sweep)
    scale = np.abs(expected).max(axis=0)
    # SciPy keeps 1e-13 a step; RK4 with 200 substeps in 10 ms some 1e-10.
    assert np.all(np.abs(trajectory.state - expected) < 1e-9 * scale)
    work = trajectory.work
    balance = trajectory.energy - trajectory.energy[0] - work.total
    # RK4's own error shows in the balance.
    assert np.abs(balance).max() < (1e-9 if plant == "rk4" else 1e-11) * work.throughput.max()


def test_linear_motion_is_that_of_the_matrix_exponential():
    times, sizes = [0.0137, 0.0171, 0.0195, 0.03], [0.05, -0.02, 0.03, -0.04]
    scene = BASE.replace(excitation=[impulse(*pair) for pair in zip(times, sizes, strict=True)])
    plant = compile_scene(scene)
    a, _ = plant.linear()
    state, now = np.array([0.01, 0.01, 0.0, 0.0]), 0.0
    for time, size in zip(times, sizes, strict=True):
        state = expm(a * (time - now)) @ state + [0.0, 0.0, size / 0.1, 0.0]
        now = time
    expected = expm(a * (0.05 - now)) @ state
    got = simulate(plant, duration=0.05).state[-1]
    assert np.abs(got - expected).max() < 1e-13 * np.abs(expected).max()


@pytest.mark.parametrize("damping", [1e-3, 1e3, 1e9])
def test_stiff_interfaces_respond_to_impulses(damping):
    # Next to a lock both masses move as one: only the sum of the impulses' momenta counts.
    scene = BASE.replace(
        interface={"kind": "viscous", "damping": damping}, excitation=[impulse(0.0137, 0.05)]
    )
    got = simulate(scene, times=[0.0137, 0.05, 0.3])
    before = got.state[0] + [0.0, 0.0, 0.5, 0.0]
    start = dict(
        zip(("carriage_velocity", "sphere_velocity"), map(float, before[2:]), strict=True),
        carriage_displacement=float(before[0]),
        sphere_offset=float(before[1] - before[0]),
    )
    expected = simulate(
        scene.replace(excitation=[], initial=start), times=[0.05 - 0.0137, 0.3 - 0.0137]
    ).state
    assert np.abs(got.state[1:] - expected).max() < 1e-12


@pytest.mark.parametrize(
    ("time", "row", "elapsed"),
    [(0.0, 0, 0.0), (0.0449, 4, 0.0049), (0.05, 5, 0.0), (7 * STEP, 7, 0.0), (0.07, 7, 0.0)],
)
def test_impulse_at_a_given_time_comes_then(time, row, elapsed):
    recording = simulate(BASE.replace(excitation=[impulse(time, 0.05)])).recording
    at_start = np.flatnonzero(recording.starts[:, 2] - recording.states[:-1, 2])
    if elapsed == 0.0:
        assert at_start.tolist() == [row]
        assert not recording.impulses.size
    else:
        assert not at_start.size
        np.testing.assert_allclose(recording.impulses, [[row, elapsed, 0.5, 0.0]], atol=1e-15)


@pytest.mark.parametrize("rate", [1.0, 10.0, 100.0, 1000.0])
def test_random_impulses_are_a_poisson_process(rate):
    scene = Scene(
        interface={"kind": "none"},
        excitation=[{"kind": "impulse", "size": [-0.02, 0.05], "rate": rate}],
        control={"time_step": 0.01},
    )
    recording = simulate(scene, duration=500.0, seed=5).recording
    rows, elapsed, jumps, others = recording.impulses.T
    counts = np.bincount(rows.astype(int), minlength=len(recording.starts))
    law, samples = poisson(rate * 0.01), len(counts)
    edges = [k for k in range(40) if samples * law.pmf(k) > 5.0 and samples * law.sf(k) > 5.0]
    bins = np.digitize(counts, np.array(edges) + 0.5)
    got = np.bincount(bins, minlength=len(edges) + 1)
    expected = samples * np.diff([0.0, *law.cdf(edges), 1.0])
    assert chisquare(got, expected).pvalue > 1e-3
    # Intervals are independent, so that their sum is Poisson too.
    assert abs(counts.sum() - 500.0 * rate) < 4.0 * np.sqrt(500.0 * rate)
    assert abs(np.corrcoef(counts[1:], counts[:-1])[0, 1]) < 4.0 / np.sqrt(samples)
    # Given their number, the instants are uniform; sizes are, and independent of the waits.
    assert kstest(elapsed / 0.01, "uniform").pvalue > 1e-3
    times = 0.01 * rows + elapsed
    assert kstest(np.diff(times) * rate, "expon").pvalue > 1e-3
    assert kstest(0.1 * jumps, "uniform", (-0.02, 0.07)).pvalue > 1e-3
    assert abs(np.corrcoef(np.diff(times), jumps[1:])[0, 1]) < 4.0 / np.sqrt(len(times))
    assert not others.any()


def test_recorded_impulses_are_those_that_the_velocities_show():
    # Without forces a velocity changes by impulses only.
    scene = Scene(
        carriage={"stiffness": 1e-12, "damping": 0.0},
        interface={"kind": "none"},
        excitation=[RANDOM, RANDOM | {"target": "ground", "rate": 30.0}],
        control={"time_step": 0.01, "steps": 200},
    )
    recording = simulate(scene, seed=3).recording
    change = np.diff(recording.states[:, 2:], axis=0)
    shown = np.zeros_like(change)
    np.add.at(shown, recording.impulses[:, 0].astype(int), recording.impulses[:, 2:])
    assert len(recording.impulses) > 300
    assert np.abs(change - shown).max() < 1e-9


@pytest.mark.parametrize("method", ["taylor", "rk4", "semi_implicit_euler"])
def test_every_method_has_the_same_impulses(method):
    scene = BASE.replace(excitation=[RANDOM, impulse(0.0333, 0.1, "ground")])
    one, other = (
        simulate(scene.replace(**{"solver.method": name}), seed=4).recording
        for name in ("exact", method)
    )
    assert one.impulses.tobytes() == other.impulses.tobytes()


@pytest.mark.parametrize("plant", PLANTS)
def test_lanes_with_impulses_equal_single_ones(plant):
    # In each step a fifth of the lanes has no impulse, others have several.
    scene = excited(plant)
    moving = {"excitation.0.time": [0.0, 0.1]}
    scene = scene.replace(randomization=scene.randomization | moving)
    assert_lanes_equal_single(compile_scene(scene), 12, 150)


@pytest.mark.parametrize("target", ["force", "ground"])
def test_lanes_with_impulses_at_the_start_equal_single_ones(target):
    # One of a random size, and at random times too; one of a given size.
    parts = [RANDOM | {"time": 0.0, "target": target}, impulse(0.0, 0.1, target)]
    assert_lanes_equal_single(compile_scene(BASE.replace(excitation=parts)), 3, 37)


def test_state_saved_between_impulses_continues_with_the_same_ones():
    scene = BASE.replace(
        excitation=[RANDOM, impulse(0.155, 0.1), impulse(0.21, 0.1, "ground")],
        actuation={"force": {}},
    )
    env, other = MovingMassEnv(scene), MovingMassEnv(scene)
    env.reset(seed=1)
    action = np.full(1, 0.3, np.float32)
    for _ in range(30):
        other.set_state(env.get_state())
        for each in (env, other):
            each.step(action)
        assert env.state.tobytes() == other.state.tobytes()


def test_impulses_without_end_in_sight_are_refused():
    scene = BASE.replace(excitation=[RANDOM | {"rate": 1e9}])
    with pytest.raises(CompileError, match=r"excitation\.0"):
        compile_scene(scene)


def test_keys_of_neighbouring_episodes_give_other_impulses():
    scene = BASE.replace(excitation=[RANDOM])
    times = [jumps_of(simulate(scene, seed=seed))[0] for seed in range(3)]
    assert not any(np.intersect1d(*pair).size for pair in pairwise(times))


def test_every_impulse_of_a_range_draws_its_own_size():
    # The one at a given time too.
    recording = simulate(BASE.replace(excitation=[RANDOM | {"time": 0.1001}]), seed=6).recording
    sizes = recording.impulses[:, 2]
    assert len(sizes) > 10
    assert len(np.unique(sizes)) == len(sizes)
