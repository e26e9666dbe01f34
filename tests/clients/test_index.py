"""Are all pages on clients listed, run, and tested with the versions that they state?"""

import re
from pathlib import Path

import pytest
from pages import PAGES, ROOT, blocks

NAMES = sorted(path.stem for path in PAGES.glob("*.md") if path.stem != "README")
INDEX = (PAGES / "README.md").read_text(encoding="utf-8")
TESTS = {path.name: path.read_text(encoding="utf-8") for path in Path(__file__).parent.glob("*.py")}


@pytest.mark.parametrize("name", NAMES)
def test_page_is_listed_and_its_blocks_are_run(name):
    assert f"]({name}.md)" in INDEX
    assert blocks(name)
    assert any(f'run_page("{name}"' in text for text in TESTS.values())


@pytest.mark.parametrize("name", NAMES)
def test_links_of_a_page_lead_somewhere(name):
    text = (PAGES / f"{name}.md").read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#]+)\)", text):
        assert (PAGES / target).exists(), target


def test_stated_versions_are_the_pinned_ones():
    pins = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    table = INDEX.partition("## ")[0]
    stated = re.findall(r"([a-z_][a-z0-9_-]+) (\d+\.\d+\.\d+)\b", table)
    assert len(stated) == 11
    for package, version in stated:
        assert f"{package}=={version}" in pins


def test_every_client_has_a_target_and_is_tested_in_ci():
    made = re.search(r"^CLIENTS := (.*)$", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)
    workflow = (ROOT / ".github/workflows/clients.yml").read_text("utf-8")
    clients = made[1].split()
    assert f"client: [{', '.join(clients)}]" in workflow
    assert {f"test_{client}.py" for client in clients} <= TESTS.keys()
