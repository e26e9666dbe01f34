"""From scene to plant: the decision table.

===============================================  ==================  ==============================
the scene's support                              plant               propagation
===============================================  ==================  ==============================
no interface, no springs                         linear              transition matrix; the sphere
                                                                     flies free
viscous interface and/or fixed stretch, cubic    linear              transition matrix, excitation
  coefficient 0, nothing randomised but the                          as exosystem
  start
the same with actuated stretch or randomised     parametric linear   exponential as a cubic in the
  excitation frequency, in short steps, with                         generator, polynomials in
  damping, without sampled or ground excitation                      the springs' stiffness
the same otherwise, or with randomised           parametric linear   Taylor series of the
  parameters                                                         exponential's action
dry friction that provably never slips           as a viscous interface of damping mu1 F_N / v_r
dry friction, cubic coefficient 0, nothing       switched linear     transition matrices, crossings
  randomised but the start                                           bisected
the same with actuated stretch, randomised       parametric          Taylor series for each regime
  parameters or excitation frequency, or         switched linear
  excitation beyond harmonics and impulses
cubic coefficient or finite stretch              smooth nonlinear    adaptive Taylor series
the same with dry friction                       switched nonlinear  adaptive Taylor series,
                                                                     crossings located
carriage without mass, otherwise linear          massless carriage   transition matrix of three
                                                                     states
===============================================  ==================  ==============================

A rigid lock needs no plant of its own: the linear one keeps its bound for any damping of the
interface.
"""

from __future__ import annotations

import hashlib
import warnings
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.errors import CompileError
from mm_gym.kernels import layout as at
from mm_gym.methods import (
    CAYLEY_HAMILTON,
    LINEAR,
    MASSLESS,
    EXPONENTIAL_ACTION,
    SWITCHED,
    SWITCHED_SERIES,
    Method,
    rk4_method,
    semi_implicit_euler_method,
    taylor_method,
)
from mm_gym.methods.cayley_hamilton.method import obstacle
from mm_gym.plant.plant import Plant
from mm_gym.plant.support_of import support_of
from mm_gym.plant.task import task_array
from mm_gym.scene.scene import Solver

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.methods.support import Support
    from mm_gym.scene.scene import Scene

PHYSICAL = range(at.M1, at.HARMONICS)
"""Rows of the physical parameters; of the rows before them only the stretch enters the dynamics."""

FRICTION = (at.MU1, at.MU2, at.VR, at.CHI, at.FN)
"""Rows of the parameters of dry friction."""


def compile_scene(scene: Scene) -> Plant:
    """Choose the least model that covers the scene's whole support, and prepare it.

    Raises
    ------
    CompileError
        If no plant covers the scene within its bound, or the method asked for does not apply to it.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused as too fast
        return _compiled(scene)


def _compiled(scene: Scene) -> Plant:
    support, reasons = _without_idle_friction(scene, support_of(scene))
    _refuse_unsupported(scene, support)
    method, why = _choose(scene, support)
    _check_solver(scene, method)
    template, draws = _start(support)
    return Plant(
        method=method,
        reasons=(*reasons, *why),
        support=support,
        model=method.constants(support),
        task=task_array(scene),
        template=template,
        draws=draws,
        actuators=tuple(
            name for name in ("force", "stretch") if getattr(scene.actuation, name) is not None
        ),
        channels=scene.sensors.channels,
        history=scene.sensors.history,
        delay=scene.sensors.delay,
        steps=scene.control.steps,
        time_step=scene.control.time_step,
        digest=_digest(scene, support),
    )


def _choose(scene: Scene, support: Support) -> tuple[Method, tuple[str, ...]]:
    """Return the method that the decision table or the scene asks for, and why."""
    method, reasons = _from_table(scene, support)
    asked = scene.solver.method
    if asked in ("auto", method.name):
        return method, reasons
    others = _others(scene, support, method)
    if asked not in others:
        allowed = ", ".join(repr(name) for name in ("auto", method.name, *others))
        why = f"({'; '.join(reasons)})"
        msg = f"solver.method: {asked!r} does not apply to this scene {why}; allowed: {allowed}"
        raise CompileError(msg)
    return others[asked], (f"solver.method asks for it in place of {method.name!r}",)


def _from_table(scene: Scene, support: Support) -> tuple[Method, tuple[str, ...]]:
    """Walk down the decision table; return the method and why."""
    moving = [
        name
        for name, row in support.names.items()
        if row in _dynamic_rows(support) and not support.fixed(row)
    ]
    moves = tuple(_moves(name, support) for name in moving)
    friction = _slips(support)
    if support.sampled:
        moves = (
            *moves,
            f"excitation besides harmonics, in {support.intervals_per_step} sample intervals",
        )
    if _is_nonlinear(support):
        return taylor_method(scene.solver.tolerance, _name(support)), (
            *_nonlinearities(support),
            *_friction(support),
        )
    if friction:
        return (SWITCHED_SERIES if moving or support.terms else SWITCHED), (
            *_friction(support),
            *(moves or (FIXED,)),
        )
    if support.low[at.M1] == 0.0:
        return MASSLESS, ("carriage.mass is 0: the forces on the carriage balance", FIXED)
    if not moving:
        return LINEAR, (_coupling(scene), *(moves or (FIXED,)))
    reasons, against = (_coupling(scene), *moves), obstacle(support)
    if against is None:
        return CAYLEY_HAMILTON, reasons
    return EXPONENTIAL_ACTION, (*reasons, f"not a cubic in the generator: {against}")


def _others(scene: Scene, support: Support, chosen: Method) -> dict[str, Method]:
    """Return by name the methods that apply besides the one of the decision table.

    Each applies within its declared domain.
    """
    if support.low[at.M1] == 0.0:
        return {}
    name = chosen.plant
    others = {"taylor": taylor_method(scene.solver.tolerance, name)}
    if not _slips(support):
        substeps = scene.solver.substeps or 1
        others["rk4"] = rk4_method(substeps, name)
        others["semi_implicit_euler"] = semi_implicit_euler_method(substeps, name)
    others.pop(chosen.name, None)
    return others


FIXED = "every parameter has one value"


def _slips(support: Support) -> bool:
    return bool(support.high[at.VR] > 0.0)


def _is_nonlinear(support: Support) -> bool:
    return bool(support.high[at.BETA] > 0.0 or support.high[at.L0] > 0.0)


def _name(support: Support) -> str:
    return "switched nonlinear" if _slips(support) else "smooth nonlinear"


def _nonlinearities(support: Support) -> list[str]:
    reasons: list[str] = []
    if support.high[at.BETA] > 0.0:
        reasons.append(f"carriage.cubic_coefficient reaches {support.high[at.BETA]:g} 1/m^2")
    if support.high[at.L0] > 0.0:
        reasons.append("springs of finite stretch")
    return reasons


def _friction(support: Support) -> list[str]:
    if not _slips(support):
        return []
    return [
        (
            "dry friction may slip faster than interface.reference_velocity = "
            f"{support.low[at.VR]:g} m/s"
        )
    ]


def _without_idle_friction(scene: Scene, support: Support) -> tuple[Support, tuple[str, ...]]:
    """Replace dry friction that provably never slips by the viscous interface that it then is."""
    low, high = support.low, support.high
    driven = (
        scene.excitation or scene.actuation.force is not None or scene.actuation.stretch is not None
    )
    fixed = all(support.fixed(row) for row in FRICTION)
    asked = scene.solver.method == "switched"
    if (
        not _slips(support)
        or driven
        or asked
        or not fixed
        or high[at.L0] > 0.0
        or low[at.M1] == 0.0
    ):
        return support, ()
    fastest, vr = _fastest_slip(support), low[at.VR]
    if not fastest < vr:
        return support, ()
    damping = low[at.MU1] * low[at.FN] / vr
    arrays: dict[str, NDArray[np.float64]] = {}
    for name in ("start_low", "start_high", "low", "high"):
        arrays[name] = getattr(support, name).copy()
        arrays[name][list(FRICTION)] = 0.0
        arrays[name][at.C] = damping
    reason = (
        f"dry friction never slips: by its energy |w| <= {fastest:.3g} m/s, below "
        f"interface.reference_velocity = {vr:g} m/s, so it is viscous with {damping:.6g} N s/m"
    )
    return replace(support, **arrays), (reason,)


def _fastest_slip(support: Support) -> float:
    """Return a bound of |w| from the largest energy at the start, which nothing adds to [m/s]."""
    low, high = support.low, support.high
    x1, offset, v1, v2 = (
        max(abs(support.start_low[row]), abs(support.start_high[row])) for row in range(4)
    )
    twice = high[at.M1] * v1**2 + high[at.M2] * v2**2 + support.stiffest * offset**2
    twice += high[at.K1] * (high[at.ALPHA] * x1**2 + 0.5 * high[at.BETA] * x1**4)
    return float(np.sqrt(twice * (1.0 / low[at.M1] + 1.0 / low[at.M2])))


def _dynamic_rows(support: Support) -> set[int]:
    """Rows that enter the propagator: physical parameters, stretch, the harmonics' frequencies."""
    harmonics = {
        at.HARMONICS + at.HARMONIC_ROWS * j + at.FREQUENCY for j in range(len(support.ground))
    }
    return {at.STRETCH, *PHYSICAL, *harmonics}


def _coupling(scene: Scene) -> str:
    bare = scene.springs.kind == "none" and scene.interface.kind == "none"
    return (
        "nothing joins the sphere to the carriage" if bare else "all forces are linear in the state"
    )


def _moves(name: str, support: Support) -> str:
    row = support.names[name]
    name = "the stretch" if row == at.STRETCH else name
    return f"{name} takes values from {support.low[row]:g} to {support.high[row]:g}"


def _digest(scene: Scene, support: Support) -> str:
    """Return what identifies the scene with the content of its records."""
    if not any(part.kind == "record" for part in scene.excitation):
        return scene.digest
    return hashlib.sha256(scene.digest.encode() + support.excitation.tobytes()).hexdigest()[:16]


def _refuse_unsupported(scene: Scene, support: Support) -> None:
    """Raise `CompileError` for what no plant covers."""
    low, high = support.low, support.high
    interface = scene.interface
    if (
        interface.kind == "dry_friction"
        and interface.normal_force is None
        and "sphere.mass" in scene.randomization
    ):
        msg = (
            "interface.normal_force: missing; by default it is the sphere's weight, but "
            "sphere.mass is randomised. State a number, or randomise it too"
        )
        raise CompileError(msg)
    if low[at.M1] == 0.0:
        _refuse_massless(support)
        _refuse_infinite(scene)
    furthest = max(abs(support.start_low[at.X2]), abs(support.start_high[at.X2]))
    if high[at.L0] > 0.0 and furthest >= low[at.STRETCH] * low[at.L0]:
        msg = (
            f"initial.sphere_offset: got up to {furthest:g} m; allowed: less than "
            f"stretch * rest_length = {low[at.STRETCH] * low[at.L0]:g} m, where a spring of finite "
            "stretch is shortened to nothing"
        )
        raise CompileError(msg)


def _refuse_massless(support: Support) -> None:
    """Raise `CompileError` unless the massless plant is linear with fixed parameters."""
    low = support.low
    reason = ""
    if _slips(support) or _is_nonlinear(support):
        reason = "needs a viscous interface, or none, and linear springs"
    elif not all(support.fixed(row) for row in _dynamic_rows(support)):
        reason = "needs parameters, stretch and frequencies that have one value"
    elif not low[at.C] + low[at.D] > 0.0:
        reason = "needs interface.damping + carriage.damping > 0, or nothing resists its motion"
    if reason:
        msg = f"carriage.mass: 0 {reason}; a small mass has no such limit"
        raise CompileError(msg)


def _refuse_infinite(scene: Scene) -> None:
    """Raise `CompileError` for what would move a carriage without mass infinitely fast."""
    impulses = [
        f"excitation.{k}"
        for k, part in enumerate(scene.excitation)
        if part.kind == "impulse" and part.target == "force"
    ]
    shown = ["sensors.channels"] if "carriage_acceleration" in scene.sensors.channels else []
    for name in (*impulses, *shown):
        msg = f"{name}: a carriage of mass 0 has no finite acceleration; give it some mass"
        raise CompileError(msg)


def _check_solver(scene: Scene, method: Method) -> None:
    """Warn of options that have no effect."""
    default = Solver()
    for option in ("tolerance", "substeps"):
        if option in method.options or getattr(scene.solver, option) == getattr(default, option):
            continue
        warnings.warn(
            f"solver.{option} has no effect: the {method.plant} plant is propagated by "
            f"{method.name!r}",
            stacklevel=4,  # where `compile_scene` was called
        )


def _start(support: Support) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return every episode's starting lane, and (row, low, high) of what is drawn instead."""
    low, high = support.start_low, support.start_high
    rows = np.flatnonzero(low != high)
    return low.copy(), np.column_stack([rows.astype(np.float64), low[rows], high[rows]])
