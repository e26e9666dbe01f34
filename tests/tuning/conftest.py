"""Rigs that are tuned, and the golden optima."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mm_gym import Scene

GOLDEN: dict[str, Any] = json.loads(
    (Path(__file__).parents[1] / "golden" / "tmd.json").read_text("utf-8")
)
del GOLDEN["provenance"]


def rig(mass_ratio: float, *, damping: float = 0.0, k0: float | None = None) -> Scene:
    """Return a rig of 1 kg and 100 rad/s, whose springs reach the optima unless k0 is given.

    Without k0 they have k2 = 4 k0 at f = 1 / (1 + mu), in the middle of what they reach.
    """
    if k0 is None:
        k0 = mass_ratio * (100.0 / (1.0 + mass_ratio)) ** 2 / 4.0
    return Scene(
        carriage={"mass": 1.0, "stiffness": 1e4, "damping": damping},
        sphere={"mass": mass_ratio},
        springs={"kind": "small_on_large", "stiffness": k0, "stretch": 1.3},
        control={"time_step": 0.01, "steps": 100},
    )
