"""The settings of searches, and of those around a law."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from agents.training.config import Count, Positive, RunSettings
from agents.training.forecast import FUTURE

LawName = Literal[
    "auto", "regulator", "lqg", "switching", "weighted", "tracking", "constant", "none"
]


class TimedSettings(RunSettings):
    """What ends a search, and how often it is validated."""

    time_budget: Positive | None = None
    """[s] without interruptions, after which it stops even if rounds are left; by default none"""
    evaluations: Count = 20
    """validations during the run; the best policy is kept"""


class SearchSettings(TimedSettings):
    """What is searched around a law, and where it is written."""

    law: LawName = "auto"
    """what a network begins as: "regulator" the LQR of the force, "switching" the clipped LQR of
    the stretch (both with both actuators) or clipped-optimal control of the damper,
    "weighted" the clipped LQR with the free weights of `tune-controllers`, "lqg" the LQG of the
    force, "tracking" an absorber tuned to the frequency it finds, "constant" the best
    constant command, "none" no control; "auto" takes the one for the actuators of a task, unless
    the LQG or no control clearly costs less on the validation episodes, and the cheapest for an own
    scene"""
    hidden: Count = 8
    """units of the hidden layer"""
    extra: Annotated[int, Field(ge=0)] = 0
    """correlation units in addition to those of the controller, drawn at random"""
    memory: Annotated[int, Field(ge=0, le=FUTURE)] = 4
    """states of a linear memory that predicts a random force, if two frames show it"""
