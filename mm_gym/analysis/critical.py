"""The reference velocity above which dry friction never slips."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
from scipy.optimize import brentq  # pyright: ignore[reportUnknownVariableType]

from mm_gym.analysis.critical_kernel import fastest_slip
from mm_gym.analysis.values import row_of
from mm_gym.errors import SceneError, SimulationError
from mm_gym.kernels import layout as at

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.scene.scene import Scene

TIGHTEST = np.float64(1e-15)
"""Tolerance of the logarithm of the velocity: a few units of round-off."""

STEEPEST = 2.0**-20
"""Smallest reference velocity looked at, relative to the fastest slip without friction: by then
the sphere is as good as locked, and slips or not whatever v_r is."""


def critical_reference_velocity(scene: Scene) -> float:
    """Return the reference velocity [m/s] above which the scene's free motion never slips.

    Below v_r friction is viscous with mu1 F_N / v_r, so the critical v_r is that for which the
    linear motion just reaches it: max |w(t)| = v_r. It depends on neither the kinetic coefficient
    nor the slip damping, nor on the scene's own reference velocity.

    Returns
    -------
    float
        0 if the sphere sticks however small v_r is.

    Raises
    ------
    SceneError
        If the interface is not dry friction, the motion in stick is not linear, or something drives
        it.
    """
    _check(scene)
    row = row_of(scene, "critical_reference_velocity")
    without = _peak(row, 0.0)
    if without == 0.0:
        return 0.0
    force = row[at.MU1] * row[at.FN]

    def excess(log_velocity: float) -> float:
        velocity = float(np.exp(log_velocity))
        return _peak(row, force / velocity) / velocity - 1.0

    # With v_r above the fastest slip of all, nothing slips.
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
    lane = row.copy()
    lane[at.C] = damping
    peak, status = cast("tuple[float, int]", fastest_slip(lane))
    if status > at.ENDED:
        msg = "critical_reference_velocity: the motion is too slow to fade for its fastest rate"
        raise SimulationError(msg)
    return peak


def _check(scene: Scene) -> None:
    problem = ""
    if scene.interface.kind != "dry_friction":
        problem = f"interface.kind: got {scene.interface.kind!r}; allowed: 'dry_friction'"
    elif scene.carriage.cubic_coefficient:
        problem = "carriage.cubic_coefficient: allowed: 0; in stick the motion must be linear"
    elif scene.springs.kind == "finite_stretch":
        problem = "springs.kind: got 'finite_stretch'; in stick the motion must be linear"
    elif scene.excitation:
        problem = "excitation: allowed: none; the critical velocity is that of a free motion"
    if problem:
        raise SceneError(problem)
