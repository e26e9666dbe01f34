"""Modules of kernels that a test writes, and processes that run programs with them."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import mm_gym


def halving(decorator="kernel"):
    """Return the source of a module whose kernel `quarter` calls its kernel `half` twice."""
    return f"""
from mm_gym.compiler import inlined_kernel, kernel

@{decorator}
def half(x):
    return 0.5 * x

@kernel
def quarter(x):
    return half(half(x))
"""


def loaded(path, monkeypatch):
    """Import the file ``module.py`` anew, as a process that starts does."""
    spec = importlib.util.spec_from_file_location("module", path)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "module", module)  # numba imports it to load code
    spec.loader.exec_module(module)
    return module


def start(program, *arguments, folder=None, **environment):
    """Run a program in a process of its own, which can import the modules of a folder."""
    path = os.pathsep.join(map(str, filter(None, [Path(mm_gym.__file__).parents[1], folder])))
    return subprocess.Popen(
        [sys.executable, "-c", program, *map(str, arguments)],
        env=os.environ | environment | {"PYTHONPATH": path},
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
