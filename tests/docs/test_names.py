"""Does what the pages import, name and point at exist?"""

import re
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
PAGES += sorted((ROOT / "docs" / "clients").glob("*.md"))
PAGES = [page for page in PAGES if page.name != "changelog.md"]  # it tells of what was
IMPORT = re.compile(r"^(?:>>> )?from ((?:mm_gym|agents)[\w.]*) import ([\w, ]+)$", re.MULTILINE)
NAME = re.compile(r"`((?:mm_gym|agents)(?:\.\w+)+)(?:\([^`]*\))?`")
PLACE = re.compile(r"`((?:agents|benchmarks|configs|docs|mm_gym|tests)/[\w/.-]+\.\w+)`")


def exists(name):
    """Return whether a dotted name is a module, or an attribute of one."""
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        try:
            found = import_module(".".join(parts[:k]))
        except ModuleNotFoundError:
            continue
        for part in parts[k:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_names_and_files_of_pages_exist(page):
    text = page.read_text("utf-8")
    names = [f"{m}.{one.strip()}" for m, all_ in IMPORT.findall(text) for one in all_.split(",")]
    names += NAME.findall(text)
    assert [name for name in dict.fromkeys(names) if not exists(name)] == []
    assert [place for place in PLACE.findall(text) if not (ROOT / place).exists()] == []
