"""Can the agents be imported where Python lacks the modules of Unix?"""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
UNIX = ("fcntl", "grp", "posix", "pwd", "resource", "termios")
"""Modules that Python has on Unix alone."""

MODULES = sorted(
    ".".join(file.relative_to(ROOT).with_suffix("").parts)
    for file in (ROOT / "agents").rglob("*.py")
    if file.name not in {"__init__.py", "__main__.py"}
)
LACKING = f"""
import importlib, os, sys
import filelock, gymnasium, matplotlib, numba, optuna, rich.console, scipy.optimize
import stable_baselines3, torch, tqdm, tyro
import mm_gym.analysis, mm_gym.metrics, mm_gym.structure, mm_gym.tuning
for name in {UNIX}:
    sys.modules[name] = None
for name in ("fork", "getuid", "O_NONBLOCK", "O_NOFOLLOW"):
    delattr(os, name)
for name in sys.argv[1:]:
    importlib.import_module(name)
"""


def test_no_module_of_agents_needs_unix():
    for package in ("control", "h5py", "matplotlib", "minari", "onnx", "optuna", "torch"):
        pytest.importorskip(package)
    done = subprocess.run(
        [sys.executable, "-c", LACKING, *MODULES],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
