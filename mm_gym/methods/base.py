"""The protocol of a method, and what methods have in common."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from contextlib import contextmanager
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from mm_gym.errors import CompileError
from mm_gym.kernels import layout as at

if TYPE_CHECKING:
    from collections.abc import Generator

    from numpy.typing import NDArray

    from mm_gym.kernels.control_step import Entries
    from mm_gym.methods.support import Support

ROUND_OFF = 2.0**-54
"""Relative size below which a term of a series changes nothing."""


class Settings(NamedTuple):
    """The fields of ``solver`` that methods read."""

    tolerance: float
    """bound of the relative error over a control step"""
    substeps: int
    """steps of a fixed-step method in each sample interval"""


class Option(NamedTuple):
    """The field of ``solver`` that a method obeys."""

    name: str
    """of a field of `Settings`"""
    values: tuple[float, ...]
    """that a work-precision measurement tries, from coarse to fine"""


class Method(ABC):
    """A way to propagate plants.

    Attributes
    ----------
    name
        The value of ``solver.method`` that asks for it. Several may share one.
    title
        A short noun phrase for messages.
    how
        In words, for `Plant.explain` and the documentation.
    kinds
        The kinds of plants that it propagates, see `mm_gym.methods.support`.
    entries
        Its compiled entries.
    option
        The field of ``solver`` that has an effect, if any.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    how: ClassVar[str]
    kinds: ClassVar[tuple[str, ...]]
    entries: ClassVar[Entries]
    option: ClassVar[Option | None] = None

    def obstacle(self, support: Support) -> str | None:
        """Return why the method does not apply to a support, or None if it does."""
        if support.kind not in self.kinds:
            return f"{self.title} cannot propagate a {support.kind} plant"
        return self.limit(support)

    def limit(self, support: Support) -> str | None:  # noqa: ARG002 - most have no limit
        """Return why it does not apply although the kind is right; None if it does."""
        return None

    @abstractmethod
    def model(self, support: Support, settings: Settings) -> NDArray[np.float64]:
        """Return the kernel's constants; raise `CompileError` where the bound cannot be met."""

    @abstractmethod
    def order(self, settings: Settings) -> str:
        """Return the order of the error in words."""

    @abstractmethod
    def cost(self, model: NDArray[np.float64]) -> str:
        """Return the work of one sample interval in words."""

    @abstractmethod
    def bound(self, settings: Settings) -> str:
        """Return the bound of the error in words."""

    def constants(self, support: Support, settings: Settings) -> NDArray[np.float64]:
        """Return the model array, with the excitation's description at its end."""
        model = self.model(support, settings)
        model[at.EXCITATION] = len(model)
        return np.concatenate([model, support.excitation])


class ExactMethod(Method):
    """A method without an error but round-off."""

    held: ClassVar[str] = "a held force"
    """for which it is exact"""

    def order(self, settings: Settings) -> str:  # noqa: ARG002 - there is nothing to set
        """Return that it has none."""
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
        msg = (
            f"control.time_step: {support.sample_interval} s is too long for this scene's rates: "
            f"{error}"
        )
        raise CompileError(msg) from error


def header(support: Support, own: int) -> NDArray[np.float64]:
    """Return a model array with the slots that every method shares, and `own` slots more."""
    model = np.zeros(at.MODEL_OWN + own)
    model[at.SAMPLE_INTERVAL] = support.sample_interval
    model[at.INTERVALS] = support.intervals_per_step
    model[at.JETS], model[at.TERMS] = support.jets, support.terms
    model[at.HARMONIC_COUNT] = len(support.ground)
    model[at.GROUND] = sum(1 << j for j, ground in enumerate(support.ground) if ground)
    return model


def degree(phase: float) -> int:
    """Return the least n for which Taylor's remainder is below round-off.

    The remainder is at most its first term phase**(n + 1) / (n + 1)!, and each further one is
    smaller by phase / (n + 2) or less. It is 2 at least: slow or free masses too move by t**2 / 2
    under a held force.
    """
    n = max(2, math.ceil(phase))
    while phase ** (n + 1) / math.factorial(n + 1) > ROUND_OFF * (1.0 - phase / (n + 2)):
        n += 1
    return n
