"""Compiled kernels on disk are those of the sources, helpers in other files included."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import mm_gym

PROGRAM = """
import mm_gym
from mm_gym.tasks import CARRIAGE_FORCE
assert mm_gym.__file__.startswith({root!r}), mm_gym.__file__
env = mm_gym.MovingMassEnv(CARRIAGE_FORCE)
env.reset(seed=0)
print(*env.state)
"""

REPLACEMENT = '''

@borrowing_kernel
def uniform(streams, i):
    """Return the middle of every range."""
    return 0.5
'''


def test_editing_a_helper_in_another_file_takes_effect(tmp_path):
    package = tmp_path / "mm_gym"
    shutil.copytree(
        Path(mm_gym.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__")
    )
    environment = {
        name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"
    } | {"PYTHONPATH": str(tmp_path)}

    def start():
        program = PROGRAM.format(root=str(tmp_path))
        done = subprocess.run(
            [sys.executable, "-c", program],
            env=environment,
            cwd=tmp_path,
            capture_output=True,
            check=False,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        return [float(value) for value in done.stdout.split()]

    drawn = start()
    assert drawn[0] != 0.0
    assert list(package.rglob("*.nbi")), "kernels are cached beside their sources"
    assert start() == drawn
    helper = package / "kernels" / "random.py"
    helper.write_text(helper.read_text("utf-8") + REPLACEMENT, "utf-8")
    # The task draws displacements from ranges symmetric about 0.
    assert start() == [0.0, 0.0, 0.0, 0.0]
