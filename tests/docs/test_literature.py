"""Is every publication that the pages name by author and year in the list?"""

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
ENTRIES = [
    " ".join(entry.split())
    for entry in re.split(r"^- ", (DOCS / "literature.md").read_text("utf-8"), flags=re.MULTILINE)
]
NAME = r"[A-ZÅŠ][\w-]+"
CITED = re.compile(
    rf"\b(?:Den )?({NAME})(?: et al\.| and others|(?:, {NAME})* and {NAME})?,? \(?(\d{{4}})\b"
)
PAGES = ("controllers", "tuning", "model", "excitation", "evaluation", "numerics", "training")
JOURNALS = {"Dynamics", "Structures"}
"""Last words of journals' names that a year follows."""


@pytest.mark.parametrize("page", PAGES)
def test_cited_publications_are_listed(page):
    text = " ".join((DOCS / f"{page}.md").read_text("utf-8").split())
    text = re.sub(r"`[^`]*`", "", text.replace("**", ""))
    text = re.sub(r"(?<= )\*(?=\w)[^*|]+\*,?", "", text)  # titles
    cited = {(name, year) for name, year in CITED.findall(text) if 1900 < int(year) < 2030}
    missing = [
        (name, year)
        for name, year in sorted(cited)
        if name not in JOURNALS
        and not any(name in entry and f"({year})" in entry for entry in ENTRIES)
    ]
    assert missing == [], "add them to docs/literature.md"
