"""Compare two checkouts of mm_gym: ``python -m benchmarks.against FOLDER``.

Each checkout has a process of its own. The two take turns at every measurement, so that
disturbances affect both alike. Listed is the median over rounds of the other checkout's time over
this one's: above 1, this one is faster.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import IO, cast

import numpy as np

from benchmarks.report import table
from benchmarks.startup import STEP, copied, finished, started

HERE = Path(__file__).parent.parent
ROUNDS, STARTS = 15, 9
LANES = 16_384
TASK = "mm_gym/CarriageForceDuffing-v0"
TOLERANCES = (None, 1e-3, 1e-6)

WORKER = """
import sys, time
from itertools import cycle
import numpy as np
from mm_gym import MovingMassEnv, MovingMassVectorEnv, load_scene

def stepper(name, lanes, tolerance):
    scene = load_scene(name).replace(**{"control.steps": 10**9 if lanes == 1 else 100})
    scene = scene if tolerance is None else scene.replace(**{"solver.tolerance": tolerance})
    env = MovingMassEnv(scene) if lanes == 1 else MovingMassVectorEnv(scene, lanes, copy=False)
    env.reset(seed=0)
    env.action_space.seed(0)
    different = 1 if lanes == 1 else 8
    actions = cycle([np.asfortranarray(env.action_space.sample()) for _ in range(different)])
    return lambda: env.step(next(actions))

asked = None
for line in sys.stdin:
    name, lanes, tolerance = eval(line)
    if line != asked:
        asked, step = line, stepper(name, lanes, tolerance)
        for _ in range(101):
            step()
    calls = 20_000 if lanes == 1 else 202
    began = time.process_time()
    for _ in range(calls):
        step()
    print((time.process_time() - began) / calls / lanes, flush=True)
"""
"""Answers each line, a task, a number of lanes and a tolerance, by the seconds of a step."""


def main() -> None:
    """Measure and print both tables."""
    others = [Path(text).resolve() for text in sys.argv[1:] if Path(text, "mm_gym").is_dir()]
    if len(others) != 1:
        sys.exit("give the folder of another checkout: python -m benchmarks.against FOLDER")
    folders = (others[0], HERE)
    print(steps(folders), flush=True)
    print(starts(folders))


def steps(folders: tuple[Path, Path]) -> str:
    """Return the table of steps, of one environment and of many lanes."""
    from mm_gym.tasks import ids  # noqa: PLC0415 - not before both folders are known

    workers = [_worker(folder) for folder in folders]
    cases = [(name, None) for name in ids()] + [(TASK, tolerance) for tolerance in TOLERANCES[1:]]
    rows = []
    for name, tolerance in cases:
        cells = [name if tolerance is None else f"{name}, tolerance {tolerance:g}"]
        for lanes in (1, LANES):
            rounds = np.array(
                [[_answer(one, (name, lanes, tolerance)) for one in workers] for _ in range(ROUNDS)]
            )
            cells.append(_ratio(rounds))
        rows.append(tuple(cells))
        print(cells, file=sys.stderr, flush=True)
    return table(("task", "one environment", f"{LANES:,} lanes, views"), rows)


def starts(folders: tuple[Path, Path]) -> str:
    """Return the table of first steps in a new process, with compiled code on disk and without."""
    from mm_gym.tasks import ids  # noqa: PLC0415 - the same

    rows = []
    for name in ids():
        with copied(folders[0]) as one, copied(folders[1]) as other:
            rounds = np.array(
                [
                    [finished(started(STEP.format(name), folder))[0] for folder in (one, other)]
                    for _ in range(STARTS + 1)
                ]
            )
        rows.append((name, _ratio(rounds[:1]), _ratio(rounds[1:])))
        print(rows[-1], file=sys.stderr, flush=True)
    return table(
        ("first step, in processor time", "nothing on disk", "compiled code on disk"), rows
    )


def _worker(folder: Path) -> subprocess.Popen[str]:
    """Start a process that answers with the package of a folder."""
    pipe, variables = subprocess.PIPE, os.environ | {"PYTHONPATH": str(folder)}
    command = [sys.executable, "-c", WORKER]
    return subprocess.Popen(command, cwd=folder, env=variables, stdin=pipe, stdout=pipe, text=True)


def _answer(worker: subprocess.Popen[str], question: object) -> float:
    """Return what a worker measured."""
    print(repr(question), file=worker.stdin, flush=True)
    return float(cast("IO[str]", worker.stdout).readline())


def _ratio(rounds: np.ndarray) -> str:
    """Return the other's time over this one's, from times (rounds, 2), with its spread."""
    ratios = rounds[:, 0] / rounds[:, 1]
    low, median, high = np.quantile(ratios, (0.25, 0.5, 0.75))
    return f"{median:.2f} ± {(high - low) / 2.0:.2f}"


if __name__ == "__main__":
    main()
