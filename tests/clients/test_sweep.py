"""A sweep on Ray: complete, nothing twice, and equal to that of this machine's own processes."""

import os
import signal
import threading
import time
from pathlib import Path

import pytest

from agents.commands.sweep import sweep
from agents.sweeps.trials import SweepSettings

SETTINGS = SweepSettings(
    name="small",
    tasks=("CarriageForce",),
    algorithms=("ppo", "sac"),
    seeds=2,
    processes=2,
    settings={
        "lanes": 8,
        "steps": 1600,
        "evaluations": 8,
        "ppo.rollout": 10,
        "ppo.batch_size": 40,
        "sac.learning_starts": 100,
        "sac.gradient_steps": 1,
        "sac.hidden": [8],
    },
)


def trainer(run):
    """The process that holds the lock of a run: it is written there."""
    words = (run / ".lock").read_text().split()
    return int(words[1])


def kill_one(folder, killed):
    """Kill the process of the first training that has a checkpoint and no policy."""
    for _ in range(6000):
        time.sleep(0.02)
        for checkpoint in folder.glob("*/checkpoint.npz"):
            if not (checkpoint.parent / "policy.safetensors").exists():
                os.kill(trainer(checkpoint.parent), signal.SIGKILL)
                killed.append(checkpoint.parent.name)
                return


@pytest.fixture(scope="module")
def local(tmp_path_factory):
    root = tmp_path_factory.mktemp("local")
    assert sweep(SETTINGS, root) is None
    return root / "small"


def files(folder):
    """What a sweep found out: the table, and of each training what has no times in it."""
    names = ("results.csv", "*/metrics.csv", "*/policy.safetensors", "*/result.json")
    paths = [path for name in names for path in sorted(folder.glob(name))]
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


def test_worker_on_ray_that_is_killed_leaves_a_sweep_complete_and_equal(local, tmp_path):
    killed = []
    killer = threading.Thread(target=kill_one, args=(tmp_path / "small", killed))
    killer.start()
    assert sweep(SETTINGS.model_copy(update={"ray": "none"}), tmp_path) is None
    killer.join()
    assert len(killed) == 1
    assert files(tmp_path / "small") == files(local)
    rows = (tmp_path / "small" / "results.csv").read_text().splitlines()[1:]
    assert len(rows) == len(set(rows)) == 4
    steps = [
        line.split(",")[0]
        for line in (tmp_path / "small" / killed[0] / "metrics.csv").read_text().splitlines()[1:]
    ]
    assert len(steps) == len(set(steps)) == 8  # no validation is there twice


def test_same_sweep_again_trains_nothing(local):
    before = {path: path.stat().st_mtime_ns for path in Path(local).rglob("*.npz")}
    assert sweep(SETTINGS.model_copy(update={"ray": "none"}), local.parent) is None
    assert {path: path.stat().st_mtime_ns for path in Path(local).rglob("*.npz")} == before
