"""The settings of searches around a law, and of an evolution."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from agents.evolution.forecast import FUTURE
from agents.training.config import Count, Positive, RunSettings

LawName = Literal["auto", "regulator", "switching", "tracking", "none"]


class SearchSettings(RunSettings):
    """What is searched around a law, and where it is written."""

    law: LawName = "auto"
    """what a network begins as: "regulator" the LQR of the force, "switching" the clipped LQR of
    the stretch (both with both actuators), "tracking" an absorber tuned to the frequency it finds,
    "none"; "auto" takes the one for the scene"""
    hidden: Count = 8
    """units of the hidden layer"""
    extra: Annotated[int, Field(ge=0)] = 0
    """correlation units beside those of the law, drawn at random"""
    memory: Annotated[int, Field(ge=0, le=FUTURE)] = 4
    """states of a linear memory that foretells a random force, where two frames show it"""
    time_budget: Positive = 300.0
    """[s] without interruptions, after which it stops even if rounds are left"""
    evaluations: Count = 20
    """validations during the run; the best network is kept"""


class EvolveSettings(SearchSettings):
    """How networks are evolved."""

    candidates: Annotated[int, Field(ge=4)] = 48
    """networks in a generation"""
    episodes: Count = 32
    """of each network in a generation, the same for all, new ones in the next"""
    generations: Count = 200
    """of the whole run"""
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
