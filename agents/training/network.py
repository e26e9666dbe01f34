"""A network's parameters as one vector, in the order of the kernel; and the policy they make."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from agents.policies import Policy
from agents.training.scales import Scales
from agents.training.start import Start
from mm_gym.arrays import Array

WEIGHT, OUTPUT, DIRECT = 0.5, 0.3, 0.5
"""Size of the changes of a hidden unit's weights, of its part in the action, and of direct weights,
of numbers of order one."""


@dataclass(frozen=True, eq=False)
class Network:
    """Correlation units, direct weights and one hidden layer, next to a given linear memory.

    The vector holds the pairs (r, 2, n + m), then for each action its bias and direct weights (1 +
    n + m + r), then for each hidden unit its bias, weights and parts in the actions (1 + n + m + r
    + k).
    """

    start: Start  # the law as which it begins
    hidden: int  # number of hidden units
    odd: bool  # whether biases stay zero: the mirrored motion then gets the opposite force
    scales: Scales | None = None  # of what it reads and does; by default all of order one

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """Shapes of the vector's three parts."""
        k, inputs = self.start.direct.shape
        return self.start.pairs.shape, (k, inputs), (self.hidden, inputs + k)

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers of an observation, of hidden units and of an action."""
        n = self.start.pairs.shape[2] - len(self.start.keep)
        return n, self.hidden, len(self.start.direct)

    def first(self, generator: np.random.Generator) -> Array:
        """Return a vector that acts as the law: hidden units are drawn, and have no part yet."""
        k, inputs = self.start.direct.shape
        drawn = 1.5 / np.sqrt(inputs) * generator.standard_normal((self.hidden, inputs))
        if self.odd:
            drawn[:, 0] = 0.0
        weights = np.pad(drawn, ((0, 0), (0, k))) * self._of_order_one[1]
        return np.concatenate(
            [self.start.pairs.ravel(), self.start.direct.ravel(), weights.ravel()]
        )

    def spreads(self) -> Array:
        """Return the size of each parameter's changes."""
        shape, k = self.start.pairs.shape, len(self.start.direct)
        pairs = np.broadcast_to(self.start.spreads[:, None, None], shape)
        direct, hidden = self._of_order_one
        hidden = hidden * np.repeat([WEIGHT, OUTPUT], [hidden.size - k, k])
        return np.concatenate(
            [pairs.ravel(), DIRECT * direct.ravel(), np.tile(hidden, self.hidden)]
        )

    @property
    def _of_order_one(self) -> tuple[Array, Array]:
        """Sizes over which direct weights, and parameters of a hidden unit, are of order one."""
        scales = self.scales or Scales.stated(self.start)
        inputs = 1.0 / np.concatenate([[1.0], scales.inputs])
        return scales.outputs[:, None] * inputs, np.concatenate([inputs, scales.outputs])

    @property
    def free(self) -> NDArray[np.bool_]:
        """Which parameters (N,) are searched."""
        parts = [np.ones(shape, np.bool_) for shape in self.shapes]
        for part in parts[1:]:
            part[:, 0] = not self.odd
        return np.concatenate([part.ravel() for part in parts])

    def policy(self, vector: Array) -> Policy:
        """Return the policy of a vector."""
        ends = np.cumsum([np.prod(shape) for shape in self.shapes])[:-1]
        parts = np.split(vector, ends)
        pairs, direct, hidden = (
            part.reshape(shape) for part, shape in zip(parts, self.shapes, strict=True)
        )
        return replace(self.start, pairs=pairs, direct=direct).policy(hidden)
