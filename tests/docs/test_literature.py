"""Is every publication that the pages name by author and year in the list?"""

import re
from pathlib import Path
from urllib.parse import unquote

import pytest

DOCS = Path(__file__).parents[2] / "docs"
ENTRIES = [
    " ".join(entry.partition("\n\n")[0].split())
    for entry in re.split(r"^- ", (DOCS / "literature.md").read_text("utf-8"), flags=re.MULTILINE)
]
NAME = r"[A-ZÅŠ][\w-]+"
CITED = re.compile(
    rf"\b(?:Den )?({NAME})(?: et al\.| and others|(?:, {NAME})* and {NAME})?,? \(?(\d{{4}})\b"
)
PAGES = ("controllers", "tuning", "model", "excitation", "evaluation", "numerics", "training")
JOURNALS = {"Dynamics", "Structures"}  # last words of journals' names that a year follows
IDENTIFIED = re.compile(
    r"\(https://\S+\)|ISBN [\dX-]{13,17}\b|no DOI verified$"
    r"|, (?:Addison-Wesley|McGraw-Hill|Pearson|Wiley) \(\d{4}\)$"
)
"""A link (of a DOI, a preprint or a record), an ISBN, a book's publisher, or what is missing."""
UNVERIFIED = 27  # articles without a verified DOI: fewer are welcome, more need a look for it


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


def test_every_publication_can_be_found():
    """By a link, an ISBN or a publisher; otherwise the entry says that no DOI is known."""
    assert len(ENTRIES) > len(PAGES)
    assert [entry for entry in ENTRIES[1:] if not IDENTIFIED.search(entry)] == []


def test_only_articles_lack_a_doi_and_no_more_than_before():
    lacking = [entry for entry in ENTRIES[1:] if entry.endswith("no DOI verified")]
    assert len(lacking) == UNVERIFIED
    assert [entry for entry in lacking if not re.search(r" \d+ \(\d{4}\), no DOI", entry)] == []


def test_a_link_to_a_doi_is_the_doi_that_is_printed():
    printed = re.findall(r"\[doi:(\S+)\]\(https://doi\.org/(\S+)\)", " ".join(ENTRIES))
    assert len(printed) == " ".join(ENTRIES).count("doi.org/")
    assert [pair for pair in printed if pair[0] != unquote(pair[1])] == []
