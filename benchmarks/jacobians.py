"""Cost of a control step with its Jacobians, compared with the environment's step, over lanes."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.report import table
from benchmarks.timing import side_by_side
from mm_gym import MovingMassVectorEnv, load_scene
from mm_gym.sensitivity import Sensitivities
from mm_gym.tasks import ids

if TYPE_CHECKING:
    from collections.abc import Callable

LANES = 512
STEPS = 64
"""Control steps of a turn, after which state and random numbers are those at its start again."""

PARAMETERS = ("carriage.mass", "carriage.stiffness", "carriage.damping", "sphere.mass")

INTRODUCTION = """The environment's step is `MovingMassVectorEnv.step`, with reward, observation and
ends. Next to it is the motion alone with its Jacobians, without anything else of that step; for a
linear plant, whose Jacobians are the same in every step, this can take less. What is prepared
before the first step is included, in each case shared by {steps} steps. The ratios are to the
environment's step.
"""


def jacobians() -> str:
    """Return the section on derivatives: by state and actuators, and by some parameters too."""
    rows = [_row(name) for name in ids()]
    header = (
        *("task", "environment's step, ns a lane"),
        *("motion and Jacobians alone, ns a lane", "ratio"),
        *(f"and those of {len(PARAMETERS)} parameters, ns a lane", "ratio"),
    )
    introduction = INTRODUCTION.format(steps=STEPS)
    title = f"## Jacobians of a control step, {LANES} lanes"
    return f"{title}\n\n{introduction}\n{table(header, rows)}\n"


def _row(name: str) -> tuple[str, ...]:
    env = MovingMassVectorEnv(load_scene(name), LANES, autoreset_mode="Disabled", copy=False)
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1.0, 1.0, (STEPS, *env.action_space.shape))
    start = env.get_state()
    columns = [np.ascontiguousarray(action.T) for action in actions]

    def step() -> None:
        env.set_state(start)
        for action in actions:
            env.step(action)

    def differentiate(parameters: tuple[str, ...] = ()) -> None:
        constants = env.plant.model, env.plant.task
        rows = {name: env.plant.support.row_of(name) for name in parameters}
        begin = start["values"], start["streams"]
        lanes = Sensitivities(env.plant.support, constants, begin, rows)
        for column in columns:
            lanes.step(column)

    candidates: dict[str, Callable[[], object]] = {
        "step": step,
        "with": differentiate,
        "with parameters": lambda: differentiate(PARAMETERS),
    }
    work = dict.fromkeys(candidates, LANES * STEPS)
    timings = side_by_side(candidates, work=work, clock=time.process_time)
    plain = timings["step"]
    cells = [name, f"{plain.median * 1e9:.0f}"]
    for label in ("with", "with parameters"):
        cells.append(f"{timings[label].median * 1e9:.0f}")
        cells.append(f"{1.0 / timings[label].times_faster_than(plain):.1f}")
    return tuple(cells)
