"""Do the programs of docs/tuning.md run?"""

import re
from pathlib import Path

import pytest

from mm_gym.tuning import CLOSED_FORMS

PAGE = (Path(__file__).parents[2] / "docs" / "tuning.md").read_text("utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


RECORD = "\n\nACCELERATION IN UNITS OF G\nNPTS= 3, DT= .01 SEC\n0.0 0.1 0.0\n"


@pytest.mark.parametrize("number", range(len(BLOCKS)))
def test_program_runs_and_prints_what_the_page_shows(number, monkeypatch, tmp_path, capsys):
    for extra in ("control", "matplotlib"):
        if extra in BLOCKS[number]:
            pytest.importorskip(extra)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "RSN953.AT2").write_text(RECORD)
    exec(compile(BLOCKS[number], f"docs/tuning.md, program {number}", "exec"), {})  # noqa: S102
    shown = re.match(r"\s*```text\n(.*?)```", PAGE.partition(BLOCKS[number])[2][3:], re.DOTALL)
    if shown:
        assert capsys.readouterr().out == shown[1]


def test_page_lists_every_closed_form():
    rows = PAGE.partition("## Closed forms")[2].partition("## ")[0]
    assert re.findall(r"^\| `(\w+)` \|", rows, re.MULTILINE) == list(CLOSED_FORMS)
