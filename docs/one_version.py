"""Refuse a release whose tag, package, citation and changelog state different versions.

`python docs/one_version.py v0.1.0`; without a tag it compares the rest.
"""

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def stated(root: Path) -> dict[str, str | None]:
    """Return the version that each file states."""
    citation = (root / "CITATION.cff").read_text("utf-8")
    changelog = (root / "docs" / "changelog.md").read_text("utf-8")
    found = {
        "CITATION.cff": re.search(r"^version: (\S+)$", citation, re.MULTILINE),
        "docs/changelog.md": re.search(r"^## (\d\S*)", changelog, re.MULTILINE),
    }
    package = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    return {"pyproject.toml": package} | {name: m and m[1] for name, m in found.items()}


def main(tags: list[str], root: Path = ROOT) -> str | None:
    """Return what differs, or nothing."""
    versions = stated(root) | {f"the tag {tag}": tag.removeprefix("v") for tag in tags if tag}
    if len(set(versions.values())) == 1:
        return None
    return "versions differ: " + ", ".join(f"{name} {found}" for name, found in versions.items())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
