"""Are the paper's systems, figures and numbers complete and right?"""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from mm_gym import SceneError, compile_scene, simulate
from mm_gym.paper import NAMES, scene
from mm_gym.paper.figures import FIGURES, draw
from mm_gym.paper.table import HEADER, printed, rows, write_table

GOLDEN = Path(__file__).parents[1] / "golden"
EXPECTED = (
    *(f"fig2{letter}" for letter in "abcdef"),
    *("fig5a", "fig5b", "fig6a", "fig6d", "fig8", "fig9", "fig10", "fig12a", "fig12d"),
)


def golden(file, name):
    return json.loads((GOLDEN / f"{file}.json").read_text(encoding="utf-8"))[name]


def test_every_system_of_the_paper_compiles():
    assert NAMES == EXPECTED
    for name in NAMES:
        compile_scene(scene(name))


def test_an_unknown_name_suggests_the_nearest():
    with pytest.raises(SceneError, match="did you mean 'fig10'"):
        scene("fig11")


@pytest.mark.parametrize(
    ("name", "file", "case"),
    [
        ("fig2d", "massless", "fig2D_swapped"),
        ("fig2f", "massless", "fig2F_d10_swapped"),
        ("fig6a", "duffing", "fig6A"),
        ("fig6d", "duffing", "fig6D"),
    ],
)
def test_systems_have_the_golden_trajectories(name, file, case):
    states = golden(file, case)["states"]
    wanted = np.array([[float(x) for x in row] for row in states.values()])
    found = simulate(scene(name), times=[float(time) for time in states]).state
    scale = np.abs(wanted).max(axis=0) + 1e-300
    # 1e-12 for exact plants, 1e-9 at the default tolerance of the nonlinear ones.
    assert (np.abs(found - wanted) / scale).max() < (1e-9 if file == "duffing" else 1e-12)


def test_computed_numbers_equal_the_stated_ones():
    found = rows()
    assert {row.system for row in found} == set(NAMES)
    for row in found:
        assert row.computed == pytest.approx(row.stated, rel=1e-12, abs=1e-15), row


def test_table_is_written_with_all_digits_and_printed_aligned(tmp_path):
    found = rows()[:3]
    write_table(tmp_path / "numbers.csv", found)
    with (tmp_path / "numbers.csv").open(encoding="utf-8", newline="") as file:
        lines = list(csv.reader(file))
    assert tuple(lines[0]) == HEADER
    assert [float(line[4]) for line in lines[1:]] == [row.computed for row in found]
    assert len(printed(found).splitlines()) == 4


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_is_drawn(name, tmp_path):
    pytest.importorskip("matplotlib")
    draw(name, tmp_path / f"{name}.png")
    assert [file.name for file in tmp_path.iterdir()] == [f"{name}.png"]
    assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
