"""Noises: their density, their variance between samples too, and that of the response to them."""

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import quad
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.stats import chi2

from mm_gym import MovingMassEnv, MovingMassVectorEnv, Scene, compile_scene, simulate
from mm_gym.excitation import filters as shaping
from mm_gym.excitation import kinds as excitation
from mm_gym.excitation import noise

from .excited import BASE, HIGH_PASSED, NOISE, SOIL


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
    described, h = plant.support.excitation, plant.support.sample_interval
    own = described[excitation.FIRST + excitation.OWN :]
    assert own[noise.STATES] == (2 if part["kind"] == "kanai_tajimi" else 4)
    matrices = described[int(own[noise.PLACE]) :]
    f, g, out = _scaled_filter(part)
    stationary = solve_continuous_lyapunov(f, -g @ g.T)
    transition = expm(f * h)
    order = len(f)
    own = matrices[shaping.TRANSITION :][:16].reshape(4, 4)[:order, :order]
    assert np.abs(own - transition).max() < 1e-14
    start, step = (
        _root(matrices[slot:][:10])[:order, :order]
        for slot in (shaping.START_SPREAD, shaping.SPREAD)
    )
    scale = np.abs(stationary).max()
    assert np.abs(start @ start.T - stationary).max() < 1e-12 * scale
    grown = stationary - transition @ stationary @ transition.T
    assert np.abs(step @ step.T - grown).max() < 1e-12 * scale
    weights = matrices[shaping.OUTPUT :][:order]
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


def test_seeds_give_different_noise_and_the_same_again():
    scene = BASE.replace(excitation=[NOISE])
    one, again, other = (simulate(scene, seed=seed).excitation for seed in (1, 1, 2))
    assert one.tobytes() == again.tobytes()
    assert not np.any(one[1:] == other[1:], axis=0)[0]


@pytest.mark.parametrize("drawn", [False, True], ids=["fixed", "drawn"])
@pytest.mark.parametrize("part", [NOISE, SOIL, HIGH_PASSED], ids=lambda part: part["kind"])
def test_lanes_have_the_noise_of_a_lone_one(part, drawn):
    name = "high_frequency" if part["kind"] == "noise" else "ground_frequency"
    scene = BASE.replace(
        excitation=[part | {"rise": 0.02, "plateau": 0.01, "decay": 3.0}],
        actuation={"force": {"limit": 1.0}},
        sensors={
            "channels": ["carriage_displacement", "sphere_offset", "ground_acceleration"],
            "noise": dict.fromkeys(["carriage_displacement", "ground_acceleration"], 0.01),
        },
        randomization={f"excitation.0.{name}": [part[name], 1.1 * part[name]]} if drawn else {},
    )
    lanes = MovingMassVectorEnv(scene, 19)  # two vectors and some more
    lone = MovingMassEnv(scene)
    together, _ = lanes.reset(seed=5)
    alone, _ = lone.reset(seed=5 + 18)
    np.testing.assert_array_equal(together[18], alone)
    for _ in range(8):
        together, *_ = lanes.step(np.zeros(lanes.action_space.shape, np.float32))
        alone, *_ = lone.step(np.zeros(lone.action_space.shape, np.float32))
        np.testing.assert_array_equal(together[18], alone)
        np.testing.assert_array_equal(lanes.state[18], lone.state)


def test_filters_side_by_side_have_the_matrices_of_each_alone():
    rng, count = np.random.default_rng(0), 60
    # Frequencies from slow to fast: the sample interval is halved a different number of times.
    filters = 10.0 ** rng.uniform([[-1.0], [-2.0]] * 2, [[3.0], [1.0]] * 2, (4, count))
    filters[2, rng.random(count) < 0.3] = 0.0  # without high-pass
    listed = np.sort(rng.permutation(count)[:50])
    together, alone = np.zeros((2, shaping.MATRICES, count))
    shaping.write_matrices(together, 0, filters, True, 0.005, listed)
    for i in listed:
        shaping.write_matrices(alone, 0, filters, True, 0.005, np.array([i]))
    np.testing.assert_array_equal(together, alone)


@pytest.mark.parametrize("name", ["low_frequency", "low_ratio"])
def test_noise_without_high_pass_does_not_depend_on_the_episode_before(name):
    scene = BASE.replace(
        excitation=[NOISE],
        actuation={"force": {"limit": 1.0}},
        sensors={"channels": ["disturbance_force"]},
        randomization={f"excitation.0.{name}": [0.0, 0.5]},
    )
    envs = [MovingMassVectorEnv(scene, 3) for _ in range(2)]
    envs[0].reset(seed=1, options={f"excitation.0.{name}": 0.5})
    for env in envs:
        env.reset(seed=2, options={f"excitation.0.{name}": [0.0, 0.3, 0.0]})
        env.step(np.zeros(env.action_space.shape, np.float32))
    np.testing.assert_array_equal(*(env.get_state()["values"] for env in envs))
