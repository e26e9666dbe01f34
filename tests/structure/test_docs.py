"""Do the programs of docs/structures.md run, and print what the page shows?"""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mm_gym import load_scene
from mm_gym.structure import EXAMPLES

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "structures.md").read_text("utf-8")
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT)}
PROGRAMS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
SHOWN = re.findall(r"```(?:text|none)\n(.*?)```", PAGE, re.DOTALL)


def record():
    """A text in PEER's format: ten seconds of noise that dies away, in g."""
    times = 0.02 * np.arange(500)
    values = 0.1 * np.random.default_rng(7).normal(size=500) * np.exp(-0.3 * times)
    samples = "\n".join(f"{value:.6e}" for value in values)
    return f"\n\nACCELERATION IN UNITS OF G\nNPTS= 500, DT= .02 SEC\n{samples}\n"


def test_frame_and_record_become_a_scene_with_its_error(monkeypatch, tmp_path, capsys):
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "RSN953.AT2").write_text(record())
    exec(compile(PROGRAMS[0], "docs/structures.md, program 1", "exec"), {})  # noqa: S102
    printed = capsys.readouterr().out
    # The last digits of what is 0 but for round-off differ between machines.
    told, expected = (re.sub(r"by \S+ at most", "", text) for text in (printed, SHOWN[0]))
    assert told.startswith(expected)
    assert "drift of storey 5" in printed
    assert len(load_scene("frame.toml").excitation) == 2
    assert (tmp_path / "frame.png").stat().st_size > 10_000


def test_errors_are_those_of_the_page(capsys):
    exec(compile(PROGRAMS[1], "docs/structures.md, program 2", "exec"), {})  # noqa: S102
    assert capsys.readouterr().out == SHOWN[1]


def test_errors_under_control_are_those_of_the_page(capsys):
    pytest.importorskip("control")
    exec(compile(PROGRAMS[2], "docs/structures.md, program 3", "exec"), {})  # noqa: S102
    assert capsys.readouterr().out == SHOWN[2]


def test_frame_and_record_become_a_learned_controller_and_a_figure(monkeypatch, tmp_path, capsys):
    for name in ("matplotlib", "cma"):
        pytest.importorskip(name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "RSN953.AT2").write_text(record())
    (tmp_path / "frame.py").write_text(PROGRAMS[3])
    exec(compile(PROGRAMS[3], "frame.py", "exec"), {})  # noqa: S102
    assert [len(load_scene(f"{name}.toml").excitation) for name in ("train", "quake")] == [1, 2]
    section = PAGE.partition("to a learned controller\n")[2].partition("\n## ")[0]
    commands = re.findall(r"^    python -m agents[. ](.*)$", section, re.MULTILINE)
    shorter = {"evolve": "--generations 1 --threads 1", "evaluate": "--episodes 2"}
    for command in commands:
        # All baselines take minutes to tune.
        words = command.replace("baselines", "no-control").split()
        words += shorter.pop(words[0]).split()
        subprocess.run(
            [sys.executable, "-m", "agents", *words], check=True, cwd=tmp_path, env=ENVIRONMENT
        )
    assert not shorter
    assert (tmp_path / "comparison" / "costs.png").stat().st_size > 10_000
    exec(compile(PROGRAMS[4], "docs/structures.md, program 5", "exec"), {})  # noqa: S102
    told = capsys.readouterr().out
    assert [line[:13].strip() for line in told.splitlines()] == [
        "tuned damper",
        "semi-active",
        "learned",
    ]
    assert (tmp_path / "comparison.png").stat().st_size > 10_000


def test_lqg_of_the_page_compiles_without_a_warning(monkeypatch, tmp_path):
    pytest.importorskip("control")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "RSN953.AT2").write_text(record())
    exec(compile(PROGRAMS[3] + PROGRAMS[5], "frame.py", "exec"), {})  # noqa: S102
    section = PAGE.partition("## An LQG and its C code\n")[2].partition("\n## ")[0]
    commands = re.findall(r"^    ((?:python -m agents export|cc) .*)$", section, re.MULTILINE)
    assert len(commands) == 2
    for command in commands:
        words = command.replace("python", sys.executable, 1).split()
        done = subprocess.run(
            words, check=True, cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True
        )
    assert done.stderr == ""
    assert (tmp_path / "lqg.o").stat().st_size > 1_000


def test_page_lists_every_example():
    rows = PAGE.partition("## Examples")[2]
    assert re.findall(r"^\| `(\w+)` \|", rows, re.MULTILINE) == list(EXAMPLES)
