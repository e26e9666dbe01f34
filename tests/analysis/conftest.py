"""Scenes and golden values of the tests of analysis."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mm_gym import Scene

GOLDEN = Path(__file__).parents[1] / "golden"


def golden(name: str) -> dict[str, Any]:
    """Return the content of a golden file, which states its provenance."""
    return json.loads((GOLDEN / f"{name}.json").read_text(encoding="utf-8"))


def linear_scene(case: dict[str, Any]) -> Scene:
    """Return the scene of a golden linear case."""
    p = {name: float(value) for name, value in case["params"].items()}
    x1, x2, v1, v2 = (float(value) for value in case["ic"])
    springs = (
        {"kind": "small_on_large", "stiffness": p["k0"], "stretch": p["lam"]}
        if "k0" in p
        else {"kind": "none"}
    )
    return Scene(
        carriage={"mass": p["m1"], "stiffness": p["k1"], "damping": p["d"]},
        sphere={"mass": p["m2"]},
        interface={"kind": "viscous", "damping": p["c"]},
        springs=springs,
        initial={
            "carriage_displacement": x1,
            "sphere_offset": x2 - x1,
            "carriage_velocity": v1,
            "sphere_velocity": v2,
        },
    )


def friction_scene(case: dict[str, Any]) -> Scene:
    """Return the scene of a golden point of figure 10."""
    static = float(case["mu1"])
    return Scene(
        interface={
            "kind": "dry_friction",
            "static_coefficient": static,
            "kinetic_coefficient": static * float(case["mu2_over_mu1"]),
            "reference_velocity": float(case["vr"]),
            "slip_damping": float(case["chi"]),
            "normal_force": 0.3924,
        },
        initial={"carriage_displacement": 0.01, "sphere_offset": 0.02},
        control={"time_step": 0.001, "steps": 1000},
    )
