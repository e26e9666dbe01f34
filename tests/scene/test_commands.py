"""The commands about scene files: what they print, write and return."""

import csv
import io
from pathlib import Path

import pytest
from tasks import TASKS

from mm_gym import simulate
from mm_gym.__main__ import main
from mm_gym.tasks import path_of

SCENE = "[initial]\ncarriage_displacement = [0.005, 0.01]\n"
WRONG = "[carriage]\nmass = -1\nmas = 2\n"
REFUSED = "[carriage]\nmass = 0\n[solver]\nmethod = 'rk4'\n"


@pytest.fixture
def write(tmp_path):
    def write(name, text):
        (tmp_path / name).write_text(text)
        return str(tmp_path / name)

    return write


def test_validate_checks_all_files(write, capsys):
    files = [write("a.toml", SCENE), write("b.toml", WRONG), write("c.toml", REFUSED)]
    assert main(["validate", *files, files[0] + "x"]) == 2
    out, err = capsys.readouterr()
    assert out == f"{files[0]}: valid\n"
    lines = err.removeprefix("error: ").splitlines()
    assert [line.split(": ")[0] for line in lines] == [
        f"{files[1]}:2",
        f"{files[1]}:3",
        f"{files[2]}:4",
        files[0] + "x",
    ]
    assert "did you mean 'a.toml'?" in lines[-1]


def test_name_that_the_output_cannot_show_is_one_message(write, capsys, monkeypatch):
    file = write("größe.toml", SCENE)
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(io.BytesIO(), encoding="ascii"))
    assert main(["validate", file]) == 2
    assert "'ascii' codec can't encode" in capsys.readouterr().err


def test_want_of_memory_is_one_message(write, capsys, monkeypatch):
    def starved(*_, **__):
        msg = "Unable to allocate 46.9 PiB"  # as NumPy says it
        raise MemoryError(msg)

    monkeypatch.setattr("mm_gym.precision.work_precision", starved)
    assert main(["work-precision", write("a.toml", SCENE)]) == 2
    assert capsys.readouterr().err == "error: Unable to allocate 46.9 PiB\n"


MANY = """\
[carriage]
mass = 0
[interface]
kind = "dry_friction"
static_coefficient = 0.3
kinetic_coefficient = 0.4
reference_velocity = 0.1
[[excitation]]
kind = "impulse"
size = 1.0
time = 0.1
[[excitation]]
kind = "record"
file = "nowhere.csv"
[sensors]
channels = ["carriage_acceleration"]
delay = -1
[randomization]
"sphere.mass" = [0.1, 0.2]
[objective]
displacement_scle = 1
"""


def test_validate_reports_findings_of_all_kinds_at_once(write, capsys):
    file = write("a.toml", MANY)
    assert main(["validate", file]) == 2
    lines = capsys.readouterr().err.removeprefix("error: ").splitlines()
    places = [line.removeprefix(f"{file}:").split(": ")[:2] for line in lines]
    assert sorted((int(line), name) for line, name in places) == [
        (3, "interface.normal_force"),  # it is not stated, so the line is its table's
        (6, "interface.kinetic_coefficient"),
        (8, "excitation.0"),
        (14, "excitation.1.file"),
        (16, "sensors.channels"),
        (17, "sensors.delay"),
        (21, "objective.displacement_scle"),
    ]


def test_validate_does_not_guess_from_values_that_are_wrong(write, capsys):
    # The method would be refused for a carriage of mass 0, and perhaps for another mass.
    file = write("a.toml", "[carriage]\nmass = -1\n[solver]\nmethod = 'switched'\n")
    assert main(["validate", file]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_validate_reports_a_method_that_does_not_apply_with_wrong_sensors(write, capsys):
    file = write("a.toml", "[sensors]\nhistory = 0\n[solver]\nmethod = 'switched'\n")
    assert main(["validate", file]) == 2
    err = capsys.readouterr().err
    assert "a.toml:2: sensors.history: got 0; allowed: " in err
    assert "a.toml:4: solver.method: 'switched' does not apply to this scene" in err


def test_simulate_writes_what_it_is_asked_for(write, tmp_path, capsys):
    pytest.importorskip("matplotlib")
    table, image = tmp_path / "out" / "a.csv", tmp_path / "out" / "a.png"
    command = ["simulate", write("a.toml", SCENE), "--duration", "0.1", "--seed", "3"]
    assert main([*command, "--csv", str(table), "--plot", str(image)]) == 0
    printed = capsys.readouterr().out
    with table.open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 11
    assert 0.005 <= float(rows[0]["x1 [m]"]) <= 0.01
    assert f"{float(rows[-1]['x1 [m]']): .9e} m\n" in printed
    assert image.read_bytes().startswith(b"\x89PNG")
    assert main(command) == 0
    assert capsys.readouterr().out == printed


def test_plot_has_a_panel_for_all_that_acts():
    pytest.importorskip("matplotlib")
    trajectory = simulate(TASKS["mm_gym/Hybrid-v0"], duration=0.1, action=[0.5, -0.5])
    panels = trajectory.plot().axes
    assert [panel.get_ylabel() for panel in panels] == [
        *["displacement [mm]", "velocity [m/s]", "ground [m/s²]"],
        *["force [N]", "stretch [-]", "energy [mJ]"],
    ]
    for panel, values in zip(
        panels[2:5], (trajectory.excitation[:, 1], *trajectory.action.T), strict=True
    ):
        (line,) = panel.get_lines()
        assert (line.get_ydata() == values).all()


@pytest.mark.parametrize("command", ["validate", "explain", "simulate"])
def test_wrong_scene_is_one_message_without_a_traceback(write, capsys, command):
    assert main([command, write("b.toml", WRONG)]) == 2
    out, err = capsys.readouterr()
    assert not out
    assert err.startswith("error: ")
    assert "b.toml:2: carriage.mass: got -1; allowed:" in err
    assert "Traceback" not in err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--duration", "-1"], "duration: got -1.0; allowed: a number greater than 0 s"),
        (["--duration", "nan"], "duration: got NaN"),
        (["--duration", "1e300"], "control steps; allowed"),
        (["--csv", "."], "error: .: cannot be written: it is a folder"),
        (["--csv", ""], "error: cannot be written: the path is empty"),
        (["--plot", ""], "error: cannot be written: the path is empty"),
        (["--plot", "a.pdf"], "--plot: got 'a.pdf'; allowed: a file whose name ends in .png"),
        (["--csv", "/dev/null/x"], "error: /dev/null/x: cannot be written: Not a directory"),
    ],
)
def test_wrong_option_is_one_message(write, capsys, options, words):
    assert main(["simulate", write("a.toml", SCENE), *options]) == 2
    assert words in capsys.readouterr().err


RECORDED = """
[[excitation]]
kind = "record"
target = "force"
file = "record.csv"
"""


@pytest.mark.parametrize("option", ["--csv", "--plot"])
@pytest.mark.parametrize("name", ["a.toml", "record.csv", "link"])
def test_command_never_writes_over_what_it_reads(write, capsys, monkeypatch, option, name):
    write("record.csv", "0,0\n0.1,1\n")
    scene = Path(write("a.toml", SCENE + RECORDED))
    scene.with_name("link").symlink_to(scene)
    output = scene.with_name(name)
    before = output.read_text()
    monkeypatch.setattr("mm_gym.__main__.simulate", None)  # nothing is computed
    assert main(["simulate", str(scene), option, str(output)]) == 2
    assert "it is an input of this command" in capsys.readouterr().err
    assert output.read_text() == before


def test_file_of_a_task_that_is_simulated_is_not_written_over(capsys):
    path = str(path_of("mm_gym/CarriageForce-v0"))
    assert main(["simulate", "mm_gym/CarriageForce-v0", "--csv", path]) == 2
    assert "it is an input of this command" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (["simulate", "a.toml", "--csv", "new", "--plot", "new"], "named for two outputs"),
        (["work-precision", "a.toml", "--out", ""], "--out: got ''"),
        (["work-precision", "a.toml", "--out", "a.toml"], "Not a directory"),
        (["paper", "--out", ""], "--out: got ''"),
        (["paper", "--out", "a.toml"], "Not a directory"),
    ],
)
def test_output_that_cannot_be_written_is_refused_before_anything_is_computed(
    tmp_path, capsys, monkeypatch, command, words
):
    (tmp_path / "a.toml").write_text(SCENE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("mm_gym.__main__.simulate", None)
    monkeypatch.setattr("mm_gym.precision.work_precision", None)
    monkeypatch.setattr("mm_gym.paper.figures.draw", None)
    assert main(command) == 2
    assert words in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["a.toml"]


@pytest.mark.parametrize("seed", ["-1", "x", "1.5"])
def test_wrong_seed_is_refused(write, capsys, seed):
    with pytest.raises(SystemExit) as caught:
        main(["simulate", write("a.toml", SCENE), "--seed", seed])
    assert caught.value.code == 2
    assert f"invalid seed value: '{seed}'" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["validate", "explain", "simulate", "schema", "paper"])
def test_help_says_what_a_command_does(capsys, command):
    with pytest.raises(SystemExit) as caught:
        main([command, "--help"])
    assert caught.value.code == 0
    assert len(capsys.readouterr().out.splitlines()) > 3


@pytest.mark.parametrize("command", ["validate", "explain", "simulate", "render", "warm"])
def test_commands_take_short_names_of_tasks(command, capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("mm_gym.simulation.simulate.warm", lambda _: 0.0)
    monkeypatch.setattr("mm_gym.rendering.episode.draw_episode", lambda *_, **__: None)
    options = ["--out", str(tmp_path / "a.png")] if command == "render" else []
    printed = []
    for name in ("PreStretch", "mm_gym/PreStretch", "mm_gym/PreStretch-v0", "PreStretch-v0"):
        assert main([command, name, *options]) == 0
        printed.append(capsys.readouterr().out)
    assert len(set(printed)) == 1


@pytest.mark.parametrize(
    "command", ["validate", "explain", "simulate", "tune", "render", "work-precision", "warm"]
)
def test_misspelt_task_is_refused_with_the_nearest_by_every_command(command, capsys, tmp_path):
    options = ["--out", str(tmp_path / "a.png")] if command == "render" else []
    assert main([command, "PreStrech", *options]) == 2
    assert "got 'PreStrech'; did you mean 'PreStretch'" in capsys.readouterr().err


def test_file_without_an_ending_is_a_scene(write, capsys):
    assert main(["explain", write("PreStrech", SCENE)]) == 0
    assert "exact" in capsys.readouterr().out
