"""Do the programs of docs/tuning.md run?"""

import re
from pathlib import Path

import pytest

from mm_gym.tuning import CLOSED_FORMS

PAGE = (Path(__file__).parents[2] / "docs" / "tuning.md").read_text("utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


@pytest.mark.parametrize("number", range(len(BLOCKS)))
def test_program_runs(number, monkeypatch, tmp_path):
    for extra in ("control", "matplotlib"):
        if extra in BLOCKS[number]:
            pytest.importorskip(extra)
    monkeypatch.chdir(tmp_path)
    exec(compile(BLOCKS[number], f"docs/tuning.md, program {number}", "exec"), {})  # noqa: S102


def test_page_lists_every_closed_form():
    rows = PAGE.partition("## Closed forms")[2]
    assert re.findall(r"^\| `(\w+)` \|", rows, re.MULTILINE) == list(CLOSED_FORMS)
