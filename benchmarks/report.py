"""Tables of the benchmark report."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

from agents.training.runs import commit

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

PACKAGES = (
    "mm-gym",
    "gymnasium",
    "numpy",
    "scipy",
    "numba",
    "torch",
    "stable-baselines3",
    "heyoka",
    "scikit-sundae",
    "gymnax",
    "jax",
    "envpool",
)


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a Markdown table; numbers must be formatted already."""
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join(
        [*lines, *("| " + " | ".join(str(cell) for cell in row) + " |" for row in rows)]
    )


def three_digits(number: float) -> str:
    """Return a number with three digits, and those before the point."""
    text = f"{number:.3g}"
    return f"{number:,.0f}" if "e" in text else text


def machine() -> str:
    """Return processor, system, package versions and the commit as a line."""
    packages = ", ".join(f"{name} {found}" for name in PACKAGES if (found := installed(name)))
    system = f"Python {platform.python_version()} on {platform.system()}"
    return f"*{processor()}, {platform.machine()}; {system}; {packages}; commit {commit()}.*"


def installed(name: str) -> str | None:
    """Return a package's version, or None if it is not installed."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def processor() -> str:
    """Return the name of the processor, as the system states it."""
    information = Path("/proc/cpuinfo")
    if information.exists():
        for line in information.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":")[1].strip()
    return platform.processor() or "unknown"
