"""The site: `make docs` builds these pages, the reference and the executed examples with Sphinx."""

from __future__ import annotations

import re
import sys
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
from docutils import nodes
from sphinx.errors import ExtensionError
from sphinx_gallery.directives import imgsgnode

if TYPE_CHECKING:
    from sphinx.application import Sphinx

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from animations import animate_tasks  # noqa: E402 - Sphinx runs this file by itself
from links import broken  # noqa: E402
from scene_fields import scene_fields  # noqa: E402

from mm_gym.drawing import COLOURS  # noqa: E402

project = "mm_gym"
author = "the developers of mm_gym"
release = metadata.version("mm-gym")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "sphinxcontrib.programoutput",
]
# A copy on the site, one file without fonts: equations are seen without a network.
MATHJAX = next(
    one for one in metadata.files("sphinx-mathjax-offline") or () if one.name == "tex-svg.js"
).locate()
mathjax_path = MATHJAX.name
exclude_patterns = ["_build", "examples", "gallery/*.ipynb", "gallery/*.md5"]
suppress_warnings = ["config.cache"]  # `palette` is a function
nitpicky = False  # types of numba and pydantic have no pages to point at

myst_fence_as_directive = ["math"]  # GitHub typesets these fences too
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # numpydoc's sections say types and units
napoleon_custom_sections = [  # of environments, as Gymnasium writes them
    "Description",
    "Action Space",
    "Observation Space",
    "Rewards",
    "Starting State",
    "Episode End",
    "Information",
    "Continuation",
    "Through Gymnasium",
    "Version History",
]
napoleon_use_ivar = True


def palette(*_: object) -> None:
    """Draw every example in the colours of all other figures."""
    mpl.rcParams["axes.prop_cycle"] = mpl.cycler(color=COLOURS)


sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "write_computation_times": False,  # its page loads scripts from the network
    "show_signature": False,
    "remove_config_comments": True,
    "reset_modules": ("matplotlib", palette),
    "within_subsection_order": "FileNameSortKey",
}

default_role = "code"

copybutton_exclude = ".linenos, .gp, .go"

html_theme = "furo"
html_title = "mm_gym"
html_show_copyright = False
html_static_path = ["static", str(MATHJAX)]
html_css_files = ["site.css"]


def prepare(*arguments: object) -> None:
    """Escape |x| in docstrings, which would be a substitution, and link the pages named there."""
    lines = arguments[-1]
    text = re.sub(r"(``.*?``)|\|", lambda m: m[1] or r"\|", "\n".join(lines), flags=re.DOTALL)
    text = re.sub(r"`?docs/([\w/-]+)\.md`?", r":doc:`\1 </\1>`", text)
    # Written out, the types of arrays are longer than what they hold.
    text = re.sub(r"numpy\.ndarray\[tuple\[Any, \.\.\.\], numpy\.dtype\[.*?\]\]", "array", text)
    # Sphinx would take the first of several names of attributes for a type.
    text = re.sub(r"(?m)^:ivar .*?:", lambda m: m[0].replace(", ", ",\u200b"), text)
    lines[:] = text.split("\n")


def is_position(*arguments: object) -> bool | None:
    """Leave out that a field of a named tuple has a number."""
    return True if "alias for field number" in (arguments[3].__doc__ or "").lower() else None


def describe_pictures(app: Sphinx, doctree: nodes.document, page: str) -> None:
    """Give the pictures of an example, here and in the list, the words that begin its page."""
    if page.startswith("gallery/"):
        for picture in [*doctree.findall(nodes.image), *doctree.findall(imgsgnode)]:
            example = re.sub(r"^sphx_glr_|_thumb$|_\d+$", "", Path(picture["uri"]).stem)
            text = app.env.get_doctree(f"gallery/{example}").next_node(nodes.section)
            picture["alt"] = text.next_node(nodes.paragraph).astext()
            if isinstance(picture, imgsgnode):  # wide figures scroll in their container
                picture.replace_self(nodes.container("", picture.deepcopy(), classes=["picture"]))


PROSE = nodes.paragraph | nodes.emphasis | nodes.strong
SHORT = 24  # letters of a name in a table that is not broken into lines


def keep_numbers_whole(_app: Sphinx, doctree: nodes.document, _page: str) -> None:
    """Keep browsers from breaking 1e-14 after its sign."""
    for text in list(doctree.findall(nodes.Text)):
        pieces = re.split(r"(?<![\w.])(\d[\d.]*e-\d+)", text)
        if len(pieces) > 1 and isinstance(text.parent, PROSE):
            parts = [
                nodes.inline("", piece, classes=["number"]) if index % 2 else nodes.Text(piece)
                for index, piece in enumerate(pieces)
            ]
            text.parent.replace(text, parts)


def break_names_at_their_joints(_app: Sphinx, doctree: nodes.document, _page: str) -> None:
    """Let long names in tables go on in the next line after a joint, and short ones not at all."""
    for name in [one for row in doctree.findall(nodes.row) for one in row.findall(nodes.literal)]:
        text = name.astext()
        if len(text) <= SHORT:
            name["classes"].append("number")
            continue
        pieces = re.split(r"(?<=[_./:,=(-])(?=\w)", text)
        name.children = []
        for piece in pieces:
            name += [nodes.Text(piece), nodes.raw("", "<wbr>", format="html")]
        name.pop()  # no line begins with the comma after a name


def check_links(app: Sphinx, error: Exception | None) -> None:
    """End the build with an error where a link leads nowhere, or a page loads from elsewhere."""
    wrong = [] if error or app.builder.format != "html" else broken(Path(app.outdir))
    if wrong:
        raise ExtensionError("\n".join(["broken links", *wrong]))


def setup(app: Sphinx) -> None:
    """Make what is drawn and written anew for each build."""
    app.connect("autodoc-process-docstring", prepare)
    app.connect("autodoc-skip-member", is_position)
    app.connect("doctree-resolved", describe_pictures)
    app.connect("doctree-resolved", keep_numbers_whole)
    app.connect("doctree-resolved", break_names_at_their_joints)
    app.connect("build-finished", check_links)
    animate_tasks()
    (HERE / "reference" / "scene-fields.md").write_text(scene_fields(), encoding="utf-8")
