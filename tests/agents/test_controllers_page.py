"""Does the program of docs/controllers.md run, and does the page name every controller's module?"""

import re
from pathlib import Path

import pytest
from tasks import CARRIAGE_FORCE

from agents.controllers.user_defined import user_defined
from agents.scoring import evaluate

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "controllers.md").read_text("utf-8")
PROGRAM, OWN = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def test_the_program_prints_what_each_reads(capsys) -> None:
    exec(compile(PROGRAM, "docs/controllers.md", "exec"), {})  # noqa: S102 - our own page
    seen, known = capsys.readouterr().out.splitlines()
    assert "reads the observation" in seen
    assert "reads the full state" in known
    costs = [float(line.rpartition(" ")[2]) for line in (seen, known)]
    # The first frame shows the whole state and nothing disturbs it: late is as good as at once.
    assert abs(costs[0] - costs[1]) < 0.01


def test_every_law_of_the_page_exists() -> None:
    modules = "".join(
        file.read_text("utf-8") for file in (ROOT / "agents" / "controllers").glob("*.py")
    )
    names = re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE)
    assert len(names) >= 9
    assert [name for name in names if f"class {name}" not in modules] == []


@pytest.mark.parametrize("name", ["Damper", "Smooth"])
def test_law_of_the_page_can_be_scored(name, tmp_path) -> None:
    (tmp_path / "my_law.py").write_text(OWN)
    _, seen = user_defined(f"{tmp_path / 'my_law.py'}:{name}", CARRIAGE_FORCE)
    assert seen.law.remembers == (name == "Smooth")
    assert evaluate(CARRIAGE_FORCE, seen, episodes=20).cost < 0.09
