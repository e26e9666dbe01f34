"""Speed of scenes with a device over lanes, compared with scenes of their class without it."""

from __future__ import annotations

from itertools import product

import numpy as np

from benchmarks.grid import TIME_STEP
from benchmarks.lanes import DUFFING, FRICTION, LANES, STEPS, ours, speeds
from benchmarks.report import table
from mm_gym import MovingMassVectorEnv, Scene

ROUNDS, REPEATS = 7, 3
TOLERANCES = (1e-9, 1e-3)
FORCE = {"limit": 4.0}
BETWEEN = {"force": FORCE | {"between": "masses"}}
STRETCH = {"minimum": 1.0, "maximum": 3.0}
RANGE = (0.2, 3.0)
DAMPING = {"minimum": RANGE[0], "maximum": RANGE[1]}
VISCOUS = {"kind": "viscous", "damping": 1.0}
LINEAR = DUFFING.replace(
    **{"control.time_step": TIME_STEP, "carriage.cubic_coefficient": 0.0},
    interface=VISCOUS,
    springs={"kind": "small_on_large"},
    actuation={"force": FORCE},
)
CUBIC = LINEAR.replace(**{"carriage.cubic_coefficient": DUFFING.carriage.cubic_coefficient})
SLIPPING = LINEAR.replace(interface=FRICTION)
DRAWN = {"interface.damping": RANGE}
PAIRS = {
    "force between the masses": (LINEAR.replace(actuation=BETWEEN), LINEAR),
    "the same, cubic carriage": (CUBIC.replace(actuation=BETWEEN), CUBIC),
    "linear springs": (LINEAR.replace(springs={"kind": "linear", "stiffness": 6.0}), LINEAR),
    "damping of the interface": (
        LINEAR.replace(actuation={"damping": DAMPING}),
        LINEAR.replace(randomization=DRAWN),
    ),
    "the same, with a stretch": (
        LINEAR.replace(actuation={"damping": DAMPING, "stretch": STRETCH}),
        LINEAR.replace(actuation={"force": FORCE, "stretch": STRETCH}, randomization=DRAWN),
    ),
    "the same, cubic carriage and a stretch": (
        CUBIC.replace(actuation={"damping": DAMPING, "stretch": STRETCH}),
        CUBIC.replace(actuation={"force": FORCE, "stretch": STRETCH}, randomization=DRAWN),
    ),
}
"""A scene with a device, and one of its class: as many actuators, and as many numbers that vary."""

LIMITS = (0.4, 1.0, 2.0, 4.0, 6.0, 9.0, 14.0)
"""Of the force with dry friction [N]: the class's shares of changes must enclose the device's."""

DEVICES = (0.4, 1.0, 2.0, 4.0)
FINER, WATCHED = 40, 1024
"""Instants of a control step at which the regime of a lane is looked at, and how many lanes."""

INTRODUCTION = f"""## Devices

Each device is compared with a scene of its class. That scene has no device, but as many actuators
and as many numbers that differ between lanes: for an actuated damping, for example, a force and a
drawn damping. {LANES:,} lanes on one core make {STEPS} control steps of {1e3 * TIME_STEP:g} ms
under random actions, by `step` with views. The table lists million steps/s of processor time, each
the fastest of {ROUNDS * REPEATS} rounds in which the two scenes took turns.
"""
SECOND = """With dry friction, a force between the masses changes the slip velocity more than the
same force on the carriage. More lanes then change their regime in a control step, and these take
longer. The table has the fraction of such lanes and million steps/s for a force against the ground
and for one between the masses. The last column is the ratio of times at equal fractions, for which
the time under a force against the ground is interpolated.
"""


def devices() -> str:
    """Return the section on the devices."""
    header = ("device", "tolerance", "with device", "its class", "ratio of times")
    second = (
        *("force [N]", "ground: fraction", "million steps/s"),
        *("masses: fraction", "million steps/s", "ratio of times", "at equal fractions"),
    )
    first = table(header, [_row(*key) for key in product(PAIRS, TOLERANCES)])
    return f"{INTRODUCTION}\n{first}\n\n{SECOND}\n{table(second, _friction())}\n"


def _row(name: str, tolerance: float) -> tuple[str, ...]:
    """Return a device's row."""
    device, own = _speeds([one.replace(**{"solver.tolerance": tolerance}) for one in PAIRS[name]])
    return name, f"{tolerance:.0e}", f"{device:.3g}", f"{own:.3g}", f"{own / device:.2f}"


def _friction() -> list[tuple[str, ...]]:
    """Return a row for each force between the masses."""
    ground = [SLIPPING.replace(**{"actuation.force.limit": limit}) for limit in LIMITS]
    masses = [
        SLIPPING.replace(actuation={"force": BETWEEN["force"] | {"limit": limit}})
        for limit in DEVICES
    ]
    shares = [_changing(one) for one in ground + masses]
    times = 1.0 / np.array(_speeds(ground + masses))
    expected = np.interp(shares[len(ground) :], shares[: len(ground)], times[: len(ground)])
    rows: list[tuple[str, ...]] = []
    for k, limit in enumerate(DEVICES):
        like, own = LIMITS.index(limit), len(ground) + k
        cells = [f"{limit:g}"]
        for one in (like, own):
            cells += [f"{shares[one]:.2f}", f"{1.0 / times[one]:.3g}"]
        rows.append((*cells, f"{times[own] / times[like]:.2f}", f"{times[own] / expected[k]:.2f}"))
    return rows


def _speeds(scenes: list[Scene]) -> list[float]:
    """Return million steps/s of each."""
    candidates = [ours(one, "", _actions(one), np.empty(0)) for one in scenes]
    return list(np.max([speeds(candidates, ROUNDS) for _ in range(REPEATS)], axis=0))


def _actions(scene: Scene) -> np.ndarray:
    count = len(scene.actuation.names)
    return np.random.default_rng(0).uniform(-1.0, 1.0, (STEPS, LANES, count)).astype(np.float32)


def _changing(scene: Scene) -> float:
    """Return the fraction of control steps in which a lane changes between stick and slip."""
    env = MovingMassVectorEnv(
        scene.replace(**{"control.time_step": TIME_STEP / FINER}), WATCHED, copy=False
    )
    env.reset(seed=0)
    limit, found = FRICTION["reference_velocity"], 0.0
    for actions in _actions(scene)[:, :WATCHED]:
        regimes = [_regime(env.state, limit)]
        for _ in range(FINER):
            env.step(np.asfortranarray(actions))
            regimes.append(_regime(env.state, limit))
        found += np.mean(np.any(np.diff(regimes, axis=0) != 0.0, axis=0))
    return found / STEPS


def _regime(state: np.ndarray, limit: float) -> np.ndarray:
    """Return -1, 0 or 1: whether a lane sticks, and the direction of its slip."""
    slip = state[:, 3] - state[:, 2]
    return np.where(np.abs(slip) > limit, np.sign(slip), 0.0)
