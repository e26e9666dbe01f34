"""The scenes of the registered tasks."""

from __future__ import annotations

from functools import partial
from math import tau

from mm_gym.scene.actuators import Actuation, ForceActuator, StretchActuator
from mm_gym.scene.excitation import Harmonic, Impulse, KanaiTajimi, Noise
from mm_gym.scene.mechanics import Carriage, DryFriction, SmallOnLarge, Viscous
from mm_gym.scene.scene import Control, Initial, Objective, Scene
from mm_gym.scene.sensors import Sensors

CARRIAGE_FORCE = Scene(
    initial=Initial(carriage_displacement=(-0.01, 0.01), sphere_offset=(-0.02, 0.02)),
    actuation=Actuation(force=ForceActuator(limit=4.0)),
    objective=Objective(velocity_weight=0.1, effort_weight=0.01),
    control=Control(time_step=0.01, steps=100),
)
"""Free mass on a viscous interface, released from random displacements; a force on the carriage."""

CARRIAGE_FORCE_DUFFING = Scene(
    carriage=Carriage(cubic_coefficient=2e6),
    initial=Initial(carriage_displacement=(-0.005, 0.005), sphere_offset=(-0.02, 0.02)),
    actuation=Actuation(force=ForceActuator(limit=4.0)),
    objective=Objective(displacement_scale=0.005, velocity_weight=0.1, effort_weight=0.01),
    control=Control(time_step=0.002, steps=200),
)
"""A cubic spring fifty times as stiff at the largest start as at rest: the LQR is only local."""

CARRIAGE_FORCE_FRICTION = Scene(
    interface=DryFriction(
        static_coefficient=0.509,
        kinetic_coefficient=0.2545,
        reference_velocity=0.2,
        slip_damping=0.1,
        normal_force=0.3924,
    ),
    initial=Initial(carriage_displacement=(-0.01, 0.01), sphere_offset=(-0.02, 0.02)),
    actuation=Actuation(force=ForceActuator(limit=4.0)),
    objective=Objective(velocity_weight=0.1, effort_weight=0.01, stroke_weight=1.0),
    control=Control(time_step=0.01, steps=200),
)
"""Dry friction of the paper's figure 8: only by slipping can the sphere be brought to the middle.

While it sticks, the offset that it would come to rest at does not change, whatever the force.
"""

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

FAST = StretchActuator(minimum=1.0, maximum=3.0, rate_limit=100.0)
"""Goes over its range in a fifth of a carriage's period, so that it can switch within one."""

_lightly_damped = partial(
    Scene,
    carriage=Carriage(damping=0.2),  # damping ratio 0.016: what stills the carriage is the sphere
    interface=Viscous(damping=0.1),
    springs=SmallOnLarge(stiffness=35.0),
    initial=Initial(stretch=(1.0, 3.0)),
)

PRE_STRETCH_NOISE = _lightly_damped(
    excitation=(Noise(rms=1.0, low_frequency=44.0, high_frequency=71.0, sample_time=0.005),),
    actuation=Actuation(stretch=FAST),
    sensors=PRE_STRETCH.sensors,
    objective=Objective(displacement_scale=0.005, velocity_scale=0.3, stroke_scale=0.02),
    control=Control(time_step=0.01, steps=400),
)
"""The same springs under band-limited noise, with an actuator fast enough for switching."""

PRE_STRETCH_SHOCK = _lightly_damped(
    excitation=(Impulse(size=(-0.04, 0.04), rate=1.0, time=0.0),),
    actuation=Actuation(stretch=FAST),
    sensors=Sensors(channels=PRE_STRETCH.sensors.channels),
    objective=Objective(displacement_scale=0.0025, velocity_scale=0.15, stroke_scale=0.01),
    control=Control(time_step=0.005, steps=400),
)
"""Free decay after random impulses on the carriage: springs that switch take energy out."""

HYBRID = _lightly_damped(
    excitation=(
        KanaiTajimi(
            rms=3.0,
            ground_frequency=75.0,
            ground_damping=0.6,
            rise=0.4,
            plateau=2.0,
            decay=2.0,
            sample_time=0.005,
        ),
    ),
    randomization={
        "excitation.0.ground_frequency": (50.0, 100.0),
        "excitation.0.ground_damping": (0.4, 0.8),
    },
    actuation=Actuation(
        force=ForceActuator(limit=0.25),
        stretch=FAST.model_copy(update={"command": "rate"}),
    ),
    sensors=Sensors(
        channels=(*PRE_STRETCH.sensors.channels, "ground_acceleration"),
        noise={"carriage_displacement": 2e-5, "ground_acceleration": 0.1},
        history=3,
    ),
    objective=Objective(
        displacement_scale=0.0025, velocity_scale=0.15, stroke_scale=0.01, effort_weight=0.02
    ),
    control=Control(time_step=0.01, steps=400),
)
"""Force and stretch against an earthquake on unknown soil, measured with noise.

The ground is that of a building of 2 Hz (soil of 10 to 20 rad/s, 2 s of rise, 10 s of strong
motion), five times faster, as befits a carriage of 10 Hz.
"""

TASKS = {
    "mm_gym/CarriageForce-v0": CARRIAGE_FORCE,
    "mm_gym/CarriageForceDuffing-v0": CARRIAGE_FORCE_DUFFING,
    "mm_gym/CarriageForceFriction-v0": CARRIAGE_FORCE_FRICTION,
    "mm_gym/PreStretch-v0": PRE_STRETCH,
    "mm_gym/PreStretchNoise-v0": PRE_STRETCH_NOISE,
    "mm_gym/PreStretchShock-v0": PRE_STRETCH_SHOCK,
    "mm_gym/Hybrid-v0": HYBRID,
}
"""Scene of each registered id."""
