"""The energy that changing the stretch puts into the motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mm_gym.analysis import spring_energy

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym import MovingMassVectorEnv, Scene

    Array = NDArray[np.float64]


class SpringWork:
    """Work on the springs of episodes that have just begun, which may be drawn for each."""

    def __init__(self, scene: Scene, env: MovingMassVectorEnv) -> None:
        finite = scene.springs.kind == "finite_stretch"
        self.stiffness = env.drawn("springs.stiffness")
        self.lengths = env.drawn("springs.rest_length") if finite else np.zeros(env.num_envs)

    def injected(self, offset: Array, stretch: Array) -> Array:
        """Return the most that stretching has given by any time, less what it has taken [J].

        Changing the stretch at an offset does the work by which the springs' energy jumps. Its sum
        from the start of an episode is positive where a law has put in more than it has taken out.

        Parameters
        ----------
        offset
            (steps, lanes): x2 - x1 at the start of each control step [m].
        stretch
            (steps + 1, lanes): at the start of the episode, and in each control step [-].

        Returns
        -------
        ndarray
            (lanes,), at least 0.
        """
        work = np.empty_like(offset)
        for lane, (k0, l0) in enumerate(zip(self.stiffness, self.lengths, strict=True)):
            own, set_to = offset[:, lane], stretch[:, lane]
            work[:, lane] = spring_energy(own, set_to[1:], k0, l0)
            work[:, lane] -= spring_energy(own, set_to[:-1], k0, l0)
        return np.maximum(np.cumsum(work, axis=0).max(axis=0), 0.0)
