"""Excitation: what each kind is, and how every plant responds to it."""

import mpmath
import numpy as np
import pytest

from mm_gym import CompileError, Scene, SceneError, compile_scene, simulate
from mm_gym.lanes import layout
from mm_gym.plant.excitation import KINDS
from mm_gym.precision.oracle import Oracle
from mm_gym.scene.excitation import FIXED_FIELDS, Excitation
from mm_gym.scene.part import parts_of
from mm_gym.scene.schema import _numbers
from mm_gym.simulation.lanes import Lanes

from .excited import BASE, FRICTION, NOISE

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


SET = {"kind": "record", "files": ["a.csv", "b.csv"]}
SPECTRAL = {"spectral_acceleration": [1.0, 2.0], "period": 0.5, "damping": 0.05}
PARTS = {"record": [SET, SET | {"scale_to": {"peak": 1.0}}, SET | {"scale_to": SPECTRAL}]}
"""Of a kind, those with other numbers."""


@pytest.mark.parametrize("kind", KINDS)
def test_every_number_of_a_kind_has_a_row_of_its_own(kind):
    own, found = KINDS[kind], set()
    for part in PARTS.get(kind, [None]):
        fields = own.fields_of(part and CLASSES[kind].model_validate(part))
        constants = set(own.constants) - set(fields.values() if kind == "record" else ())
        rows = {*fields.values(), *constants}
        assert len(rows) == len(fields) + len(constants)
        assert rows <= set(range(own.rows))
        found |= set(fields)
    # What is drawn as a ratio has a row behind all others; which ordinate is meant is fixed.
    without = {*FIXED_FIELDS, *CLASSES[kind].ratios, "scale_to.period", "scale_to.damping"}
    assert found - {"record"} == set(_numbers(CLASSES[kind])) - without


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


def test_sweep_without_duration_takes_half_a_radian():
    part = SWEEP | {"duration": 5e-324, "phase": 0.0}
    trajectory = simulate(BASE.replace(excitation=[part]))
    step = trajectory.recording.plant.support.sample_interval
    lasts = np.ceil(0.5 / 70.0 / step) * step  # whole sample intervals
    after = trajectory.time >= lasts
    expected = np.sin(0.5 * (20.0 + 70.0) * lasts + 70.0 * (trajectory.time[after] - lasts))
    assert np.abs(trajectory.excitation[after, 0] - expected).max() < 1e-12


@pytest.mark.parametrize("spacing", ["linear", "logarithmic"])
@pytest.mark.parametrize("duration", [1e-9, 0.02, 0.1])
def test_a_fast_sweep_follows_its_formula_within_sample_intervals(spacing, duration):
    part = SWEEP | {"spacing": spacing, "start_frequency": 0.1, "duration": duration}
    recording = simulate(BASE.replace(excitation=[part])).recording
    step = recording.plant.support.sample_interval
    shown = part | {"duration": np.ceil(max(duration, 0.5 / 70.0) / step - 1e-9) * step}
    parts = np.linspace(0.0, 1.0, 21)
    for k, jet in enumerate(recording.jets[:20]):
        terms = jet[: len(jet) // 2]
        expected = np.sin(phase((k + parts) * step, shown))
        # What the series leaves out and the rounding of some 10 rad.
        assert np.abs(np.polynomial.polynomial.polyval(parts, terms) - expected).max() < 1e-14


def test_a_slow_sweep_keeps_its_phase_to_the_last_digits():
    part = SWEEP | {"spacing": "logarithmic", "duration": 1e4, "end_frequency": 20.0 + 1e-6}
    lanes = Lanes(compile_scene(BASE.replace(excitation=[part])), 1)
    lanes.restart()
    lanes.values[layout.BEGAN] = -500_000.0  # control steps of 10 ms
    lanes.advance(np.zeros(0))
    plant = lanes.plant
    with mpmath.workdps(40):
        count = 500_000 * plant.support.intervals_per_step + plant.support.intervals_per_step - 1
        step, duration = mpmath.mpf(plant.support.sample_interval), mpmath.mpf(1e4)
        duration = mpmath.ceil(duration / step - mpmath.mpf(1e-9)) * step
        growth = mpmath.log(mpmath.mpf(part["end_frequency"]) / 20) / duration
        angle = 20 * mpmath.expm1(growth * count * step) / growth + mpmath.mpf(part["phase"])
        expected = float(mpmath.sin(angle))
    # 1e5 rad: their rounding alone would be 1e-11.
    assert abs(lanes.values[plant.support.jets, 0] - expected) < 4e-16


def test_a_shaken_plant_is_the_same_however_its_steps_are_divided():
    scene = BASE.replace(excitation=[LOGARITHMIC, HARMONIC])
    whole = simulate(scene).state
    halved = simulate(scene.replace(**{"control.time_step": 0.005, "control.steps": 120})).state
    assert np.abs(whole - halved[::2]).max() < 1e-14 * np.abs(whole).max() * 10.0


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
        ({"kind": "record", "file": "x", "unit": "N"}, "unit: got 'N'; allowed: "),
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
