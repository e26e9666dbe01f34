"""Copy the golden values of nonlinear plants, limits and dampers out of their reference.

    python tests/golden/make_nonlinear.py REFERENCE.json

The reference values were computed without this project's code: ball arithmetic for the linear and
dry-friction systems, a Taylor series of order 42 with 60 digits for the cubic spring. Every digit
given is correct.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

HERE = Path(__file__).parent
STATES = ("fig8_chi0.1", "fig9")
MASSLESS = ("fig2D_swapped", "fig2F_d10_swapped")


def main(reference: str) -> None:
    """Write friction.json, duffing.json, massless.json and tmd.json next to this file."""
    values = json.loads(Path(reference).read_text())
    provenance = values["meta"]["source"]
    friction = values["friction"]
    contents = {
        "friction": {
            "asymptotes": friction["fig10_points"],
            "states": {name: friction[name] for name in STATES},
        },
        "duffing": values["duffing"],
        "massless": {name: values["linear"][name] for name in MASSLESS},
        "tmd": values["tmd"],
    }
    for name, content in contents.items():
        text = json.dumps({"provenance": provenance} | content, indent=1)
        (HERE / f"{name}.json").write_text(text + "\n")


if __name__ == "__main__":
    main(sys.argv[1])
