"""Does the command line do what it says, and fail with one message?"""

import sys

import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled

from mm_gym import Scene, simulate
from mm_gym.__main__ import main

SCENE = """
[initial]
carriage_displacement = 0.01

[control]
time_step = 0.01
steps = 20
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE, encoding="utf-8")
    return str(path)


def test_validate_and_explain(file, capsys):
    assert main(["validate", file]) == 0
    assert main(["explain", file]) == 0
    assert "plant    linear" in capsys.readouterr().out


def test_simulate_prints_the_end_and_writes_files(file, tmp_path, capsys):
    pytest.importorskip("matplotlib")
    outputs = ["--csv", str(tmp_path / "t.csv"), "--plot", str(tmp_path / "t.png")]
    assert main(["simulate", file, "--duration", "0.1", *outputs]) == 0
    assert "dissipated" in capsys.readouterr().out
    table = np.loadtxt(tmp_path / "t.csv", delimiter=",", skiprows=1)
    assert table[-1, 0] == 0.1
    assert (tmp_path / "t.png").stat().st_size > 10_000


def test_paper_draws_the_figure_asked_for(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    assert main(["paper", "--figure", "fig12", "--out", str(tmp_path / "new")]) == 0
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["fig12.png"]
    assert "fig12.png" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["validate", "absent.toml"], "no such file"),
        (["simulate", "{file}", "--duration", "-1"], "duration"),
        (["simulate", "{file}", "--csv", "/dev/null/x.csv"], "/dev/null"),
        (["paper", "--figure", "fig11", "--out", "x"], "did you mean 'fig12'"),
    ],
)
def test_errors_are_one_message_and_status_two(arguments, text, file, capsys):
    assert main([argument.format(file=file) for argument in arguments]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("error: ")
    assert text in captured.err
    assert len(captured.err.splitlines()) == 1


@pytest.mark.parametrize("arguments", [["frobnicate"], ["validate"], ["paper"], []])
def test_wrong_usage_has_status_two(arguments):
    with pytest.raises(SystemExit) as error:
        main(arguments)
    assert error.value.code == 2


def test_drawing_without_matplotlib_names_the_extra(monkeypatch, file, capsys):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    trajectory = simulate(Scene(), duration=0.1)
    with pytest.raises(DependencyNotInstalled, match="the extra `plot`"):
        trajectory.plot()
    assert main(["simulate", file, "--plot", "x.png"]) == 2
    assert "the extra `plot`" in capsys.readouterr().err
