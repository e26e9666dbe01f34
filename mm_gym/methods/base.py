"""The interface of a method, and the parts that methods have in common."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from contextlib import contextmanager
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from mm_gym.arrays import Array
from mm_gym.errors import CompileError
from mm_gym.lanes import layout

if TYPE_CHECKING:
    from collections.abc import Generator

    from mm_gym.methods.support import Support
    from mm_gym.step.control_step import Entries

ROUND_OFF = 2.0**-54  # relative size below which a term of a series changes nothing


class Settings(NamedTuple):
    """The fields of ``solver`` that methods read."""

    tolerance: float  # bound of the relative error over a control step
    substeps: int  # in each sample interval, for a fixed-step method


class Option(NamedTuple):
    """The field of ``solver`` that sets a method's accuracy."""

    name: str  # of a field of `Settings`
    values: tuple[float, ...]  # that a work-precision measurement tries, from coarse to fine


class Method(ABC):
    """A way to propagate plants.

    Attributes
    ----------
    name
        The value of ``solver.method`` that asks for it. Several methods may have the same name.
    title
        A short noun phrase for messages.
    how
        The method in words, for `Plant.explain` and the documentation.
    kinds
        The kinds of plants that it propagates; see `mm_gym.methods.support`.
    entries
        Its compiled functions.
    option
        The field of ``solver`` that sets its accuracy, if any.
    tightest
        The smallest tolerance that it keeps.
    beyond
        What its error has beyond the tolerance, for messages.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    how: ClassVar[str]
    kinds: ClassVar[tuple[str, ...]]
    entries: ClassVar[Entries]
    option: ClassVar[Option | None] = None
    tightest: ClassVar[float] = 0.0
    beyond: ClassVar[str] = ""

    def entries_of(self, support: Support) -> Entries:  # noqa: ARG002 - most have one kind
        """Return the compiled functions for a support."""
        return self.entries

    def deferral(self, support: Support, settings: Settings) -> str | None:  # noqa: ARG002 - most defer to none
        """Return why `auto` prefers a later method although this one applies, or None."""
        return None

    def obstacle(self, support: Support, settings: Settings | None = None) -> str | None:
        """Return why the method does not apply to a support, or None if it does.

        With settings, also why not with those.
        """
        if support.kind not in self.kinds:
            return f"{self.title} cannot propagate a {support.kind} plant"
        obstacle = self.limit(support)
        if obstacle is not None or settings is None:
            return obstacle
        if settings.tolerance < self.tightest:
            return f"solver.tolerance is below {self.tightest:g}"
        return self.failing(support, settings)

    def failing(self, support: Support, settings: Settings) -> str | None:  # noqa: ARG002 - few fail
        """Return why the method cannot keep the settings on a plant that it applies to, or None."""
        return None

    def planned(self, support: Support, settings: Settings) -> Settings | None:
        """Return the settings, with ten times the tolerance and so on until it can keep them."""
        looser = (settings._replace(tolerance=settings.tolerance * 10.0**k) for k in range(12))
        return next((one for one in looser if self.obstacle(support, one) is None), None)

    def limit(self, support: Support) -> str | None:  # noqa: ARG002 - most have no limit
        """Return why the method does not apply to a plant of its kinds, or None if it does."""
        return None

    @abstractmethod
    def model(self, support: Support, settings: Settings) -> Array:
        """Return the kernel's constants (m,); raise `CompileError` if it cannot keep its bound."""

    @abstractmethod
    def order(self, settings: Settings) -> str:
        """Return the order of the error in words."""

    @abstractmethod
    def cost(self, model: Array) -> str:
        """Return the work of one sample interval in words."""

    def bound(self, settings: Settings) -> str:
        """Return the bound of the error in words: the tolerance, if it is not overridden."""
        return f"{settings.tolerance:g} of the state's scale over a control step{self.beyond}"

    def constants(self, support: Support, settings: Settings) -> Array:
        """Return the model array: the kernel's constants, then the excitation's description."""
        model = self.model(support, settings)
        model[layout.EXCITATION] = len(model)
        return np.concatenate([model, support.excitation])


class ExactMethod(Method):
    """A method whose only error is round-off."""

    held: ClassVar[str] = "a held force"
    """the input for which it is exact"""

    def order(self, settings: Settings) -> str:  # noqa: ARG002 - there is nothing to set
        """Return the input for which the method is exact."""
        return f"exact for {self.held}"

    def bound(self, settings: Settings) -> str:  # noqa: ARG002 - there is nothing to set
        """Return the size of the round-off."""
        return "round-off: 1e-12 of the trajectory's scale"


@contextmanager
def refuse_overflow(support: Support) -> Generator[None]:
    """Turn an overflow of a transition matrix into a `CompileError`."""
    try:
        yield
    except OverflowError as error:
        what = f"a sample interval of {support.sample_interval} s"
        msg = f"control.time_step: {what} is too long for this scene's rates: {error}"
        raise CompileError(msg) from error


def refuse_long_interval(
    support: Support,
    phase: float,
    longest: float,
    *,
    unit: str = "the scene's shortest time constant",
    remedy: str = "lower the fastest rate",
) -> None:
    """Raise `CompileError` if a sample interval is longer than so many units of time."""
    if not phase <= longest:
        interval = support.sample_interval
        msg = (
            f"control.time_step: a sample interval of {interval} s is {phase:.3g} times {unit}, "
            f"{interval / phase:.3g} s; allowed: {longest:.4g} times. Shorten the control step, or "
            f"{remedy}"
        )
        raise CompileError(msg)


def header(support: Support, own: int) -> Array:
    """Return a model array with the slots of every method filled, and `own` more slots."""
    model = np.zeros(layout.MODEL_OWN + own)
    model[layout.SAMPLE_INTERVAL] = support.sample_interval
    model[layout.INTERVALS] = support.intervals_per_step
    model[layout.JETS], model[layout.TERMS] = support.jets, support.terms
    model[layout.INTERFACE], model[layout.BETWEEN] = support.interface_row, support.is_between
    model[layout.DAMPED] = support.damped_row
    model[layout.HARMONIC_COUNT] = len(support.ground)
    model[layout.GROUND] = sum(1 << j for j, ground in enumerate(support.ground) if ground)
    return model


def degree(phase: float) -> int:
    """Return the lowest degree n at which Taylor's remainder is below round-off.

    The first term of the remainder is at most phase**(n + 1) / (n + 1)!, and each next one is
    smaller by a factor of phase / (n + 2) or less. n is at least 2, because under a held force even
    a slow or free mass moves by t**2 / 2.
    """
    n = max(2, math.ceil(phase))
    while phase ** (n + 1) / math.factorial(n + 1) > ROUND_OFF * (1.0 - phase / (n + 2)):
        n += 1
    return n
