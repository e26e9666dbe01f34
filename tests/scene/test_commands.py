"""The commands about scene files: what they print, write and return."""

import csv

import pytest
from tasks import TASKS

from mm_gym import simulate
from mm_gym.__main__ import main

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
        files[2],
        files[0] + "x",
    ]
    assert "did you mean 'a.toml'?" in lines[-1]


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
        (["--csv", "."], "error: "),
    ],
)
def test_wrong_option_is_one_message(write, capsys, options, words):
    assert main(["simulate", write("a.toml", SCENE), *options]) == 2
    assert words in capsys.readouterr().err


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
