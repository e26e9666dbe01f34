"""Kernels can be run as plain Python, for a debugger: NUMBA_DISABLE_JIT=1."""

import json
import os
import subprocess
import sys
import warnings

import numpy as np
import pytest

from mm_gym import MovingMassVectorEnv, load_scene
from mm_gym.kernels import layout as at

LANES = at.BLOCK + 1
"""Enough for two threads."""

PROGRAM = """
import json, sys
from tests.packaging.test_uncompiled import motion
print(json.dumps(motion(sys.argv[1])))
"""

TASKS_OF_EACH_KIND = ["CarriageForce", "CarriageForceFriction", "PreStretch"]


def motion(name):
    """States of the first and last lane after three steps."""
    # As plain Python, numpy warns of the overflow that the random numbers are made of.
    warnings.filterwarnings("ignore", "overflow encountered", RuntimeWarning)
    env = MovingMassVectorEnv(load_scene(f"mm_gym/{name}-v0"), LANES, threads=2)
    env.reset(seed=0)
    actions = np.linspace(-1.0, 1.0, LANES, dtype=np.float32)[:, None]
    for _ in range(3):
        env.step(actions)
    return env.state[[0, -1]].tolist()


@pytest.mark.parametrize("name", TASKS_OF_EACH_KIND)
def test_plain_python_moves_as_compiled_code_does(name):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, name],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        check=False,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    # Plain Python rounds a product before it adds to it; compiled code rounds once.
    np.testing.assert_allclose(json.loads(done.stdout), motion(name), rtol=0.0, atol=1e-15)
