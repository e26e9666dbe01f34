"""The seeds of training lanes."""

from __future__ import annotations

from agents.training.config import LANE_BITS

TRAINING = 1 << 63
"""The bit that seeds of training lanes have; those of validation and held-out episodes do not."""


def training_seeds(seed: int, count: int, first: int = 0) -> list[int]:
    """Return the seeds of a training's lanes, which no other training and no evaluation uses.

    The lanes are numbered from the first.

    The training's seed, of 32 bits, stands above the lane's number, of 31. With the environment's
    own rule, lane i = seed + i, trainings of neighbouring seeds would have all lanes but one in
    common.
    """
    return [TRAINING | seed << LANE_BITS | lane for lane in range(first, first + count)]
