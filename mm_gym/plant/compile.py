"""Compilation of a scene to a plant, and the findings that say field by field why one has none."""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import numpy as np

from mm_gym import methods
from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.errors import CompileError, SceneError
from mm_gym.lanes import layout
from mm_gym.law.dry_friction import write_regimes
from mm_gym.law.hardening_springs import CUBIC
from mm_gym.methods import Method
from mm_gym.methods.support import MASSLESS, Support
from mm_gym.plant.excitation import samples_of
from mm_gym.plant.idle_friction import without_idle_friction
from mm_gym.plant.method_choice import choose, settings_of
from mm_gym.plant.plant import Plant
from mm_gym.plant.support_of import support_of
from mm_gym.plant.task import observed, rewarded_channels, task_array
from mm_gym.scene.part import is_whole
from mm_gym.scene.scene import DELAY, Scene, Solver, bounds


def compile_scene(scene: Scene) -> Plant:
    """Choose the simplest model that covers everything the scene can reach, and prepare it.

    Raises
    ------
    CompileError
        If no plant covers the scene within its error bound, or the selected method does not apply
        to it. The message lists every finding.
    SceneError
        If it is no scene, or a record cannot be read: the field, the file, and its line and column.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # a rate that overflows is refused later
        return _compiled(scene)


def _compiled(scene: Scene) -> Plant:
    support, idle = without_idle_friction(scene, support_of(scene))
    findings = [*scene_findings(scene), *support_findings(scene, support)]
    if findings:
        raise CompileError("\n".join([*findings, *method_findings(scene, support)]))
    settings = settings_of(scene.solver)
    method, reasons = choose(scene.solver, support)
    _check_solver(scene, method, support)
    template, draws = _start(support)
    least, most = bounds(scene.range_of(DELAY, float(scene.sensors.delay)))
    return Plant(
        method=method,
        settings=settings,
        reasons=(*idle, *reasons),
        support=support,
        model=method.constants(support, settings),
        task=task_array(scene, support),
        template=template,
        draws=draws,
        actuators=scene.actuation.names,
        observed=observed(scene),
        history=scene.sensors.history,
        delay=int(least + most + 1.0) // 2,  # of two in the middle the larger
        steps=scene.control.steps,
        time_step=scene.control.time_step,
        digest=scene.digest,
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


def _start(support: Support) -> tuple[Array, Array]:
    """Return the lane at the start of an episode, and (row, low, high) of each drawn value."""
    low, high = support.start_low, support.start_high
    followers = [row for row, _, _ in support.products]
    drawn = np.union1d(np.flatnonzero(low != high), support.own_rows)  # own states begin at 0
    rows, template = np.setdiff1d(drawn, followers).astype(np.intp), low.copy()
    plain(write_regimes)(template[:, None], 0, 1)  # lanes rest before their first episode
    return template, np.column_stack([rows.astype(np.float64), low[rows], high[rows]])


MECHANICAL = (
    *("carriage", "sphere", "interface", "springs", "excitation", "initial"),
    *("actuation", "control", "randomization", "solver"),
)
"""What the choice of a method depends on: all parts of a scene but sensors and objective."""

MOST_GROWTH = 9.0
"""Largest growth of a motion about an unstable place in a control step, as an exponent: round-off
of 1.1e-16 then stays below the bound of 1e-12 that exact methods have."""

ACCELERATION_ERROR = 1e-6
"""Largest round-off of an observed acceleration of the carriage, relative to the motion's."""


def compile_findings(scene: Scene, wrong: frozenset[str] = frozenset()) -> list[str]:
    """Return why a scene cannot be compiled, each finding as "field: text".

    Parameters
    ----------
    scene
        A scene, or a draft whose wrong fields were replaced.
    wrong
        Dotted names of what was wrong; what depends on it is left out.
    """
    lines = [*_record_findings(scene, wrong), *scene_findings(scene, wrong)]
    if lines or not is_whole(MECHANICAL, wrong):
        return lines
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            support, _ = without_idle_friction(scene, support_of(scene))
            return [*support_findings(scene, support), *method_findings(scene, support)]
    except CompileError as error:
        return [str(error)]


def _record_findings(scene: Scene, wrong: frozenset[str]) -> Iterator[str]:
    for k, part in enumerate(scene.excitation):
        if is_whole([f"excitation.{k}"], wrong):
            try:
                samples_of(f"excitation.{k}", part)
            except SceneError as error:
                yield str(error)


def scene_findings(scene: Scene, wrong: frozenset[str] = frozenset()) -> Iterator[str]:
    """Yield what no plant covers, as far as the scene itself shows it."""
    interface, drawn = scene.interface, scene.randomization
    if (
        getattr(interface, "normal_force", 0.0) is None
        and "sphere.mass" in drawn
        and is_whole(["interface.kind", "interface.normal_force"], wrong)
    ):
        yield (
            "interface.normal_force: missing; by default it is the sphere's weight, but "
            "sphere.mass is randomised. State a number, or randomise it too"
        )
    for k, part in enumerate(scene.excitation):
        if part.kind != "record" or part.scale_to is None or part.scale_to.period is None:
            continue
        name = f"excitation.{k}.time_scale"
        if name in drawn and is_whole([f"excitation.{k}", f"randomization.{name}"], wrong):
            yield (
                f"randomization.{name}: allowed: no range, because a spectral acceleration depends "
                f"on it; draw excitation.{k}.scale in place of scale_to"
            )
    yield from _cubic_findings(scene, wrong)
    mass = bounds(scene.range_of("carriage.mass", scene.carriage.mass))
    if mass[0] > 0.0 or not is_whole(["carriage.mass", "randomization.carriage.mass"], wrong):
        return
    impulses = [
        f"excitation.{k}"
        for k, part in enumerate(scene.excitation)
        if part.kind == "impulse" and part.target == "force"
    ]
    source = "objective" if scene.own_reward is None else "reward"
    read = {"sensors.channels": scene.sensors.channels, source: rewarded_channels(scene)}
    shown = [name for name, channels in read.items() if "carriage_acceleration" in channels]
    for name in (*impulses, *shown):
        if is_whole([name], wrong):
            yield f"{name}: a carriage of mass 0 has no finite acceleration; give it some mass"


def _cubic_findings(scene: Scene, wrong: frozenset[str]) -> Iterator[str]:
    """Yield that springs with a cubic term meet dry friction."""
    cubic = scene.range_of(CUBIC, getattr(scene.springs, "cubic_coefficient", 0.0))
    read = [CUBIC, f"randomization.{CUBIC}", "interface.kind", "springs.kind"]
    if scene.interface.kind == "dry_friction" and bounds(cubic)[1] > 0.0 and is_whole(read, wrong):
        yield (
            f"{CUBIC}: got up to {bounds(cubic)[1]:g} 1/m^2; allowed: 0 with interface.kind = "
            "'dry_friction', whose changes of regime no method follows between such springs; "
            "'stribeck' has none"
        )


def support_findings(scene: Scene, support: Support) -> Iterator[str]:
    """Yield what no plant covers in a scene's support."""
    yield from _obstacles(support)
    yield from _cancellation(scene, support)


def _obstacles(support: Support) -> Iterator[str]:
    """Yield what no plant covers whatever is observed."""
    low, high = support.low, support.high
    obstacles = [method.obstacle(support) for method in methods.METHODS if MASSLESS in method.kinds]
    if low[layout.M1] == 0.0 and None not in obstacles:
        yield f"carriage.mass: 0 {obstacles[0]}; a small mass has no such limit"
    growth = support.growth_rate * support.sample_interval * support.intervals_per_step
    if not growth <= MOST_GROWTH:
        yield (
            f"control.time_step: about an unstable place of the carriage's spring motions, and "
            f"errors with them, grow by up to exp({growth:.3g}) in a control step; allowed: "
            f"exp({MOST_GROWTH:g}), with a time_step of at most "
            f"{MOST_GROWTH / support.growth_rate:.3g} s"
        )
    furthest = max(abs(support.start_low[layout.X2]), abs(support.start_high[layout.X2]))
    if high[layout.L0] > 0.0 and furthest >= low[layout.STRETCH] * low[layout.L0]:
        yield (
            f"initial.sphere_offset: got up to {furthest:g} m; allowed: less than "
            f"stretch * rest_length = {low[layout.STRETCH] * low[layout.L0]:g} m, where a spring "
            "of finite stretch has length 0"
        )


def _cancellation(scene: Scene, support: Support) -> Iterator[str]:
    """Yield that the carriage's acceleration is shown, but is only the round-off of its forces.

    At a velocity v the forces of dampers and springs are (c + d) v and (k1 + k2) v / w, each
    rounded to 2^-52 of itself; the slow motion of both masses on k1, of frequency w, accelerates by
    w v.
    """
    low, high = support.low, support.high
    if low[layout.M1] == 0.0 or "carriage_acceleration" not in scene.sensors.channels:
        return
    slow = np.sqrt(low[layout.K1] / (high[layout.M1] + high[layout.M2]))
    stiffness = support.outer_stiffness + support.stiffest
    resistance = high[layout.D] + support.steepest + stiffness / slow
    lightest = 2.0**-52 * resistance / (slow * ACCELERATION_ERROR)
    if low[layout.M1] < lightest:
        yield (
            "sensors.channels: carriage_acceleration is the difference of forces that cancel, and "
            f"round-off leaves less than 6 digits of it at carriage.mass = {low[layout.M1]:g} kg; "
            f"allowed: a carriage.mass of at least {lightest:.2g} kg"
        )


def method_findings(scene: Scene, support: Support) -> Iterator[str]:
    """Yield why the method asked for does not apply, if there is one that does."""
    if any(method.obstacle(support) is None for method in methods.METHODS):
        try:
            choose(scene.solver, support)
        except CompileError as error:
            yield str(error)
