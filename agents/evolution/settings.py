"""The settings of an evolution."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from agents.training.config import Count, Positive, SearchSettings


class EvolveSettings(SearchSettings):
    """How networks are evolved."""

    candidates: Annotated[int, Field(ge=4)] = 48
    """networks in a generation"""
    episodes: Count = 32
    """of each network in a generation, the same for all, new ones in the next"""
    generations: Count = 200
    """of the whole run"""
    worst: Annotated[float, Field(gt=0, le=1)] = 1.0
    """share of the episodes, those that cost most, whose mean is minimised and validated (CVaR); 1
    is the mean of all"""
    spread: Positive = 0.3
    """of the first generation, over the size of each parameter"""
    separable: bool = False
    """adapt a variance for each parameter, not their covariance: for wide networks"""
    tolerance: Annotated[float, Field(gt=0, lt=1)] = 1e-3
    """solver.tolerance during the search, where the scene's is finer; validations keep the
    scene's"""
    threads: Count = 2
    """among which a generation is divided; results do not depend on it"""

    growing: ClassVar[tuple[str, ...]] = ("generations", "time_budget")
