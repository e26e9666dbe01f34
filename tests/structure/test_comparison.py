"""The whole structure with its device: right in itself, and what its reduction leaves out."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mm_gym import SceneError, SimulationError
from mm_gym.records import Record
from mm_gym.structure import (
    Structure,
    StructureError,
    compare,
    example,
    full_model,
    white_noise,
)
from mm_gym.structure.full_model import FullModel

FRAME = Structure.of_storeys([3.0, 2.0, 1.5], [900.0, 700.0, 400.0], [0.03, 0.02, 0.05])
ONE = Structure.of_storeys([2.0], [80.0], 0.03)
SPRINGS = {"kind": "small_on_large", "stiffness": 3.0, "stretch": 1.5}
FINITE = {"kind": "finite_stretch", "stiffness": 3.0, "stretch": 1.5, "rest_length": 0.2}
VISCOUS = {"kind": "viscous", "damping": 0.4}
DRY = {
    "kind": "dry_friction",
    "static_coefficient": 0.05,
    "kinetic_coefficient": 0.04,
    "reference_velocity": 0.02,
    "slip_damping": 0.1,
}
STRIBECK = {
    "kind": "stribeck",
    "static_coefficient": 0.05,
    "kinetic_coefficient": 0.03,
    "reference_velocity": 0.02,
    "stribeck_velocity": 0.05,
}
BOUC_WEN = {
    "kind": "bouc_wen",
    "stiffness": 30.0,
    "yield_displacement": 0.005,
    "stiffness_ratio": 0.2,
    "damping": 0.2,
}
CONTROL = {"time_step": 0.02, "steps": 100}
GROUND = white_noise(2.0, 0.02, seed=3)
SHAPES = {"displacement of floor 1", "stroke of the device", "acceleration of floor 1"}


@pytest.mark.parametrize(
    ("interface", "springs", "bound"),
    [
        # Both are exact; the state of the whole structure passes some hundred products.
        (VISCOUS, SPRINGS, 1e-10),
        ({"kind": "none"}, SPRINGS, 1e-10),
        (VISCOUS, {"kind": "none"}, 1e-10),
        (VISCOUS, {"kind": "linear", "stiffness": 8.0}, 1e-10),
        # A tolerance of 1e-8 adds up over 100 corners of the ground's motion: 4e-7 was seen.
        (VISCOUS, FINITE, 2e-6),
        (VISCOUS, {"kind": "linear", "stiffness": 8.0, "cubic_coefficient": 2e3}, 2e-6),
        (DRY, SPRINGS, 2e-6),
        (STRIBECK, SPRINGS, 2e-6),
        (BOUC_WEN, {"kind": "none"}, 2e-6),
    ],
)
def test_one_storey_with_any_device_moves_as_its_scene(interface, springs, bound):
    reduction = ONE.reduce(1)
    scene = reduction.scene(0.5, interface=interface, springs=springs, control=CONTROL)
    found = compare(reduction, scene, GROUND)
    assert {row.name for row in found.rows} == SHAPES | {"drift of storey 1"}
    for row in found.rows:
        assert row.difference_rms < bound, row


def test_start_of_the_scene_is_that_of_the_whole_structure():
    reduction = ONE.reduce(1)
    initial = {
        "carriage_displacement": 0.02,
        "sphere_offset": -0.01,
        "carriage_velocity": 0.1,
        "sphere_velocity": 0.3,
    }
    scene = reduction.scene(
        0.5, interface=VISCOUS, springs=SPRINGS, initial=initial, control=CONTROL
    )
    assert compare(reduction, scene, GROUND)["stroke of the device"].difference_rms < 1e-10


def test_uneven_ground_motion_is_followed_to_each_of_its_corners():
    times = np.cumsum(np.r_[0.013, np.random.default_rng(5).uniform(0.01, 0.05, 40)])
    ground = np.column_stack([times, np.random.default_rng(6).normal(size=41)])
    reduction = ONE.reduce(1)
    scene = reduction.scene(0.5, interface=VISCOUS, springs=SPRINGS, control=CONTROL)
    found = compare(reduction, scene, ground, duration=1.5)
    # Corners inside sample intervals: docs/excitation.md, section 2.
    assert found["displacement of floor 1"].difference_rms < 1e-8


@pytest.mark.parametrize(("device", "mode"), [(3, 1), (1, 2)])
def test_whole_structure_is_that_of_its_equations(device, mode):
    reduction = FRAME.reduce(device, mode)
    scene = reduction.scene(0.3, interface=VISCOUS, springs=SPRINGS, control=CONTROL)
    k2, j = 6.0 * (1.0 + 2.0 / 1.5**3), device - 1
    ground = np.array([[0.0, 0.5], [1.0, -1.5]])

    def field(t, y):
        q, x2, v, v2 = y[:3], y[3], y[4:7], y[7]
        inner = 0.4 * (v2 - v[j]) + k2 * (x2 - q[j])
        a = 0.5 - 2.0 * t
        pushed = -FRAME.stiffness @ q - FRAME.damping @ v - FRAME.mass @ np.ones(3) * a
        pushed[j] += inner
        return np.r_[v, v2, np.linalg.solve(FRAME.mass, pushed), -inner / 0.3 - a]

    times = np.linspace(0.0, 1.0, 51)
    expected = solve_ivp(
        field, (0.0, 1.0), np.zeros(8), "DOP853", t_eval=times, rtol=1e-12, atol=1e-14
    ).y.T
    found = FullModel(reduction, scene).motion(times, ground)
    scale = np.abs(expected[:, :3]).max()
    assert np.abs(found.displacement - expected[:, :3]).max() < 1e-10 * scale
    assert np.abs(found.stroke - expected[:, 3] + expected[:, j]).max() < 1e-10 * scale
    absolute = [field(t, y)[4 + j] + 0.5 - 2.0 * t for t, y in zip(times, expected, strict=True)]
    assert np.abs(found.acceleration - absolute).max() < 1e-9 * np.abs(absolute).max()


def test_ground_at_rest_outside_its_record_leaves_free_vibration():
    """A record that ends away from zero stops at once, in both models."""
    reduction = ONE.reduce(1)
    scene = reduction.scene(0.5, interface=VISCOUS, springs=SPRINGS, control=CONTROL)
    ground = np.array([[0.1, 1.0], [0.3, 2.0]])
    found = compare(reduction, scene, ground, duration=1.0)
    assert found["displacement of floor 1"].difference_rms < 1e-10
    assert not found.full[found.time < 0.1 - 1e-9].any()


# Relative errors of peak and root mean square, and of the motion itself, of docs/structures.md.
STATED = {
    "three_storeys": {
        "displacement of floor 3": (-0.024, -0.006, 0.075),
        "acceleration of floor 3": (-0.248, -0.152, 0.526),
        "stroke of the device": (0.002, -0.002, 0.020),
        "drift of storey 1": (-0.048, -0.022, 0.176),
    },
    "five_storeys": {
        "displacement of floor 5": (-0.030, -0.004, 0.068),
        "acceleration of floor 5": (-0.076, -0.087, 0.629),
        "stroke of the device": (0.015, -0.001, 0.035),
        "drift of storey 1": (-0.122, -0.028, 0.208),
        "drift of storey 5": (-0.348, -0.170, 0.559),
    },
}


@pytest.mark.parametrize("name", STATED)
def test_errors_of_the_examples_under_white_noise_are_as_documented(name):
    made = example(name)
    found = compare(made.reduction, made.scene(), white_noise(20.0, 0.02, seed=1))
    for row, (peak, rms, difference) in STATED[name].items():
        # Stated with three decimals.
        assert found[row].peak_error == pytest.approx(peak, abs=6e-4), row
        assert found[row].rms_error == pytest.approx(rms, abs=6e-4), row
        assert found[row].difference_rms == pytest.approx(difference, abs=6e-4), row


def test_examples_have_the_published_modes():
    five = example("five_storeys")
    periods = 2.0 * np.pi / five.structure.frequencies
    # Chopra prints 2.0, 0.6852, 0.4346, 0.3383, 0.2966 s, and 87.95 % of the mass in mode 1.
    np.testing.assert_allclose(periods, [2.0, 0.6852, 0.4346, 0.3383, 0.2966], rtol=2e-4)
    assert five.reduction.effective_mass_ratio == pytest.approx(0.8795, abs=5e-5)
    # Identified of the laboratory frame: 0.31, 0.62 and 0.63 %.
    three = example("three_storeys").structure
    np.testing.assert_allclose(three.damping_ratios, [0.0031, 0.0062, 0.0063], rtol=0.02)
    tower = example("tower").reduction
    # The condition number of K is 1e8, so that the slowest eigenvalue has some eight digits.
    assert tower.frequency / (2.0 * np.pi) == pytest.approx(0.16, rel=1e-7)
    assert tower.damping_ratio == pytest.approx(0.01, rel=1e-7)
    # Of a uniform cantilever: a quarter of its mass, and 1.566 (Blevins, table 8-1).
    assert tower.mass == pytest.approx(0.25 * 153e6, rel=1e-3)
    assert tower.participation == pytest.approx(1.566, rel=1e-3)
    beams = tower.structure.frequencies[:4] / tower.structure.frequencies[0]
    np.testing.assert_allclose(beams, [1.0, 6.2669, 17.548, 34.386], rtol=2e-3)


def test_quarter_car_loses_nothing():
    made = example("quarter_car")
    found = compare(made.reduction, made.scene(), white_noise(2.0, 0.01, seed=2))
    assert max(row.difference_rms for row in found.rows) < 1e-9
    assert not any("drift" in row.name for row in found.rows)


def test_table_and_figure(tmp_path):
    made = example("five_storeys")
    record = Record(*white_noise(2.0, 0.02, seed=1).T, 0.02)
    found = compare(made.reduction, made.scene(), record)
    lines = found.table().splitlines()
    assert lines[0].split() == [
        *["unit", "peak", "full", "reduced", "error", "rms", "full", "reduced", "error"],
        "difference",
    ]
    assert len(lines) == 1 + len(found.rows) == 9
    assert f"{found.rows[0].full_peak:.4g}" in lines[1]
    pytest.importorskip("matplotlib")
    found.plot(tmp_path / "reduction.png")
    assert (tmp_path / "reduction.png").read_bytes().startswith(b"\x89PNG")


def test_table_of_a_tall_structure_has_its_worst_drifts():
    made = example("tower")
    found = compare(made.reduction, made.scene(), white_noise(60.0, 0.5, seed=1))
    assert len(found.rows) == 3 + 76
    assert len(found.table().splitlines()) in (5, 6)


def scene_of(**changes):
    scene = FRAME.reduce(3).scene(0.3, interface=VISCOUS, springs=SPRINGS, control=CONTROL)
    return scene.replace(**changes)


@pytest.mark.parametrize(
    ("changes", "ground", "options", "error", "words"),
    [
        ({"carriage.mass": 1.0}, GROUND, {}, StructureError, ["carriage.mass", "got 1;"]),
        (
            {"carriage.cubic_coefficient": 3.0},
            *(GROUND, {}, StructureError, ["carriage.cubic_coefficient"]),
        ),
        (
            {"initial.sphere_offset": [0.0, 0.1]},
            *(GROUND, {}, StructureError, ["initial.sphere_offset", "range"]),
        ),
        (
            {"randomization": {"sphere.mass": [0.2, 0.3]}},
            *(GROUND, {}, StructureError, ["randomization.sphere.mass", "range"]),
        ),
        ({}, GROUND[:, 0], {}, SimulationError, ["ground", "(101,)"]),
        ({}, [[0.0, 1.0], [1.0, np.nan]], {}, SimulationError, ["ground", "NaN"]),
        ({}, [[1.0, 1.0], [0.5, 1.0]], {}, SceneError, ["increase"]),
        ({}, GROUND, {"duration": -1.0}, StructureError, ["duration", "-1"]),
        ({}, GROUND, {"duration": 1e9}, StructureError, ["duration", "1e+09"]),
        ({}, GROUND, {"duration": float("nan")}, StructureError, ["duration", "nan"]),
        ({}, np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]), {}, StructureError, ["0 at"]),
    ],
)
def test_bad_comparisons_are_named(changes, ground, options, error, words):
    with pytest.raises(error) as caught:
        compare(FRAME.reduce(3), scene_of(**changes), ground, **options)
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_integration_that_takes_too_long_ends(monkeypatch):
    monkeypatch.setattr(full_model, "MOST_EVALUATIONS", 100)
    reduction = ONE.reduce(1)
    scene = reduction.scene(0.5, interface=DRY, springs=SPRINGS, control=CONTROL)
    with pytest.raises(SimulationError, match=r"gave up at .* after 100 evaluations"):
        compare(reduction, scene, GROUND)


def test_unknown_row_and_unfit_noise_are_named():
    reduction = ONE.reduce(1)
    scene = reduction.scene(0.5, interface=VISCOUS, springs=SPRINGS, control=CONTROL)
    with pytest.raises(StructureError, match=r"'roof'.*'stroke of the device'"):
        compare(reduction, scene, GROUND)["roof"]
    for duration, step in ((1.0, 0.0), (1.0, -1.0), (0.5, 1.0), (1e9, 1.0), (np.nan, 1.0)):
        with pytest.raises(StructureError, match="white noise"):
            white_noise(duration, step)


def test_white_noise_has_its_size_and_seed():
    noise = white_noise(400.0, 0.02, rms=3.0, seed=4)
    assert noise.shape == (20001, 2)
    # The spread of the root mean square of n normal numbers is 1 / sqrt(2 n).
    assert np.sqrt(np.mean(noise[:, 1] ** 2)) == pytest.approx(3.0, rel=4.0 / np.sqrt(40000))
    assert not np.array_equal(noise, white_noise(400.0, 0.02, rms=3.0, seed=5))
