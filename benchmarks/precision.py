"""Time against error of mm_gym and its peers, on four classes of scenes.

The section redraws its figure, docs/work_precision.png.
"""

from __future__ import annotations

import time
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.peers import (
    BUDGET,
    GaveUpError,
    Motion,
    families,
    times_of_calls,
    truth,
    within_budget,
)
from benchmarks.report import table
from benchmarks.timing import Timing, side_by_side
from mm_gym import compile_scene, simulate
from mm_gym.drawing import COLOURS, legend_below, panels, save, style
from mm_gym.paper import scene as paper_scene

if TYPE_CHECKING:
    from collections.abc import Callable

    from benchmarks.peers import Family, Run

FRICTION = paper_scene("fig8")
MOTIONS = (
    Motion("linear (fig. 2 A)", paper_scene("fig2a")),
    Motion("cubic spring (fig. 6 D)", paper_scene("fig6d")),
    Motion("dry friction (fig. 8)", FRICTION),
    Motion(
        "stiff dry friction (v_r = 1e-6 m/s)",
        FRICTION.replace(**{"interface.reference_velocity": 1e-6}),
    ),
)
LEVELS = tuple(10.0**-k for k in range(3, 13))
TOLERANCES = tuple(10.0**-k for k in range(2, 16))
FIGURE = Path(__file__).parent.parent / "docs" / "work_precision.png"

QUICK = 0.05
"""Time of a run [s] above which it is timed only once; the ratios are then in the thousands."""

ROUNDS = 15

CLOSE = 10.0  # ratio up to which decimals are printed

OURS = "mm_gym"
MISSED = "-"
INTRODUCTION = """## Work and precision

One second of motion from rest is computed in one control step, and only the end state is kept. The
error is relative to the largest position or velocity of the motion. Set-up and compilation are not
counted. For each candidate the table has the fastest setting that attains the error, as a multiple
of mm_gym's time. Times are processor time, each the fastest of {rounds} rounds in which all took
turns. This is the best case for the peers: with a force held for 10 ms at a time they would restart
a hundred times.

The times contain the following overhead of calls:

- mm_gym: one call of a kernel from Python for the motion. The state is set before it and the status
  checked after it. Without a lane to move this takes {mm_gym:.2f} µs.
- CVODE: none. Compiled code calls the C interface of SUNDIALS, with compiled right-hand sides and
  events. CVODE forms its Jacobians by differences; Adams has fixed-point or Newton iteration.
- heyoka: one call from Python for the motion, which takes {heyoka:.1f} µs if there is nothing to
  do. With friction there is one more call for each event.
- SciPy `odeint` (LSODA), `dopri5`, `dop853`, `vode` (the last three of `scipy.integrate.ode`): the
  steps are compiled, but SciPy takes a right-hand side as a Python callable only; its low-level
  callables are for quadrature. Called from Python, the compiled right-hand side takes
  {python:.2f} µs, and {compiled:.3f} µs from compiled code. These methods have no events and step
  over the kinks of dry friction.
- SciPy RK23 to LSODA (`solve_ivp`): the same call. The steps are written in Python, or called one
  by one from it. These rows show the interface as much as the method.

![Time for one second of motion over the error, on four classes of scenes](work_precision.png)
"""

LOOKS = {
    OURS: {"color": COLOURS[6], "marker": "*", "markersize": 9.0, "zorder": 3.0},
    "heyoka": {"color": COLOURS[0], "marker": "o"},
    "CVODE Adams": {"color": COLOURS[3], "marker": "D"},
    "CVODE Adams, Newton": {"color": COLOURS[3], "marker": "x", "linestyle": ":"},
    "CVODE BDF": {"color": COLOURS[3], "marker": "d", "linestyle": "--"},
    "SciPy odeint": {"color": COLOURS[1], "marker": "x"},
    "SciPy dopri5": {"color": COLOURS[4], "marker": "4", "linestyle": "--"},
    "SciPy dop853": {"color": COLOURS[4], "marker": "x"},
    "SciPy vode adams": {"color": COLOURS[5], "marker": "D"},
    "SciPy vode bdf": {"color": COLOURS[5], "marker": "d", "linestyle": "--"},
    "SciPy RK23": {"color": COLOURS[4], "marker": "<", "linestyle": ":"},
    "SciPy RK45": {"color": COLOURS[4], "marker": ">", "linestyle": "--"},
    "SciPy DOP853": {"color": COLOURS[4], "marker": "^"},
    "SciPy LSODA": {"color": COLOURS[1], "marker": "v"},
    "SciPy BDF": {"color": COLOURS[2], "marker": "s", "linestyle": "--"},
    "SciPy Radau": {"color": COLOURS[2], "marker": "p"},
}
"""Look of each candidate; with the markers the figure is readable without colours."""


@dataclass(frozen=True)
class Measured:
    """A setting of a candidate on one motion."""

    tolerance: float
    error: float
    timing: Timing


@dataclass(frozen=True)
class Comparison:
    """All candidates on one motion.

    Attributes
    ----------
    measured
        Candidate -> its settings.
    gave_up
        Candidate -> the first tolerance at which it failed or took too long.
    """

    motion: Motion
    measured: dict[str, list[Measured]]
    gave_up: dict[str, float]

    def best(self, name: str, level: float) -> Timing | None:
        """Return the time of a candidate's fastest setting with at most that error."""
        met = [one.timing for one in self.measured[name] if one.error <= level]
        return min(met, key=lambda timing: timing.fastest, default=None)

    def ratio(self, name: str, level: float) -> float:
        """Return a candidate's time at a level over mm_gym's; NaN if either does not attain it."""
        own, other = self.best(OURS, level), self.best(name, level)
        return np.nan if own is None or other is None else other.fastest / own.fastest


def precision() -> str:
    """Return the section on work and precision, and draw its figure."""
    comparisons = [_compare(motion) for motion in MOTIONS]
    _draw(comparisons)
    calls = {"heyoka": np.nan} | times_of_calls(MOTIONS[0])
    introduction = INTRODUCTION.format(rounds=ROUNDS, **calls)
    return "\n\n".join([introduction.strip(), *map(_section, comparisons)]) + "\n"


def _compare(motion: Motion) -> Comparison:
    """Find the error of every setting, then time the fast ones in turns."""
    end, scale = truth(motion), _scale(motion)
    found: dict[str, list[tuple[float, float, float, Run]]] = {}
    gave_up: dict[str, float] = {}
    for name, family in families().items():
        found[name] = []
        with suppress(GaveUpError):  # the first run may compile
            _attempt(name, motion, family, TOLERANCES[0])
        for tolerance in TOLERANCES if name != OURS or _has_tolerance(motion) else (1e-9,):
            try:
                run, seconds, state = _attempt(name, motion, family, tolerance)
            except GaveUpError:
                gave_up[name] = tolerance
                break
            error = float((np.abs(state - end) / scale).max())
            found[name].append((tolerance, error, seconds, run))
    quick: dict[str, Callable[[], object]] = {
        f"{name} {tolerance}": run
        for name, settings in found.items()
        for tolerance, _, seconds, run in settings
        if seconds < QUICK
    }
    timings = side_by_side(quick, rounds=ROUNDS, seconds=0.01, clock=time.process_time)
    measured = {
        name: [
            Measured(tolerance, error, timings.get(f"{name} {tolerance}", _once(name, seconds)))
            for tolerance, error, seconds, _ in settings
        ]
        for name, settings in found.items()
    }
    return Comparison(motion, measured, gave_up)


def _attempt(
    name: str, motion: Motion, family: Family, tolerance: float
) -> tuple[Run, float, np.ndarray]:
    run = family(motion, tolerance)
    # The others run outside Python, where nothing interrupts them, and have a limit of steps.
    limit = within_budget() if name.startswith("SciPy") else nullcontext()
    began = time.process_time()
    with limit:
        state = np.array(run())
    return run, time.process_time() - began, state


def _once(name: str, seconds: float) -> Timing:
    return Timing(name, np.full(ROUNDS, seconds))


def _has_tolerance(motion: Motion) -> bool:
    option = compile_scene(motion.scene).method.option
    return option is not None and option.name == "tolerance"


def _scale(motion: Motion) -> np.ndarray:
    largest = np.abs(simulate(motion.scene, duration=1.0).state).max(axis=0)
    return np.repeat([largest[:2].max(), largest[2:].max()], 2)


def _section(comparison: Comparison) -> str:
    own = [comparison.best(OURS, level) for level in LEVELS]
    first = [
        "mm_gym `auto` [µs]",
        *(MISSED if t is None else f"{t.fastest * 1e6:.3g}" for t in own),
    ]
    rows = [
        [name, *(_cell(comparison.ratio(name, level)) for level in LEVELS)]
        for name in comparison.measured
        if name != OURS
    ]
    error = min(one.error for one in comparison.measured[OURS])
    notes = [f"Tightest error of mm_gym: {error:.0e}.", _verdict(comparison)]
    if comparison.gave_up:
        late = "; ".join(f"{name} from {at:.0e} on" for name, at in comparison.gave_up.items())
        notes.append(f"Failed, or SciPy took longer than {BUDGET:g} s, at tolerances: {late}.")
    header = ("error at most", *(f"{level:.0e}" for level in LEVELS))
    body = table(header, [first, *rows])
    return f"### {comparison.motion.name}\n\n{body}\n\n" + "\n".join(notes)


def _cell(ratio: float) -> str:
    return MISSED if np.isnan(ratio) else f"{ratio:,.{0 if ratio > CLOSE else 2}f}"


def _verdict(comparison: Comparison) -> str:
    """Return the levels at which a peer is faster, and those that mm_gym misses, as text."""
    faster = []
    for name in comparison.measured:
        levels = [level for level in LEVELS if comparison.ratio(name, level) < 1.0]
        if name != OURS and levels:
            faster.append(f"{name} at {', '.join(f'{level:.0e}' for level in levels)}")
    missed = [level for level in LEVELS if comparison.best(OURS, level) is None]
    lost = f" mm_gym does not attain {', '.join(f'{m:.0e}' for m in missed)}." if missed else ""
    text = f"Faster than `auto`: {'; '.join(faster)}." if faster else "No peer is faster."
    return text + lost


def _draw(comparisons: list[Comparison]) -> None:
    """Draw time over error, one panel per motion."""
    with style():
        figure, axes = panels(6.0, 2, 2, sharey="all")
        for panel, comparison in zip(axes, comparisons, strict=True):
            for name, settings in comparison.measured.items():
                errors = [max(one.error, 1e-16) for one in settings]
                times = [one.timing.fastest for one in settings]
                label = "mm_gym auto" if name == OURS else name
                panel.plot(errors, times, label=label, **{"markersize": 4.0} | LOOKS[name])
            panel.set(xscale="log", yscale="log", xlim=(1e-1, 3e-17), title=comparison.motion.name)
        for panel in axes[2:]:
            panel.set_xlabel("error after one second, relative [-]")
        for panel in axes[::2]:
            panel.set_ylabel("time for one second of motion [s]")
        legend_below(figure, axes[1], 5)
        save(figure, FIGURE)
