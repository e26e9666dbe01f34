"""What a network is before its hidden units take part, and how the best of several is found."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import block_diag

from agents.control.actuators import Command
from agents.control.scene import beginning
from agents.controllers.learned import Learned
from agents.policies import Policy, network
from agents.scoring import validation_cost
from agents.training.config import LawName
from agents.training.shown import Shown
from mm_gym import ActionError, DesignError, Scene
from mm_gym.arrays import Array

FLOOR = 1e-3  # of a correlation unit's denominator, see `agents.network.layers.Correlation`

COARSE, FINE = 0.3, 0.01
"""Size of the changes of a switching function's weights, and of those of a frequency's estimate:
they are of order one, and a hundredth changes the frequency by as much as the springs can."""

HELD = np.linspace(-1.0, 1.0, 17)  # constant actions of a stretch or a device that are tried


@dataclass(frozen=True, eq=False)
class Start:
    """What a network is before hidden units take part.

    It observes n numbers, remembers m, correlates r pairs, and makes k actions.
    """

    # pairs, units: (r, 2, n + m), (r, 4), those of `agents.network.layers.Correlation`
    pairs: Array
    units: Array
    direct: Array  # (k, 1 + n + m + r): bias and direct weights of each action
    spreads: Array  # (r,) size of the changes of each pair's weights
    # keep, enter, back: (m, m), (m, n), and (m, k) or (m, 0), the linear memory, which is not
    # searched; where it knows the action, that of `agents.network.layers.Observer`
    keep: Array = field(default_factory=lambda: np.empty((0, 0)))
    enter: Array = field(default_factory=lambda: np.empty((0, 0)))
    back: Array = field(default_factory=lambda: np.empty((0, 0)))
    # early, fade: (m, m + n + k), (1,), or empty: those of `agents.network.layers.SettlingObserver`
    early: Array = field(default_factory=lambda: np.empty((0, 0)))
    fade: Array = field(default_factory=lambda: np.empty(0))
    law: LawName = "none"  # the name of what it is
    # Of an LQG that may settle, what it was designed with: the factor of the force's weight, and
    # `unmodelled`.
    design: tuple[float, float] | None = None

    @classmethod
    def linear(cls, direct: Array) -> Start:
        """Return the start of direct weights (k, 1 + n) alone."""
        return cls(np.empty((0, 2, direct.shape[1] - 1)), np.empty((0, 4)), direct, np.empty(0))

    def with_memory(self, keep: Array, enter: Array, back: Array | None = None) -> Start:
        """Return it with more states of the linear memory, which have no part in the action."""
        m, more, seen = len(self.keep), len(keep), self.pairs.shape[2]
        backs = [self.back, np.empty((more, 0)) if back is None else back]
        known, early = max(one.shape[1] for one in backs), self.early
        if early.size:
            early = np.pad(np.insert(early, [m] * more, 0.0, axis=1), ((0, more), (0, 0)))
        return replace(
            self,
            pairs=np.pad(self.pairs, ((0, 0), (0, 0), (0, more))),
            direct=np.insert(self.direct, [1 + seen] * more, 0.0, axis=1),
            keep=block_diag(self.keep, keep) if m else keep,  # in its order: sums round alike
            enter=np.vstack([self.enter.reshape(m, seen - m), enter]),
            back=np.vstack([np.pad(one, ((0, 0), (0, known - one.shape[1]))) for one in backs]),
            early=early,
        )

    def with_units(self, extra: int, generator: np.random.Generator) -> Start:
        """Return it with more correlation units, drawn, which have no part in the action."""
        drawn = 0.5 * generator.standard_normal((extra, *self.pairs.shape[1:]))
        return replace(
            self,
            pairs=np.concatenate([self.pairs, drawn]),
            units=np.concatenate([self.units, np.tile((0.0, FLOOR, 0.0, 1.0), (extra, 1))]),
            spreads=np.concatenate([self.spreads, np.full(extra, COARSE)]),
            direct=np.pad(self.direct, ((0, 0), (0, extra))),
        )

    def policy(self, hidden: Array | None = None) -> Policy:
        """Return the policy of it and of hidden units; see `agents.training.network.Network`.

        Parameters
        ----------
        hidden
            (units, 1 + n + m + r + k); by default one that has no part in the action.
        """
        k, inputs = self.direct.shape
        units = np.zeros((1, inputs + k)) if hidden is None else hidden
        bias, weights, output = np.split(units, [1, inputs], axis=1)
        last, direct = np.split(self.direct, [1], axis=1)
        return network(
            (weights, output.T),
            (bias[:, 0], last[:, 0]),
            "rational",
            -np.ones(k),
            np.ones(k),
            direct=direct,
            keep=self.keep,
            enter=self.enter,
            back=self.back if self.back.size else (),
            early=self.early,
            fade=self.fade,
            pairs=self.pairs,
            units=self.units,
        )

    def cost(self, scene: Scene, most: float = np.inf) -> float:
        """Return its cost on the validation episodes, infinite where it is no finite number.

        Where it is above `most`, it is another number above it, as of `validation_cost`.
        """
        try:
            cost = validation_cost(scene, Learned(self.policy()), most=most)
        except ActionError:  # of an observer that is not stable
            return np.inf
        return cost if np.isfinite(cost) else np.inf


def best_of(scene: Scene, starts: list[Start], most: float = 1.0) -> Start:
    """Return the first of the starts that costs at most so many times the least."""
    if len(starts) == 1:
        return starts[0]
    costs: list[float] = []
    for start in starts:
        costs.append(start.cost(scene, most * min(costs, default=np.inf)))
    return next(one for one, cost in zip(starts, costs, strict=True) if cost <= most * min(costs))


def no_control(shown: Shown) -> Start:
    """Return no force, and the stretch and damping that an episode begins with.

    Of a range of them it keeps the middle.
    """
    direct = np.zeros((shown.actions, 1 + shown.count))
    for row, name in zip(direct, shown.scene.actuation.names, strict=True):
        held = np.full(1, beginning(shown.scene, name))
        row[:1] = Command(shown.scene, name)(held, held)[0]
    return Start.linear(direct)


def best_constant(shown: Shown) -> Start:
    """Return the best of the constant commands of what is not a force."""
    if shown.scene.actuation.names == ("force",):
        msg = "law: 'constant' needs a stretch or a damping; the scene has only a force"
        raise DesignError(msg)
    starts = [no_control(shown) for _ in HELD]
    for start, action in zip(starts, HELD, strict=True):
        start.direct[-1, 0] = action
    return best_of(shown.scene, starts)
