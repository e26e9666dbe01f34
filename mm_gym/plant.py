"""A plant: what a scene compiles to. Frozen, NumPy only."""

from __future__ import annotations

from dataclasses import dataclass, replace
from decimal import Context, Decimal, localcontext
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import CompileError, SceneError
from mm_gym.exponential import ASSEMBLY_DIGITS
from mm_gym.kernels import layout as at
from mm_gym.propagators import massless_transition, transition
from mm_gym.state_space import StateSpace, state_space

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.methods import Method
    from mm_gym.parameters import Support


@dataclass(frozen=True, eq=False)
class Plant:
    """The least model that covers a scene's support, ready to be propagated.

    Attributes
    ----------
    method
        What propagates the state, with its order, cost and bound.
    reasons
        Why this method was chosen, one clause each.
    support
        All values that the scene can reach.
    model
        (m,) float64: the constants of the method's kernel.
    task
        (t,) float64: actuators, reward, limits and channels.
    template, draws
        (rows,) the start of every lane, and (n, 3) rows to draw, each with its low and high.
    actuators
        Names of the action's columns, in order: "force" [N], "stretch" [-].
    history, delay, channels
        Frames observed, control steps by which they are late, and the names of the channels.
    steps, time_step
        Control steps of an episode, and their length [s].
    digest
        Identifies the scene that it was compiled from.
    """

    method: Method
    reasons: tuple[str, ...]
    support: Support
    model: NDArray[np.float64]
    task: NDArray[np.float64]
    template: NDArray[np.float64]
    draws: NDArray[np.float64]
    actuators: tuple[str, ...]
    channels: tuple[str, ...]
    history: int
    delay: int
    steps: int
    time_step: float
    digest: str

    def linear(
        self, stretch: float | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return A (4, 4) and B (4, 1) of x' = A x + B u about rest, u the control force [N].

        Parameters
        ----------
        stretch
            Stretch of the springs [-]; by default the one that an episode starts from (the middle
            of a range).

        Notes
        -----
        A randomised parameter enters with the middle of its range, a cubic spring with its tangent.

        Raises
        ------
        SceneError
            If the stretch is below 1 or not finite.
        CompileError
            If the carriage has no mass.
        """
        system = self.system(stretch)
        return system.a.astype(np.float64), system.force.astype(np.float64)[:, None]

    def discrete(
        self, stretch: float | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return Ad (4, 4) and Bd (4, 1) of the sampled plant: the force is held over each step."""
        row = self._middle(stretch)
        massless = row[at.M1] == 0.0
        both = (
            massless_transition(values_of(row), self.time_step)
            if massless
            else transition(linear_system(row), self.time_step)
        )
        return both[:, :4], both[:, 4:]

    def system(self, stretch: float | None = None) -> StateSpace:
        """Return the linear equations about rest in decimal arithmetic, see `linear`."""
        row = self._middle(stretch)
        if row[at.M1] == 0.0:
            msg = "carriage.mass: 0 leaves three states, so there is no A (4, 4); use discrete()"
            raise CompileError(msg)
        return linear_system(row)

    def _middle(self, stretch: float | None) -> NDArray[np.float64]:
        middle = 0.5 * (self.support.start_low + self.support.start_high)
        if stretch is not None:
            if not 1.0 <= stretch < np.inf:
                msg = f"stretch: got {stretch!r}; allowed: a finite number of at least 1"
                raise SceneError(msg)
            middle[at.STRETCH] = stretch
        return middle

    def at_time_step(self, time_step: float) -> Plant:
        """Return the same plant with a substep of another length, for samples in between."""
        return _at_time_step(self, time_step)

    def explain(self) -> str:
        """Say what was chosen, why, its order, its cost and its error bound."""
        method = self.method
        lines = [
            ("plant", method.plant),
            ("because", "; ".join(self.reasons)),
            ("method", f"{method.name}: {method.how}"),
            ("order", method.order),
            ("cost", method.cost(self.model)),
            ("error", method.bound),
        ]
        return "\n".join(f"{title:8} {text}" for title, text in lines)


@lru_cache(maxsize=4096)
def _at_time_step(plant: Plant, time_step: float) -> Plant:
    support = replace(plant.support, time_step=time_step)
    return replace(plant, support=support, model=plant.method.constants(support))


def linear_system(row: NDArray[np.float64]) -> StateSpace:
    """Return the linear equations of one lane; dry friction enters with its slope in stick."""
    with localcontext(Context(prec=ASSEMBLY_DIGITS)):
        return state_space(values_of(row))


def values_of(row: NDArray[np.float64]) -> dict[str, Decimal]:
    """Return m1, m2, k1 (times alpha), d, c and k2 of one lane.

    Doubles enter as the decimals that they exactly are.
    """
    m1, m2, k1, d, alpha, c, k0, stretch = (
        Decimal(float(row[i]))
        for i in (at.M1, at.M2, at.K1, at.D, at.ALPHA, at.C, at.K0, at.STRETCH)
    )
    mu1, normal, vr = (Decimal(float(row[i])) for i in (at.MU1, at.FN, at.VR))
    with localcontext(Context(prec=ASSEMBLY_DIGITS)):
        k2 = 2 * k0 * (1 + 2 / stretch**3) if k0 else Decimal(0)
        c = mu1 * normal / vr if vr else c
        return {"m1": m1, "m2": m2, "k1": k1 * alpha, "d": d, "c": c, "k2": k2}
