"""Are the equations of the site typeset, and without a network?"""

import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from browser import chromium

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


def test_pages_with_equations_are_found():
    assert "model" in {page.stem for page in PAGES}
