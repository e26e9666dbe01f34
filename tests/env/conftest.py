"""Scenes whose episodes end often, and how to compare environments to the last bit."""

import numpy as np
import pytest

from mm_gym.tasks import CARRIAGE_FORCE, PRE_STRETCH

# Short horizons, and limits that random starts and actions exceed now and then; some episodes of
# the first begin beyond the limit and end at once.
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


@pytest.fixture(params=list(ENDING))
def ending_scene(request):
    return ENDING[request.param]


@pytest.fixture(params=["force", "stretch"])
def scene(request):
    return {"force": CARRIAGE_FORCE, "stretch": PRE_STRETCH}[request.param]


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
