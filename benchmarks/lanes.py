"""Speed over accuracy on many lanes of every task, compared with what a user would write instead.

The public step with views against bare kernels of twenty lines, see `benchmarks.by_hand`. The
section redraws the README's figure, docs/lanes.png.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from itertools import groupby, product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.by_hand import Physics, rk4, semi_implicit_euler, unrolled_taylor
from benchmarks.recorded import record
from benchmarks.report import installed, table, three_digits
from mm_gym import MovingMassVectorEnv, compile_scene, load_scene
from mm_gym.drawing import COLOURS, legend_below, panels, save, style
from mm_gym.methods import METHODS, Settings
from mm_gym.tasks import ids

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from benchmarks.by_hand import Block
    from benchmarks.recorded import Recorded
    from mm_gym import Scene

    Values = NDArray[np.float64]

LANES, STEPS, ROUNDS = 16_384, 20, 15
SUBSTEPS = {"RK4": (1, 2, 3, 4, 6, 8, 16, 32), "semi-implicit Euler": (1, 4, 16, 64)}
SERIES = {4: (2, 3, 4, 8), 6: (2, 3, 4), 8: (2, 3, 4), 10: (2, 3, 4), 12: (2, 3, 4)}
LEVELS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11)
HEYOKA_LANES = (16, 32, 64, 128, 256)
"""Lanes of a batch, which a call from Python advances; the widest are no faster than the others."""

HEYOKA_TOLERANCES = (1e-3, 1e-6, 1e-9, 1e-12)
OURS, RK4, EULER, TAYLOR, HEYOKA = (
    "`step`, views",
    "RK4",
    "semi-implicit Euler",
    "unrolled Taylor series",
    "heyoka",
)
DUFFING = load_scene("mm_gym/CarriageForceDuffing-v0")
FRICTION = load_scene("mm_gym/CarriageForceFriction-v0").interface.model_dump()
SCENES = {name.removeprefix("mm_gym/"): load_scene(name) for name in ids()} | {
    "CarriageForceDuffing with dry friction": DUFFING.replace(interface=FRICTION),
    "CarriageForceDuffing with springs of finite stretch": DUFFING.replace(
        springs={"kind": "finite_stretch", "stiffness": 35.0, "stretch": 1.5, "rest_length": 0.05}
    ),
}
"""The tasks, and what else is nonlinear."""

FIGURE = Path(__file__).parent.parent / "docs" / "lanes.png"
LEAST = 1e-12  # errors below this one are drawn as it is

INTRODUCTION = f"""## Many lanes: speed over accuracy

{LANES:,} lanes on one core make {STEPS} control steps under random actions. The error is the
largest of all lanes after the last step, relative to the largest position or velocity. mm_gym is
measured by its public `step`, with reward, termination and observation. The others are bare kernels
that advance the state alone. They get the noise, earthquakes and impulses that mm_gym has drawn,
each impulse in the nearest substep. Each step counts with its fastest processor time of {ROUNDS}
rounds, in which the candidates took turns. Errors below {LEAST:g} are not distinguished.

heyoka advances one batch, whose numbers stay in the cache. The table has the fastest of batches of
{", ".join(map(str, HEYOKA_LANES))} lanes. Each control step has a new action and is therefore one
call from Python, which its times include. If the action is held for all {STEPS} control steps,
heyoka makes them in one call. These times have a table of their own, in which mm_gym makes one
control step of the whole length.

The tables list the million steps/s of the fastest setting that attains the error. In brackets is
the speed of mm_gym as a multiple of this speed. "-" means that no setting attains the error.

![Million steps/s over the error, for seven of the tasks](lanes.png)
"""

HELD = f"The same action for all {STEPS} control steps, in one call:"

LOOKS = {
    OURS: {"color": COLOURS[6], "marker": "*", "markersize": 9.0, "zorder": 3.0},
    RK4: {"color": COLOURS[0], "marker": "o"},
    EULER: {"color": COLOURS[4], "marker": "v"},
    TAYLOR: {"color": COLOURS[2], "marker": "s"},
    HEYOKA: {"color": COLOURS[3], "marker": "D"},
}


@dataclass(frozen=True)
class Candidate:
    """A setting: how to begin, make a control step, and return the state (4, lanes).

    Attributes
    ----------
    family, setting
        Its names.
    lanes
        How many lanes it steps.
    truth
        What the state should be at the end (4, lanes).
    begin, step, state
        Return to the start; make call n; return the state (4, lanes).
    calls
        Calls that make the `STEPS` control steps.
    """

    family: str
    setting: str
    lanes: int
    truth: Values
    begin: Callable[[], None]
    step: Callable[[int], object]
    state: Callable[[], Values]
    calls: int = STEPS


@dataclass(frozen=True)
class Measured:
    """A candidate's error, and its million steps/s."""

    family: str
    setting: str
    error: float
    speed: float


def lanes() -> str:
    """Return the section on many lanes of every task, and draw its figure."""
    found = {name: _measured(_candidates(scene)) for name, scene in SCENES.items()}
    _draw({name: one for name, one in found.items() if f"mm_gym/{name}" in ids()})
    parts = []
    for name, scene in SCENES.items():
        parts.append(f"### {name}\n\n{_levels(found[name])}")
        if any(one.family == HEYOKA for one in found[name]):
            parts.append(f"{HELD}\n\n{_levels(_measured(_held_candidates(scene)))}")
    return "\n\n".join([INTRODUCTION.strip(), *parts]) + "\n"


def _measured(candidates: list[Candidate]) -> list[Measured]:
    """Return error and speed of each candidate."""
    errors = [error_of(one) for one in candidates]
    found = speeds(candidates)
    return [
        Measured(one.family, one.setting, max(error, LEAST), speed)
        for one, error, speed in zip(candidates, errors, found, strict=True)
    ]


def _candidates(scene: Scene) -> list[Candidate]:
    count = len(compile_scene(scene).actuators)
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1.0, 1.0, (STEPS, LANES, count)).astype(np.float32)
    exact = scene.replace(solver=tightest(scene))
    truth = played(ours(exact, "", actions, np.empty(0)))
    found = [ours(one, name, actions, truth) for name, one in _settings(scene)]
    recorded = record(exact, actions)
    for name, kernel in ((RK4, rk4), (EULER, semi_implicit_euler)):
        block = kernel(scene)
        found += [by_hand(name, "", block, n, recorded) for n in SUBSTEPS[name]]
    physics = Physics.of(scene)
    is_smooth = physics.friction[0] == 0.0
    if is_smooth and physics.k3 > 0.0 and physics.k0 == 0.0:
        for order, counts in SERIES.items():
            block, setting = unrolled_taylor(scene, order), f"of order {order}, "
            found += [by_hand(TAYLOR, setting, block, n, recorded) for n in counts]
    is_drawn = {part.kind for part in scene.excitation} - {"harmonic"}
    if is_smooth and physics.l0 == 0.0 and not is_drawn and installed("heyoka"):
        found += _all_of_heyoka(scene, recorded)
    return found


def _held_candidates(scene: Scene) -> list[Candidate]:
    """Return mm_gym and heyoka where one call makes all control steps, under one action."""
    whole = scene.replace(**{"control.time_step": STEPS * scene.control.time_step})
    count = len(compile_scene(whole).actuators)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (1, LANES, count)).astype(np.float32)
    exact = whole.replace(solver=tightest(whole))
    truth = played(ours(exact, "", actions, np.empty(0)))
    found = [ours(one, name, actions, truth) for name, one in _settings(whole)]
    return found + _all_of_heyoka(whole, record(exact, actions))


def _all_of_heyoka(scene: Scene, recorded: Recorded) -> list[Candidate]:
    both = product(HEYOKA_TOLERANCES, HEYOKA_LANES)
    return [_heyoka(scene, tolerance, count, recorded) for tolerance, count in both]


def _settings(scene: Scene) -> list[tuple[str, Scene]]:
    """Return mm_gym's settings: those of every method that might be the fastest somewhere."""
    found: dict[str, Scene] = {}
    support = compile_scene(scene).support
    for method in METHODS:
        if method.name in BY_HAND or method.obstacle(support) is not None:
            continue
        if method.option is None:
            found.setdefault(method.name, scene.replace(solver={"method": method.name}))
        elif support.is_nonlinear or method.name != "taylor":
            name, values = method.option
            for value in values:
                if value < LEAST or method.obstacle(support, Settings(value, 1)) is not None:
                    continue
                solver = {"method": method.name, name: value}
                found[f"{method.name}, {name} {value:.0e}"] = scene.replace(solver=solver)
    return list(found.items())


BY_HAND = ("rk4", "semi_implicit_euler")  # methods that are there for comparison only


def tightest(scene: Scene) -> dict[str, object]:
    """Return the solver of least error."""
    option = compile_scene(scene.replace(solver={})).method.option
    return {} if option is None else {"method": "taylor", "tolerance": 1e-15}


def _levels(found: list[Measured]) -> str:
    """Return the table of the fastest setting of each family at each level, and who is ahead."""
    families = list(dict.fromkeys(one.family for one in found))
    rows: list[tuple[str, ...]] = []
    ahead: dict[str, list[str]] = {}
    for level in LEVELS:
        best = {name: _best(found, name, level) for name in families}
        others = [
            f"{three_digits(best[name])} ({best[OURS] / best[name]:.2f})" for name in families[1:]
        ]
        cells = [x.replace("nan (nan)", "-") for x in others]
        rows.append((f"{level:.0e}", three_digits(best[OURS]), *cells))
        for name in families[1:]:
            if best[name] > best[OURS]:
                ahead.setdefault(name, []).append(f"{level:.0e}")
    faster = "; ".join(f"{name} at {', '.join(levels)}" for name, levels in ahead.items())
    text = f"Faster than mm_gym: {faster}." if faster else "Nothing is faster than mm_gym."
    return f"{table(('error at most', *families), merged(rows))}\n\n{text}"


def merged(rows: list[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Return rows of which neighbours with the same cells after the first are one."""
    groups = [list(group) for _, group in groupby(rows, key=lambda row: row[1:])]
    return [
        (" to ".join(dict.fromkeys((group[0][0], group[-1][0]))), *group[0][1:]) for group in groups
    ]


def _best(found: list[Measured], family: str, level: float) -> float:
    """Return the speed of a family's fastest setting with at most that error; NaN if none has."""
    speeds = [one.speed for one in found if one.family == family and one.error <= level]
    return max(speeds, default=np.nan)


def ours(scene: Scene, setting: str, actions: NDArray[np.float32], truth: Values) -> Candidate:
    """Return mm_gym's public step with views, under actions (calls, lanes, actuators)."""
    count = actions.shape[1]
    env = MovingMassVectorEnv(scene, count, copy=False)
    own = [np.asfortranarray(row) for row in actions]
    return Candidate(
        OURS,
        setting,
        count,
        truth,
        lambda: env.reset(seed=0),
        lambda n: env.step(own[n]),
        lambda: env.state.T,
        len(own),
    )


def by_hand(family: str, setting: str, block: Block, count: int, recorded: Recorded) -> Candidate:
    """Return the candidate of a kernel written by hand, with a number of substeps."""
    values, (amplitude, frequency, phase) = recorded.start.copy(), recorded.harmonic
    begun = amplitude * np.cos(phase), amplitude * np.sin(phase)
    cosines, sines = begun[0].copy(), begun[1].copy()
    # The method of Runge and Kutta wants the force in the middle of a substep too.
    turn = frequency * recorded.interval / (count if family == EULER else 2 * count)
    turns, has_impulses = (np.cos(turn), np.sin(turn)), bool(recorded.impulses.any())
    sudden, late, change = np.moveaxis(recorded.impulses, 1, 0)
    whens = np.clip(np.round(late / recorded.interval * count), 0, count - 1)

    def begin() -> None:
        values[:], cosines[:], sines[:] = recorded.start, *begun

    def step(n: int) -> None:
        for k in range(n * recorded.intervals, (n + 1) * recorded.intervals):
            motion = (*values, *recorded.applied[k], *recorded.disturbance[k])
            impulse = whens[k], change[k]
            if has_impulses:
                values[2] += sudden[k]
            block((*motion, cosines, sines, *turns, *impulse, recorded.by_m1), count)

    name = f"{setting}{count} substeps"
    calls = len(recorded.applied) // recorded.intervals
    return Candidate(
        family, name, values.shape[1], recorded.end, begin, step, lambda: values, calls
    )


def _heyoka(scene: Scene, tolerance: float, count: int, recorded: Recorded) -> Candidate:
    import heyoka as hy  # noqa: PLC0415 - an optional peer

    p, own, calls = Physics.of(scene), slice(0, count), len(recorded.applied) // recorded.intervals
    x1, x2, v1, v2 = hy.make_vars("x1", "x2", "v1", "v2")
    inner = p.c * (v2 - v1)
    if p.k0:
        inner += hy.par[1] * (x2 - x1)
    push = inner - p.d * v1 - p.k1 * x1 + hy.par[0]
    if p.k3:
        push -= p.k3 * x1**3
    if p.is_harmonic:
        push += hy.par[2] * hy.sin(hy.par[3] * hy.time + hy.par[4])
    system = [(x1, v1), (x2, v2), (v1, push * p.by_m1), (v2, -inner * p.by_m2)]
    first = np.ascontiguousarray(recorded.start[:, own])
    integrator = hy.taylor_adaptive_batch(system, first, tol=tolerance)
    # A call then copies its parameters, and computes none.
    pars = np.zeros((calls, 5, count))
    force, stretch = np.moveaxis(recorded.applied[:: recorded.intervals, :, own], 1, 0)
    pars[:, 0], pars[:, 2:] = force, recorded.harmonic[:, own]
    if p.k0:
        pars[:, 1] = 2.0 * p.k0 * (1.0 + 2.0 / stretch**3)
    used = np.ascontiguousarray(pars[:, : len(integrator.pars)])
    view, state, duration = integrator.pars, integrator.state, scene.control.time_step

    def begin() -> None:
        integrator.set_time(0.0)
        state[:] = first

    def step(n: int) -> None:
        view[:] = used[n]
        integrator.propagate_for(duration)

    setting, truth = f"tolerance {tolerance:.0e}, {count} lanes", recorded.end[:, own]
    return Candidate(HEYOKA, setting, count, truth, begin, step, lambda: state, calls)


def played(candidate: Candidate) -> Values:
    """Return the state after all steps."""
    candidate.begin()
    for n in range(candidate.calls):
        candidate.step(n)
    return candidate.state().copy()


def error_of(candidate: Candidate) -> float:
    """Return the largest error of all lanes at the end, relative to position or velocity."""
    known = np.isfinite(candidate.truth).all(axis=0)
    truth = candidate.truth[:, known]
    scale = np.repeat([np.abs(truth[:2]).max(), np.abs(truth[2:]).max()], 2)[:, None]
    with np.errstate(over="ignore", invalid="ignore"):  # a coarse setting may diverge
        error = float((np.abs(played(candidate)[:, known] - truth) / scale).max())
    return error if np.isfinite(error) else np.inf


def speeds(candidates: list[Candidate], rounds: int = ROUNDS) -> list[float]:
    """Return million control steps/s of each, every call at its fastest."""
    fastest = [np.full(one.calls, np.inf) for one in candidates]
    for _ in range(rounds):
        for one, own in zip(candidates, fastest, strict=True):
            one.begin()
            for n in range(one.calls):
                began = time.process_time()
                one.step(n)
                own[n] = min(own[n], time.process_time() - began)
    both = zip(candidates, fastest, strict=True)
    return [float(1e-6 * one.lanes * STEPS / own.sum()) for one, own in both]


def _undominated(found: list[Measured], family: str) -> list[Measured]:
    """Return a family's settings than which no more exact one is as fast, coarse ones first."""
    own = sorted(
        (one for one in found if one.family == family), key=lambda one: (one.error, -one.speed)
    )
    best = [one for k, one in enumerate(own) if all(one.speed > other.speed for other in own[:k])]
    return [one for one in best[::-1] if one.error < 1.0]


def _draw(found: dict[str, list[Measured]]) -> None:
    """Draw speed over error, one panel per task."""
    with style():
        figure, axes = panels(7.0, 4, 2, sharex="all", sharey="all")
        for panel, (name, measured) in zip(axes, found.items(), strict=False):
            for family, look in LOOKS.items():
                own = _undominated(measured, family)
                # What is more exact than asked for is as fast.
                errors = [1.0, *(one.error for one in own)]
                speeds = [own[0].speed if own else np.nan, *(one.speed for one in own)]
                label = "mm_gym, public step" if family == OURS else family
                options = {"markersize": 4.0, "markevery": slice(1, None)} | look
                panel.plot(errors, speeds, label=label, **options)
            title = name.removesuffix("-v0")
            panel.set(xscale="log", yscale="log", xlim=(1.0, 0.5 * LEAST), title=title)
        for panel in axes[len(found) - 2 : len(found)]:  # the lowest of each column
            panel.tick_params(labelbottom=True)
            panel.set_xlabel("error after 20 control steps, relative [-]")
        for panel in axes[::2]:
            panel.set_ylabel("million steps/s")
        axes[len(found)].set_axis_off()
        legend_below(figure, axes[1], 5)
        save(figure, FIGURE)
