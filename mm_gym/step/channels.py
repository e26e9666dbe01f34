"""The observation channels: one row each, from which names, units and scales follow."""

from __future__ import annotations

from typing import NamedTuple

from mm_gym.lanes import layout


class Channel(NamedTuple):
    """A quantity that an agent can observe.

    Attributes
    ----------
    row
        Row of the lanes that it shows.
    subtracted
        Row subtracted from it, or `NO_ROW`.
    unit
        SI unit.
    scale
        What it is divided by to be of order one, by the name that `mm_gym.plant.task` gives it.
    meaning
        In the symbols of docs/model.md, or in words.
    """

    row: int
    subtracted: int
    unit: str
    scale: str
    meaning: str


NONE = layout.NO_ROW

CHANNELS: dict[str, Channel] = {
    "carriage_displacement": Channel(layout.X1, NONE, "m", "displacement", "x1"),
    "sphere_displacement": Channel(layout.X2, NONE, "m", "displacement", "x2"),
    "sphere_offset": Channel(layout.X2, layout.X1, "m", "stroke", "x2 - x1"),
    "carriage_velocity": Channel(layout.V1, NONE, "m/s", "velocity", "v1"),
    "sphere_velocity": Channel(layout.V2, NONE, "m/s", "velocity", "v2"),
    "slip_velocity": Channel(layout.V2, layout.V1, "m/s", "velocity", "v2 - v1"),
    "stretch": Channel(layout.STRETCH, NONE, "-", "stretch", "stretch of the springs"),
    "damping": Channel(
        layout.DAMPING, NONE, "N s/m", "damping", "coefficient of an actuated damper"
    ),
    "voltage": Channel(layout.DAMPING, NONE, "V", "voltage", "of a magnetorheological damper"),
    "applied_force": Channel(layout.FORCE, NONE, "N", "limit", "of the actuator on the carriage"),
    "carriage_acceleration": Channel(
        layout.CARRIAGE_ACCELERATION, NONE, "m/s^2", "acceleration", "absolute, of the carriage"
    ),
    "sphere_acceleration": Channel(
        layout.SPHERE_ACCELERATION, NONE, "m/s^2", "acceleration", "absolute, of the sphere"
    ),
    "spring_force": Channel(
        layout.SPRING_FORCE, NONE, "N", "force", "of the sphere's springs on the carriage"
    ),
    "disturbance_force": Channel(
        layout.DISTURBANCE, NONE, "N", "force", "of the excitation on the carriage"
    ),
    "ground_acceleration": Channel(
        layout.GROUND_ACCELERATION, NONE, "m/s^2", "acceleration", "of the ground"
    ),
}
"""Name -> channel, in the order in which the schema and the documentation list them."""
