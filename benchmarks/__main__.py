"""Measure everything and write docs/benchmarks.md: ``make bench``.

``python -m benchmarks SECTION ...`` measures and prints the named sections and leaves the page
unchanged; ``precision`` always redraws the README's figure.
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
    "nonlinear": "nonlinear",
    "precision": "precision",
    "figure10": "figure10",
    "learning": "learning",
    "evolution": "evolution",
    "startup": "startup",
}
"""The module of each section, imported only when needed because of its optional peers."""

PAGE = Path(__file__).parent.parent / "docs" / "benchmarks.md"
HEADER = """# Benchmarks

Written by `make bench`. Unless a section says otherwise, every ratio is the median over rounds in
which the candidates took turns, and ± is half the interquartile range. Peers that are not installed
are left out.
"""


def main() -> None:
    """Run the named sections, or run all and write the page."""
    asked = sys.argv[1:] or list(SECTIONS)
    unknown = [name for name in asked if name not in SECTIONS]
    if unknown:
        sys.exit(f"unknown section {unknown[0]!r}; allowed: {', '.join(SECTIONS)}")
    parts = []
    for name in asked:
        section = getattr(import_module(f"benchmarks.{SECTIONS[name]}"), name)
        parts.append(section())
        print(parts[-1], flush=True)
    if not sys.argv[1:]:
        write_text(PAGE, "\n".join([HEADER, machine(), "", *parts]))


if __name__ == "__main__":
    main()
