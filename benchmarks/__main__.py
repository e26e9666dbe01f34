"""Measure everything and write docs/benchmarks.md: ``make bench``.

``python -m benchmarks SECTION ...`` measures and prints the named sections, and ``--write`` puts
them on the page in place of what it has; ``precision`` and ``lanes`` always redraw their figures.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

from benchmarks.report import machine
from mm_gym.files import write_text

SECTIONS = {
    "single": "stepping",
    "vector": "stepping",
    "threads": "stepping",
    "learner": "learner",
    "lanes": "lanes",
    "grid": "grid",
    "methods": "methods",
    "interfaces": "interfaces",
    "devices": "devices",
    "jacobians": "jacobians",
    "precision": "precision",
    "figure10": "figure10",
    "learning": "learning",
    "evolution": "evolution",
    "startup": "startup",
}
"""The module of each section, imported only when needed because of its optional peers."""

PAGE = Path(__file__).parent.parent / "docs" / "benchmarks.md"
HEADER = """# Benchmarks

`make bench` writes this page; a comment above each section in the source of the page has the
command that writes this section alone. Unless a section says otherwise, every ratio is the median
over rounds in which the candidates took turns, and ± is half the interquartile range. Peers that
are not installed are left out. The last line of a section names the processor, the versions, and
the commit that was measured or, for older sections, the commit that added the numbers.
"""
MARK = "<!-- python -m benchmarks --write {} -->"


def main() -> None:
    """Run the named sections, or run all, and write the page if asked to."""
    asked = [name for name in sys.argv[1:] if name != "--write"] or list(SECTIONS)
    unknown = [name for name in asked if name not in SECTIONS]
    if unknown:
        sys.exit(f"unknown section {unknown[0]!r}; allowed: --write, {', '.join(SECTIONS)}")
    for name in asked:
        section = getattr(import_module(f"benchmarks.{SECTIONS[name]}"), name)
        text = f"{section()}\n{machine()}\n"
        print(text, flush=True)
        if len(sys.argv) == 1 or "--write" in sys.argv:
            _put(name, text)


def _put(name: str, text: str) -> None:
    """Write a section in its place on the page."""
    page = PAGE.read_text(encoding="utf-8") if PAGE.exists() else ""
    own = {name: text}
    for other in SECTIONS:
        _, found, rest = page.partition(MARK.format(other) + "\n")
        if found and other != name:
            own[other] = rest.split(MARK.split("{}", maxsplit=1)[0])[0]
    parts = [f"{MARK.format(one)}\n{own[one].strip()}\n" for one in SECTIONS if one in own]
    write_text(PAGE, "\n".join([HEADER, *parts]))


if __name__ == "__main__":
    main()
