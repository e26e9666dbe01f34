"""The settings of a training by analytic policy gradients."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from agents.search.settings import SearchSettings
from agents.training.config import Count, Positive


class GradientSettings(SearchSettings):
    """How a network is trained by gradients."""

    hidden: Count = 32
    """units of the hidden layer"""
    oscillators: Annotated[int, Field(ge=0)] = 4
    """of the linear memory, two states each, beside those that foretell a random force"""
    episodes: Count = 256
    """of an iteration, new ones in the next"""
    iterations: Count = 600
    """of the whole run"""
    rate: Positive = 4e-3
    """of learning (Adam), at first"""
    first_horizon: Positive = 25.0
    """control steps in which the slopes fade to 1/e, at first"""
    horizon: Positive = 200.0
    """the same at the end"""
    feedback: Annotated[float, Field(ge=0, le=1)] = 1.0
    """part of the slopes over observations that is followed to the motion before; 1 is the exact
    gradient, less is steadier"""
    floor: Positive = 0.05
    """of the correlation units' denominators; a smaller one switches more sharply"""

    growing: ClassVar[tuple[str, ...]] = ("iterations", "time_budget")
    suffix: ClassVar[str] = "-gradient"
    folder: ClassVar[str | None] = "gradient"
