"""The responses of episodes in the lanes of a vector environment, step by step."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from mm_gym.compiler.jit import plain
from mm_gym.errors import SimulationError
from mm_gym.lanes import layout as at
from mm_gym.law import springs
from mm_gym.metrics.totals import End, Totals

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.env.vector import MovingMassVectorEnv
    from mm_gym.metrics.response import Response

    Array = NDArray[np.float64]


class LaneResponse:
    """Response and effort of an episode in each lane of a vector environment.

    Make one after a reset, and call `add` after each step.

    Parameters
    ----------
    env
        An environment whose episodes have just begun. With autoreset, use the mask of `add` to
        leave out all episodes after the first.

    Notes
    -----
    The motion is evaluated at the start and end of each control step. For a vibration at w and
    control steps of h, up to (w h)^4 / 384 of the amplitudes are missed, and (w h)^2 / 8 of those
    of the acceleration. `mm_gym.metrics.response` has a finer resolution. Measure references in the
    same way, as `uncontrolled_response` does.

    Raises
    ------
    SimulationError
        If a carriage has no mass.
    """

    def __init__(self, env: MovingMassVectorEnv) -> None:
        self._env = env
        self._values = _values_of(env)
        self._totals = Totals(self._values, is_between=env.plant.support.is_between)
        self._task = env.plant.task.copy()  # of an environment that shows accelerations
        self._task[[at.IS_DERIVED, at.HAS_REACTIONS]] = 1.0

    def add(self, counts: NDArray[np.bool_] | None = None) -> None:
        """Add the control step that was just made, in the lanes of a mask (lanes,), or in all."""
        env, before = self._env, self._values
        after = _values_of(env)
        counts = np.ones(env.num_envs, np.bool_) if counts is None else np.asarray(counts)
        if counts.shape != (env.num_envs,) or counts.dtype != np.bool_:
            msg = (
                f"counts: got {counts.dtype} of shape {counts.shape}; "
                f"allowed: booleans of shape ({env.num_envs},)"
            )
            raise SimulationError(msg)
        old = _spring_energy(before)
        held = [at.FORCE, at.STRETCH, at.DAMPING, *env.plant.support.held_rows]
        before[held] = after[held]
        jumps = np.where(counts, _spring_energy(before) - old, 0.0)
        model = env.plant.model
        for values in (before, after):
            env.plant.entries.derive(self._task, model, values, 0, env.num_envs)
        duration = np.where(counts, env.scene.control.time_step, 0.0)
        self._totals.add(_end(before), _end(after), after[at.FORCE][:, None], duration[:, None])
        self._totals.add_jumps(jumps[:, None])
        self._values = after

    def response(self) -> Response:
        """Return the responses so far."""
        return self._totals.response()


def _values_of(env: MovingMassVectorEnv) -> Array:
    return cast("Array", env.get_state()["values"])


def _spring_energy(values: Array) -> Array:
    """Return the energy [J] of the sphere's springs in each lane."""
    energy, offset = plain(springs.spring_energy), values[at.X2] - values[at.X1]
    k0, l0, stretch = values[[at.K0, at.L0, at.STRETCH]]
    if not l0.any():  # all of a scene are of one kind
        return energy(k0, 0.0, stretch, offset)
    return np.array([energy(*lane) for lane in zip(k0, l0, stretch, offset, strict=True)])


def _end(values: Array) -> End:
    return End(
        values[:4, :, None],
        values[at.CARRIAGE_ACCELERATION : at.SPHERE_ACCELERATION + 1, :, None],
        values[at.GROUND_ACCELERATION][:, None],
        values[at.D][:, None],
    )
