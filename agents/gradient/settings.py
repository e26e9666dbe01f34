"""The settings of a training by analytic policy gradients."""

from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from agents.control.scene import periods
from agents.training.config import Count, Positive, SearchSettings
from mm_gym import Scene
from mm_gym.errors import refuse

LAST_RATE = 0.03  # part of the learning rate that is left at the end
AVERAGED = 0.03  # weight of an iteration in the mean that is validated
FRAMES = 64_000  # control steps in an iteration on your own scene

PERIODS = 2.5, 20.0
"""Of the slowest mode of your own scene; slopes fade to 1/e in them, at first and at the end."""

FORCE_RATE = 0.012
"""Learning rate on your own scene where a force alone acts, whose slopes are steady."""

WARMED = 10
"""Iterations in which the rate rises on your own scene: Adam's first steps are of full size in each
parameter, however little its slope is known."""

SPRING_PERIODS = 0.75, 6.5
"""The same where springs are tuned: they pump energy, and slopes over longer times mislead."""


class GradientSettings(SearchSettings):
    """How a network is trained by gradients."""

    hidden: Count = 32
    """units of the hidden layer"""
    oscillators: Annotated[int, Field(ge=0)] = 4
    """oscillators of the linear memory, two states each, in addition to those that predict a
    random force; not allowed with a cell, which has half as many as it has units"""
    cell: Annotated[int, Field(ge=0)] = 0
    """units of a recurrent cell (GRU), which begins as the linear memory and is trained by torch; 0
    for none"""
    episodes: Count = 256
    """episodes of an iteration, new ones in the next; for your own scene as many as have 64,000
    control steps"""
    iterations: Count = 600
    """iterations of the whole run; for your own scene as many as a time budget allows"""
    rate: Positive = 4e-3
    """learning rate of Adam at the start; 0.012 for your own scene where a force alone acts"""
    first_horizon: Positive = 25.0
    """control steps in which the slopes fade to 1/e, at first; for your own scene 2.5 periods, and
    0.75 where springs are tuned"""
    horizon: Positive = 200.0
    """the same at the end; for your own scene 20 periods, and 6.5 where springs are tuned"""
    feedback: Annotated[float, Field(ge=0, le=1)] = 1.0
    """fraction of the slopes over observations that is followed back to earlier motion; 1 is the
    exact gradient, less is steadier; not allowed with a cell, for which it is 1"""
    inwards: bool = False
    """whether an action beyond its limit has the slope just inside the limit, if this leads back
    inside; its fraction falls from 1 to 0 over the run; by default on for your own scene"""
    floor: Positive = 0.05
    """floor of the correlation units' denominators; a smaller one switches more sharply; for your
    own scene the best of three"""

    growing: ClassVar[tuple[str, ...]] = ("iterations", "time_budget")
    suffix: ClassVar[str] = "-gradient"
    folder: ClassVar[str | None] = "gradient"

    @property
    def unused(self) -> dict[str, str]:
        """What a cell has of its own, or torch does not follow; a task's file may have it."""
        names = ("oscillators", "feedback") if self.cell else ()
        return dict.fromkeys(names, "with cell = 0")

    @model_validator(mode="after")
    def _learns_one_scene_with_a_cell(self) -> Self:
        if self.cell and self.also is not None:
            got = f"{self.also!r} with cell = {self.cell}"
            refuse("also", got, "with cell = 0", ValueError)
        return self


STEEPEST = 1000.0
"""Largest slope of a lane over the median on your own scene, where a force alone acts. No spring
pumps energy there. After a shock a lane has steeper slopes than lanes at rest, and they hold."""


def schedule(settings: GradientSettings, done: float) -> tuple[float, float]:
    """Return the factor of the slopes in a step back, and the rate, once a part of it is done."""
    first, last = np.log(settings.first_horizon), np.log(settings.horizon)
    horizon = np.exp(first + (last - first) * done)
    warmth = 0.5 * (1.0 + np.cos(np.pi * done))
    rate = settings.rate * (LAST_RATE + (1.0 - LAST_RATE) * warmth)
    return float(np.exp(-1.0 / horizon)), rate


def fitted(settings: GradientSettings, scene: Scene) -> GradientSettings:
    """Return settings with what is not asked for chosen for the scene."""
    steps = periods(scene)
    chosen: dict[str, float] = {"episodes": max(8, FRAMES // scene.control.steps), "inwards": True}
    if scene.actuation.names == ("force",):
        chosen["rate"] = FORCE_RATE
    if steps.size:
        slowest = PERIODS if scene.actuation.stretch is None else SPRING_PERIODS
        horizons = (float(f"{value:.8g}") for value in np.multiply(slowest, steps.max()))
        chosen |= zip(("first_horizon", "horizon"), horizons, strict=True)
    left = {name: value for name, value in chosen.items() if name not in settings.model_fields_set}
    return settings.model_copy(update=left)
