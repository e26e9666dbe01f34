"""Speed and error of every method that applies to a scene: which of them pay.

The scenes are the combinations of `benchmarks.grid` under a force, and the registered tasks.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.grid import COMBINATIONS
from benchmarks.lanes import SCENES, STEPS, error_of, ours, played, speeds, tightest
from benchmarks.report import table
from mm_gym import CompileError, compile_scene
from mm_gym.methods import names

if TYPE_CHECKING:
    from mm_gym import Scene

LANES, ROUNDS = 4096, 5
TOLERANCES = (1e-3, 1e-6, 1e-9)
METHODS = tuple(name for name in names() if name not in ("rk4", "semi_implicit_euler"))
LEAST = 1e-12

INTRODUCTION = f"""## Which method pays

A special method is kept if in some row it is 1.3 times as fast as the general method at the same
error, or a hundred times more exact at the same speed. The general method is `runge_kutta`, and
`taylor` where `runge_kutta` does not apply. {LANES:,} lanes on one core make {STEPS} control steps
under random actions by `step` with views. Each step counts with its fastest processor time of
{ROUNDS} rounds, in which the methods took turns. The table lists million steps/s. In brackets is
the largest error of all lanes after the last step, relative to the largest position or velocity,
against `taylor` at 1e-15. A scene is named by its carriage, its interface and its springs, as in
the section on every combination. A method without a tolerance has the same numbers in each row. The
fastest method is set in bold; `auto` is the method that the scene uses by default at the tolerance.
"""


def methods() -> str:
    """Return the section on the methods."""
    scenes = {
        ", ".join((*key[:3], *(() if key[3] == "fixed" else ("mass drawn",)))): scene
        for key, scene in COMBINATIONS.items()
        if key[-1] == "force"
    }
    tasks = {f"{name.removesuffix('-v0')} (task)": SCENES[name] for name in list(SCENES)[:7]}
    rows = [row for name, scene in (scenes | tasks).items() for row in _rows(name, scene)]
    header = ("scene", "tolerance", *(f"`{name}`" for name in METHODS), "`auto`")
    return f"{INTRODUCTION}\n{table(header, rows)}\n"


def _rows(name: str, scene: Scene) -> list[tuple[str, ...]]:
    """Return a row for each tolerance."""
    count = len(compile_scene(scene).actuators)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (STEPS, LANES, count)).astype(np.float32)
    truth = played(ours(scene.replace(solver=tightest(scene)), "", actions, np.empty(0)))
    settings: dict[tuple[str, float], Scene] = {}
    for method in METHODS:
        for tolerance in TOLERANCES:
            own = scene.replace(solver={"method": method, "tolerance": tolerance})
            if (option := _option(own)) is not None:
                settings[method, tolerance if option else 0.0] = own
    candidates = [ours(own, "", actions, truth) for own in settings.values()]
    errors = [max(error_of(one), LEAST) for one in candidates]
    found = dict(zip(settings, zip(speeds(candidates, ROUNDS), errors, strict=True), strict=True))
    rows: list[tuple[str, ...]] = []
    for tolerance in TOLERANCES:
        cells = [found.get((method, tolerance), found.get((method, 0.0))) for method in METHODS]
        most = max(cell[0] for cell in cells if cell is not None)
        texts = ["" if cell is None else _cell(*cell, fastest=cell[0] == most) for cell in cells]
        chosen = scene.replace(solver={"tolerance": tolerance})
        rows.append((name, f"{tolerance:.0e}", *texts, f"`{_chosen(chosen)}`"))
    return rows


def _cell(speed: float, error: float, *, fastest: bool) -> str:
    text = f"{speed:.3g} ({error:.0e})"
    return f"**{text}**" if fastest else text


def _option(scene: Scene) -> bool | None:
    """Return whether the method asked for has a tolerance, or None if it does not apply."""
    try:
        with warnings.catch_warnings(action="ignore", category=UserWarning):
            return compile_scene(scene).method.option is not None
    except CompileError:
        return None


def _chosen(scene: Scene) -> str:
    with warnings.catch_warnings(action="ignore", category=UserWarning):
        return compile_scene(scene).method.name
