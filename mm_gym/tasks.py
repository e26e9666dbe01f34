"""The scenes of the registered tasks."""

from __future__ import annotations

from math import tau

from mm_gym.excitation import Harmonic
from mm_gym.scene import (
    Actuation,
    Control,
    ForceActuator,
    Initial,
    Objective,
    Scene,
    Sensors,
    SmallOnLarge,
    StretchActuator,
    Viscous,
)

CARRIAGE_FORCE = Scene(
    initial=Initial(carriage_displacement=(-0.01, 0.01), sphere_offset=(-0.02, 0.02)),
    actuation=Actuation(force=ForceActuator(limit=4.0)),
    objective=Objective(velocity_weight=0.1, effort_weight=0.01),
    control=Control(time_step=0.01, steps=100),
)
"""Free mass on a viscous interface, released from random displacements; a force on the carriage."""

PRE_STRETCH = Scene(
    interface=Viscous(damping=0.1),
    springs=SmallOnLarge(stiffness=35.0),
    excitation=(Harmonic(amplitude=1.0, frequency=57.5),),
    randomization={"excitation.0.frequency": (44.0, 71.0), "excitation.0.phase": (0.0, tau)},
    initial=Initial(stretch=(1.0, 3.0)),
    actuation=Actuation(stretch=StretchActuator(minimum=1.0, maximum=3.0, rate_limit=4.0)),
    sensors=Sensors(
        channels=(
            "carriage_displacement",
            "sphere_offset",
            "carriage_velocity",
            "slip_velocity",
            "stretch",
        ),
        history=3,
    ),
    objective=Objective(displacement_scale=0.0025, velocity_scale=0.15, stroke_scale=0.01),
    control=Control(time_step=0.01, steps=400),
)
"""An adaptive absorber: a harmonic force of unknown frequency; the agent sets the stretch."""

TASKS = {"mm_gym/CarriageForce-v0": CARRIAGE_FORCE, "mm_gym/PreStretch-v0": PRE_STRETCH}
"""Scene of each registered id."""
