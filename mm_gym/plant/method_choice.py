"""The choice of a method for a scene, and its reasons.

The decision table is `mm_gym.methods.METHODS`, in order; each row is for what no row before it
takes. Section 1 of docs/numerics.md says what that comes to.
"""

from __future__ import annotations

from mm_gym import methods
from mm_gym.errors import CompileError
from mm_gym.lanes import layout
from mm_gym.methods import Method
from mm_gym.methods.support import MASSLESS, Support
from mm_gym.scene.scene import Solver

FIXED = "every parameter has one value"


def settings_of(solver: Solver) -> methods.Settings:
    """Return what methods read of a scene's ``solver``."""
    return methods.Settings(solver.tolerance, solver.substeps or 1)


def choose(solver: Solver, support: Support) -> tuple[Method, tuple[str, ...]]:
    """Return the first method of the table that applies and has the name asked for, and why."""
    asked, settings = solver.method, settings_of(solver)
    skipped: dict[Method, str] = {}
    chosen = next((m for m in methods.METHODS if _takes(m, support, settings, skipped)), None)
    if chosen is not None and asked in ("auto", chosen.name):
        return chosen, _reasons(support, skipped, chosen)
    obstacles = {method: method.obstacle(support, settings) for method in methods.METHODS}
    applicable = [method for method, obstacle in obstacles.items() if obstacle is None]
    if not applicable:
        whys = [f"{m.title}: {why}" for m, why in obstacles.items() if support.kind in m.kinds]
        msg = f"solver.method: none propagates this scene ({'; '.join(whys)})"
        raise CompileError(msg)
    chosen = chosen or applicable[-1]  # all defer: the last does not
    reasons = _reasons(support, skipped | {m: why for m, why in obstacles.items() if why}, chosen)
    if asked in ("auto", chosen.name):
        return chosen, reasons
    named = [method for method in applicable if method.name == asked]
    if named:  # the one that `auto` would take, whatever the tolerance
        later = (method for method in named if method.deferral(support, settings) is None)
        method = next(later, named[0])
        return method, (f"solver.method asks for it in place of {chosen.name!r}",)
    allowed = ", ".join(map(repr, dict.fromkeys(("auto", *(m.name for m in applicable)))))
    why = f"({'; '.join(reasons)})"
    msg = f"solver.method: {asked!r} does not apply to this scene {why}; allowed: {allowed}"
    raise CompileError(msg)


def _takes(
    method: Method, support: Support, settings: methods.Settings, skipped: dict[Method, str]
) -> bool:
    """Return whether a method applies and does not defer; else note why in `skipped`."""
    # Whether it fails with the settings is asked last: that may take long to find out.
    why = method.obstacle(support)
    why = why or method.deferral(support, settings) or method.obstacle(support, settings)
    if why is not None:
        skipped[method] = why
    return why is None


def _reasons(support: Support, obstacles: dict[Method, str], chosen: Method) -> tuple[str, ...]:
    """Return the reasons for the choice, one clause each."""
    low, high, instability = support.low, support.high, _instability(support)
    if support.kind == MASSLESS:
        return "carriage.mass is 0: the forces on the carriage balance", *instability, FIXED
    reasons: list[str] = []
    if support.is_cubic:
        furthest = max(high[layout.BETA], low[layout.BETA], key=abs)
        reasons.append(f"carriage.cubic_coefficient reaches {furthest:g} 1/m^2")
    if high[layout.L0] > 0.0:
        reasons.append("springs of finite stretch")
    reasons += instability
    if support.slips:
        velocity = f"interface.reference_velocity = {low[layout.VR]:g} m/s"
        reasons.append(f"dry friction may slip faster than {velocity}")
    earlier = methods.METHODS[: methods.METHODS.index(chosen)]
    before = [method for method in earlier if support.kind in method.kinds]
    skipped = [f"not {method.title}: {obstacles[method]}" for method in before]
    if support.is_nonlinear and not support.is_general:
        return (*reasons, *skipped)
    if support.is_general:
        reasons.append(f"{support.general_because}; such a force is known by its value only")
    elif not support.slips:
        is_joined = high[layout.C] > 0.0 or high[layout.K0] > 0.0
        free = "nothing joins the sphere to the carriage"
        reasons.append("all forces are linear in the state" if is_joined else free)
    moves: list[str] = []
    for name in support.varying:
        row = support.names[name]
        moving = "the stretch" if row == layout.STRETCH else name
        moves.append(f"{moving} takes values from {low[row]:g} to {high[row]:g}")
    if support.sampled:
        moves.append("there is excitation other than harmonics")
    return (*reasons, *(moves or [FIXED]), *skipped)


def _instability(support: Support) -> list[str]:
    """Return where the carriage has no stable rest, as far as its spring tells."""
    (alpha, beta), place = support.low[[layout.ALPHA, layout.BETA]], "|x1| = sqrt(-alpha / beta)"
    reasons: list[str] = []
    if alpha < 0.0:
        start = f"carriage.linear_coefficient reaches {alpha:g}, so that x1 = 0 is unstable"
        ends = f"the spring has two wells, at {place}" if beta > 0.0 else "motions may grow forever"
        reasons.append(f"{start} and {ends}")
    if beta < 0.0 < support.high[layout.ALPHA]:
        reasons.append(f"the carriage escapes beyond the barrier at {place}")
    return reasons
