"""Start-up times: the import, and the first step with and without compiled code on disk."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

import mm_gym
from benchmarks.report import table
from mm_gym.tasks import ids

if TYPE_CHECKING:
    from collections.abc import Iterator

STEP = (
    "import gymnasium, mm_gym; e = gymnasium.make('{}'); e.reset(seed=0); "
    "e.step(e.action_space.sample())"
)
SCRIPTS = {
    "`import numpy, gymnasium, numba`": "import numpy, gymnasium, numba",
    "`import mm_gym`": "import mm_gym",
    "make, reset and step CarriageForce": STEP.format("mm_gym/CarriageForce-v0"),
    "make, reset and step PreStretch": STEP.format("mm_gym/PreStretch-v0"),
}
ROUNDS = 5
WORKERS = 10

TIMED = """
import resource, time
start = time.perf_counter()
{}
used = resource.getrusage(resource.RUSAGE_SELF)
print(used.ru_utime + used.ru_stime, time.perf_counter() - start)
"""
"""Prints the processor time of the process, and the time of the script [s]."""

EMPTY = """These processes begin without compiled code on disk. First each scene runs in its own
process with its own copy of the package. Then all scenes share one copy, so that kernels which
tasks have in common are compiled once. Then {workers} processes step CarriageForce at the same time
with one copy. The processor time is that of whole processes; other programs on a shared machine
change it less than the time by the clock.
"""


def startup() -> str:
    """Return the sections on start-up: each script in its own process, in turns."""
    seconds: dict[str, list[float]] = {name: [] for name in SCRIPTS}
    for _ in range(ROUNDS + 1):
        for name, script in SCRIPTS.items():
            seconds[name].append(finished(started(script))[1])
    # The first round fills the caches.
    rows = [(name, f"{np.median(values[1:]):.2f}") for name, values in seconds.items()]
    warm = f"## Start-up, warm cache\n\n{table(('process', 'seconds'), rows)}\n"
    return f"{warm}\n## Start-up, empty cache\n\n{EMPTY.format(workers=WORKERS)}\n{empty()}\n"


def empty() -> str:
    """Return the table of first steps without compiled code on disk."""
    rows = []
    with copied() as common:
        for name in ids():
            with copied() as folder:
                alone = finished(started(STEP.format(name), folder))
            shared = finished(started(STEP.format(name), common))
            rows.append((name, *(f"{value:.1f}" for value in (*alone, *shared))))
    with copied() as folder:
        script = STEP.format("mm_gym/CarriageForce-v0")
        processes = [started(script, folder) for _ in range(WORKERS)]
        times = np.array([finished(process) for process in processes])
    rows.append(
        (f"{WORKERS} at once", f"{times[:, 0].sum():.1f}", f"{times[:, 1].max():.1f}", "", "")
    )
    kinds = ("processor seconds", "seconds")
    header = ("first step of", *kinds, *(f"with one copy, {kind}" for kind in kinds))
    return table(header, rows)


@contextmanager
def copied(checkout: Path | None = None) -> Iterator[str]:
    """Make a copy of the package, by default of the one that runs here, in a folder of its own.

    It has no compiled kernels.

    To name another folder for them is not enough: those next to the sources would be loaded.
    """
    with TemporaryDirectory() as folder:
        ignored = shutil.ignore_patterns("*.nbi", "*.nbc")
        package = Path(mm_gym.__file__).parent if checkout is None else checkout / "mm_gym"
        shutil.copytree(package, Path(folder, "mm_gym"), ignore=ignored)
        yield folder


def started(script: str, folder: str | None = None) -> subprocess.Popen[str]:
    """Start a script that prints its times, by default with the package that runs here."""
    places = ("PYTHONPATH", "HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR")  # of package and kernels
    return subprocess.Popen(
        [sys.executable, "-c", TIMED.format(script)],
        env=os.environ | ({} if folder is None else dict.fromkeys(places, folder)),
        cwd=folder,
        stdout=subprocess.PIPE,
        text=True,
    )


def finished(process: subprocess.Popen[str]) -> tuple[float, float]:
    """Return processor time and time of a started script [s]."""
    out, _ = process.communicate()
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, process.args)
    used, passed = out.split()[-2:]
    return float(used), float(passed)
