"""Scenes whose episodes end often, and how to compare environments to the last bit."""

from pathlib import Path

import numpy as np
import pytest
from rollouts import LANES
from tasks import CARRIAGE_FORCE, PRE_STRETCH

from mm_gym import MovingMassEnv, MovingMassVectorEnv

# Short horizons, and limits that random starts and actions sometimes exceed; some episodes of the
# first begin beyond the limit and end in their first step.
ENDING = {
    "force": CARRIAGE_FORCE.replace(**{"objective.displacement_limit": 0.007, "control.steps": 12}),
    "stretch": PRE_STRETCH.replace(
        **{
            "objective.displacement_limit": 0.006,
            "objective.rail_half_length": 0.02,
            "control.steps": 31,
            "randomization.carriage.mass": (0.08, 0.12),
        }
    ),
}
MOTION = Path(__file__).parents[1] / "data" / "motion.csv"
ENDING["everything"] = PRE_STRETCH.replace(
    excitation=[
        {"kind": "harmonic", "amplitude": 0.5, "frequency": 50.0},
        {"kind": "impulse", "size": [-0.02, 0.02], "rate": 20.0},
        {
            "kind": "sweep",
            "amplitude": 0.5,
            "start_frequency": 20.0,
            "end_frequency": 70.0,
            "duration": 0.1,
        },
        {"kind": "noise", "rms": 0.5, "low_frequency": 40.0, "high_frequency": 80.0, "rise": 0.05},
        {"kind": "kanai_tajimi", "rms": 1.0, "ground_frequency": 60.0},
        {"kind": "record", "file": str(MOTION)},
    ],
    randomization={
        "excitation.0.frequency": [44.0, 71.0],
        "excitation.3.high_frequency": [70.0, 90.0],
        "excitation.4.rms": [0.5, 2.0],
        "excitation.5.time_scale": [0.5, 2.0],
        "excitation.5.start": [0.0, 0.2],
        "interface.damping": [0.05, 0.2],
    },
    actuation={
        "force": {"limit": 1.0, "rate_limit": 20.0, "lag": 0.02, "command": "rate"},
        "stretch": {"minimum": 1.0, "maximum": 3.0, "rate_limit": 4.0, "lag": 0.015},
    },
    sensors={
        "channels": [
            "carriage_displacement",
            "sphere_offset",
            "carriage_acceleration",
            "sphere_acceleration",
            "spring_force",
            "disturbance_force",
            "ground_acceleration",
        ],
        "noise": {"carriage_displacement": 1e-4, "ground_acceleration": 0.1},
        "delay": 2,
        "history": 3,
    },
    **{
        "control.steps": 31,
        "objective.displacement_limit": 0.009,
        "objective.rail_half_length": 0.02,
    },
)


@pytest.fixture(params=list(ENDING))
def ending_scene(request):
    return ENDING[request.param]


@pytest.fixture(params=["force", "stretch"])
def scene(request):
    return {"force": CARRIAGE_FORCE, "stretch": PRE_STRETCH}[request.param]


@pytest.fixture(params=["single", "vector"])
def make(request):
    """Return a function that makes an environment of a scene: of one lane, or of several."""
    if request.param == "single":
        return MovingMassEnv
    return lambda scene: MovingMassVectorEnv(scene, LANES)


def _assert_same(one, other):
    assert type(one) is type(other)
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            _assert_same(one[key], other[key])
    elif isinstance(one, tuple | list):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            _assert_same(a, b)
    elif isinstance(one, np.ndarray):
        assert (one.dtype, one.shape) == (other.dtype, other.shape)
        if one.dtype == object:
            for a, b in zip(one, other, strict=True):
                _assert_same(a, b)
        else:
            # Bytes, so that -0.0 differs from 0.0.
            assert np.ascontiguousarray(one).tobytes() == np.ascontiguousarray(other).tobytes()
    else:
        assert one == other


@pytest.fixture(scope="session")
def assert_same():
    """Compare nested dictionaries and arrays to the last bit."""
    return _assert_same
