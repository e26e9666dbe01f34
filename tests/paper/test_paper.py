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
    *(f"fig2{letter}_caption" for letter in "abcdef"),
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


def test_computed_numbers_equal_the_references():
    found = rows()
    assert {row.system for row in found} == set(NAMES)
    for row in found:
        assert row.computed == pytest.approx(row.reference, rel=1e-12, abs=1e-15), row


def test_stated_is_only_what_the_paper_states_and_every_reference_has_its_provenance():
    found = rows()
    stated = [row for row in found if row.stated is not None]
    # All digits that the paper gives, four at most; mu1 = 0.5097 makes 1.00003 of the linear 1.
    for row in stated:
        assert row.stated == round(row.stated, 4)
        assert row.computed == pytest.approx(row.stated, rel=1e-4, abs=1e-15), row
    # -4 mm of 5A is the sum of two numbers that it states, and itself stated nowhere.
    assert {row.stated for row in stated} == {0.0, 0.02, 0.03, 0.4635, 1.0}
    quantities = {row.quantity for row in found if row.stated is None}
    assert {"real part of the eigenvalue", "k2 at stretch 1.5"} < quantities
    assert {row.provenance for row in found} == {
        "first integral",
        "equilibrium",
        "ball arithmetic",
        "arithmetic",
    }


def test_table_is_written_with_all_digits_and_printed_aligned(tmp_path):
    found = [row for row in rows() if row.system in {"fig2a", "fig10"}]
    write_table(tmp_path / "numbers.csv", found)
    with (tmp_path / "numbers.csv").open(encoding="utf-8", newline="") as file:
        lines = list(csv.reader(file))
    assert tuple(lines[0]) == HEADER
    columns = dict(zip(HEADER, zip(*lines[1:], strict=True), strict=True))
    assert [float(text) for text in columns["computed"]] == [row.computed for row in found]
    assert [float(text) for text in columns["reference"]] == [row.reference for row in found]
    assert {text == "" for text in columns["stated"]} == {True, False}
    assert len(printed(found).splitlines()) == 1 + len(found)
    ends = {line.index("  ", line.index("arithmetic")) for line in printed(found).splitlines()[2:4]}
    assert len(ends) == 1


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_is_drawn(name, tmp_path):
    pytest.importorskip("matplotlib")
    draw(name, tmp_path / f"{name}.png")
    assert [file.name for file in tmp_path.iterdir()] == [f"{name}.png"]
    assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
