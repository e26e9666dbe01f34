"""The reference velocity above which dry friction never slips."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
from scipy.optimize import brentq  # pyright: ignore[reportUnknownVariableType]

from mm_gym.analysis.critical_kernel import fastest_slip
from mm_gym.analysis.values import row_of
from mm_gym.errors import SceneError, SimulationError
from mm_gym.kernels import laws
from mm_gym.kernels import layout as at
from mm_gym.kernels.jit import plain

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.scene.scene import Scene

TIGHTEST = np.float64(1e-15)
"""Tolerance of the logarithm of the velocity: a few units of round-off."""

STEEPEST = 2.0**-20
"""Lowest reference velocity tried, relative to the fastest slip without friction: the sphere is
practically locked there, and a lower one changes nothing."""


def critical_reference_velocity(scene: Scene) -> float:
    """Return the reference velocity [m/s] above which the scene's free motion never slips.

    Below v_r dry friction is a viscous interface with c = mu1 F_N / v_r. At the critical v_r the
    fastest slip of this linear motion equals v_r: max |w(t)| = v_r, with w = v2 - v1 (eq. 21 of
    docs/model.md). The kinetic coefficient, the slip damping and the scene's own reference
    velocity have no effect on it.

    Parameters
    ----------
    scene
        A scene with dry friction, one value for every field and no excitation. Its actuators stay
        at rest.

    Returns
    -------
    float
        The critical reference velocity [m/s]; 0 if the sphere sticks at any v_r.

    Raises
    ------
    SceneError
        If the interface is not dry friction, the motion in stick is not linear, a field is a range,
        or the scene has excitation.
    SimulationError
        If the motion decays too slowly for its peak to be found.
    """
    _check(scene)
    row = row_of(scene, "critical_reference_velocity")
    without = _peak(row, 0.0)
    if without == 0.0:
        return 0.0
    slope_of = plain(laws.stick_slope)

    def excess(log_velocity: float) -> float:
        velocity = float(np.exp(log_velocity))
        return _peak(row, slope_of(row[at.MU1], row[at.FN], velocity)) / velocity - 1.0

    # Nothing slips if v_r is above the fastest slip without friction.
    high = float(np.log(without)) + 1e-9
    low = high
    while excess(low) <= 0.0:
        low -= 1.0
        if low < high + np.log(STEEPEST):
            return 0.0
    high = min(high, low + 1.0)
    if low == high:
        return without
    root = cast("float", brentq(excess, low, high, xtol=TIGHTEST, rtol=TIGHTEST))
    return float(np.exp(root))


def _peak(row: NDArray[np.float64], damping: float) -> float:
    """Return max |w| [m/s] of the lane (rows,) with a viscous interface of a damping [N s/m]."""
    lane = row.copy()
    lane[at.C] = damping
    peak, status = cast("tuple[float, int]", fastest_slip(lane))
    if status > at.ENDED:
        msg = "critical_reference_velocity: the motion decays too slowly for its fastest rate"
        raise SimulationError(msg)
    return peak


def _check(scene: Scene) -> None:
    problem = ""
    if scene.interface.kind != "dry_friction":
        problem = f"interface.kind: got {scene.interface.kind!r}; allowed: 'dry_friction'"
    elif scene.carriage.cubic_coefficient:
        problem = "carriage.cubic_coefficient: allowed: 0; the motion in stick must be linear"
    elif scene.springs.kind == "finite_stretch":
        problem = "springs.kind: got 'finite_stretch'; the motion in stick must be linear"
    elif scene.excitation:
        problem = "excitation: allowed: none; the critical velocity is that of a free motion"
    if problem:
        raise SceneError(problem)
