"""Kernels can be run as plain Python, for a debugger: NUMBA_DISABLE_JIT=1."""

import json
import os
import subprocess
import sys
import warnings

import numpy as np
import pytest
from numba import njit

from mm_gym import MovingMassVectorEnv, Scene, load_scene, simulate
from mm_gym.lanes import layout

LANES = layout.BLOCK + 1  # enough for two threads
ENDS = [0, LANES - 1]  # lanes that are compared

PROGRAM = """
import json, sys
from tests.packaging import test_uncompiled
print(json.dumps(getattr(test_uncompiled, sys.argv[1])(*sys.argv[2:])))
"""

ROUNDING = {
    "CarriageForce": 1e-15,
    # Columns of 2 to 6 substeps, whose weights' magnitudes add up to 10: of each rounding of 1e-16.
    "CarriageForceDuffing": 2e-14,
    "CarriageForceFriction": 1e-15,
    "PreStretch": 1e-15,
}
"""A task of each kind, and how far plain Python may be off: it rounds a product before adding."""


def motion(name, others="with"):
    """States of the first and last lane after three steps, with the lanes between them or not."""
    # As plain Python, numpy warns of the overflow that the random numbers are made of.
    warnings.filterwarnings("ignore", "overflow encountered", RuntimeWarning)
    chosen = ENDS if others == "without" else list(range(LANES))
    env = MovingMassVectorEnv(load_scene(f"mm_gym/{name}-v0"), len(chosen), threads=2)
    env.reset(seed=chosen)
    actions = np.linspace(-1.0, 1.0, LANES, dtype=np.float32)[chosen, None]
    for _ in range(3):
        env.step(actions)
    return env.state[[0, -1]].tolist()


STRIBECK = {
    "kind": "stribeck",
    "static_coefficient": 0.3,
    "kinetic_coefficient": 0.2,
    "reference_velocity": 0.02,
    "stribeck_velocity": 0.05,
}


def slides():
    """States of a motion of Runge-Kutta steps, whose lengths change."""
    warnings.filterwarnings("ignore", category=RuntimeWarning)
    start = {"carriage_displacement": 0.01, "carriage_velocity": 0.2}
    scene = Scene(interface=STRIBECK, initial=start, control={"time_step": 0.02, "steps": 3})
    return simulate(scene).state.tolist()


@njit
def law(observed, actions):
    for lane in range(actions.shape[1]):
        actions[0, lane] = -observed[0, lane]


def returns():
    """Returns of two short episodes in closed loop."""
    warnings.filterwarnings("ignore", "overflow encountered", RuntimeWarning)
    env = MovingMassVectorEnv(load_scene("mm_gym/CarriageForce-v0"), 2, max_episode_steps=9)
    run = env.closed_loop(law)
    env.reset(seed=0)
    return run().returns.tolist()


def run_uncompiled(name, *arguments):
    """Return what a function of this module returns, run as plain Python."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, name, *arguments],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        check=False,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("name", list(ROUNDING))
def test_plain_python_moves_as_compiled_code_does(name):
    # More than a block of lanes as plain Python once: other tasks take longest for it.
    others = ["without"] * (name != "CarriageForce")
    got, want = run_uncompiled("motion", name, *others), motion(name)
    np.testing.assert_allclose(got, want, rtol=0.0, atol=ROUNDING[name])


def test_plain_python_closes_the_loop_as_compiled_code_does():
    # Nine rewards, each rounded a few times.
    np.testing.assert_allclose(run_uncompiled("returns"), returns(), rtol=1e-14)


def test_plain_python_makes_runge_kutta_steps_as_compiled_code_does():
    # Some 100 steps, whose roundings of 1e-16 the friction damps.
    np.testing.assert_allclose(run_uncompiled("slides"), slides(), rtol=0.0, atol=1e-13)
