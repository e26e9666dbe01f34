"""The generator that seeds the streams of random numbers."""

from __future__ import annotations

import numpy as np

from mm_gym.errors import SceneError

SEEDS = 2**63
"""Number of seeds to choose from where none is given."""


class Seeded:
    """An environment whose generator can be replaced.

    Episodes draw from streams of their own. The generator gives the stream of the first reset
    without a seed its seed, and that of the first one after the generator was set.
    """

    _np_random: np.random.Generator | None = None
    _np_random_seed: int | None = None
    _draws_seed = True
    """Whether the next reset draws a seed, if it is not given one."""

    @property
    def np_random(self) -> np.random.Generator:
        """The generator from which seeds are drawn.

        It can be set; all but a generator of NumPy raises `SceneError`.
        """
        return super().np_random  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType, reportAttributeAccessIssue] - of Gymnasium's class

    @np_random.setter
    def np_random(self, value: np.random.Generator) -> None:
        if not isinstance(value, np.random.Generator):  # pyright: ignore[reportUnnecessaryIsInstance] - callers may not check types
            msg = f"np_random: got {value!r}; allowed: a numpy.random.Generator"
            raise SceneError(msg)
        self._np_random, self._np_random_seed = value, -1  # as Gymnasium
        self._draws_seed = True

    def _drawn_seed(self) -> int:
        self._draws_seed = False
        return int(self.np_random.integers(SEEDS))
