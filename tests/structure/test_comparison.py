"""The whole structure with its device: right in itself, and what its reduction leaves out."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mm_gym import ActionError, SceneError, SimulationError
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


DAMPER = {"minimum": 0.05, "maximum": 2.0}


def switched(_time, state):
    return 1.5 if state[2] * (state[2] - state[3]) > 0.0 else 0.1


def pushed(_time, state):
    return 0.5 * state[0] - 3.0 * state[2] - 4.0 * state[3]


@pytest.mark.parametrize(
    ("actuation", "action"),
    [
        ({"damping": DAMPER | {"rate_limit": 20.0}}, switched),
        ({"damping": DAMPER | {"lag": 0.05}}, switched),
        ({"force": {"limit": 0.2, "between": "masses", "lag": 0.02}}, pushed),
        ({"force": {"limit": 1.0, "rate_limit": 3.0}}, pushed),
        ({"force": {"limit": 1.0}}, np.random.default_rng(8).normal(size=67)),
        (
            {"force": {"limit": 1.0, "between": "masses"}, "damping": DAMPER},
            lambda *now: [pushed(*now), switched(*now)],
        ),
        ({"force": {"limit": 1.0}, "damping": DAMPER}, [0.3, 1.2]),
    ],
)
def test_one_storey_moves_as_its_scene_under_control(actuation, action):
    # A control step of 0.03 s: commands change between the ground's samples, 0.02 s apart.
    reduction = ONE.reduce(1)
    scene = reduction.scene(
        0.5,
        interface=VISCOUS,
        springs={"kind": "linear", "stiffness": 8.0},
        actuation=actuation,
        control={"time_step": 0.03, "steps": 67},
    )
    found = compare(reduction, scene, GROUND, action=action)
    idle = compare(reduction, scene, GROUND)
    for row in found.rows:
        # Both are exact, as without control.
        assert row.difference_rms < 1e-10, row
        assert abs(row.full_rms - idle[row.name].full_rms) > 1e-3 * row.full_rms


def with_a_force():
    reduction, actuation = ONE.reduce(1), {"force": {"limit": 1.0}}
    control = {"time_step": 0.02, "steps": 100}
    return reduction, reduction.scene(
        0.5, interface=VISCOUS, springs=SPRINGS, actuation=actuation, control=control
    )


def test_motion_lasts_as_long_as_it_is_asked_for():
    reduction, scene = with_a_force()
    ground = white_noise(2.1, 0.07, seed=3)
    found = compare(reduction, scene, ground, duration=1.0, action=np.linspace(-1.0, 1.0, 50))
    assert found.time[-1] == 1.0
    # Corners inside sample intervals: docs/excitation.md, section 2.
    assert max(row.difference_rms for row in found.rows) < 1e-8


def test_commands_begin_on_time_where_samples_of_the_ground_almost_do():
    reduction, scene = with_a_force()
    # Not the same time, but by less than round-off of the last: as of times that lost digits.
    ground = GROUND * [1.0 - 1.9e-12, 1.0]
    found = compare(reduction, scene, ground, action=lambda t, _: 3.0 * np.sin(7.0 * t))
    # Corners inside sample intervals: docs/excitation.md, section 2.
    assert max(row.difference_rms for row in found.rows) < 1e-8


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


def controlled(name, share):
    """An example with a semi-active or, with a share of its weight as the limit, active damper."""
    made = example(name)
    tuned = made.scene().interface.damping
    if not share:
        damper = {"minimum": 0.2 * tuned, "maximum": 3.0 * tuned}
        return (
            made.scene(actuation={"damping": damper}),
            lambda _, x: 3.0 * tuned if x[2] * (x[2] - x[3]) > 0.0 else 0.2 * tuned,
        )
    scale = {"three_storeys": 0.001, "five_storeys": 0.05}[name]
    limit = share * made.reduction.mass * 9.81
    scene = made.scene(
        actuation={"force": {"limit": limit, "between": "masses"}},
        objective={
            "displacement_scale": scale,
            "stroke_weight": 0.01,
            "stroke_scale": scale,
            "effort_weight": 0.3,
        },
    )
    gain = pytest.importorskip("agents.controllers.lqr").design(scene).gain
    return scene, lambda _, x: -gain @ x


@pytest.mark.parametrize(
    ("name", "share", "displacement", "stroke"),
    [
        ("five_storeys", 0.0, (-0.017, -0.009, 0.075), (0.023, 0.024, 0.082)),
        ("five_storeys", 0.01, (-0.027, -0.004, 0.079), (-0.013, -0.000, 0.040)),
        ("five_storeys", 0.05, (0.005, -0.001, 0.098), (0.016, -0.001, 0.075)),
        ("three_storeys", 0.0, (-0.041, 0.022, 0.197), (0.014, 0.092, 0.239)),
        ("three_storeys", 0.01, (-0.054, -0.013, 0.109), (-0.025, -0.001, 0.042)),
        ("three_storeys", 0.05, (-0.476, -0.497, 0.817), (-0.205, -0.102, 0.635)),
    ],
)
def test_errors_of_the_examples_under_control_are_as_documented(name, share, displacement, stroke):
    scene, action = controlled(name, share)
    reduction = example(name).reduction
    found = compare(reduction, scene, white_noise(20.0, 0.02, seed=1), action=action)
    for row, stated in ((found.rows[0], displacement), (found.rows[2], stroke)):
        # Stated with three decimals.
        got = (row.peak_error, row.rms_error, row.difference_rms)
        np.testing.assert_allclose(got, stated, rtol=0, atol=6e-4, err_msg=row.name)


def test_strong_regulator_makes_higher_modes_of_the_frame_unstable():
    """Spillover, as documented."""
    scene, action = controlled("three_storeys", 0.05)
    model = FullModel(example("three_storeys").reduction, scene, action)
    gain = np.array([action(0.0, unit)[0] for unit in np.eye(4)])
    # The state is q (3), x2 and their velocities; the regulator sees x1 = q3.
    free = np.column_stack([model.rates(unit, 0.0) for unit in np.eye(8)])
    push = np.concatenate([np.zeros(4), model.push])
    closed = free + np.outer(push, gain @ np.eye(8)[[2, 3, 6, 7]])
    poles = np.linalg.eigvals(closed)
    poles = poles[np.argsort(-poles.imag)][1::-1]
    np.testing.assert_allclose(-poles.real / np.abs(poles), [-0.0033, -0.0013], atol=5e-5)


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


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"springs": FINITE, "actuation": {"force": {"limit": 1.0}}}, ["action", "not linear"]),
        ({"actuation": {"stretch": {}}}, ["actuation.stretch", "force"]),
        ({"actuation": {"damping": {"of": "carriage"}}}, ["actuation.damping", "interface"]),
    ],
)
def test_actions_without_a_counterpart_are_named(fields, words):
    reduction = FRAME.reduce(3)
    device = {"interface": VISCOUS, "springs": SPRINGS, "control": CONTROL}
    scene = reduction.scene(0.3, **(device | fields))
    with pytest.raises(StructureError) as caught:
        compare(reduction, scene, GROUND, action=1.5)
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_action_that_does_not_fit_is_named():
    reduction = FRAME.reduce(3)
    scene = scene_of(actuation={"force": {"limit": 1.0}})
    with pytest.raises(ActionError, match=r"action: got shape \(3, 1\)"):
        compare(reduction, scene, GROUND, action=[1.0, 2.0, 3.0])


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
