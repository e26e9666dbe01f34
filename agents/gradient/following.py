"""What the descents share: where they start, how far they trust a gradient, what they keep."""

from abc import abstractmethod
from contextlib import suppress
from typing import ClassVar

import numpy as np

from agents.control.controller import part
from agents.gradient.settings import GradientSettings, fitted, schedule
from agents.network.layers import UNIT
from agents.training.arrays import Arrays
from agents.training.config import training_seeds
from agents.training.search import Search
from agents.training.starts import IN_WORDS, start_of
from mm_gym import ActionError, Scene

DOUBTED, REGAINED = 0.5, 1.02
"""Factors of the trust after a gradient that is not finite, and after one that is."""


class Following(Search):
    """A search along gradients.

    Attributes
    ----------
    generator
        What further is drawn from.
    began
        What it begins as; of the best floor on your own scene unless one is asked for.
    trust
        Part of the rate and the horizon that is used: a half after each gradient that is not
        finite, and again more with each that is.
    size
        Length of the last gradient.
    """

    unit: ClassVar[str] = "iteration"
    warmed: int = 1  # iterations in which the rate rises at first
    trust: float = 1.0
    size: float = 0.0

    def __init__(self, settings: GradientSettings, scene: Scene) -> None:
        settings = settings if settings.scene is None else fitted(settings, scene)
        super().__init__(settings, scene)
        self.settings: GradientSettings = settings
        self.generator = np.random.default_rng(settings.seed)
        self.began = start_of(scene, settings, self.generator)
        self.began_as = IN_WORDS[self.began.law]
        if settings.scene is None or "floor" in settings.model_fields_set:
            self.began.units[:, UNIT.index("floor")] = settings.floor

    @property
    def inwards(self) -> float:
        """Part of the slope just inside its limit that an action beyond it has."""
        return 1.0 - self.done if self.settings.inwards else 0.0

    @property
    @abstractmethod
    def _parts(self) -> dict[str, Arrays]:
        """The arrays from which the next iterations follow, by part and name; to write into."""

    @abstractmethod
    def _slope(self, seeds: list[int], fade: float) -> float:
        """Find the gradient in the episodes of the seeds, and return its length."""

    @abstractmethod
    def _follow(self, rate: float) -> None:
        """Make a step of Adam along the gradient, of which only the direction counts."""

    def _advance(self) -> None:
        """Follow the gradient, and trust it more or less then.

        After one that is not finite the search goes on from the mean that it validates.
        """
        settings, count = self.settings, self.settings.episodes
        fade, rate = schedule(settings, self.done)
        rate *= min(1.0, (self.rounds + 1) / self.warmed)
        seeds, self.size = training_seeds(settings.seed, count, self.rounds * count), np.inf
        with suppress(ActionError), np.errstate(over="ignore", invalid="ignore"):
            self.size = self._slope(seeds, fade ** (1.0 / self.trust))
            if 0.0 < self.size < np.inf:
                self._follow(rate * self.trust)
        if np.isfinite(self.size):
            self.trust = min(1.0, REGAINED * self.trust)
            return
        self.trust *= DOUBTED
        parts = self._parts
        for name, array in parts["parameters"].items():
            array[...] = parts["mean"][name]

    def _present(self) -> Arrays:
        return {name: array.copy() for name, array in self._parts["mean"].items()}

    def _state(self) -> Arrays:
        numbers = {"rounds": self.rounds, "trust": self.trust}
        state = {f"gradient/{name}": np.asarray(number) for name, number in numbers.items()}
        for role, own in self._parts.items():
            state |= {f"{role}/{name}": array.copy() for name, array in own.items()}
        return state

    def _restore(self, arrays: Arrays) -> None:
        self.rounds, self.trust = int(arrays["gradient/rounds"]), float(arrays["gradient/trust"])
        for role, own in self._parts.items():
            for name, array in part(arrays, role).items():
                own[name][...] = array
