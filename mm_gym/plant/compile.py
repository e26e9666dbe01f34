"""Compilation of a scene to a plant: its support, its method, and the arrays for the kernels."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.compiler.jit import plain
from mm_gym.errors import CompileError
from mm_gym.law.dry_friction import write_regimes
from mm_gym.plant.findings import method_findings, scene_findings, support_findings
from mm_gym.plant.idle_friction import without_idle_friction
from mm_gym.plant.method_choice import choose, settings_of
from mm_gym.plant.plant import Plant
from mm_gym.plant.support_of import support_of
from mm_gym.plant.task import observed, task_array
from mm_gym.scene.scene import DELAY, Solver, bounds

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mm_gym.methods import Method
    from mm_gym.methods.support import Support
    from mm_gym.scene.scene import Scene


def compile_scene(scene: Scene) -> Plant:
    """Choose the simplest model that covers everything the scene can reach, and prepare it.

    Raises
    ------
    CompileError
        If no plant covers the scene within its error bound, or the selected method does not apply
        to it. The message lists every finding.
    SceneError
        If a record cannot be read: the field, the file, and its line and column.
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
        delay=_nominal_delay(scene),
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


def _nominal_delay(scene: Scene) -> int:
    """Return the delay, or of a range's whole numbers the middle one: of two the larger."""
    low, high = bounds(scene.range_of(DELAY, float(scene.sensors.delay)))
    return int(low + high + 1.0) // 2


def _start(support: Support) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lane at the start of an episode, and (row, low, high) of each drawn value."""
    low, high = support.start_low, support.start_high
    followers = [row for row, _, _ in support.products]
    drawn = np.union1d(np.flatnonzero(low != high), support.own_rows)  # own states begin at 0
    rows, template = np.setdiff1d(drawn, followers).astype(np.intp), low.copy()
    plain(write_regimes)(template[:, None], 0, 1)  # lanes rest before their first episode
    return template, np.column_stack([rows.astype(np.float64), low[rows], high[rows]])
