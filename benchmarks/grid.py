"""Speed on every combination of carriage, interface, springs, parameters, excitation, tolerance.

mm_gym's public step with views takes turns with a vectorised Runge-Kutta method that is written for
the combination, see `benchmarks.by_hand`, at the error that was asked for and at mm_gym's own.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.by_hand import rk4
from benchmarks.lanes import (
    DUFFING,
    FRICTION,
    LANES,
    LEAST,
    RK4,
    STEPS,
    by_hand,
    error_of,
    ours,
    played,
    speeds,
    tightest,
)
from benchmarks.recorded import record
from benchmarks.report import table
from mm_gym import compile_scene

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.by_hand import Block
    from benchmarks.lanes import Candidate
    from benchmarks.recorded import Recorded
    from mm_gym import Scene

    Values = NDArray[np.float64]

TIME_STEP = 5e-3
TOLERANCES = (1e-2, 1e-3, 1e-6, 1e-9)
ROUNDS = 7
SUBSTEPS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512)
COMPARED = 1024  # lanes of which errors are measured; the kernels by hand have them many times over

SPRINGS = {
    "none": {"kind": "none"},
    "small on large": {"kind": "small_on_large"},
    "finite stretch": {
        "kind": "finite_stretch",
        "stiffness": 35.0,
        "stretch": 1.5,
        "rest_length": 0.05,
    },
}
CARRIAGES = {"linear": 0.0, "cubic": DUFFING.carriage.cubic_coefficient}
INTERFACES = {"viscous": {"kind": "viscous"}, "dry friction": FRICTION}
MASSES = {"fixed": {}, "drawn": {"carriage.mass": (0.09, 0.11)}}
NOISE = {
    "kind": "noise",
    "rms": 1.0,
    "low_frequency": 44.0,
    "high_frequency": 71.0,
    "sample_time": TIME_STEP,
}
DRIVES = {
    "force": [],
    "ground noise": [NOISE],
}
COMBINATIONS = {
    (carriage, interface, springs, mass, drive): DUFFING.replace(
        **{
            "control.time_step": TIME_STEP,
            "carriage.cubic_coefficient": CARRIAGES[carriage],
            "interface": INTERFACES[interface],
            "springs": SPRINGS[springs],
            "randomization": MASSES[mass],
            "excitation": DRIVES[drive],
        }
    )
    for carriage, interface, springs, mass, drive in product(
        CARRIAGES, INTERFACES, SPRINGS, MASSES, DRIVES
    )
}

INTRODUCTION = f"""## Every combination

{LANES:,} lanes on one core make {STEPS} control steps of {1e3 * TIME_STEP:g} ms, under random
forces on the carriage, or without force under noise of the ground. mm_gym is measured by its public
`step` with views, at a `solver.tolerance`. It is compared with the classical Runge-Kutta method,
which is written and vectorised for the combination and advances the state alone, in the fewest of
{SUBSTEPS[0]} to {SUBSTEPS[-1]} substeps that attain the error. Both count with their fastest
processor time of {ROUNDS} rounds, in which they took turns. Errors are the largest of {COMPARED:,}
lanes after the last step, relative to the largest position or velocity. They are measured against
mm_gym at its tightest tolerance, and not distinguished below {LEAST:g}.

The tables list million steps/s. In brackets are the speed of mm_gym as a multiple of that of RK4,
and the substeps of RK4. One column has RK4 with an error of at most the tolerance, the other with
an error of at most that of mm_gym. "-" means that no number of substeps attains it, for example
because friction drops at the onset of slip inside a substep.
"""
HEADER = (
    "carriage",
    "interface",
    "springs",
    "mass",
    "tolerance",
    "mm_gym",
    "its error",
    "RK4 at the tolerance",
    "RK4 at its error",
)


@dataclass(frozen=True)
class Row:
    """mm_gym at a tolerance, and the method of Runge and Kutta at the error asked for and its own.

    Attributes
    ----------
    error, speed
        mm_gym's, relative and in million steps/s.
    asked, equal
        Speed and substeps of what is written by hand; None where nothing attains the error.
    """

    tolerance: float
    error: float
    speed: float
    asked: tuple[float, int] | None
    equal: tuple[float, int] | None


def grid() -> str:
    """Return the section on all combinations."""
    parts = [INTRODUCTION.strip()]
    for drive in DRIVES:
        keys = [key for key in COMBINATIONS if key[-1] == drive]
        found = [(key, row) for key in keys for row in rows_of(COMBINATIONS[key])]
        cells = [(*key[:-1], *_cells(row)) for key, row in found]
        summary = _summary([row for _, row in found])
        parts.append(f"### Under {drive}\n\n{table(HEADER, cells)}\n\n{summary}")
    return "\n\n".join(parts) + "\n"


def rows_of(scene: Scene, lanes: int = LANES) -> list[Row]:
    """Measure one combination at every tolerance."""
    compared = min(COMPARED, lanes)
    count = len(compile_scene(scene).actuators)
    few = np.random.default_rng(0).uniform(-1.0, 1.0, (STEPS, compared, count))
    if scene.excitation:
        few[:] = 0.0
    actions = np.tile(few, (1, lanes // compared, 1)).astype(np.float32)
    exact = scene.replace(solver=tightest(scene))
    truth = played(ours(exact, "", actions, np.empty(0)))
    own = [ours(_at(scene, tolerance), "", actions, truth) for tolerance in TOLERANCES]
    errors = [_error(one, compared) for one in own]
    recorded = record(exact, actions[:, :compared])
    block, attained = rk4(scene), {}
    for level in sorted({*TOLERANCES, *errors}, reverse=True):
        attained[level] = _fewest(block, recorded, level)
    many = recorded.repeated(lanes // compared)
    counts = sorted({count for count in attained.values() if count})
    found = speeds([*own, *(by_hand(RK4, "", block, count, many) for count in counts)], ROUNDS)
    fast = dict(zip(counts, found[len(own) :], strict=True))
    best = {level: (fast[count], count) for level, count in attained.items() if count}
    rows = zip(TOLERANCES, errors, found[: len(own)], strict=True)
    return [Row(*row, best.get(row[0]), best.get(row[1])) for row in rows]


def _at(scene: Scene, tolerance: float) -> Scene:
    """Return a scene at a tolerance, if that has an effect."""
    at_tolerance = scene.replace(**{"solver.tolerance": tolerance})
    with warnings.catch_warnings(action="ignore", category=UserWarning):
        option = compile_scene(at_tolerance).method.option
    return scene if option is None else at_tolerance


def _error(candidate: Candidate, compared: int) -> float:
    few = slice(0, compared)
    truth, state = candidate.truth[:, few], candidate.state
    return max(error_of(replace(candidate, truth=truth, state=lambda: state()[:, few])), LEAST)


def _fewest(block: Block, recorded: Recorded, level: float) -> int | None:
    """Return the fewest substeps whose error is at most a level."""
    for count in SUBSTEPS:
        if max(error_of(by_hand(RK4, "", block, count, recorded)), LEAST) <= level:
            return count
    return None


def _cells(row: Row) -> tuple[str, ...]:
    """Return the columns behind the combination."""
    other = [
        "-" if one is None else f"{one[0]:.3g} ({row.speed / one[0]:.2f}; {one[1]})"
        for one in (row.asked, row.equal)
    ]
    return f"{row.tolerance:.0e}", f"{row.speed:.3g}", f"{row.error:.0e}", *other


def _summary(rows: list[Row]) -> str:
    """Return in how many rows mm_gym is the faster one."""
    pairs = {
        "the tolerance": [(row.speed, row.asked) for row in rows],
        "mm_gym's own error": [(row.speed, row.equal) for row in rows],
    }
    texts = []
    for name, both in pairs.items():
        ratios = [speed / other[0] for speed, other in both if other is not None]
        ahead = sum(ratio >= 1.0 for ratio in ratios)
        ends = [f"{float(f'{one:.2g}'):g}" for one in (min(ratios), max(ratios))] if ratios else []
        range_of = f", {' to '.join(ends)} times as fast" if ratios else ""
        texts.append(
            f"RK4 attains {name} in {len(ratios)} of {len(rows)} rows; mm_gym is at least as fast"
            f" in {ahead} of these{range_of}."
        )
    return " ".join(texts)
