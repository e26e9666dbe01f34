"""Pages in Markdown and HTML: templates of prose, which data fill."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from shutil import which

from jinja2 import Environment, FileSystemLoader, StrictUndefined

FOLDER = Path(__file__).with_name("templates")


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def percent(value: float) -> str:
    """Return a ratio in whole per cent; nothing rounds to -0."""
    return f"{round(100.0 * value)} %"


def not_scored_cells(not_scored: Mapping[str, str]) -> list[str]:
    """Return the cell of each controller that is not scored, in one line with the reason."""
    return [
        f"{name}: not scored: {'; '.join(reason.splitlines())}"
        for name, reason in not_scored.items()
    ]


TEMPLATES = Environment(
    loader=FileSystemLoader(FOLDER),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    autoescape=False,  # noqa: S701 - it is Markdown
)
TEMPLATES.globals["table"] = markdown


def render(name: str, **data: object) -> str:
    """Return a page: the template of a name with data, and one empty line between paragraphs."""
    text = TEMPLATES.get_template(f"{name}.md.jinja").render(data)
    return re.sub(r"\n{3,}", "\n\n", text).strip("\n") + "\n"


WEB = TEMPLATES.overlay(autoescape=True)  # the same for HTML, where a name may hold any character


def web_page(name: str, **data: object) -> str:
    """Return a page in HTML: the template of a name with data."""
    return WEB.get_template(f"{name}.html.jinja").render(data)


def commit() -> str:
    """Return the commit of this checkout, "-dirty" behind it where files differ from it."""
    git, root = which("git"), Path(__file__).parents[2]
    if git is None or not (root / ".git").exists():
        return "unknown: not a checkout"
    words = [git, "-C", str(root), "describe", "--always", "--dirty", "--abbrev=40", "--match="]
    done = subprocess.run(words, capture_output=True, text=True, check=False)  # noqa: S603 - no user's text
    return done.stdout.strip() or "unknown"
