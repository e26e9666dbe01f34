"""Compilation of a scene to a plant, by the decision table of methods.

The table is `mm_gym.methods.METHODS`, in order:

===============================================  ==================  ==============================
the scene's support                              plant               propagation
===============================================  ==================  ==============================
no interface, no springs                         linear              transition matrix; the sphere
                                                                     flies free
viscous interface and/or fixed stretch, cubic    linear              transition matrix, excitation
  coefficient 0, only the start randomised                           as exosystem
carriage without mass, otherwise linear          massless carriage   transition matrix of three
                                                                     states
actuated stretch or randomised excitation        parametric linear   exponential as a cubic in the
  frequency, in short control steps, with                            generator, polynomials in
  damping; excitation by harmonic forces and                         the springs' stiffness
  impulses only
the same otherwise, or with randomised           parametric linear   Taylor series of the
  parameters                                                         exponential's action
dry friction that provably never slips           as a viscous interface of damping mu1 F_N / v_r
dry friction, cubic coefficient 0, only the      switched linear     transition matrices, crossings
  start randomised                                                   bisected
the same with actuated stretch, randomised       parametric          Taylor series for each regime
  parameters or excitation frequency, or         switched linear
  excitation beyond harmonics and impulses
cubic coefficient above 0, only the start        smooth nonlinear    splitting, extrapolated
  randomised, short control steps, no
  excitation, tolerance above 1e-9
cubic coefficient other than 0 otherwise, or     smooth nonlinear    adaptive Taylor series
  finite stretch
the same with dry friction                       switched nonlinear  adaptive Taylor series,
                                                                     crossings located
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

from mm_gym import methods
from mm_gym.errors import CompileError, SceneError
from mm_gym.kernels import laws
from mm_gym.kernels import layout as at
from mm_gym.kernels.jit import plain
from mm_gym.methods.support import MASSLESS
from mm_gym.plant.excitation import KINDS
from mm_gym.plant.plant import Plant
from mm_gym.plant.support_of import support_of
from mm_gym.plant.task import observed, task_array
from mm_gym.scene.rules import is_whole
from mm_gym.scene.scene import Solver, bounds

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from mm_gym.methods import Method
    from mm_gym.methods.support import Support
    from mm_gym.scene.scene import Scene

FRICTION = (at.MU1, at.MU2, at.VR, at.CHI, at.FN)
"""Rows of the parameters of dry friction."""

MECHANICAL = (
    *("carriage", "sphere", "interface", "springs", "excitation", "initial"),
    *("actuation", "control", "randomization", "solver"),
)
"""What the choice of a method depends on: all parts of a scene but sensors and objective."""

FIXED = "every parameter has one value"

MOST_GROWTH = 9.0
"""Largest growth of a motion about an unstable place in a control step, as an exponent: round-off
of 1.1e-16 then stays below the bound of 1e-12 that exact methods have."""

ACCELERATION_ERROR = 1e-6
"""Largest round-off of an observed acceleration of the carriage, relative to the motion's."""


def compile_scene(scene: Scene) -> Plant:
    """Choose the simplest model that covers the scene's whole support, and prepare it.

    Raises
    ------
    CompileError
        If no plant covers the scene within its bound, or the method asked for does not apply to it.
        The message lists every finding.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # a rate that overflows is refused later
        return _compiled(scene)


def _compiled(scene: Scene) -> Plant:
    support, idle = _without_idle_friction(scene, support_of(scene))
    findings = [
        *_scene_findings(scene, frozenset()),
        *_support_findings(support),
        *_cancellation_findings(scene, support),
    ]
    if findings:
        raise CompileError("\n".join([*findings, *_method_findings(scene, support)]))
    settings = _settings(scene)
    method, reasons = _choose(scene.solver.method, support, settings)
    _check_solver(scene, method, support)
    template, draws = _start(support)
    return Plant(
        method=method,
        settings=settings,
        reasons=(*idle, *reasons),
        support=support,
        model=method.constants(support, settings),
        task=task_array(scene),
        template=template,
        draws=draws,
        actuators=tuple(
            name for name in ("force", "stretch") if getattr(scene.actuation, name) is not None
        ),
        observed=observed(scene),
        history=scene.sensors.history,
        delay=scene.sensors.delay,
        steps=scene.control.steps,
        time_step=scene.control.time_step,
        digest=_digest(scene, support),
    )


def _settings(scene: Scene) -> methods.Settings:
    return methods.Settings(scene.solver.tolerance, scene.solver.substeps or 1)


def _choose(
    asked: str, support: Support, settings: methods.Settings
) -> tuple[Method, tuple[str, ...]]:
    """Return the first method of the table that applies and has the name asked for, and why."""
    obstacles = {method: method.obstacle(support, settings) for method in methods.METHODS}
    applicable = [method for method, obstacle in obstacles.items() if obstacle is None]
    deferrals = {method: method.deferral(settings) for method in applicable[:-1]}
    chosen = next((m for m in applicable if deferrals.get(m) is None), applicable[0])
    reasons = _reasons(support, obstacles | deferrals, chosen)
    if asked in ("auto", chosen.name):
        return chosen, reasons
    for method in applicable:
        if method.name == asked:
            return method, (f"solver.method asks for it in place of {chosen.name!r}",)
    allowed = ", ".join(repr(name) for name in ("auto", *_names(applicable)))
    why = f"({'; '.join(reasons)})"
    msg = f"solver.method: {asked!r} does not apply to this scene {why}; allowed: {allowed}"
    raise CompileError(msg)


def _names(applicable: list[Method]) -> list[str]:
    return list(dict.fromkeys(method.name for method in applicable))


def _reasons(
    support: Support, obstacles: dict[Method, str | None], chosen: Method
) -> tuple[str, ...]:
    """Return the reasons for the choice, one clause each."""
    reasons = [*_nonlinearities(support), *_instability(support), *_friction(support)]
    if support.kind == MASSLESS:
        balance = "carriage.mass is 0: the forces on the carriage balance"
        return balance, *_instability(support), FIXED
    before = [method for method in _before(chosen) if support.kind in method.kinds]
    skipped = [f"not {method.title}: {obstacles[method]}" for method in before]
    if support.is_nonlinear:
        return (*reasons, *skipped)
    if not support.slips:
        reasons.append(_coupling(support))
    moves = [_moves(name, support) for name in support.varying]
    if support.sampled:
        moves.append("there is excitation besides harmonics")
    return (*reasons, *(moves or [FIXED]), *skipped)


def _before(chosen: Method) -> tuple[Method, ...]:
    """Return the methods before one in the table."""
    return methods.METHODS[: methods.METHODS.index(chosen)]


def _nonlinearities(support: Support) -> list[str]:
    reasons: list[str] = []
    low, high = support.low[at.BETA], support.high[at.BETA]
    if support.is_cubic:
        furthest = low if -low > high else high
        reasons.append(f"carriage.cubic_coefficient reaches {furthest:g} 1/m^2")
    if support.high[at.L0] > 0.0:
        reasons.append("springs of finite stretch")
    return reasons


def _instability(support: Support) -> list[str]:
    """Return where the carriage has no stable rest, as far as its spring tells."""
    (alpha, beta), place = support.low[[at.ALPHA, at.BETA]], "|x1| = sqrt(-alpha / beta)"
    reasons: list[str] = []
    if alpha < 0.0:
        start = f"carriage.linear_coefficient reaches {alpha:g}, so that x1 = 0 is unstable"
        ends = f"the spring has two wells, at {place}" if beta > 0.0 else "motions may grow forever"
        reasons.append(f"{start} and {ends}")
    if beta < 0.0 < support.high[at.ALPHA]:
        reasons.append(f"the carriage escapes beyond the barrier at {place}")
    return reasons


def _friction(support: Support) -> list[str]:
    if not support.slips:
        return []
    return [
        (
            "dry friction may slip faster than interface.reference_velocity = "
            f"{support.low[at.VR]:g} m/s"
        )
    ]


def _coupling(support: Support) -> str:
    joined = support.high[at.C] > 0.0 or support.high[at.K0] > 0.0
    if joined:
        return "all forces are linear in the state"
    return "nothing joins the sphere to the carriage"


def _moves(name: str, support: Support) -> str:
    row = support.names[name]
    name = "the stretch" if row == at.STRETCH else name
    return f"{name} takes values from {support.low[row]:g} to {support.high[row]:g}"


def _without_idle_friction(scene: Scene, support: Support) -> tuple[Support, tuple[str, ...]]:
    """Replace dry friction that provably never slips by the equivalent viscous interface."""
    low, high = support.low, support.high
    driven = (
        scene.excitation or scene.actuation.force is not None or scene.actuation.stretch is not None
    )
    fixed = all(support.fixed(row) for row in FRICTION)
    asked = scene.solver.method == "switched"
    if not support.slips or driven or asked or not fixed or high[at.L0] > 0.0 or low[at.M1] == 0.0:
        return support, ()
    fastest, vr = _fastest_slip(support), low[at.VR]
    if not fastest < vr:
        return support, ()
    damping = plain(laws.stick_slope)(low[at.MU1], low[at.FN], vr)
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
    """Return a bound of |w| [m/s] from the largest initial energy, which cannot grow.

    It is infinite if the energy of the carriage's spring has no lower bound.
    """
    low, high = support.low, support.high
    x1, offset, v1, v2 = (
        max(abs(support.start_low[row]), abs(support.start_high[row])) for row in range(4)
    )
    twice = high[at.M1] * v1**2 + high[at.M2] * v2**2 + support.stiffest * offset**2
    twice += high[at.K1] * max(0.0, high[at.ALPHA] * x1**2 + 0.5 * high[at.BETA] * x1**4)
    alpha, beta = low[at.ALPHA], low[at.BETA]
    if beta < 0.0 or (alpha < 0.0 and beta == 0.0):
        return np.inf
    if alpha < 0.0:
        twice += 0.5 * high[at.K1] * alpha**2 / beta  # the depth of the wells, below the middle
    return float(np.sqrt(twice * (1.0 / low[at.M1] + 1.0 / low[at.M2])))


def _digest(scene: Scene, support: Support) -> str:
    """Return an identifier of the scene and of the content of its records."""
    if not any(part.kind == "record" for part in scene.excitation):
        return scene.digest
    return hashlib.sha256(scene.digest.encode() + support.excitation.tobytes()).hexdigest()[:16]


def compile_findings(scene: Scene, wrong: frozenset[str] = frozenset()) -> list[str]:
    """Return why a scene cannot be compiled, each finding as "field: text".

    Parameters
    ----------
    scene
        A scene, or a draft whose wrong fields were replaced.
    wrong
        Dotted names of what was wrong; what depends on it is left out.
    """
    lines = [*_record_findings(scene, wrong), *_scene_findings(scene, wrong)]
    if lines or not is_whole(MECHANICAL, wrong):
        return lines
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            support, _ = _without_idle_friction(scene, support_of(scene))
            findings = [*_support_findings(support), *_cancellation_findings(scene, support)]
            return [*findings, *_method_findings(scene, support)]
    except CompileError as error:
        return [str(error)]


def _record_findings(scene: Scene, wrong: frozenset[str]) -> Iterator[str]:
    for k, part in enumerate(scene.excitation):
        if is_whole([f"excitation.{k}"], wrong):
            try:
                KINDS[part.kind].samples(part)
            except SceneError as error:
                yield f"excitation.{k}.file: {error}"


def _scene_findings(scene: Scene, wrong: frozenset[str]) -> Iterator[str]:
    """Yield what no plant covers, as far as the scene itself shows it."""
    interface, drawn = scene.interface, scene.randomization
    if (
        interface.kind == "dry_friction"
        and interface.normal_force is None
        and "sphere.mass" in drawn
        and is_whole(["interface.kind", "interface.normal_force"], wrong)
    ):
        yield (
            "interface.normal_force: missing; by default it is the sphere's weight, but "
            "sphere.mass is randomised. State a number, or randomise it too"
        )
    mass = bounds(scene.range_of("carriage.mass", scene.carriage.mass))
    if mass[0] > 0.0 or not is_whole(["carriage.mass", "randomization.carriage.mass"], wrong):
        return
    impulses = [
        f"excitation.{k}"
        for k, part in enumerate(scene.excitation)
        if part.kind == "impulse" and part.target == "force"
    ]
    shown = ["sensors.channels"] if "carriage_acceleration" in scene.sensors.channels else []
    for name in (*impulses, *shown):
        if is_whole([name], wrong):
            yield f"{name}: a carriage of mass 0 has no finite acceleration; give it some mass"


def _support_findings(support: Support) -> Iterator[str]:
    """Yield what no plant covers in a scene's support."""
    low, high = support.low, support.high
    obstacles = [method.obstacle(support) for method in methods.METHODS if MASSLESS in method.kinds]
    if low[at.M1] == 0.0 and None not in obstacles:
        yield f"carriage.mass: 0 {obstacles[0]}; a small mass has no such limit"
    growth = support.growth_rate * support.sample_interval * support.intervals_per_step
    if not growth <= MOST_GROWTH:
        yield (
            f"control.time_step: about an unstable place of the carriage's spring motions, and "
            f"errors with them, grow by up to exp({growth:.3g}) in a control step; allowed: "
            f"exp({MOST_GROWTH:g}), with a time_step of at most "
            f"{MOST_GROWTH / support.growth_rate:.3g} s"
        )
    furthest = max(abs(support.start_low[at.X2]), abs(support.start_high[at.X2]))
    if high[at.L0] > 0.0 and furthest >= low[at.STRETCH] * low[at.L0]:
        yield (
            f"initial.sphere_offset: got up to {furthest:g} m; allowed: less than "
            f"stretch * rest_length = {low[at.STRETCH] * low[at.L0]:g} m, where a spring of finite "
            "stretch has length 0"
        )


def _method_findings(scene: Scene, support: Support) -> Iterator[str]:
    """Yield why the method asked for does not apply, if there is one that does."""
    if any(method.obstacle(support) is None for method in methods.METHODS):
        try:
            _choose(scene.solver.method, support, _settings(scene))
        except CompileError as error:
            yield str(error)


def _cancellation_findings(scene: Scene, support: Support) -> Iterator[str]:
    """Yield that the carriage's acceleration is shown, but is only the round-off of its forces.

    At a velocity v the forces of dampers and springs are (c + d) v and (k1 + k2) v / w, each
    rounded to 2^-52 of itself; the slow motion of both masses on k1, of frequency w, accelerates by
    w v.
    """
    low, high = support.low, support.high
    if low[at.M1] == 0.0 or "carriage_acceleration" not in scene.sensors.channels:
        return
    slow = np.sqrt(low[at.K1] / (high[at.M1] + high[at.M2]))
    stiffness = support.outer_stiffness + support.stiffest
    resistance = high[at.D] + support.steepest + stiffness / slow
    lightest = 2.0**-52 * resistance / (slow * ACCELERATION_ERROR)
    if low[at.M1] < lightest:
        yield (
            "sensors.channels: carriage_acceleration is the difference of forces that cancel, and "
            f"round-off leaves less than 6 digits of it at carriage.mass = {low[at.M1]:g} kg; "
            f"allowed: a carriage.mass of at least {lightest:.2g} kg"
        )


def _check_solver(scene: Scene, method: Method, support: Support) -> None:
    """Warn of options without effect."""
    default = Solver()
    for option in ("tolerance", "substeps"):
        used = method.option is not None and method.option.name == option
        if used or getattr(scene.solver, option) == getattr(default, option):
            continue
        warnings.warn(
            f"solver.{option} has no effect: the {support.kind} plant is propagated by "
            f"{method.name!r}",
            stacklevel=4,  # where `compile_scene` was called
        )


def _start(support: Support) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lane at the start of an episode, and (row, low, high) of each drawn value."""
    low, high = support.start_low, support.start_high
    followers = [row for row, _, _ in support.products]
    rows, template = np.setdiff1d(np.flatnonzero(low != high), followers), low.copy()
    plain(laws.write_regimes)(template[:, None], 0, 1)  # lanes rest before their first episode
    return template, np.column_stack([rows.astype(np.float64), low[rows], high[rows]])
