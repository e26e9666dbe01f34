"""The row of each field of a scene, and the scene's support: all values that the rows can take."""

from __future__ import annotations

import math

import numpy as np

from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.excitation.sources import LONGEST_TURN
from mm_gym.lanes import layout
from mm_gym.law.dry_friction import write_regimes
from mm_gym.law.hardening_springs import CUBIC
from mm_gym.law.interface import LINE, Interface
from mm_gym.law.springs import LINEAR
from mm_gym.methods.support import Support, fastest_rate, interface_of
from mm_gym.plant.excitation import NUMBER, lay_out
from mm_gym.plant.task import instruments_of
from mm_gym.scene.mechanics import GRAVITY
from mm_gym.scene.scene import NumberOrRange, Scene, bounds, require_scene

ROWS: dict[str, int] = {
    "initial.carriage_displacement": layout.X1,
    "initial.sphere_offset": layout.X2,
    "initial.carriage_velocity": layout.V1,
    "initial.sphere_velocity": layout.V2,
    "initial.stretch": layout.STRETCH,
    "carriage.mass": layout.M1,
    "carriage.stiffness": layout.K1,
    "carriage.damping": layout.D,
    "carriage.linear_coefficient": layout.ALPHA,
    "carriage.cubic_coefficient": layout.BETA,
    "sphere.mass": layout.M2,
    "interface.damping": layout.C,
    "interface.static_coefficient": layout.MU1,
    "interface.kinetic_coefficient": layout.MU2,
    "interface.reference_velocity": layout.VR,
    "interface.slip_damping": layout.CHI,
    "interface.normal_force": layout.FN,
    "springs.stiffness": layout.K0,
    "springs.stretch": layout.STRETCH,
    "springs.rest_length": layout.L0,
}
"""Field -> its row of a lane; `mm_gym.plant.excitation` has those of the excitation."""

FIXED_STRETCH = {"none": 1.0, "linear": LINEAR}
"""Stretch of springs that have none: kernels divide by it, also where their stiffness is 0."""

CONSTANT = (layout.FORCE, layout.STRETCH, layout.DAMPING, *range(layout.M1, layout.L0 + 1))
"""Rows of what the actuators apply, and of the physical parameters."""


def support_of(scene: Scene) -> Support:
    """Collect the values that randomisation, initial ranges and actuation can reach."""
    require_scene(scene)
    interface = _interface(scene)
    own = [] if interface is LINE else list(interface.fields)
    known = ROWS if interface is LINE else [n for n in ROWS if not n.startswith("interface.")]
    values = {n: value for n, value in _fields(scene).items() if n in known or n in own}
    others = {n: value for n, value in values.items() if n not in own}
    # A general plant has one method, so fast harmonics divide its control step.
    turn = math.inf if interface is LINE else LONGEST_TURN
    stiffness = {n: value for n, value in values.items() if n == "springs.stiffness"}
    excitation = lay_out(scene, _rate(scene, others | stiffness), turn)
    rows = {name: ROWS[name] for name in others}
    rows |= excitation.names
    ratios = {name: excitation.size + k for k, name in enumerate(scene.drawn_ratios)}
    first = excitation.size + len(ratios) + len(interface.states)
    own_rows = {name: first + k for k, name in enumerate(own)}
    rows |= own_rows
    damper, damped = scene.actuation.device, scene.actuation.damped
    damped_row = 0 if damped is None else rows[damped]
    if damped is not None:
        rows[damped] = layout.DAMPING
    instruments = instruments_of(scene, first + len(own))
    rows |= instruments.names
    low, high = np.zeros(instruments.size), np.zeros(instruments.size)
    stated = [(rows[name], value) for name, value in values.items() if name in rows]
    drawn = [(row, scene.randomization[name]) for name, row in ratios.items()]
    for row, value in [*stated, *excitation.values.items(), *drawn, *instruments.values.items()]:
        low[row], high[row] = bounds(value)
    if scene.springs.kind in FIXED_STRETCH:
        low[layout.STRETCH] = high[layout.STRETCH] = FIXED_STRETCH[scene.springs.kind]
    sample_interval = scene.control.time_step / excitation.intervals_per_step
    for placed in excitation.parts:
        placed.kind.prepare(placed, excitation.description, sample_interval)
    if damper is not None:  # row DAMPING is drawn, the other one follows
        low[damped_row] = high[damped_row] = low[layout.DAMPING]
    start_low, start_high = low.copy(), high.copy()
    # Whole numbers are drawn from [low, high + 1), and rounded down.
    start_high[instruments.whole] += low[instruments.whole] < high[instruments.whole]
    for name in excitation.records:
        high[rows[f"{name}.{NUMBER}"]] -= 1.0
    if damper is not None:
        low[[layout.DAMPING, damped_row]] = damper.minimum
        high[[layout.DAMPING, damped_row]] = damper.maximum
    if scene.actuation.force is not None:
        high[layout.FORCE] = scene.actuation.force.limit
        low[layout.FORCE] = -high[layout.FORCE]
    if scene.actuation.stretch is not None:
        low[layout.STRETCH] = scene.actuation.stretch.minimum
        high[layout.STRETCH] = scene.actuation.stretch.maximum
    return Support(
        start_low=start_low,
        start_high=start_high,
        low=low,
        high=high,
        names=rows | ratios,
        ground=excitation.ground,
        sample_interval=sample_interval,
        intervals_per_step=excitation.intervals_per_step,
        parameters=(
            *(*CONSTANT, *excitation.values, *ratios.values(), *own_rows.values()),
            *instruments.values,
        ),
        products=tuple(
            (rows[field], ratios[name], rows[of])
            for name, (field, of) in scene.drawn_ratios.items()
        ),
        jets=excitation.jets,
        terms=excitation.terms,
        excitation=excitation.description,
        interface=interface,
        interface_row=first if own else 0,
        is_between=scene.actuation.is_between,
        records=excitation.records,
        damped_row=damped_row,
        sensors_row=instruments.sensors,
        actuator_rows=instruments.actuators,
        device=next((n for n in ("damping", "voltage") if n in scene.actuation.names), ""),
    )


def lane_of(support: Support) -> Array:
    """Return the lane (rows,) that begins at the lower end of every range."""
    row = support.start_low.copy()
    row[layout.X2] += row[layout.X1]
    plain(write_regimes)(row[:, None], 0, 1)
    return row


def _interface(scene: Scene) -> Interface:
    """Return the force between the masses.

    Dry friction is not known by value; `findings` refuses it with springs that harden.
    """
    kind = scene.interface.kind
    cubic = scene.range_of(CUBIC, getattr(scene.springs, "cubic_coefficient", 0.0))
    return interface_of(kind, hardens=bounds(cubic)[1] > 0.0 and kind != "dry_friction")


def _rate(scene: Scene, values: dict[str, NumberOrRange]) -> float:
    """Return the fastest rate of the plant [1/s], but for dry friction and nonlinear springs."""
    low, high = np.zeros(layout.HARMONICS), np.zeros(layout.HARMONICS)
    low[layout.STRETCH] = FIXED_STRETCH.get(scene.springs.kind, 1.0)
    for name, value in values.items():
        low[ROWS[name]], high[ROWS[name]] = bounds(value)
    if scene.actuation.stretch is not None:
        low[layout.STRETCH] = scene.actuation.stretch.minimum
    damper, damped = scene.actuation.device, scene.actuation.damped
    if damper is not None and damped in values:
        low[ROWS[damped]], high[ROWS[damped]] = damper.minimum, damper.maximum
    low[layout.VR] = high[layout.VR] = 0.0  # friction is propagated from corner to corner
    support = Support(low, high, low, high)
    if low[layout.M1] > 0.0:
        return fastest_rate(support)
    # Without inertia the carriage follows at (k1 + k2) / (c + d), the sphere as if on a held one.
    damping = low[layout.C] + low[layout.D]
    stiffness = support.outer_stiffness + support.stiffest
    held = np.sqrt(support.stiffest / low[layout.M2]) + high[layout.C] / low[layout.M2]
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
