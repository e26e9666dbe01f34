"""Excitation: what each kind is, and how every plant responds to it."""

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import quad
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.stats import chi2

from mm_gym import CompileError, Scene, SceneError, compile_scene, simulate
from mm_gym.kernels import noise
from mm_gym.plant.excitation import KINDS
from mm_gym.precision.oracle import Oracle
from mm_gym.scene.excitation import FIXED_FIELDS, Excitation
from mm_gym.scene.part import parts_of
from mm_gym.scene.schema import _numbers

BASE = Scene(initial={"carriage_displacement": 0.01}, control={"time_step": 0.01, "steps": 60})
FRICTION = {
    "kind": "dry_friction",
    "static_coefficient": 0.51,
    "kinetic_coefficient": 0.4,
    "reference_velocity": 0.01,
}
PLANTS = {
    "linear": {},
    "massless": {"carriage.mass": 0.0},
    "parametric": {"randomization": {"sphere.mass": [0.04, 0.040000001]}},
    "friction": {"interface": FRICTION},
    "parametric friction": {
        "interface": FRICTION,
        "springs": {"kind": "small_on_large"},
        "actuation": {"stretch": {}},
    },
    "cubic": {"carriage.cubic_coefficient": 2e6, "solver.tolerance": 1e-12},
    "finite stretch": {
        "springs": {"kind": "finite_stretch", "rest_length": 0.05},
        "solver.tolerance": 1e-12,
    },
    "rk4": {"solver": {"method": "rk4", "substeps": 400}},
}
SWEEP = {
    "kind": "sweep",
    "amplitude": 1.0,
    "start_frequency": 20.0,
    "end_frequency": 70.0,
    "duration": 0.4,
    "phase": 0.3,
}
LOGARITHMIC = SWEEP | {"spacing": "logarithmic", "target": "ground", "amplitude": 5.0}
NOISE = {"kind": "noise", "rms": 1.0, "low_frequency": 40.0, "high_frequency": 80.0}
SOIL = {"kind": "kanai_tajimi", "rms": 2.0, "ground_frequency": 60.0, "ground_damping": 0.5}
HIGH_PASSED = SOIL | {"kind": "clough_penzien", "filter_frequency": 10.0, "filter_damping": 0.7}
HARMONIC = {"kind": "harmonic", "amplitude": 0.3, "frequency": 33.0}

MOTION = np.random.default_rng(3).normal(0.0, 3.0, 80)
MOTION_STEP = 0.004


CLASSES = {part.model_fields["kind"].default: part for part in parts_of(Excitation)}


@pytest.fixture
def record(tmp_path):
    path = tmp_path / "motion.csv"
    np.savetxt(path, np.column_stack([MOTION_STEP * np.arange(80), MOTION]), delimiter=",")
    return {"kind": "record", "file": str(path)}


def test_every_kind_of_a_scene_has_a_row_of_the_table():
    assert list(KINDS) == list(CLASSES)


@pytest.mark.parametrize("kind", KINDS)
def test_every_number_of_a_kind_has_a_row_of_its_own(kind):
    fields = KINDS[kind].fields
    # What is drawn as a ratio has a row behind all others.
    without = {*FIXED_FIELDS, *CLASSES[kind].ratios}
    assert set(fields) == set(_numbers(CLASSES[kind])) - without
    rows = {*fields.values(), *KINDS[kind].constants}
    assert len(rows) == len(fields) + len(KINDS[kind].constants)
    assert rows <= set(range(KINDS[kind].rows))


def phase(time, part):
    """Return the integral of a sweep's frequency, kept after its duration."""
    w0, w1, duration = part["start_frequency"], part["end_frequency"], part["duration"]
    t, rest = np.minimum(time, duration), np.maximum(time - duration, 0.0)
    if part.get("spacing") == "logarithmic":
        growth = np.log(w1 / w0) / duration
        swept = w0 * np.expm1(growth * t) / growth
    else:
        swept = w0 * t + 0.5 * (w1 - w0) / duration * t**2
    return swept + w1 * rest + part["phase"]


@pytest.mark.parametrize(("part", "column"), [(SWEEP, 0), (LOGARITHMIC, 1)])
def test_sweep_follows_its_formula(part, column):
    times = np.linspace(0.0, 0.6, 53)
    shown = simulate(BASE.replace(excitation=[part]), times=times).excitation
    expected = part["amplitude"] * np.sin(phase(times, part))
    # The phase is a double of some 40 rad, and the series is cut off below round-off.
    assert np.abs(shown[:, column] - expected).max() < 1e-13 * part["amplitude"] * 40.0
    assert not shown[:, 1 - column].any()


@pytest.mark.parametrize("scales", [{}, {"scale": -0.5, "time_scale": 0.5, "start": 0.1}])
def test_record_is_its_interpolant(record, scales):
    scene = BASE.replace(excitation=[record | scales], **{"control.time_step": 0.008})
    times = np.linspace(0.0, 0.47, 211)
    shown = simulate(scene, times=times).excitation[:, 1]
    own = times / scales.get("time_scale", 1.0) + scales.get("start", 0.0)
    knots = MOTION_STEP * np.arange(80)
    expected = np.interp(own, knots, MOTION, right=0.0) * scales.get("scale", 1.0)
    # An instant within 1e-12 of the start of a sample interval counts as that start, and the record
    # is steep.
    assert np.abs(shown - expected).max() < 1e-12 * 60 * np.abs(MOTION).max()


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("kind", ["record", "sweep", "noise"])
def test_plants_respond_as_the_oracle(plant, kind, record):
    part = {"record": record, "sweep": LOGARITHMIC, "noise": NOISE | {"target": "ground"}}[kind]
    scene = BASE.replace(**PLANTS[plant]).replace(excitation=[part])
    times = np.array([0.05, 0.123, 0.3])
    trajectory = simulate(scene, times=times, seed=4)
    step = trajectory.recording.plant.support.sample_interval
    if kind == "sweep":
        ground = lambda t: LOGARITHMIC["amplitude"] * np.sin(phase(t, LOGARITHMIC))  # noqa: E731
    elif kind == "record":
        step = 0.001
        ground = lambda t: np.interp(t, MOTION_STEP * np.arange(80), MOTION)  # noqa: E731
    else:
        knots = step * np.arange(int(0.3 / step) + 2)
        values = simulate(scene, times=knots, seed=4).excitation[:, 1]
        ground = lambda t: np.interp(t, knots, values)  # noqa: E731
    oracle = Oracle(
        scene,
        max_step=step / 4.0,
        disturbance=lambda t, target: ground(t) if target == "ground" else 0.0,
    )
    expected = oracle.solve(times)
    scale = np.abs(expected).max(axis=0)
    # DOP853 crosses the knots of an interpolant, where it is of first order.
    assert np.all(np.abs(trajectory.state - expected) < 1e-8 * scale)


def test_response_to_a_record_from_knot_to_knot(record):
    control = {"control.time_step": MOTION_STEP, "control.steps": 80}
    scene = BASE.replace(excitation=[record], **control)
    trajectory = simulate(scene, duration=0.2)
    values = np.append(MOTION, 0.0)
    state = trajectory.state[0]
    for n, expected in enumerate(trajectory.state[1:]):
        slope = (values[n + 1] - values[n]) / MOTION_STEP
        line = lambda t, target, n=n, slope=slope: (  # noqa: E731
            values[n] + slope * t if target == "ground" else 0.0
        )
        state = Oracle(scene, disturbance=line).solve([MOTION_STEP], start=state)[0]
        assert np.all(np.abs(state - expected) < 1e-9 * np.abs(trajectory.state).max(axis=0))


def stationary(part, seconds=4000.0, time_step=0.004):
    """Return samples of a noise, and their spacing [s]."""
    column = 0 if part["kind"] == "noise" else 1
    scene = Scene(
        interface={"kind": "none"},
        excitation=[part | {"sample_time": time_step}],
        control={"time_step": time_step},
    )
    return simulate(scene, duration=seconds, seed=1).excitation[:, column], time_step


def density(part, w):
    """Return the filter's squared gain, up to a factor."""
    if part["kind"] == "noise":
        high = 1.0 / (1.0 + (w / part["high_frequency"]) ** 4)
        return high * w**4 / (w**4 + part["low_frequency"] ** 4)
    wg, zg = part["ground_frequency"], part["ground_damping"]
    soil = (1.0 + (2 * zg * w / wg) ** 2) / ((1 - (w / wg) ** 2) ** 2 + (2 * zg * w / wg) ** 2)
    if part["kind"] == "kanai_tajimi":
        return soil
    r, zf = w / part["filter_frequency"], part["filter_damping"]
    return soil * r**4 / ((1 - r**2) ** 2 + (2 * zf * r) ** 2)


@pytest.mark.parametrize("part", [NOISE, SOIL, HIGH_PASSED], ids=lambda part: part["kind"])
def test_noise_has_its_density_and_variance(part):
    values, step = stationary(part)
    total = quad(lambda w: density(part, w), 0.0, np.inf, limit=500)[0]
    segments = len(values) // 4096
    frequency, estimate = signal.welch(values, 1.0 / step, nperseg=4096, noverlap=0)
    w = 2.0 * np.pi * frequency
    samples = _scale_of_samples(part, step) * part["rms"] ** 2
    # What lies beyond half the sampling rate is folded back, as for any sampled process.
    folds = 2.0 * np.pi / step * np.arange(1, 200)
    folded = density(part, w) + sum(density(part, f - w) + density(part, f + w) for f in folds)
    expected = 2.0 * np.pi * samples * folded / total
    band = slice(3, int(200.0 * 4096 * step / (2.0 * np.pi)))
    low, high = chi2.ppf([0.0005, 0.9995], 2 * segments) / (2 * segments)
    ratio = estimate[band] / expected[band]
    assert np.mean((ratio > low) & (ratio < high)) > 0.99
    assert abs(np.mean(ratio) - 1.0) < 0.01
    # The record holds thousands of independent stretches, so the estimate is good to 1 %.
    assert abs(np.var(values) / samples - 1.0) < 0.01


def _scale_of_samples(part, step):
    """Return the variance of the samples of a noise whose interpolant has variance 1 on average."""
    f, g, out = _scaled_filter(part)
    covariance = solve_continuous_lyapunov(f, -g @ g.T)
    present, following = out @ covariance @ out, out @ expm(f * step) @ covariance @ out
    return 3.0 * present / (2.0 * present + following)


@pytest.mark.parametrize("sample_time", [0.001, 0.012])
@pytest.mark.parametrize("part", [NOISE, SOIL, HIGH_PASSED], ids=lambda part: part["kind"])
def test_noise_has_its_rms_on_average_between_the_samples_too(part, sample_time):
    part = part | {"target": "force", "sample_time": sample_time}
    scene = Scene(excitation=[part], control={"time_step": 0.012})
    start, change = simulate(scene, duration=4000.0, seed=1).recording.jets[:, :2].T
    mean_square = np.mean(start**2 + start * change + change**2 / 3.0)
    # Thousands of independent stretches: good to 1 %. Unscaled, 0.012 s would miss 15 %.
    assert abs(mean_square / part["rms"] ** 2 - 1.0) < 0.02


@pytest.mark.parametrize(
    "part",
    [
        NOISE,
        NOISE | {"low_frequency": 0.0},
        NOISE | {"low_frequency": 79.9},
        SOIL,
        SOIL | {"ground_damping": 3.0},
        HIGH_PASSED,
        HIGH_PASSED | {"filter_frequency": 200.0},
    ],
)
def test_noise_half_way_between_samples_is_within_one_percent_by_default(part):
    scene = Scene(excitation=[part], control={"time_step": 0.05})
    step = compile_scene(scene).support.sample_interval
    samples = _scale_of_samples(part, step)
    half_way = 0.5 * (3.0 - samples)  # from 2 R(0) + R(h) = 3
    assert 0.99 < np.sqrt(half_way / samples) < 1.0
    assert 0.99 < np.sqrt(half_way) < np.sqrt(samples) < 1.01


@pytest.mark.parametrize(
    "fields", [{"ground_frequency": (30.0, 60.0)}, {"ground_damping": (0.3, 0.9)}]
)
def test_default_sample_time_is_that_of_the_worst_corner_of_ranges(fields):
    ((name, limits),) = fields.items()
    plain = Scene(excitation=[SOIL | {name: limits[1]}], control={"time_step": 0.05})
    drawn = plain.replace(randomization={f"excitation.0.{name}": limits})
    steps = [compile_scene(s).support.intervals_per_step for s in (plain, drawn)]
    assert steps[0] == steps[1] > 1


@pytest.mark.parametrize("part", [NOISE, SOIL, HIGH_PASSED], ids=lambda part: part["kind"])
def test_variance_of_the_response_is_lyapunovs(part):
    # White noise behind the filter, then the oscillator: one linear system with one covariance.
    part = part | {"target": "force", "sample_time": 0.0005}
    scene = Scene(
        interface={"kind": "none"},
        carriage={"damping": 3.0},
        excitation=[part],
        control={"time_step": 0.005},
    )
    b, a = _filter(part)
    f, g, out, _ = signal.tf2ss(b, a)
    system = np.zeros((len(f) + 2, len(f) + 2))
    system[: len(f), : len(f)], system[-1, : len(f)] = f, out[0] / 0.1
    system[-2, -1], system[-1, -2], system[-1, -1] = 1.0, -4000.0, -30.0
    drive = np.vstack([g, np.zeros((2, 1))])
    covariance = solve_continuous_lyapunov(system, -drive @ drive.T)
    variance = out[0] @ covariance[: len(f), : len(f)] @ out[0]
    expected = covariance[-2, -2] / variance * part["rms"] ** 2
    squares = [
        np.mean(simulate(scene, duration=1000.0, seed=k).state[400:, 0] ** 2) for k in (1, 2)
    ]
    # 2000 s of 35 rad/s bandwidth: some 20,000 independent squares, 1 % at one standard deviation;
    # linear samples take (w h)^2 / 6 off the highest frequencies, far less.
    assert abs(np.mean(squares) / expected - 1.0) < 0.03


def _filter(part):
    """Return numerator and denominator of a noise's filter as polynomials in s."""
    if part["kind"] == "noise":
        wh, wl, z = part["high_frequency"], part["low_frequency"], np.sqrt(0.5)
        low = np.array([1.0 / wh**2, 2 * z / wh, 1.0])
        return [1.0, 0.0, 0.0], np.polymul(low, [1.0, 2 * z * wl, wl**2])
    wg, zg = part["ground_frequency"], part["ground_damping"]
    b, a = [2 * zg / wg, 1.0], [1.0 / wg**2, 2 * zg / wg, 1.0]
    if part["kind"] == "clough_penzien":
        wf, zf = part["filter_frequency"], part["filter_damping"]
        b, a = np.polymul(b, [1.0, 0.0, 0.0]), np.polymul(a, [1.0, 2 * zf * wf, wf**2])
    return b, a


@pytest.mark.parametrize("part", [NOISE, SOIL, HIGH_PASSED], ids=lambda part: part["kind"])
def test_law_of_the_samples_is_lyapunovs(part):
    plant = compile_scene(BASE.replace(excitation=[part]))
    rows, h = plant.template, plant.support.sample_interval
    first = plant.support.names["excitation.0.rms"]
    f, g, out = _scaled_filter(part)
    stationary = solve_continuous_lyapunov(f, -g @ g.T)
    transition = expm(f * h)
    order = len(f)
    own = rows[first + noise.TRANSITION :][:16].reshape(4, 4)[:order, :order]
    assert np.abs(own - transition).max() < 1e-14
    start, step = (
        _root(rows[first + slot :][:10])[:order, :order]
        for slot in (noise.START_SPREAD, noise.SPREAD)
    )
    scale = np.abs(stationary).max()
    assert np.abs(start @ start.T - stationary).max() < 1e-12 * scale
    grown = stationary - transition @ stationary @ transition.T
    assert np.abs(step @ step.T - grown).max() < 1e-12 * scale
    weights = rows[first + noise.OUTPUT :][:order]
    average = (2.0 * stationary + transition @ stationary) / 3.0
    assert weights @ average @ weights == pytest.approx(1.0, abs=1e-12)
    assert weights == pytest.approx(out / np.sqrt(out @ average @ out), abs=1e-12)


def _root(packed):
    root = np.zeros((4, 4))
    root[np.tril_indices(4)] = packed
    return root


def _scaled_filter(part):
    """Return F, G and the output of a noise's filter, velocities in units of the frequency."""
    if part["kind"] == "noise":
        w, z, passed = part["high_frequency"], np.sqrt(0.5), 0.0
        high = (part["low_frequency"], np.sqrt(0.5))
    else:
        w, z = part["ground_frequency"], part["ground_damping"]
        passed = 2.0 * z
        high = (part.get("filter_frequency", 0.0), part.get("filter_damping", 0.0))
    f = np.zeros((4, 4))
    f[0, 1], f[1, :2] = w, [-w, -2.0 * z * w]
    out = np.array([1.0, passed, 0.0, 0.0])
    g = np.array([[0.0], [np.sqrt(w)], [0.0], [0.0]])
    if high[0] == 0.0:
        return f[:2, :2], g[:2], out[:2]
    f[2, 3], f[3] = high[0], high[0] * np.array([1.0, passed, -1.0, -2.0 * high[1]])
    return f, g, np.array([1.0, passed, -1.0, -2.0 * high[1]])


def test_envelope_shapes_the_noise():
    shape = {"rise": 0.5, "plateau": 1.0, "decay": 2.0}
    scene = BASE.replace(excitation=[SOIL], **{"control.steps": 300})
    shaped = scene.replace(excitation=[SOIL | shape])
    bare, damped = (simulate(s, seed=7).excitation[:, 1] for s in (scene, shaped))
    t = simulate(scene).time
    envelope = np.minimum((t / 0.5) ** 2, 1.0) * np.exp(-2.0 * np.maximum(t - 1.5, 0.0))
    assert np.abs(damped - envelope * bare).max() < 1e-14


def test_impulse_on_the_carriage_is_a_jump_of_its_velocity():
    impulse = {"kind": "impulse", "size": 0.05, "time": 0.1}
    moved = simulate(BASE.replace(initial={}, excitation=[impulse]))
    free = simulate(BASE.replace(initial={"carriage_velocity": 0.05 / 0.1}))
    assert not moved.state[:11].any()
    assert np.abs(moved.state[11:] - free.state[1:51]).max() < 1e-15


def test_impulse_of_the_ground_moves_both_masses():
    impulse = {"kind": "impulse", "target": "ground", "size": 0.2, "time": 0.0}
    moved = simulate(BASE.replace(initial={}, excitation=[impulse]))
    start = {"carriage_velocity": -0.2, "sphere_velocity": -0.2}
    free = simulate(BASE.replace(initial=start))
    assert np.abs(moved.state[1:] - free.state[1:]).max() < 1e-15


def test_sweep_without_duration_has_its_last_frequency_at_once():
    part = SWEEP | {"duration": 5e-324, "phase": 0.0}
    trajectory = simulate(BASE.replace(excitation=[part]))
    step = trajectory.recording.plant.support.sample_interval
    first = 0.5 * (20.0 + 70.0) * step  # the phase that the first sample interval adds
    expected = np.sin(first + 70.0 * (trajectory.time[1:] - step))
    assert np.abs(trajectory.excitation[1:, 0] - expected).max() < 1e-12


def test_a_shaken_plant_is_the_same_however_its_steps_are_divided():
    scene = BASE.replace(excitation=[LOGARITHMIC, HARMONIC])
    whole = simulate(scene).state
    halved = simulate(scene.replace(**{"control.time_step": 0.005, "control.steps": 120})).state
    assert np.abs(whole - halved[::2]).max() < 1e-14 * np.abs(whole).max() * 10.0


def test_seeds_give_different_noise_and_the_same_again():
    scene = BASE.replace(excitation=[NOISE])
    one, again, other = (simulate(scene, seed=seed).excitation for seed in (1, 1, 2))
    assert one.tobytes() == again.tobytes()
    assert not np.any(one[1:] == other[1:], axis=0)[0]


def test_too_fine_samples_are_refused():
    scene = BASE.replace(excitation=[NOISE | {"sample_time": 1e-9}])
    with pytest.raises(CompileError, match=r"excitation\.0: samples 1e-09 s apart"):
        compile_scene(scene)


@pytest.mark.parametrize(
    ("part", "finding"),
    [
        ({"kind": "impulse", "size": 1.0}, "time: missing"),
        ({"kind": "impulse", "size": [2.0, 1.0], "rate": 1.0}, "size: got"),
        (NOISE | {"low_frequency": 90.0}, "low_frequency: got 90.0"),
        ({"kind": "record", "file": "x", "unit": "N"}, "unit: got 'N'; allowed with"),
        ({"kind": "swep"}, "unknown kind 'swep'; did you mean 'sweep'?"),
    ],
)
def test_findings_name_the_field(part, finding):
    with pytest.raises(SceneError) as caught:
        Scene(excitation=[part])
    assert "excitation.0" in str(caught.value)
    assert finding in str(caught.value)


def test_force_impulse_on_a_massless_carriage_is_refused():
    impulse = {"kind": "impulse", "size": 1.0, "rate": 1.0}
    with pytest.raises(CompileError, match=r"excitation\.0: a carriage of mass 0"):
        compile_scene(BASE.replace(excitation=[impulse], **{"carriage.mass": 0.0}))
