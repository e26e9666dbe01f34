"""Do the peers of the benchmarks follow the same motion, so that their times compare?"""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.peers import families, mm_gym
from benchmarks.precision import MOTIONS, Motion

LINEAR, CUBIC, FRICTION, STIFF = MOTIONS
SMOOTH = ("SciPy odeint", "SciPy dopri5", "SciPy dop853", "SciPy vode adams", "SciPy vode bdf")
COMPILED = ("CVODE Adams", "CVODE Adams, Newton", "CVODE BDF", "heyoka")


def installed(*names: str) -> list[str]:
    """Return those that are there: `make bench` has an environment with all of them."""
    return [name for name in names if name in families()]


def error(name: str, motion: Motion, tolerance: float) -> float:
    """Return a peer's largest error at the end, relative to the largest start value."""
    end = np.array(mm_gym(motion, 1e-14)())
    ours = np.array(families()[name](motion, tolerance)())
    return float(np.abs(ours - end).max() / np.abs(motion.start).max())


@pytest.mark.parametrize("name", installed(*SMOOTH, *COMPILED, "SciPy DOP853", "SciPy Radau"))
@pytest.mark.parametrize("motion", [LINEAR, CUBIC], ids=lambda motion: motion.name)
def test_a_peer_follows_a_smooth_motion(name: str, motion: Motion) -> None:
    assert error(name, motion, 1e-8) < 1e-4


@pytest.mark.parametrize("name", installed(*COMPILED, "SciPy LSODA", "SciPy odeint"))
def test_a_peer_follows_stick_and_slip(name: str) -> None:
    assert error(name, FRICTION, 1e-8) < 1e-4


@pytest.mark.parametrize("name", installed("CVODE BDF", "SciPy LSODA"))
def test_a_peer_follows_stiff_friction(name: str) -> None:
    assert error(name, STIFF, 1e-6) < 1e-3
