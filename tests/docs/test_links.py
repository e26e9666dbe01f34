"""Does every link in the pages lead to a file, and to a heading in it?

Pages are read on GitHub too, where nothing is built. `make docs` checks the built site.
"""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs"))
from links import broken  # noqa: E402 - it is next to the pages

PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *ROOT.glob(".github/*.md")])
PAGES = [page for page in PAGES if not {"_build", "gallery"} & set(page.parts)]

MADE = ("docs/gallery", "docs/task-gallery.md", "docs/reference/scene-fields.md", "docs/static")
"""What `make docs` makes."""

LINK = re.compile(r"!?\[(?:[^\[\]]|\[[^\]]*\])*\]\(([^()\s]+)\)")
CODE = re.compile(r"^```.*?^```$|^ {4}[^\n]*$|`[^`\n]*`", re.MULTILINE | re.DOTALL)
HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE)
LABEL = re.compile(r"^\(([\w-]+)\)=$", re.MULTILINE)


def places(page):
    """The anchors of a page, as GitHub and MyST make them of headings."""
    text = re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)
    found = list(LABEL.findall(text))
    for heading in HEADING.findall(text):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        slug = re.sub(r"[^\w\- ]", "", words.lower().strip()).replace(" ", "-")
        again = sum(
            one == slug or re.fullmatch(rf"{re.escape(slug)}-\d+", one) is not None for one in found
        )
        found.append(f"{slug}-{again}" if again else slug)
    return found


def links(page):
    """The targets of a page's links, and whether each is in the checkout."""
    text = CODE.sub("", page.read_text("utf-8"))
    for link in LINK.findall(text):
        if not re.match(r"[a-z]+:", link):
            yield link


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_to_a_file_and_a_heading(page):
    wrong = []
    for link in links(page):
        path, _, place = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        if target.suffix == "" and not target.exists():
            target = target.with_suffix(".md")
        if target.is_relative_to(ROOT) and str(target.relative_to(ROOT)).startswith(MADE):
            continue
        if not target.exists():
            wrong.append(f"{link}: no such file")
        elif place and target.suffix == ".md" and place not in places(target):
            wrong.append(f"{link}: no such heading")
    assert not wrong


def test_pages_have_links():
    assert sum(1 for page in PAGES for _ in links(page)) > 150


def test_site_with_a_link_that_leads_nowhere_is_refused(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "a.html").write_text('<h1 id="here">a</h1><a href="sub/b.html#there">b</a>')
    (tmp_path / "sub" / "b.html").write_text('<p id="there"><a href="../a.html#here">a</a>')
    assert broken(tmp_path) == []
    (tmp_path / "c.html").write_text(
        '<a href="a.html#no">1</a><img src="no.png"><a href="https://x.org">2</a><a href="#">3</a>'
        '<img src="data:,"><script src="https://x.org/a.js"></script><link href="//x.org/a.css">'
    )
    assert broken(tmp_path) == [
        "c.html: a.html#no: no such place on that page",
        "c.html: no.png: no such file",
        "c.html: https://x.org/a.js: loaded from elsewhere",
        "c.html: //x.org/a.css: loaded from elsewhere",
    ]


WORDS = ROOT / "docs" / "replaced_words.txt"


@pytest.mark.parametrize("line", WORDS.read_text("utf-8").splitlines())
def test_replaced_words_are_refused(line, tmp_path):
    old, _, new = line.partition("->")
    (tmp_path / "page.md").write_text(f"What the {old} is.\nWhat is {new}\n")
    told = (ROOT / "Makefile").read_text("utf-8")
    regex = (
        re.search(r"-r \"(.*?)\" \\\n", told)[1].replace("$$", "$").replace("$(WORDS)", str(WORDS))
    )
    words = f'{sys.executable} -m codespell_lib -D {WORDS} -r "{regex}" {tmp_path}/page.md'
    done = subprocess.run(["/bin/sh", "-c", words], capture_output=True, text=True, check=False)
    (found,) = done.stdout.splitlines()
    assert f"page.md:1: {old} ==> " in found
    assert done.returncode != 0
