"""Asymptotic offsets under dry friction: the paper's figure 10, compared with SciPy."""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.report import table
from mm_gym.analysis import bifurcation
from mm_gym.paper import scene as paper_scene
from mm_gym.paper.scenes import CHI, RATIOS
from mm_gym.precision.oracle import Oracle

if TYPE_CHECKING:
    from mm_gym import Scene

SAMPLES = 6  # points of figure 10 that SciPy integrates; its time for all is extrapolated from them


def figure10() -> str:
    """Return the section on figure 10: twelve curves of a thousand points."""
    velocities = np.arange(1e-6, 1.0, 1e-3)
    curves = [
        paper_scene("fig10").replace(
            **{"interface.slip_damping": chi, "interface.kinetic_coefficient": 0.51 * ratio}
        )
        for chi, ratio in [(chi, 0.5) for chi in CHI] + [(0.1, ratio) for ratio in RATIOS]
    ]
    bifurcation(curves[0], "interface.reference_velocity", velocities[:2])
    began, used = time.perf_counter(), time.process_time()
    found = [bifurcation(curve, "interface.reference_velocity", velocities) for curve in curves]
    wall, processor = time.perf_counter() - began, time.process_time() - used
    points, errors, seconds = len(curves) * velocities.size, [], 0.0
    for k in np.linspace(20, velocities.size - 20, SAMPLES).astype(int):
        point = curves[2].replace(**{"interface.reference_velocity": float(velocities[k])})
        began = time.perf_counter()
        asymptote = _oracle_asymptote(point)
        seconds += time.perf_counter() - began
        errors.append(abs(found[2][k] - asymptote))
    extrapolated = seconds / SAMPLES * points
    rows = [
        ("mm_gym, wall clock", f"{wall:.2f}", "1"),
        (f"mm_gym, processor time on {os.cpu_count()} cores", f"{processor:.2f}", ""),
        (
            f"SciPy DOP853 with events, extrapolated from {SAMPLES} points",
            f"{extrapolated:,.0f}",
            f"{extrapolated / processor:,.0f} times mm_gym's processor time",
        ),
    ]
    note = f"Largest difference of the sampled points: {max(errors):.1e} m.\n"
    title = f"## Dry friction: figure 10, {points:,} points"
    return f"{title}\n\n{table(('', 'seconds', 'ratio'), rows)}\n\n{note}"


def _oracle_asymptote(scene: Scene) -> float:
    """Return the offset at rest [m]: SciPy until after the last slip, then the first integral."""
    x1, x2, _, v2 = Oracle(scene, rtol=1e-11, max_step=2e-3).solve([1.5])[-1]
    interface = scene.interface
    assert interface.kind == "dry_friction"  # noqa: S101 - figure 10 is about it
    assert interface.normal_force is not None  # noqa: S101 - the paper states it
    creep = interface.static_coefficient * interface.normal_force / interface.reference_velocity
    return float(x2 - x1 + scene.sphere.mass * v2 / creep)
