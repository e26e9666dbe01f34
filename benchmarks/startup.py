"""Start-up times: the import, and the first step of a new environment with a warm cache."""

from __future__ import annotations

import subprocess
import sys

import numpy as np

from benchmarks.report import table

SCRIPTS = {
    "`import numpy, gymnasium, numba`": "import numpy, gymnasium, numba",
    "`import mm_gym`": "import mm_gym",
    "make, reset and step CarriageForce": (
        "import gymnasium, mm_gym; e = gymnasium.make('mm_gym/CarriageForce-v0'); e.reset(seed=0); "
        "e.step(e.action_space.sample())"
    ),
    "make, reset and step PreStretch": (
        "import gymnasium, mm_gym; e = gymnasium.make('mm_gym/PreStretch-v0'); e.reset(seed=0); "
        "e.step(e.action_space.sample())"
    ),
}
ROUNDS = 5


def startup() -> str:
    """Return the section on start-up: each script in its own process, in turns."""
    seconds: dict[str, list[float]] = {name: [] for name in SCRIPTS}
    for _ in range(ROUNDS + 1):
        for name, script in SCRIPTS.items():
            timed = (
                f"import time; t = time.perf_counter(); {script}; print(time.perf_counter() - t)"
            )
            done = subprocess.run(
                [sys.executable, "-c", timed], capture_output=True, text=True, check=True
            )
            seconds[name].append(float(done.stdout.split()[-1]))
    # The first round fills the caches.
    rows = [(name, f"{np.median(values[1:]):.2f}") for name, values in seconds.items()]
    return f"## Start-up, warm cache\n\n{table(('process', 'seconds'), rows)}\n"
