"""Places in a picture: where the parts stand, and by how much displacements are magnified."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mm_gym.rendering.look import PIXELS
from mm_gym.rendering.numbers import FINE_STEPS, Unit, round_down, unit_of

if TYPE_CHECKING:
    from mm_gym.rendering.history import Past
    from mm_gym.rendering.subject import Subject

DOTS = 96.0 / 0.0254 / PIXELS
"""Units of a picture to a metre of a screen that has 96 dots per inch."""

# Places and lengths of the mechanism.
WALL, SPRING = 35.0, 165.0
HALF_BODY = 175.0
REST = WALL + SPRING + HALF_BODY
GROUND, BOTTOM, TOP = 232.5, 213.75, 162.5
"""Heights of the ground's surface and of the carriage's underside and top."""
POST, POST_TOP = 165.0, 98.0
"""Where the sphere's springs are held, from the carriage's middle, and how high up."""
RADIUS, WHEEL = 33.0, 9.0
FILM = 4.0
"""Thickness of the interface."""

ROOM = 88.0
"""Largest displacement of the carriage, that of the ground included."""
TRAVEL = POST - RADIUS - 16.0
"""Largest offset of the sphere."""


@dataclass(frozen=True)
class View:
    """The scale of a picture.

    Attributes
    ----------
    magnification
        Of displacements on a screen of 96 dots per inch [-].
    unit
        Unit of the lengths that the picture states.
    """

    magnification: float
    unit: Unit

    @property
    def scale(self) -> float:
        """Units to a metre."""
        return self.magnification * DOTS

    def angle(self, rolled: float, radius: float) -> float:
        """Return by how much a wheel of a radius has turned [rad] to roll a distance [m].

        Clockwise if it rolled to the right. The distance is magnified; thus the wheel does not slip
        in the picture.
        """
        return rolled * self.scale / radius


def view_of(subject: Subject, past: Past) -> View:
    """Return the largest round magnification that keeps the episode so far in view."""
    displacement = max(subject.displacement, past.displacement)
    room = ROOM / displacement
    if subject.has_sphere:
        room = min(room, TRAVEL / max(subject.offset, past.offset))
    return View(round_down(room / DOTS, FINE_STEPS), unit_of(0.999 * displacement))
