"""From scene to plant: the decision table.

====================================================  ====================  ==========================================
the scene's support                                   plant                 propagation
====================================================  ====================  ==========================================
no interface, no springs                              linear                transition matrix; the sphere flies free
viscous interface and/or fixed stretch, cubic
coefficient 0, nothing randomised but the start       linear                transition matrix, harmonics as exosystem
the same with actuated stretch, or with randomised
parameters or excitation frequency                    parametric linear     Taylor series of the exponential's action
====================================================  ====================  ==========================================
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import CompileError
from mm_gym.kernels import layout as at
from mm_gym.methods import LINEAR, PARAMETRIC, Method
from mm_gym.parameters import Support, support_of
from mm_gym.plant import Plant
from mm_gym.scene import Solver
from mm_gym.task import task_array

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.scene import Scene

PHYSICAL = range(at.M1, at.TONES)
"""Rows of the physical parameters; of the rows before them only the stretch enters the dynamics."""


def compile_scene(scene: Scene) -> Plant:
    """Choose the least model that covers the scene's whole support, and prepare it.

    Raises
    ------
    CompileError
        If no plant covers the scene within its bound, or the method asked for does not apply to it.
    """
    support = support_of(scene)
    method, reasons = _choose(scene, support)
    _check_solver(scene, method)
    template, draws = _start(support)
    return Plant(
        method=method,
        reasons=reasons,
        support=support,
        model=method.model(support),
        task=task_array(scene),
        template=template,
        draws=draws,
        actuators=tuple(name for name in ("force", "stretch") if getattr(scene.actuation, name) is not None),
        channels=scene.sensors.channels,
        history=scene.sensors.history,
        steps=scene.control.steps,
        digest=scene.digest,
    )


def _choose(scene: Scene, support: Support) -> tuple[Method, tuple[str, ...]]:
    """Walk down the decision table; return the method and why."""
    _refuse_unsupported(scene)
    moving = [name for name, row in support.names.items() if row in _dynamic_rows(support) and not support.fixed(row)]
    if not moving:
        return LINEAR, (_coupling(scene), "every parameter has one value")
    return PARAMETRIC, (_coupling(scene), *(_moves(name, support) for name in moving))


def _dynamic_rows(support: Support) -> set[int]:
    """Rows that enter the propagator: the physical parameters, the stretch, and the tones' frequencies."""
    tones = {at.TONES + at.TONE_ROWS * j + at.FREQUENCY for j in range(len(support.ground))}
    return {at.STRETCH, *PHYSICAL, *tones}


def _coupling(scene: Scene) -> str:
    bare = scene.springs.kind == "none" and scene.interface.kind == "none"
    return "nothing joins the sphere to the carriage" if bare else "all forces are linear in the state"


def _moves(name: str, support: Support) -> str:
    row = support.names[name]
    name = "the stretch" if row == at.STRETCH else name
    return f"{name} takes values from {support.low[row]:g} to {support.high[row]:g}"


def _refuse_unsupported(scene: Scene) -> None:
    if scene.carriage.cubic_coefficient or "carriage.cubic_coefficient" in scene.randomization:
        msg = "carriage.cubic_coefficient: no plant covers a cubic spring yet; allowed: 0"
        raise CompileError(msg)
    if scene.interface.kind == "dry_friction":
        msg = "interface.kind: no plant covers 'dry_friction' yet; allowed: 'none', 'viscous'"
        raise CompileError(msg)
    if scene.springs.kind == "finite_stretch":
        msg = "springs.kind: no plant covers 'finite_stretch' yet; allowed: 'none', 'small_on_large'"
        raise CompileError(msg)


def _check_solver(scene: Scene, method: Method) -> None:
    solver = scene.solver
    if solver.method not in ("auto", method.name):
        msg = f"solver.method: {solver.method!r} does not apply to this scene; allowed: 'auto', {method.name!r}"
        raise CompileError(msg)
    default = Solver()
    for option in ("tolerance", "substeps"):
        if getattr(solver, option) == getattr(default, option):
            continue
        warnings.warn(f"solver.{option} has no effect: the {method.plant} plant is exact", stacklevel=3)


def _start(support: Support) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lane that every episode starts from, and (row, low, high) of what is drawn instead."""
    low, high = support.start_low, support.start_high
    rows = np.flatnonzero(low != high)
    return low.copy(), np.column_stack([rows, low[rows], high[rows]])
