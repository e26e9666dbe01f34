"""Sets of records: each episode has one of them, scaled as asked, the same in every lane."""

import shutil

import numpy as np
import pytest

from mm_gym import (
    CompileError,
    MovingMassEnv,
    MovingMassVectorEnv,
    Scene,
    SceneError,
    compile_scene,
    load_scene,
    simulate,
)
from mm_gym.__main__ import main
from mm_gym.analysis import response_spectrum
from mm_gym.env.arguments import FLOAT32
from mm_gym.plant.compile import compile_findings
from mm_gym.records import Record, read_record
from mm_gym.scene.toml_file import toml_of
from mm_gym.simulation.lanes import Lanes

STEPS = {0: (200, 0.005), 1: (90, 0.01), 2: (60, 0.02)}
"""Number of a record -> its samples, and their spacing [s]."""

pytestmark = pytest.mark.filterwarnings("ignore:.*records? lasts?.*")


@pytest.fixture
def folder(tmp_path):
    rng = np.random.default_rng(1)
    for k, (count, step) in STEPS.items():
        rows = np.column_stack([step * np.arange(count), rng.normal(size=count)])
        np.savetxt(tmp_path / f"m{k}.csv", rows, "%.17g", delimiter=",")
    return tmp_path


def scene_of(folder, *, control=(0.01, 150), **options):
    part = {"kind": "record", "files": str(folder / "m*.csv")} | options
    return Scene(
        excitation=[part],
        control={"time_step": control[0], "steps": control[1]},
        actuation={"force": {}},
        sensors={"channels": ["carriage_displacement", "ground_acceleration"]},
    )


def number_of(file):
    return int(file.removesuffix(".csv")[-1])


@pytest.mark.parametrize("step", [0.01, 0.013])
def test_episode_has_one_record_scaled_to_a_peak_that_is_drawn(folder, step):
    # 0.013 s is no multiple of the spacings: corners lie inside sample intervals.
    scene = scene_of(folder, control=(step, 120), scale_to={"peak": [2.0, 4.0]})
    plant = compile_scene(scene)
    seen = set()
    for seed in range(8):
        trajectory = simulate(plant, seed=seed)
        (file,) = trajectory.records.values()
        seen.add(number_of(file))
        record = read_record(file, unit="m/s^2")
        peak = trajectory.parameters[plant.support.names["excitation.0.scale_to.peak"]]
        assert 2.0 <= peak <= 4.0
        own = record.values * (peak / np.abs(record.values).max())
        expected = np.interp(trajectory.time, record.times, own, right=0.0)
        # Round-off, and slopes of 10 / 0.005 s times that of instants of about 1 s.
        assert np.abs(trajectory.excitation[:, 1] - expected).max() < 1e-11
    assert seen == {0, 1, 2}


def test_lanes_threads_and_single_environments_have_the_same_episodes(folder):
    scene, count = scene_of(folder, control=(0.01, 9), scale_to={"peak": [2.0, 4.0]}), 21
    plant = compile_scene(scene)
    many, threaded = Lanes(plant, count), Lanes(plant, count, threads=2)
    single = [Lanes(plant, 1) for _ in range(count)]
    for lanes in (many, threaded):
        lanes.seed(3)
    for i, lanes in enumerate(single):
        lanes.seed(3 + i)
    row = plant.support.names["excitation.0.record"]
    actions = np.zeros(count)
    drawn = []
    for _ in range(3):  # episodes
        for lanes in (many, threaded, *single):
            lanes.restart()
        for _ in range(9):
            many.advance(actions)
            threaded.advance(actions)
            for lanes in single:
                lanes.advance(actions[:1])
        alone = np.hstack([lanes.values[:4] for lanes in single])
        assert np.array_equal(many.values[:4], alone)
        assert np.array_equal(threaded.values, many.values)
        drawn.append(many.values[row].copy())
    assert np.all(np.isin(drawn, [0.0, 1.0, 2.0]))
    assert not np.array_equal(drawn[0], drawn[1])


def test_records_are_drawn_with_equal_chances(folder):
    lanes = Lanes(compile_scene(scene_of(folder)), 3000)
    lanes.seed(0)
    lanes.restart()
    counts = np.bincount(lanes.drawn("excitation.0.record").astype(int), minlength=3)
    assert counts.sum() == 3000
    # Binomial: a standard deviation of sqrt(3000 * 2 / 9) = 26.
    assert np.abs(counts - 1000).max() < 5 * 26


def test_no_file_is_read_after_the_scene_was_compiled(folder):
    env = MovingMassEnv(scene_of(folder))
    vector = MovingMassVectorEnv(scene_of(folder), num_envs=3)
    names = env.plant.records["excitation.0"]
    assert names == tuple(str(folder / f"m{k}.csv") for k in range(3))
    shutil.rmtree(folder)
    vector.reset(seed=5)
    drawn = []
    for seed in range(5, 8):
        env.reset(seed=seed)
        drawn.append(env.drawn("excitation.0.record"))
        env.step(np.zeros(1, FLOAT32))
    assert vector.drawn("excitation.0.record").tolist() == drawn


def test_record_is_chosen_by_an_option_of_reset(folder):
    env = MovingMassEnv(scene_of(folder))
    for number in (2, 0, 1):
        observed, _ = env.reset(seed=0, options={"excitation.0.record": number})
        first = read_record(folder / f"m{number}.csv", unit="m/s^2").values[0]
        shown = observed[1] / env.plant.observed[1].factor
        assert shown == pytest.approx(first, rel=1e-6)  # single precision
        assert env.drawn("excitation.0.record") == number
    for wrong in (3, -1, 0.5):
        with pytest.raises(SceneError, match=r"excitation\.0\.record: got "):
            env.reset(options={"excitation.0.record": wrong})
    state = env.get_state()
    row = env.plant.support.names["excitation.0.record"]
    for wrong in (0.5, 3.0, -1.0):
        state["values"][row] = wrong
        with pytest.raises(SceneError, match=rf"state\.values: row {row}"):
            env.set_state(state)


def test_set_of_one_is_that_record(folder):
    one = simulate(scene_of(folder, files=[str(folder / "m1.csv")]))
    part = {"kind": "record", "file": str(folder / "m1.csv")}
    other = simulate(scene_of(folder).replace(excitation=[part]))
    assert np.array_equal(one.state, other.state)
    assert one.records == {"excitation.0": str(folder / "m1.csv")}
    assert other.records == {}


@pytest.mark.parametrize("time_scale", [1.0, 0.4])
def test_record_is_scaled_to_a_spectral_acceleration(folder, time_scale):
    measure = {"spectral_acceleration": [3.0, 6.0], "period": 0.12, "damping": 0.03}
    scene = scene_of(folder, scale_to=measure, time_scale=time_scale)
    plant = compile_scene(scene)
    for seed in range(4):
        trajectory = simulate(plant, seed=seed, duration=0.05)
        (file,) = trajectory.records.values()
        record = read_record(file, unit="m/s^2")
        # The applied motion: by its value where the first sample is.
        factor = trajectory.excitation[0, 1] / record.values[0]
        applied = Record(record.times * time_scale, record.values * factor, record.time_step)
        reached = response_spectrum(applied, 0.12, 0.03).pseudo_acceleration[0, 0]
        name = "excitation.0.scale_to.spectral_acceleration"
        assert 3.0 <= reached <= 6.0
        # Round-off of the recurrence, over a thousand parts of sample intervals.
        assert reached == pytest.approx(trajectory.parameters[plant.support.names[name]], rel=1e-11)


def test_inertial_force_is_of_the_acceleration_that_is_scaled(folder):
    options = {"target": "force", "inertial_mass": 2.5, "scale_to": {"peak": 3.0}}
    part = compile_scene(scene_of(folder, files=[str(folder / "m1.csv")], **options))
    values = simulate(part, duration=0.9).excitation[:, 0]
    record = read_record(folder / "m1.csv", unit="m/s^2").values
    expected = -2.5 * 3.0 * record[:90] / np.abs(record).max()
    np.testing.assert_allclose(values[:90], expected, atol=1e-12)
    measure = {"spectral_acceleration": 3.0, "period": 0.1}
    compile_scene(scene_of(folder, target="force", inertial_mass=2.5, scale_to=measure))


def test_memory_of_a_set_is_shared_by_the_lanes(folder):
    set_of_three = compile_scene(scene_of(folder))
    alone = compile_scene(scene_of(folder, files=str(folder / "m0.csv")))
    assert len(set_of_three.template) == len(alone.template)
    more = len(set_of_three.model) - len(alone.model)
    assert more == 2 * (90 + 60) + 2 * 4  # times, values and two lines of the table


def test_explain_tells_of_the_set(folder):
    scene = scene_of(folder, scale_to={"peak": [2, 4]}, target="force")
    text = compile_scene(scene).explain()
    assert "excitation.0: one of 3 in each episode, scaled to a peak of 2 to 4 in SI units" in text
    measure = {"spectral_acceleration": 3.0, "period": 0.1}
    text = compile_scene(scene_of(folder, scale_to=measure)).explain()
    assert "scaled to a spectral acceleration of 3 in SI units" in text


def test_scene_file_names_a_set_relative_to_its_folder(tmp_path, folder, monkeypatch):
    inner = tmp_path / "a[b]*"
    inner.mkdir()
    for k in range(3):
        shutil.copy(folder / f"m{k}.csv", inner)
    head = '[[excitation]]\nkind = "record"\nscale_to = { peak = [2.0, 4.0] }\n'
    expected = tuple(str(inner / f"m{k}.csv") for k in range(3))
    for k, files in enumerate(('"m?.csv"', '["m0.csv", "m1.csv", "m2.csv"]')):
        path = inner / f"{k}.toml"
        path.write_text(f"{head}files = {files}\n")
        scene = load_scene(path)
        assert scene.excitation[0].paths == expected
        copy = tmp_path / "copy.toml"
        copy.write_text(toml_of(scene, tmp_path))
        assert load_scene(copy).excitation[0].paths == expected
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", str(inner / "0.toml"), "--csv", str(inner / "m1.csv")]) == 2


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"files": None}, "excitation.0.file: missing; allowed: file, or files for a set"),
        ({"file": "m0.csv"}, "excitation.0.file: got files too; allowed: one of them"),
        ({"files": []}, "excitation.0.files: got []; allowed: at least 1"),
        ({"files": ""}, "excitation.0.files: "),
        ({"files": [1]}, "excitation.0.files"),
        ({"scale_to": {}}, "excitation.0.scale_to.peak: missing; allowed: peak or spectral_acc"),
        (
            {"scale_to": {"peak": 1.0, "spectral_acceleration": 1.0, "period": 1.0}},
            "excitation.0.scale_to.peak: got spectral_acceleration too; allowed: one of them",
        ),
        ({"scale_to": {"spectral_acceleration": 1.0}}, "excitation.0.scale_to.period: missing; "),
        ({"scale_to": {"peak": 1.0, "period": 1.0}}, "excitation.0.scale_to.period: has no effect"),
        ({"scale_to": {"peak": 0.0}}, "excitation.0.scale_to.peak: got 0.0; allowed: "),
        ({"scale_to": {"peak": [2.0, 1.0]}}, "excitation.0.scale_to.peak: got [2.0, 1.0]; allowed"),
        (
            {"scale_to": {"peek": 1.0}},
            "excitation.0.scale_to.peek: unknown key; did you mean 'peak'",
        ),
        (
            {"scale_to": {"peak": 1.0}, "scale": 2.0},
            "excitation.0.scale: has no effect with scale_to",
        ),
        (
            {
                "scale_to": {"spectral_acceleration": 1.0, "period": 1.0},
                "target": "force",
            },
            "excitation.0.scale_to: spectral_acceleration is of the ground's motion; got target",
        ),
    ],
)
def test_fields_that_do_not_fit_are_refused(folder, options, words):
    with pytest.raises(SceneError) as caught:
        scene_of(folder, **options)
    assert words in str(caught.value)


def test_files_that_do_not_fit_are_refused(folder):
    (folder / "zero.csv").write_text("0,0\n1,0\n")
    (folder / "bad.csv").write_text("0,1\n1,x\n")
    for files, words in (
        (str(folder / "n*.csv"), "n*.csv: got 0 files; allowed: 1 to 1000 that match"),
        (str(folder / "*.csv"), "bad.csv:2: column 2: got 'x'"),
        ([str(folder / "zero.csv")], "zero.csv: all samples are 0; allowed: a record that can"),
        ([str(folder / "none.csv")], "none.csv: no such file; did you mean"),
    ):
        scene = scene_of(folder, files=files, scale_to={"peak": 1.0})
        with pytest.raises(SceneError) as caught:
            compile_scene(scene)
        (finding,) = compile_findings(scene)
        assert str(caught.value) == finding
        assert finding.startswith("excitation.0.files: ")
        assert words in finding


def test_file_that_does_not_fit_is_refused_with_its_field(folder):
    (folder / "bad.csv").write_text("0,1\n1,x\n")
    scene = scene_of(folder, files=None, file=str(folder / "bad.csv"))
    with pytest.raises(SceneError, match=r"^excitation\.0\.file: .*bad\.csv:2: column 2: got 'x'"):
        compile_scene(scene)


def test_time_scale_of_a_spectral_acceleration_is_not_drawn(folder):
    scene = scene_of(folder, scale_to={"spectral_acceleration": 1.0, "period": 0.1})
    scene = scene.replace(**{"randomization.excitation.0.time_scale": [0.5, 1.0]})
    with pytest.raises(
        CompileError, match=r"randomization\.excitation\.0\.time_scale: allowed: no"
    ):
        compile_scene(scene)


def test_drawn_scale_needs_no_scale_to(folder):
    drawn = {"randomization.excitation.0.scale": [1.0, 2.0]}
    lanes = Lanes(compile_scene(scene_of(folder).replace(**drawn)), 4)
    lanes.restart()
    assert np.all(lanes.drawn("excitation.0.scale") >= 1.0)
    with pytest.raises(SceneError, match="scale: has no effect with scale_to"):
        scene_of(folder, scale_to={"peak": 1.0}).replace(**drawn)
