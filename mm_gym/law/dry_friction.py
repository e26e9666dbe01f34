"""Dry friction, (4) of docs/model.md, and a viscous interface, (3), which never leaves stick."""

from __future__ import annotations

import math

from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel
from mm_gym.lanes import layout
from mm_gym.lanes.memory import span

REGIMES_READ = layout.VR, layout.MU1, layout.MU2, layout.FN
REGIMES_WRITTEN = layout.C, layout.KINETIC_FORCE
"""Rows of `write_regimes`."""


@inlined_kernel
def stick_slope(mu1, normal, vr):
    """Return the slope [N s/m] of dry friction while the sphere sticks, in truth creeps."""
    return mu1 * normal / vr  # (4), eq. 9 of the paper, |w| <= v_r


@inlined_kernel
def kinetic_force(mu2, normal):
    """Return the force [N] of dry friction where slip begins."""
    return mu2 * normal  # (4), eq. 9 of the paper, |w| = v_r from above


@inlined_kernel
def slip_intercept(kinetic, chi, vr):
    """Return the force [N] at w = 0 of the line that friction follows in slip to positive w."""
    return kinetic - chi * vr  # (4), eq. 9 of the paper, |w| > v_r: intercept + chi |w|


@borrowing_kernel
def write_regimes(lanes, first, last):
    """Write what (4) comes to in the lanes first .. last - 1: rows C and KINETIC_FORCE.

    So an interface is one slope C up to the slip velocity VR, none if that is 0, and beyond it
    KINETIC_FORCE and a slope CHI. Every episode begins with this; kernels read these rows alone.
    """
    if lanes[layout.VR, first] == 0.0:  # all lanes of a scene have an interface of one kind
        return
    for i in span(first, last):
        lanes[layout.C, i] = stick_slope(
            lanes[layout.MU1, i], lanes[layout.FN, i], lanes[layout.VR, i]
        )
        lanes[layout.KINETIC_FORCE, i] = kinetic_force(lanes[layout.MU2, i], lanes[layout.FN, i])


@inlined_kernel
def interface_force(c, vr, kinetic, chi, w):
    """Return the force [N] of the interface on the carriage at a slip velocity w [m/s].

    The arguments before w are the rows that `write_regimes` speaks of.
    """
    if vr == 0.0 or abs(w) <= vr:
        return c * w  # (3), or (4) in stick
    force = kinetic + chi * (abs(w) - vr)  # (4) in slip
    return force if w > 0.0 else -force


@inlined_kernel
def interface_line(regime, c, chi, intercept):
    """Return slope [N s/m] and force [N] at w = 0 of the interface in one regime.

    The regime is the direction of slip, 1 or -1, or 0 for stick; the intercept is `slip_intercept`.
    """
    if regime == 0.0:
        return c, 0.0
    return chi, regime * intercept


@inlined_kernel
def threshold(vr):
    """Return the slip velocity [m/s] at which the regime changes; infinite without friction."""
    return vr if vr > 0.0 else math.inf
