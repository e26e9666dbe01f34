"""Speed of the interfaces in value form on every combination of carriage, springs and masses."""

from __future__ import annotations

from itertools import product

import numpy as np

from benchmarks.grid import CARRIAGES, COMPARED, MASSES, SPRINGS, TIME_STEP
from benchmarks.lanes import DUFFING, FRICTION, LANES, LEAST, STEPS, error_of, ours, played, speeds
from benchmarks.report import table
from mm_gym import Scene, compile_scene

TOLERANCES = (1e-2, 1e-3, 1e-6, 1e-9)
TIGHTEST = 1e-12
ROUNDS = 7
WAYS = {
    "Stribeck": {
        "kind": "stribeck",
        "static_coefficient": FRICTION["static_coefficient"],
        "kinetic_coefficient": FRICTION["kinetic_coefficient"],
        "reference_velocity": 0.05,
        "stribeck_velocity": 0.2,
    },
    "Bouc-Wen": {
        "kind": "bouc_wen",
        "stiffness": 60.0,
        "yield_displacement": 0.005,
        "damping": 0.1,
    },
}

INTRODUCTION = f"""## Interfaces in value form

{LANES:,} lanes, one core, {STEPS} control steps of {1e3 * TIME_STEP:g} ms under random forces:
`step` with views at a `solver.tolerance`, at the fastest of {ROUNDS} rounds in which all took
turns, in processor time. Stribeck has v_r = {WAYS["Stribeck"]["reference_velocity"]} and
v_s = {WAYS["Stribeck"]["stribeck_velocity"]} m/s, Bouc-Wen u_y = 5 mm. Errors are the largest of
{COMPARED:,} lanes at the end, relative to the largest position or velocity, against a tolerance of
{TIGHTEST:g}. In brackets: as a multiple of dry friction's speed in the same scene at that
tolerance. Million steps/s.
"""
COLUMNS = [f"{name}{what}" for name in WAYS for what in ("", ", error")]
HEADER = ("carriage", "springs", "mass", "tolerance", "dry friction", *COLUMNS)


def interfaces() -> str:
    """Return the section on the interfaces."""
    keys = product(CARRIAGES, SPRINGS, MASSES)
    return f"{INTRODUCTION}\n{table(HEADER, [row for key in keys for row in _rows(*key)])}\n"


def _rows(carriage: str, springs: str, mass: str) -> list[tuple[str, ...]]:
    """Return a row for each tolerance."""
    values = {
        "control.time_step": TIME_STEP,
        "carriage.cubic_coefficient": CARRIAGES[carriage],
        "springs": SPRINGS[springs],
        "randomization": MASSES[mass],
    }
    scenes = [DUFFING.replace(interface=one, **values) for one in (FRICTION, *WAYS.values())]
    count = len(compile_scene(scenes[0]).actuators)
    few = np.random.default_rng(0).uniform(-1.0, 1.0, (STEPS, COMPARED, count)).astype(np.float32)
    many = np.tile(few, (1, LANES // COMPARED, 1))
    fast = speeds(
        [ours(_at(one, goal), "", many, np.empty(0)) for goal in TOLERANCES for one in scenes],
        ROUNDS,
    )
    truths = [played(ours(_at(one, TIGHTEST), "", few, np.empty(0))) for one in scenes[1:]]
    rows: list[tuple[str, ...]] = []
    for k, goal in enumerate(TOLERANCES):
        friction, *others = fast[k * len(scenes) : (k + 1) * len(scenes)]
        cells = [f"{friction:.3g}"]
        for scene, truth, speed in zip(scenes[1:], truths, others, strict=True):
            error = max(error_of(ours(_at(scene, goal), "", few, truth)), LEAST)
            cells += [f"{speed:.3g} ({speed / friction:.2f})", f"{error:.0e}"]
        rows.append((carriage, springs, mass, f"{goal:.0e}", *cells))
    return rows


def _at(scene: Scene, tolerance: float) -> Scene:
    return scene.replace(**{"solver.tolerance": tolerance})
