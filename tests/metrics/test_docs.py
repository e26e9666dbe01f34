"""Do the programs of docs/evaluation.md run, and do its tables name every field?"""

import re
from dataclasses import fields
from pathlib import Path

import pytest

from mm_gym import metrics

PAGE = (Path(__file__).parents[2] / "docs" / "evaluation.md").read_text("utf-8")


def test_the_programs_print_what_they_say(capsys):
    programs = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    exec(compile("".join(programs), "docs/evaluation.md", "exec"), {})  # noqa: S102 - our own page
    *_, last = capsys.readouterr().out.splitlines()
    assert float(last) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("kind", [metrics.Response, metrics.Indices])
def test_the_tables_name_every_field(kind):
    named = set(re.findall(r"`(\w+)`", PAGE))
    missing = {field.name for field in fields(kind)} - named - {"duration", "weight"}
    assert missing == set()
