"""Speed over accuracy on many lanes of a cubic spring, beside what a user would write instead.

The public step with views against bare kernels of twenty lines, which neither score nor observe:
one array per component, blocks of lanes within the substep, and every liberty for the compiler.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numba
import numpy as np

from benchmarks.report import installed, processor, table
from mm_gym import MovingMassVectorEnv, load_scene

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from mm_gym import Scene

    Values = NDArray[np.float64]
    Arrays = tuple[Values, ...]
    Block = Callable[[Arrays, int], None]

SCENE = load_scene("mm_gym/CarriageForceDuffing-v0")
LANES, BLOCK, STEPS, ROUNDS = 16_384, 256, 20, 15
TOLERANCES = tuple(float(f"1e-{digits}") for digits in range(1, 13))
SERIES = {4: (2, 3, 4, 8), 6: (2, 3, 4), 8: (2, 3, 4), 10: (2, 3, 4), 12: (2, 3, 4)}
LEVELS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11)
HEYOKA_LANES = 16
OURS, RK4, EULER, TAYLOR = "`step`, views", "RK4", "semi-implicit Euler", "unrolled Taylor series"
INTRODUCTION = f"""## Many lanes of a cubic spring: speed over accuracy

CarriageForceDuffing, {LANES:,} lanes, one core, {STEPS} control steps under random forces. The
error is the largest of all lanes at their end, relative to the largest position or velocity. mm_gym
is its public `step`, with reward, termination and observation; the others are bare kernels that
advance the state alone. Each step counts at its fastest of {ROUNDS} rounds in which the candidates
took turns. Listed are million steps/s of the fastest setting that attains the error, and in
brackets mm_gym's speed as a multiple of them.
"""


@dataclass(frozen=True)
class Candidate:
    """A setting: how to begin, make a control step, and return the state (4, lanes).

    Attributes
    ----------
    family, setting
        Its names.
    lanes
        How many lanes it steps.
    """

    family: str
    setting: str
    lanes: int
    begin: Callable[[], None]
    step: Callable[[int], object]
    state: Callable[[], Values]


def nonlinear() -> str:
    """Return the section on many lanes of a cubic spring."""
    start, forces = _start()
    scene = SCENE.replace(**{"solver.method": "splitting"})
    candidates = [_ours(scene, tolerance) for tolerance in TOLERANCES]
    for name, block, counts in _kernels(SCENE):
        candidates += [_bare(name, block, count, start, forces) for count in counts]
    if installed("heyoka"):
        candidates += [_heyoka(SCENE, 10.0**-k, start, forces) for k in (3, 6, 9, 12)]
    truth = _played(_ours(SCENE.replace(solver={"method": "taylor"}), 1e-15))
    scale = np.repeat([np.abs(truth[:2]).max(), np.abs(truth[2:]).max()], 2)[:, None]
    errors = [
        float((np.abs(_played(one) - truth[:, : one.lanes]) / scale).max()) for one in candidates
    ]
    speeds = _speeds(candidates)
    rows = [
        (one.family, one.setting, f"{error:.0e}", f"{speed:.3g}")
        for one, error, speed in zip(candidates, errors, speeds, strict=True)
    ]
    settings = table(("", "setting", "error", "million steps/s"), rows)
    levels = _levels(candidates, errors, speeds)
    return f"{INTRODUCTION}\nProcessor: {processor()}.\n\n{levels}\n\n{settings}\n"


def _levels(candidates: list[Candidate], errors: list[float], speeds: list[float]) -> str:
    """Return the table of the fastest setting of each family at each level."""
    families = list(dict.fromkeys(one.family for one in candidates))
    rows = []
    for level in LEVELS:
        best = {
            family: max(
                (
                    speed
                    for one, error, speed in zip(candidates, errors, speeds, strict=True)
                    if one.family == family and error <= level
                ),
                default=np.nan,
            )
            for family in families
        }
        others = [f"{best[name]:.3g} ({best[OURS] / best[name]:.2f})" for name in families[1:]]
        rows.append((f"{level:.0e}", f"{best[OURS]:.3g}", *(x.replace("nan", "-") for x in others)))
    return table(("error at most", *families), rows)


def _start() -> tuple[Values, Values]:
    """Return the states (4, lanes) of the environment at its start, and forces (steps, lanes)."""
    env = _env(SCENE)
    env.reset(seed=0)
    limit = SCENE.actuation.force.limit
    return env.state.T.copy(), limit * _actions().astype(np.float64)


def _actions() -> NDArray[np.float32]:
    return np.random.default_rng(0).uniform(-1.0, 1.0, (STEPS, LANES)).astype(np.float32)


def _env(scene: Scene) -> MovingMassVectorEnv:
    return MovingMassVectorEnv(scene, LANES, copy=False)


def _ours(scene: Scene, tolerance: float) -> Candidate:
    env = _env(scene.replace(**{"solver.tolerance": tolerance}))
    actions = [np.asfortranarray(row[:, None]) for row in _actions()]
    return Candidate(
        OURS,
        f"tolerance {tolerance:.0e}",
        LANES,
        lambda: env.reset(seed=0),
        lambda n: env.step(actions[n]),
        lambda: env.state.T,
    )


def _bare(name: str, block: Block, count: int, start: Values, forces: Values) -> Candidate:
    values = start.copy()

    def begin() -> None:
        values[:] = start

    def step(n: int) -> None:
        block((*values, forces[n]), count)

    family = TAYLOR if name.startswith(TAYLOR) else name
    setting = f"{name.removeprefix(family)} {count} substeps".strip()
    return Candidate(family, setting, LANES, begin, step, lambda: values)


def _kernels(scene: Scene) -> list[tuple[str, Block, tuple[int, ...]]]:
    """Return name, kernel and numbers of substeps of what a user would write."""
    series = [(f"{TAYLOR} of order {p},", _taylor(scene, p), n) for p, n in SERIES.items()]
    return [
        (RK4, _rk4(scene), (1, 2, 3, 4, 6, 8, 16, 32)),
        (EULER, _semi_implicit_euler(scene), (4, 16, 64, 256)),
        *series,
    ]


def _constants(scene: Scene) -> tuple[float, ...]:
    carriage = scene.carriage
    m1, k1, d, beta = (
        carriage.mass,
        carriage.stiffness,
        carriage.damping,
        carriage.cubic_coefficient,
    )
    return 1.0 / m1, 1.0 / scene.sphere.mass, k1, k1 * beta, scene.interface.damping, d


def _rk4(scene: Scene) -> Block:
    by_m1, by_m2, k1, k3, c, d = _constants(scene)
    time_step = scene.control.time_step

    @numba.njit(fastmath=True, inline="always")
    def field(x1: float, v1: float, v2: float, u: float) -> tuple[float, float]:
        slip = c * (v2 - v1)
        return (slip - d * v1 - (k1 + k3 * x1 * x1) * x1 + u) * by_m1, -slip * by_m2

    @numba.njit(fastmath=True)
    def block(arrays: Arrays, count: int) -> None:
        x1s, x2s, v1s, v2s, us = arrays
        h = time_step / count
        for _ in range(count):
            for i in range(x1s.size):
                x1, v1, v2, u = x1s[i], v1s[i], v2s[i], us[i]
                a1, a2 = field(x1, v1, v2, u)
                w1, w2 = v1 + 0.5 * h * a1, v2 + 0.5 * h * a2
                b1, b2 = field(x1 + 0.5 * h * v1, w1, w2, u)
                y1, y2 = v1 + 0.5 * h * b1, v2 + 0.5 * h * b2
                c1, c2 = field(x1 + 0.5 * h * w1, y1, y2, u)
                z1, z2 = v1 + h * c1, v2 + h * c2
                d1, d2 = field(x1 + h * y1, z1, z2, u)
                x1s[i] = x1 + h / 6.0 * (v1 + 2.0 * (w1 + y1) + z1)
                x2s[i] += h / 6.0 * (v2 + 2.0 * (w2 + y2) + z2)
                v1s[i] = v1 + h / 6.0 * (a1 + 2.0 * (b1 + c1) + d1)
                v2s[i] = v2 + h / 6.0 * (a2 + 2.0 * (b2 + c2) + d2)

    return _in_blocks(block)


def _semi_implicit_euler(scene: Scene) -> Block:
    by_m1, by_m2, k1, k3, c, d = _constants(scene)
    time_step = scene.control.time_step

    @numba.njit(fastmath=True)
    def block(arrays: Arrays, count: int) -> None:
        x1s, x2s, v1s, v2s, us = arrays
        h = time_step / count
        for _ in range(count):
            for i in range(x1s.size):
                x1, v1, v2 = x1s[i], v1s[i], v2s[i]
                slip = c * (v2 - v1)
                v1 += h * (slip - d * v1 - (k1 + k3 * x1 * x1) * x1 + us[i]) * by_m1
                v2 -= h * slip * by_m2
                x1s[i], v1s[i], v2s[i] = x1 + h * v1, v1, v2
                x2s[i] += h * v2

    return _in_blocks(block)


def _taylor(scene: Scene, order: int) -> Block:
    """Return the recurrences of a Taylor series, unrolled: a function written by a loop."""
    lines = ["def block(arrays, count):", " x1s, x2s, v1s, v2s, us = arrays"]
    lines += [" h = time_step / count"]
    lines += [" for _ in range(count):", "  for i in range(x1s.size):"]
    lines += ["   x0, y0, v0, w0 = x1s[i], x2s[i], v1s[i], v2s[i]"]
    for n in range(order):
        square = " + ".join(f"x{j} * x{n - j}" for j in range(n + 1))
        cube = " + ".join(f"s{j} * x{n - j}" for j in range(n + 1))
        push = " + us[i]" if n == 0 else ""
        lines += [
            f"   s{n} = {square}",
            f"   slip = c * (w{n} - v{n})",
            f"   a = slip - d * v{n} - k1 * x{n} - k3 * ({cube}){push}",
            f"   v{n + 1} = h / {n + 1}.0 * by_m1 * a",
            f"   w{n + 1} = -h / {n + 1}.0 * by_m2 * slip",
            f"   x{n + 1}, y{n + 1} = h / {n + 1}.0 * v{n}, h / {n + 1}.0 * w{n}",
        ]
    for array, term in (("x1s", "x"), ("x2s", "y"), ("v1s", "v"), ("v2s", "w")):
        lines += [f"   {array}[i] = " + " + ".join(f"{term}{n}" for n in range(order, -1, -1))]
    names = ("by_m1", "by_m2", "k1", "k3", "c", "d")
    values = dict(zip(names, _constants(scene), strict=True))
    known: dict[str, object] = {"time_step": scene.control.time_step, **values}
    exec("\n".join(lines), known)  # noqa: S102 - the text above
    return _in_blocks(numba.njit(fastmath=True)(known["block"]))


def _in_blocks(block: Block) -> Block:
    """Return a kernel that makes all substeps of a block of lanes before those of the next."""

    @numba.njit
    def run(arrays: Arrays, count: int) -> None:
        x1s, x2s, v1s, v2s, us = arrays
        for k in range(0, x1s.size, BLOCK):
            end = k + BLOCK
            own = x1s[k:end], x2s[k:end], v1s[k:end], v2s[k:end], us[k:end]
            block(own, count)

    return run


def _heyoka(scene: Scene, tolerance: float, start: Values, forces: Values) -> Candidate:
    import heyoka as hy  # noqa: PLC0415 - an optional peer

    by_m1, by_m2, k1, k3, c, d = _constants(scene)
    x1, x2, v1, v2 = hy.make_vars("x1", "x2", "v1", "v2")
    slip = c * (v2 - v1)
    push = slip - d * v1 - k1 * x1 - k3 * x1**3 + hy.par[0]
    system = [(x1, v1), (x2, v2), (v1, push * by_m1), (v2, -slip * by_m2)]
    first = np.ascontiguousarray(start[:, :HEYOKA_LANES])
    integrator = hy.taylor_adaptive_batch(
        system, first, tol=tolerance, pars=np.zeros((1, HEYOKA_LANES))
    )

    def begin() -> None:
        integrator.set_time(0.0)
        integrator.state[:] = first

    def step(n: int) -> None:
        integrator.pars[0] = forces[n, :HEYOKA_LANES]
        integrator.propagate_for(scene.control.time_step)

    setting = f"tolerance {tolerance:.0e}, {HEYOKA_LANES} lanes"
    return Candidate("heyoka", setting, HEYOKA_LANES, begin, step, lambda: integrator.state)


def _played(candidate: Candidate) -> Values:
    """Return the state after all steps."""
    candidate.begin()
    for n in range(STEPS):
        candidate.step(n)
    return candidate.state().copy()


def _speeds(candidates: list[Candidate]) -> list[float]:
    """Return million steps/s of each, every control step at its fastest."""
    fastest = np.full((len(candidates), STEPS), np.inf)
    for _ in range(ROUNDS):
        for k, one in enumerate(candidates):
            one.begin()
            for n in range(STEPS):
                began = time.perf_counter()
                one.step(n)
                fastest[k, n] = min(fastest[k, n], time.perf_counter() - began)
    lanes = np.array([one.lanes for one in candidates])
    return [float(speed) for speed in 1e-6 * lanes / fastest.mean(axis=1)]
