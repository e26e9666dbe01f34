"""Are the equations of the site typeset, and without a network?"""

import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from browser import chromium
from docutils import nodes
from docutils.utils import new_document

DOCS = Path(__file__).parents[2] / "docs"
PAGES = sorted(page for page in DOCS.glob("*.md") if "\n```math\n" in page.read_text("utf-8"))
COPIED = ("html_theme", "mathjax_path", "myst_enable_extensions", "myst_fence_as_directive")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The pages with equations, built with the site's settings; links to other pages are dead."""
    folder = tmp_path_factory.mktemp("site")
    for file in [*PAGES, *DOCS.glob("*.png")]:
        shutil.copy(file, folder)
    (folder / "index.md").write_text("# Equations\n\n```{toctree}\n:glob:\n\n*\n```\n")
    settings = runpy.run_path(str(DOCS / "conf.py"))
    own = {name: settings[name] for name in COPIED}
    own["extensions"] = ["myst_parser", "sphinx.ext.mathjax"]
    own["html_static_path"] = [str(DOCS / path) for path in settings["html_static_path"]]
    (folder / "conf.py").write_text("".join(f"{name} = {own[name]!r}\n" for name in own))
    command = [sys.executable, "-m", "sphinx", "-q", "-b", "html", str(folder)]
    subprocess.run([*command, str(folder / "html")], check=True, capture_output=True)
    return folder / "html"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with chromium(tmp_path_factory.mktemp("profile")) as found:
        yield found


@pytest.mark.browser
@pytest.mark.parametrize("page", [page.stem for page in PAGES])
def test_equations_are_typeset_without_a_request(browser, site, page):
    browser.open(site / f"{page}.html", 1280)
    browser.run("window.MathJax?.startup?.promise")
    asked = "['.math', '.math > mjx-container', 'mjx-container [data-mml-node=merror]']"
    written, typeset, wrong = browser.run(
        f"{asked}.map(one => document.querySelectorAll(one).length)"
    )
    assert written == typeset > 0
    assert wrong == 0
    assert browser.requests() == []
    assert browser.complaints() == []


def test_names_and_numbers_in_tables_break_at_joints_only():
    conf = runpy.run_path(str(DOCS / "conf.py"))
    long = nodes.literal("", "tests/paper/test_equations.py::test_every_motion")
    short = nodes.literal("", "--new-version")
    bold = nodes.strong("", "242 (1e-12)")
    table = nodes.row(
        "", *(nodes.entry("", nodes.paragraph("", "", x)) for x in (long, short, bold))
    )
    page = new_document("page")
    page += table
    conf["keep_numbers_whole"](None, page, "")
    conf["break_names_at_their_joints"](None, page, "")
    assert [one.astext() for one in long.children if isinstance(one, nodes.Text)] == [
        *("tests/", "paper/", "test_", "equations.", "py::", "test_", "every_", "motion")
    ]
    assert long.children[1].astext() == "<wbr>"
    assert short["classes"] == bold.children[1]["classes"] == ["number"]
    assert bold.children[1].astext() == "1e-12"


def test_fields_of_scenes_are_told_in_short_numbers_and_whole_sentences():
    text = runpy.run_path(str(DOCS / "scene_fields.py"))["scene_fields"]()
    assert re.findall(r"\d{9,}", text) == []
    assert "at most 16777216 |" in text  # a limit is whole
    assert "```none\nreward = -(w_x" in text
    head = [part.partition("\n\n")[2].lstrip() for part in text.split("\n## ")[1:]]
    assert [one for one in head if not re.match(r"[A-Z`#]", one)] == []


@pytest.mark.parametrize(
    "page", [*DOCS.glob("*.md"), *DOCS.glob("clients/*.md")], ids=lambda page: page.stem
)
def test_a_page_has_one_title(page):
    """Each further one is another entry of the site's list of pages."""
    prose = re.sub(r"(?ms)^```.*?^```$", "", page.read_text("utf-8"))
    assert len(re.findall(r"(?m)^# ", prose)) == 1


def test_pages_with_equations_are_found():
    assert "model" in {page.stem for page in PAGES}
