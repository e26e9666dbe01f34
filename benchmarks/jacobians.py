"""Cost of a control step with its Jacobians, compared with the environment's step, over lanes."""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.report import table
from benchmarks.timing import side_by_side
from mm_gym import MovingMassVectorEnv, load_scene
from mm_gym.sensitivity import Sensitivities
from mm_gym.tasks import ids

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from benchmarks.timing import Timing

LANES = 512
STEPS = 64
"""Control steps of a turn, after which state and random numbers are those at its start again."""

PARAMETERS = ("carriage.mass", "carriage.stiffness", "carriage.damping", "sphere.mass")

INTRODUCTION = """The environment's step is `MovingMassVectorEnv.step`, with reward, observation and
ends. It is compared with the motion and its Jacobians alone, without reward, observation and ends.
For a linear plant, whose Jacobians are the same in every step, this can take less time than the
step. The times include the preparations before the first step, divided by {steps} steps. The ratios
are to the environment's step.
"""

WAYS = ("by hand, ns a lane", "by tangents, ns a lane")
HAND_WRITTEN = {
    "linear_kernel": "mm_gym/PreStretch-v0",
    "cubic_kernel": "mm_gym/CarriageForceDuffing-v0",
}
"""The kernels in `mm_gym.sensitivity`, each with a task that it serves."""

COMPARISON = """A derivative is computed by tangents (forward mode) unless a kernel by hand is 1.5
times as fast. With friction or springs of finite stretch the motion is a Taylor series of numbers
with tangents. These serve all plants. Where a hand-written kernel exists too, both were measured in
turns. The last column is the largest difference between the derivatives of the first step by both,
relative to the largest of each column.
"""


def jacobians() -> str:
    """Return the section on derivatives: by state and actuators, and by some parameters too."""
    header = (
        *("task", "environment's step, ns a lane"),
        *("motion and Jacobians alone, ns a lane", "ratio"),
        *(f"and those of {len(PARAMETERS)} parameters, ns a lane", "ratio"),
    )
    header_of_kernels = ("kernel", "task", "parameters", *WAYS, "ratio", "difference")
    kernels = [
        _compared(kernel, _Case(task), count)
        for kernel, task in HAND_WRITTEN.items()
        for count in (0, 1, len(PARAMETERS))
    ]
    return (
        f"## Jacobians of a control step, {LANES} lanes\n\n{INTRODUCTION.format(steps=STEPS)}\n"
        f"{table(header, [_row(_Case(name)) for name in ids()])}\n\n"
        f"{COMPARISON}\n{table(header_of_kernels, kernels)}\n"
    )


class _Case:
    """A task's lanes, where their episodes begin, and random actions."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.env = MovingMassVectorEnv(
            load_scene(name), LANES, autoreset_mode="Disabled", copy=False
        )
        self.env.reset(seed=0)
        rng = np.random.default_rng(0)
        self.actions = rng.uniform(-1.0, 1.0, (STEPS, LANES, len(self.env.plant.actuators)))
        self.start = self.env.get_state()
        self._columns = [np.ascontiguousarray(action.T) for action in self.actions]

    def step(self) -> None:
        """Make the environment's steps."""
        self.env.set_state(self.start)
        for action in self.actions:
            self.env.step(action)

    def differentiate(
        self, parameters: tuple[str, ...] = (), *, by_tangents: bool = False, steps: int = STEPS
    ) -> NDArray[np.float64]:
        """Make steps with derivatives; return those of the last."""
        plant, values = self.env.plant, np.asarray(self.start["values"], np.float64)
        begin = values, np.asarray(self.start["streams"], np.uint64)
        rows = {name: plant.support.row_of(name) for name in parameters}
        constants = plant.model, plant.task
        lanes = Sensitivities(plant.support, constants, begin, rows, by_tangents=by_tangents)
        found = [lanes.step(column)[1] for column in self._columns[:steps]]
        return found[-1].copy()


def _row(case: _Case) -> tuple[str, ...]:
    candidates: dict[str, Callable[[], object]] = {
        "step": case.step,
        "with": case.differentiate,
        "with parameters": lambda: case.differentiate(PARAMETERS),
    }
    timings = _timed(candidates)
    plain = timings["step"]
    cells = [case.name, f"{plain.median * 1e9:.0f}"]
    for label in ("with", "with parameters"):
        cells.append(f"{timings[label].median * 1e9:.0f}")
        cells.append(f"{1.0 / timings[label].times_faster_than(plain):.1f}")
    return tuple(cells)


def _compared(kernel: str, case: _Case, count: int) -> tuple[str, ...]:
    """Return the row of a hand-written kernel with so many parameters."""
    by_hand, by_tangents = (
        partial(case.differentiate, PARAMETERS[:count], by_tangents=way == WAYS[1]) for way in WAYS
    )
    one, other = by_hand(steps=1), by_tangents(steps=1)
    largest = np.maximum(np.abs(other).max(axis=0), np.finfo(float).tiny)
    difference = float((np.abs(one - other).max(axis=0) / largest).max())
    timings = _timed(dict(zip(WAYS, (by_hand, by_tangents), strict=True)))
    cells = [f"{timings[way].median * 1e9:.0f}" for way in WAYS]
    ratio = timings[WAYS[0]].times_faster_than(timings[WAYS[1]])
    return (f"`{kernel}`", case.name, str(count), *cells, f"{ratio:.1f}", f"{difference:.0e}")


def _timed(candidates: Mapping[str, Callable[[], object]]) -> dict[str, Timing]:
    work = dict.fromkeys(candidates, LANES * STEPS)
    return side_by_side(candidates, work=work, clock=time.process_time)
