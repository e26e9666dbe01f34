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

ROUNDING = {
    "CarriageForce": 1e-15,
    # Columns of 2 to 6 substeps, whose weights' magnitudes add up to 10: of each rounding of 1e-16.
    "CarriageForceDuffing": 2e-14,
    "CarriageForceFriction": 1e-15,
    "PreStretch": 1e-15,
}
"""A task of each kind, and how far plain Python may be off: it rounds a product before adding."""


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


@pytest.mark.parametrize("name", list(ROUNDING))
def test_plain_python_moves_as_compiled_code_does(name):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, name],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        check=False,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    got, want = json.loads(done.stdout), motion(name)
    np.testing.assert_allclose(got, want, rtol=0.0, atol=ROUNDING[name])
