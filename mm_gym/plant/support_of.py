"""The row of each field of a scene, and the scene's support: all values that the rows can take."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.excitation.sources import LONGEST_TURN
from mm_gym.lanes import layout as at
from mm_gym.law import INTERFACES
from mm_gym.law.hardening_springs import CUBIC, LINES, with_hardening_springs
from mm_gym.law.interface import LINE
from mm_gym.law.springs import LINEAR
from mm_gym.methods.support import Support, fastest_rate
from mm_gym.plant.excitation import NUMBER, lay_out
from mm_gym.plant.task import instruments_of
from mm_gym.scene.mechanics import GRAVITY
from mm_gym.scene.scene import bounds

if TYPE_CHECKING:
    from mm_gym.law.interface import Interface
    from mm_gym.scene.scene import NumberOrRange, Scene

ROWS: dict[str, int] = {
    "initial.carriage_displacement": at.X1,
    "initial.sphere_offset": at.X2,
    "initial.carriage_velocity": at.V1,
    "initial.sphere_velocity": at.V2,
    "initial.stretch": at.STRETCH,
    "carriage.mass": at.M1,
    "carriage.stiffness": at.K1,
    "carriage.damping": at.D,
    "carriage.linear_coefficient": at.ALPHA,
    "carriage.cubic_coefficient": at.BETA,
    "sphere.mass": at.M2,
    "interface.damping": at.C,
    "interface.static_coefficient": at.MU1,
    "interface.kinetic_coefficient": at.MU2,
    "interface.reference_velocity": at.VR,
    "interface.slip_damping": at.CHI,
    "interface.normal_force": at.FN,
    "springs.stiffness": at.K0,
    "springs.stretch": at.STRETCH,
    "springs.rest_length": at.L0,
}
"""Field -> its row of a lane; `mm_gym.plant.excitation` has those of the excitation."""

FIXED_STRETCH = {"none": 1.0, "linear": LINEAR}
"""Stretch of springs that have none: kernels divide by it, also where their stiffness is 0."""

CONSTANT = (at.FORCE, at.STRETCH, at.DAMPING, *range(at.M1, at.L0 + 1))
"""Rows of what the actuators apply, and of the physical parameters."""


def support_of(scene: Scene) -> Support:
    """Collect the values that randomisation, initial ranges and actuation can reach.

    Raises
    ------
    SceneError
        If a record cannot be read.
    CompileError
        If the excitation divides a control step too finely.
    """
    interface = _interface(scene)
    own = [] if interface is LINE else list(interface.fields)
    known = ROWS if interface is LINE else [n for n in ROWS if not n.startswith("interface.")]
    values = {n: value for n, value in _fields(scene).items() if n in known or n in own}
    others = {n: value for n, value in values.items() if n not in own}
    # A general plant has one method, so fast harmonics divide its control step.
    turn = math.inf if interface is LINE else LONGEST_TURN
    stiffness = {n: value for n, value in values.items() if n == "springs.stiffness"}
    layout = lay_out(scene, _rate(scene, others | stiffness), turn)
    rows = {name: ROWS[name] for name in others}
    rows |= layout.names
    ratios = {name: layout.size + k for k, name in enumerate(scene.drawn_ratios)}
    first = layout.size + len(ratios) + len(interface.states)
    own_rows = {name: first + k for k, name in enumerate(own)}
    rows |= own_rows
    damper, damped = scene.actuation.device, scene.actuation.damped
    damped_row = 0 if damped is None else rows[damped]
    if damped is not None:
        rows[damped] = at.DAMPING
    instruments = instruments_of(scene, first + len(own))
    rows |= instruments.names
    low, high = np.zeros(instruments.size), np.zeros(instruments.size)
    stated = [(rows[name], value) for name, value in values.items() if name in rows]
    drawn = [(row, scene.randomization[name]) for name, row in ratios.items()]
    for row, value in [*stated, *layout.values.items(), *drawn, *instruments.values.items()]:
        low[row], high[row] = bounds(value)
    if scene.springs.kind in FIXED_STRETCH:
        low[at.STRETCH] = high[at.STRETCH] = FIXED_STRETCH[scene.springs.kind]
    sample_interval = scene.control.time_step / layout.intervals_per_step
    for placed in layout.parts:
        placed.kind.prepare(placed, layout.description, sample_interval)
    if damper is not None:  # row DAMPING is drawn, the other one follows
        low[damped_row] = high[damped_row] = low[at.DAMPING]
    start_low, start_high = low.copy(), high.copy()
    # Whole numbers are drawn from [low, high + 1), and rounded down.
    start_high[instruments.whole] += low[instruments.whole] < high[instruments.whole]
    for name in layout.records:
        high[rows[f"{name}.{NUMBER}"]] -= 1.0
    if damper is not None:
        low[[at.DAMPING, damped_row]] = damper.minimum
        high[[at.DAMPING, damped_row]] = damper.maximum
    if scene.actuation.force is not None:
        high[at.FORCE] = scene.actuation.force.limit
        low[at.FORCE] = -high[at.FORCE]
    if scene.actuation.stretch is not None:
        low[at.STRETCH], high[at.STRETCH] = (
            scene.actuation.stretch.minimum,
            scene.actuation.stretch.maximum,
        )
    return Support(
        start_low=start_low,
        start_high=start_high,
        low=low,
        high=high,
        names=rows | ratios,
        ground=layout.ground,
        sample_interval=sample_interval,
        intervals_per_step=layout.intervals_per_step,
        parameters=(
            *(*CONSTANT, *layout.values, *ratios.values(), *own_rows.values()),
            *instruments.values,
        ),
        products=tuple(
            (rows[field], ratios[name], rows[of])
            for name, (field, of) in scene.drawn_ratios.items()
        ),
        jets=layout.jets,
        terms=layout.terms,
        excitation=layout.description,
        interface=interface,
        interface_row=first if own else 0,
        is_between=scene.actuation.is_between,
        records=layout.records,
        damped_row=damped_row,
        sensors_row=instruments.sensors,
        actuator_rows=instruments.actuators,
        device=next((n for n in ("damping", "voltage") if n in scene.actuation.names), ""),
    )


def _interface(scene: Scene) -> Interface:
    """Return the force between the masses as methods take it: with springs that harden, by value.

    Dry friction is not known by value; `findings` refuses it with such springs.
    """
    kind = scene.interface.kind
    cubic = scene.range_of(CUBIC, getattr(scene.springs, "cubic_coefficient", 0.0))
    if bounds(cubic)[1] > 0.0 and kind != "dry_friction":
        return with_hardening_springs((LINES | INTERFACES)[kind])
    return INTERFACES.get(kind, LINE)


def _rate(scene: Scene, values: dict[str, NumberOrRange]) -> float:
    """Return the fastest rate of the plant [1/s], but for dry friction and nonlinear springs."""
    low, high = np.zeros(at.HARMONICS), np.zeros(at.HARMONICS)
    low[at.STRETCH] = FIXED_STRETCH.get(scene.springs.kind, 1.0)
    for name, value in values.items():
        low[ROWS[name]], high[ROWS[name]] = bounds(value)
    if scene.actuation.stretch is not None:
        low[at.STRETCH] = scene.actuation.stretch.minimum
    damper, damped = scene.actuation.device, scene.actuation.damped
    if damper is not None and damped in values:
        low[ROWS[damped]], high[ROWS[damped]] = damper.minimum, damper.maximum
    low[at.VR] = high[at.VR] = 0.0  # friction is propagated from corner to corner
    support = Support(
        start_low=low,
        start_high=high,
        low=low,
        high=high,
        names={},
        ground=(),
        sample_interval=0.0,
        intervals_per_step=1,
        parameters=(),
        products=(),
        jets=0,
        terms=0,
        excitation=np.zeros(1),
    )
    if low[at.M1] > 0.0:
        return fastest_rate(support)
    # Without inertia the carriage follows at (k1 + k2) / (c + d), the sphere as if on a held one.
    damping = low[at.C] + low[at.D]
    stiffness = support.outer_stiffness + support.stiffest
    held = np.sqrt(support.stiffest / low[at.M2]) + high[at.C] / low[at.M2]
    follows = stiffness / damping if damping > 0.0 else 0.0  # no plant covers it without damping
    return float(follows + held)


def _fields(scene: Scene) -> dict[str, NumberOrRange]:
    """Return dotted name -> value or range of every number but the excitation's."""
    values: dict[str, NumberOrRange] = {}
    for part in ("carriage", "sphere", "interface", "springs", "initial"):
        for field, value in getattr(scene, part):
            if isinstance(value, float | tuple):
                values[f"{part}.{field}"] = value
    if getattr(scene.interface, "normal_force", 0.0) is None:
        values["interface.normal_force"] = scene.sphere.mass * GRAVITY
    if scene.actuation.stretch is not None and "springs.stretch" in values:
        values.setdefault("initial.stretch", values["springs.stretch"])
        del values["springs.stretch"]  # both have the same row, and the initial value counts
    return {name: scene.range_of(name, value) for name, value in values.items()}
