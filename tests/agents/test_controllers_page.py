"""Does the program of docs/controllers.md run, and does the page name every controller's module?"""

import re
from pathlib import Path

import pytest
from tasks import CARRIAGE_FORCE

from agents.controllers.user_defined import user_defined
from agents.scoring import evaluate

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "controllers.md").read_text("utf-8")
PROGRAM, OBSERVER, OWN = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
PRINTED = re.findall(r"^```text\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize(
    ("program", "printed"), list(zip((PROGRAM, OBSERVER), PRINTED, strict=True))
)
def test_programs_print_what_the_page_says(program, printed, capsys, monkeypatch) -> None:
    monkeypatch.chdir(ROOT)
    exec(compile(program, "docs/controllers.md", "exec"), {})  # noqa: S102 - our own page
    told = capsys.readouterr().out
    assert told == printed
    first, second = (float(line.rpartition(" ")[2]) for line in told.splitlines())
    assert second < first, "nothing is learned from two equal costs"


def test_every_law_of_the_page_exists() -> None:
    modules = "".join(
        file.read_text("utf-8") for file in (ROOT / "agents" / "controllers").glob("*.py")
    )
    names = re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE)
    assert len(names) >= 9
    assert [
        name for name in names if not re.search(rf"^(class|def) {name}\b", modules, re.MULTILINE)
    ] == []


@pytest.mark.parametrize("name", ["Damper", "Smooth"])
def test_law_of_the_page_can_be_scored(name, tmp_path) -> None:
    (tmp_path / "my_law.py").write_text(OWN)
    _, seen = user_defined(f"{tmp_path / 'my_law.py'}:{name}", CARRIAGE_FORCE)
    assert bool(seen.law.begin(1)) == (name == "Smooth")
    assert evaluate(CARRIAGE_FORCE, seen, episodes=20).cost < 0.09
