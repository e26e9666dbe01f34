"""The reference velocity above which dry friction never slips."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from mm_gym.analysis.critical_kernel import sticks_throughout
from mm_gym.analysis.values import row_of
from mm_gym.compiler.jit import plain
from mm_gym.errors import SceneError, SimulationError
from mm_gym.lanes import layout as at
from mm_gym.law import dry_friction, springs
from mm_gym.simulation.energy import piecewise_linear_kernel as piecewise

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.scene.scene import Scene

LEAST = 2.0**-20
"""Smallest reference velocity tried, relative to the fastest slip that the energy at the start
allows: the sphere is then as good as locked, and whether it slips no longer depends on v_r."""

RESOLUTION = 2.0**-50
"""Relative width to which the critical velocity is bracketed: some units of round-off."""

MARGIN = 2.0**-46
"""Relative amount, 1.4e-14, by which the result is rounded up. A motion that just reaches v_r slips
or sticks by its last digits, so the velocity has to stay clear of them."""

WIDEST = 2.0**-20
"""Largest margin tried."""


def critical_reference_velocity(scene: Scene) -> float:
    """Return the least reference velocity [m/s] for which the scene's free motion never slips.

    Below v_r friction is viscous with the damping mu1 F_N / v_r. The slip velocity of the linear
    motion just reaches the critical v_r: max |w(t)| = v_r, eq. 21 of docs/model.md. The result does
    not depend on the kinetic coefficient, the slip damping, or the scene's own reference velocity.
    It is found by bisection, because it can be proved whether a motion slips at all, see
    `sticks_throughout`.

    Returns
    -------
    float
        The root, rounded up by a relative 1.4e-14, so that nothing slips at the returned value
        itself; 0 if the sphere sticks for every v_r.

    Raises
    ------
    SceneError
        If the interface is not dry friction, the motion in stick is not linear, or the scene has
        excitation.
    SimulationError
        If the motion is too slow to be followed, or too close to locked for its last digits to
        decide between stick and slip.
    """
    _check(scene)
    row = row_of(scene, "critical_reference_velocity")
    high = _fastest_by_energy(row)  # nothing slips faster
    low, least = 0.5 * high, LEAST * high
    while low > 0.0 and _sticks(row, low):
        high, low = low, 0.5 * low
        if low < least:
            low = 0.0
    if low == 0.0:
        return 0.0
    while high - low > RESOLUTION * high:
        middle = 0.5 * (low + high)
        if _sticks(row, middle):
            high = middle
        else:
            low = middle
    return _rounded_up(row, high)


def _rounded_up(row: NDArray[np.float64], velocity: float) -> float:
    """Return the velocity enlarged by the margin, or by more until nothing slips."""
    margin = MARGIN
    while margin <= WIDEST:
        enlarged = velocity * (1.0 + margin)
        if _sticks(row, enlarged):
            return enlarged
        margin *= 2.0
    msg = (
        f"critical_reference_velocity: near {velocity:g} m/s the sphere is nearly locked, and "
        "round-off decides whether it slips"
    )
    raise SimulationError(msg)


def _sticks(row: NDArray[np.float64], velocity: float) -> bool:
    """Tell whether the motion never slips with a reference velocity."""
    lane = row.copy()
    lane[at.VR] = velocity
    lane[at.C] = plain(dry_friction.stick_slope)(lane[at.MU1], lane[at.FN], velocity)
    sticks, status = cast("tuple[bool, int]", sticks_throughout(lane))
    if status > at.ENDED:
        msg = "critical_reference_velocity: the motion decays too slowly for its fastest rate"
        raise SimulationError(msg)
    return sticks


def _fastest_by_energy(row: NDArray[np.float64]) -> float:
    """Return the slip velocity [m/s] of a motion with all its energy in it, sqrt(2 E / m_r)."""
    m1, m2 = cast("float", piecewise.carriage_mass(row)), row[at.M2]
    k2 = cast("float", springs.stiffness(row[at.K0], row[at.STRETCH]))
    z = piecewise.start(row, row[:4], 0.0, 0, 0.0, row[:0])
    root = cast("float", piecewise.energy_root(row, k2, z))
    return float(root * np.sqrt((m1 + m2) / m1 / m2))


def _check(scene: Scene) -> None:
    problem = ""
    if scene.interface.kind != "dry_friction":
        problem = f"interface.kind: got {scene.interface.kind!r}; allowed: 'dry_friction'"
    elif scene.carriage.linear_coefficient < 0.0:
        got = f"got {scene.carriage.linear_coefficient}"
        problem = f"carriage.linear_coefficient: {got}; allowed: at least 0; the motion grows"
    elif scene.carriage.cubic_coefficient:
        problem = "carriage.cubic_coefficient: allowed: 0; the motion in stick must be linear"
    elif scene.springs.kind == "finite_stretch":
        problem = "springs.kind: got 'finite_stretch'; the motion in stick must be linear"
    elif scene.excitation:
        problem = "excitation: allowed: none; the critical velocity is that of a free motion"
    if problem:
        raise SceneError(problem)
