"""Helpers of the numerical tests."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from mm_gym.lanes import layout
from mm_gym.simulation.lanes import Lanes

GOLDEN = Path(__file__).parents[1] / "golden"


def golden(name: str) -> dict[str, Any]:
    """Return the content of a golden file."""
    return json.loads((GOLDEN / f"{name}.json").read_text())


def numbers(texts: list[str]) -> np.ndarray:
    """Return decimal texts as doubles."""
    return np.array([float(text) for text in texts])


def assert_lanes_equal_single(plant: Any, steps: int, count: int = 21) -> None:
    """Assert that lane i among many equals lane i alone, to the last bit."""
    rng = np.random.default_rng(7)
    many = Lanes(plant, count)
    many.seed(3)
    many.restart()
    single = [Lanes(plant, 1) for _ in range(count)]
    for i, lane in enumerate(single):
        lane.seed(3 + i)
        lane.restart()
    for _ in range(steps):
        actions = rng.uniform(-1.0, 1.0, (len(plant.actuators), count))
        many.advance(actions.ravel())
        for i, lane in enumerate(single):
            lane.advance(np.ascontiguousarray(actions[:, i]))
    alone = np.hstack([lane.values for lane in single])
    for row in set(range(len(alone))) - {
        layout.NOW,
        layout.DUE,
    }:  # of a block of lanes, not of a lane
        assert np.array_equal(many.values[row], alone[row]), row
