"""Is a tuned scene the best of its kind, in reach, and as good as predicted?"""

from itertools import product

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import differential_evolution
from tasks import TASKS
from tuning.conftest import rig

from mm_gym import Scene, load_scene, simulate
from mm_gym.__main__ import main
from mm_gym.analysis import frequency_response
from mm_gym.scene.toml_file import toml_of
from mm_gym.tuning import CHANNELS, DesignError, OutOfReachError, evaluate, stretch_for, tune


def steady_amplitude(scene, excitation, frequency, channel_of):
    """Return the amplitude of a channel of the simulated motion under a harmonic of amplitude 1."""
    harmonic = {
        "kind": "harmonic", "target": excitation, "amplitude": 1.0, "frequency": frequency,
    }  # fmt: skip
    driven = scene.replace(excitation=[harmonic])
    times = 8.0 + np.linspace(0.0, 2.0 * np.pi / frequency, 12, endpoint=False)
    state = simulate(driven, times=times).state
    wave = np.column_stack([np.sin(frequency * times), np.cos(frequency * times)])
    both, *_ = np.linalg.lstsq(wave, channel_of(state), rcond=None)
    return np.hypot(*both)


CHANNEL = {
    "carriage_displacement": (lambda state: state[:, 0], 1e4, 1e4),  # k1 x1 / F and w1^2 x1 / a_g
    "carriage_velocity": (lambda state: state[:, 2], 100.0, 100.0),
    "sphere_displacement": (lambda state: state[:, 1], 1e4, 1e4),
}


@pytest.mark.parametrize("channel", CHANNEL)
@pytest.mark.parametrize("excitation", ["force", "ground"])
def test_simulated_peak_of_the_tuned_scene_is_the_predicted_one(excitation, channel):
    # The damper's motion decays as exp(-10 t) or faster: after 8 s below round-off.
    found = tune(rig(0.1, damping=4.0), excitation=excitation, channel=channel)
    after, (show, force_unit, ground_unit) = found.after, CHANNEL[channel]
    unit = force_unit if excitation == "force" else ground_unit
    at_peak = unit * steady_amplitude(found.tuned, excitation, after.peak_frequency, show)
    assert at_peak == pytest.approx(after.peak, rel=1e-9)
    for factor in (0.99, 1.01):  # and it is a peak
        beside = steady_amplitude(found.tuned, excitation, factor * after.peak_frequency, show)
        assert unit * beside < at_peak


@pytest.mark.parametrize(
    ("mass_ratio", "damping"),
    [*product([0.016, 0.044, 0.05, 0.31, 1.3], [0.0, 40.0, 120.0, 180.0]), (1.0, 140.0)],
)
@pytest.mark.filterwarnings("error")
def test_no_design_at_all_decays_faster(mass_ratio, damping):
    def slowest(unknowns):
        c, k2 = np.exp(unknowns)
        f = np.array([[-(1e4 + k2), k2], [k2 / mass_ratio, -k2 / mass_ratio]])
        g = np.array([[-(damping + c), c], [c / mass_ratio, -c / mass_ratio]])
        return np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [f, g]])).real.max()

    scene = rig(mass_ratio, damping=damping)
    best = tune(scene, excitation="force", criterion="stability").free
    found = slowest(np.log([best.damping, best.stiffness]))
    around = np.log([[2e-4, 2e3], [40.0, 4e6]]) + np.log(mass_ratio)
    other = differential_evolution(slowest, around.T, seed=1, maxiter=100)
    assert found <= other.fun + 1e-6 * abs(other.fun)


def test_table_says_that_the_search_has_no_optimum_inside():
    scene = rig(0.05, damping=10.0).replace(springs={"kind": "linear", "stiffness": 400.0})
    tables = {name: tune(scene, excitation="force", channel=name).table() for name in CHANNELS}
    assert "f is at an end of what is searched, 0.002 to 20" in tables["sphere_offset"]
    assert "at an end" not in tables["carriage_displacement"]


@pytest.mark.parametrize("criterion", ["h_infinity", "h2", "stability"])
@pytest.mark.parametrize("excitation", ["force", "ground"])
def test_no_design_near_the_optimum_is_better(excitation, criterion):
    scene = rig(0.2, damping=10.0, k0=300.0)
    best = tune(scene, excitation=excitation, criterion=criterion)
    assert best.out_of_reach is None
    for stretch, damping in ((1.001, 1.0), (0.999, 1.0), (1.0, 1.001), (1.0, 0.999)):
        other = best.tuned.replace(
            **{
                "springs.stretch": best.stretch * stretch,
                "interface.damping": best.after.damping * damping,
            }
        )
        changed = evaluate(other, excitation=excitation, criterion=criterion)
        assert changed.value > best.after.value


@pytest.mark.parametrize("excitation", ["force", "ground"])
@pytest.mark.parametrize("channel", CHANNELS)
def test_every_channel_can_be_tuned_and_its_peak_is_the_largest(channel, excitation):
    found = tune(rig(0.1, damping=4.0), excitation=excitation, channel=channel)
    assert found.after.value == found.after.peak <= found.before.peak
    if channel != "carriage_displacement":
        return
    response = frequency_response(found.tuned, np.geomspace(30.0, 300.0, 4001))
    largest = 1e4 * np.abs(getattr(response, excitation)[:, 0]).max()
    assert found.after.peak * (1 - 1e-6) <= largest <= found.after.peak * (1 + 1e-12)


def test_optimum_out_of_reach_is_answered_with_the_reason_and_the_best_in_reach():
    scene = rig(0.4, k0=800.0)  # the optimum is k2 = 2039 N/m for 2 k0 = 1600, and 12 k0 = 4800
    assert tune(scene).out_of_reach is None
    stiff = rig(0.4, k0=1500.0)
    found = tune(stiff)
    assert "k2 = 2038.95 N/m is out of reach" in found.out_of_reach
    assert "from 339.8 to 1019 N/m reaches it" in found.out_of_reach
    assert found.after.stiffness == pytest.approx(3000.0)
    assert found.after.value > found.free.value
    with pytest.raises(OutOfReachError, match="out of reach"):
        stretch_for(stiff, found.free.stiffness)
    softer = stiff.replace(**{"springs.stiffness": 1000.0})
    assert tune(softer).out_of_reach is None


def test_springs_that_are_drawn_have_the_middle_of_their_range():
    scene = rig(0.1, k0=300.0).replace(randomization={"springs.stiffness": [180.0, 240.0]})
    found = tune(scene)
    assert evaluate(found.tuned).value == pytest.approx(found.after.value, rel=1e-9)
    assert f"  {scene.springs.stretch:.6g}  " in found.table().splitlines()[3]
    softer = tune(scene.replace(randomization={"springs.stiffness": [18.0, 22.0]}))
    assert "with springs.stiffness = 20 N/m" in softer.out_of_reach


def test_limits_of_the_actuator_are_the_reach():
    scene = TASKS["mm_gym/PreStretch-v0"]
    found = tune(scene)
    assert "limits of actuation.stretch" in found.out_of_reach
    assert found.stretch == 3.0
    assert found.tuned.initial.stretch == 3.0
    assert stretch_for(scene, 210.0) == 1.0
    with pytest.raises(OutOfReachError):
        stretch_for(scene, 210.1)
    with pytest.raises(DesignError, match="stiffness: got None; allowed: a finite number"):
        stretch_for(scene, None)
    with pytest.raises(DesignError, match="has no stretch"):
        stretch_for(TASKS["mm_gym/CarriageForce-v0"], 100.0)


def test_stretch_gives_the_stiffness_asked_for():
    scene = rig(0.4, k0=100.0)
    for k2 in (200.001, 300.0, 600.0):
        stretched = scene.replace(**{"springs.stretch": stretch_for(scene, k2)})
        assert evaluate(stretched).stiffness == pytest.approx(k2, rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "options", "message"),
    [
        ({"carriage.mass": 0.0}, {}, "carriage.mass: got 0"),
        ({"carriage.linear_coefficient": 0.0}, {}, "carriage.linear_coefficient: got 0"),
        ({"randomization.interface.damping": [0.1, 0.2]}, {}, "randomization.interface.damping"),
        (
            {
                "interface": {
                    "kind": "dry_friction",
                    "static_coefficient": 0.5,
                    "kinetic_coefficient": 0.3,
                    "reference_velocity": 0.1,
                }
            },
            {},
            "interface.kind: 'dry_friction'",
        ),
        ({}, {"criterion": "h_two"}, "criterion: got 'h_two'"),
        ({}, {"excitation": "grnd"}, "did you mean 'ground'"),
        ({}, {"channel": "stretch"}, "channel: got 'stretch'"),
        ({}, {"channel": "carriage_acceleration", "criterion": "h2"}, "no finite h2"),
        (
            {"springs": {"kind": "none"}},
            {"channel": "sphere_displacement", "excitation": "ground"},
            "no finite h_infinity",
        ),
        (
            {"springs": {"kind": "none"}},
            {"channel": "spring_force"},
            "'spring_force' under 'force' excitation is 0 for any damping",
        ),
        (
            {"springs": {"kind": "none"}},
            {"channel": "spring_force", "criterion": "h2"},
            "'spring_force' under 'force' excitation is 0 for any damping",
        ),
    ],
)
def test_what_cannot_be_tuned_is_refused_with_the_reason(changes, options, message):
    with pytest.raises(DesignError, match=message):
        tune(rig(0.1).replace(**changes), **options)


@pytest.mark.parametrize("criterion", ["h_infinity", "h2"])
def test_uncoupled_sphere_stays_where_it_is_under_a_force(criterion):
    free = {"interface": {"kind": "none"}, "springs": {"kind": "none"}}
    for channel in ("sphere_displacement", "sphere_velocity"):
        found = evaluate(
            rig(0.1, damping=5.0).replace(**free), channel=channel, criterion=criterion
        )
        assert found.value == found.peak == 0.0


def test_peak_that_is_narrower_than_doubles_are_apart_is_found():
    damping = 2.6e-10
    scene = Scene(
        carriage={"mass": 1.0, "stiffness": 1.0, "damping": damping},
        sphere={"mass": 0.05},
        springs={"kind": "linear", "stiffness": 3e-5},
        interface={"kind": "none"},
        control={"time_step": 0.01, "steps": 100},
    )
    squares, shapes = eigh([[1.00003, -3e-5], [-3e-5, 3e-5]], np.diag([1.0, 0.05]))
    # Of a mode alone, which the others change by their static part over its peak.
    peaks = np.abs(shapes[0] * shapes[1]) / (np.sqrt(squares) * damping * shapes[0] ** 2)
    found = evaluate(scene, channel="sphere_displacement")
    assert found.value == found.peak == pytest.approx(peaks.max(), rel=1e-6)
    assert found.peak_frequency == pytest.approx(np.sqrt(squares[np.argmax(peaks)]), rel=1e-8)


def test_peak_without_damping_is_infinite():
    found = evaluate(rig(0.1).replace(interface={"kind": "none"}))
    assert found.value == found.peak == np.inf


@pytest.mark.parametrize("name", TASKS)
def test_scene_is_read_back_from_its_own_text(name, tmp_path):
    (tmp_path / "scene.toml").write_text(toml_of(TASKS[name], tmp_path))
    assert load_scene(tmp_path / "scene.toml") == TASKS[name]


def test_names_and_texts_are_quoted(tmp_path):
    file = str(tmp_path / 'a "b"\\\t\x7fé.csv')
    record = {"kind": "record", "file": file, "scale": 0.1 + 0.2}
    scene = rig(0.1).replace(excitation=[record], randomization={"excitation.0.scale": [1.0, 2.0]})
    (tmp_path / "scene.toml").write_text(toml_of(scene, tmp_path), "utf-8")
    (read,) = load_scene(tmp_path / "scene.toml").excitation
    assert read.file == file
    assert read.scale == 0.1 + 0.2


def test_command_prints_draws_and_writes_the_tuned_scene(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    assert main(["tune", "mm_gym/PreStretch-v0", "--out", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    assert "nishihara_asami" in out
    assert "out of reach" in out
    tuned = load_scene(tmp_path / "out" / "tuned.toml")
    assert tuned == tune(TASKS["mm_gym/PreStretch-v0"]).tuned
    assert (tmp_path / "out" / "response.png").stat().st_size > 10_000


def test_response_without_springs_is_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    assert main(["tune", "mm_gym/CarriageForce-v0", "--out", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "response.png").stat().st_size > 10_000
