"""The mechanism: ground, springs, damper, carriage and sphere, with the forces on them."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, floor, pi, sin, sqrt
from typing import TYPE_CHECKING

from mm_gym.lanes import layout as at
from mm_gym.rendering import history as rows
from mm_gym.rendering import look
from mm_gym.rendering import view as place
from mm_gym.rendering.impulses import can_be_seen, recent_impulse
from mm_gym.rendering.numbers import round_up, text_of
from mm_gym.rendering.subject import UNSTRETCHED

if TYPE_CHECKING:
    from mm_gym.rendering.canvas import Canvas
    from mm_gym.rendering.history import Past
    from mm_gym.rendering.look import Colour
    from mm_gym.rendering.subject import Subject
    from mm_gym.rendering.view import View

COILS = 7
"""Coils of the carriage's spring."""

PITCH = 20.0
"""Distance of the coils of the sphere's springs where they are not stretched."""

COIL, CARRIAGE_COIL = 9.0, 9.0
"""Half the width of springs where they are not stretched."""

ARROW = 128.0
"""Length of the arrow of the largest force."""


@dataclass(frozen=True)
class Mechanism:
    """Draws the mechanism as it is now.

    Attributes
    ----------
    canvas, subject, past, view
        Where to draw, what, when, and at which scale.
    """

    canvas: Canvas
    subject: Subject
    past: Past
    view: View

    @property
    def ground(self) -> float:
        """Displacement of the ground in the picture."""
        return self._shown(self.past.now(rows.GROUND))

    @property
    def carriage(self) -> float:
        """Place of the carriage's middle."""
        return place.REST + self.ground + self._shown(self.past.now(at.X1))

    @property
    def offset(self) -> float:
        """The sphere's offset."""
        return self._shown(self.past.now(at.X2) - self.past.now(at.X1))

    def _shown(self, length: float) -> float:
        """Return a length [m] in the picture, in whole pixels: videos are a tenth smaller."""
        return round(length * self.view.scale * look.PIXELS) / look.PIXELS

    def draw(self) -> None:
        """Draw all parts, the farthest first."""
        self._draw_ground()
        self._draw_carriage_spring()
        if self.subject.has_damper:
            self._draw_damper()
        self._draw_carriage()
        if self.subject.has_springs:
            self._draw_springs()
        if self.subject.has_sphere:
            self._draw_sphere()
        self._draw_forces()

    def _draw_ground(self) -> None:
        """Draw ground and wall, with a ruler on which the carriage's pointer shows x1."""
        canvas, ground = self.canvas, self.ground
        wall = place.WALL + ground
        canvas.box(-20, place.GROUND, look.WIDTH + 20, place.GROUND + 14, look.PALE)
        canvas.box(-20, 128, wall, place.GROUND + 14, look.PALE)
        for k in range(-1, 54):
            x = 16.0 * k + ground % 16.0
            canvas.line([(x + 8, place.GROUND + 3), (x, place.GROUND + 14)], look.HATCH, 1.5)
        for k in range(7):
            y = 134 + 14.0 * k
            canvas.line([(wall - 2, y), (wall - 12, y + 11)], look.HATCH, 1.5)
        canvas.line([(wall, 128), (wall, place.GROUND)], look.INK, 2.5)
        canvas.line([(wall, place.GROUND), (look.WIDTH + 20, place.GROUND)], look.INK, 2.5)
        self._draw_ruler()
        limit = self.subject.displacement_limit
        if limit is not None and limit * self.view.scale <= 1.2 * place.ROOM:
            for side in (-1.0, 1.0):
                x = place.REST + ground + side * limit * self.view.scale
                self._draw_stop(x, place.GROUND, 12.0, side)

    def _draw_ruler(self) -> None:
        canvas, view = self.canvas, self.view
        middle, top = place.REST + self.ground, place.GROUND + 14.0
        each = round_up(40.0 / view.scale / view.unit.size)
        parts = 4 if f"{each:e}".startswith("2") else 5
        spacing = each / parts * view.unit.size * view.scale
        reach = floor(1.3 * place.ROOM / spacing)
        for k in range(-reach, reach + 1):
            x, is_labelled = middle + k * spacing, k % parts == 0
            canvas.line([(x, top), (x, top + (7 if is_labelled else 4))], look.GREY, 1.25)
            if is_labelled:
                label = text_of(k // parts * each) if k else f"0 {view.unit.name}"
                canvas.text(label, (x, top + 15), look.SMALL, look.GREY, 0.5)

    def _draw_stop(self, x: float, bottom: float, height: float, side: float) -> None:
        """Draw where an episode ends."""
        canvas = self.canvas
        canvas.box(x - 1.25, bottom - height, x + 1.25, bottom, look.LIMIT)
        canvas.polygon(
            [(x, bottom - height), (x, bottom - height + 7), (x + side * 8, bottom - height + 3.5)],
            look.LIMIT,
        )

    def _draw_carriage_spring(self) -> None:
        start, end, y = place.WALL + self.ground, self.carriage - place.HALF_BODY, 174.0
        extended = self.past.now(at.X1) / max(self.subject.displacement, self.past.displacement)
        colour = look.spring_colour(0.5 + 0.5 * extended)
        self.canvas.line([(start, y), (start + 10, y)], colour, 2.25)
        self.canvas.line([(end - 10, y), (end, y)], colour, 2.25)
        self._draw_coils(end - 10, start + 10, y, coils=COILS, half=CARRIAGE_COIL, colour=colour)

    def _draw_coils(
        self, start: float, end: float, y: float, *, coils: float, half: float, colour: Colour
    ) -> None:
        """Draw a helix of so many coils from one place to another, the far sides paler."""
        pitch = (end - start) / coils
        turns = [*(0.5 * k for k in range(floor(2.0 * coils) + 1)), coils]
        points = [(start + pitch * t, y + half * (4.0 * abs(t % 1.0 - 0.5) - 1.0)) for t in turns]
        for k in range(1, len(points) - 1, 2):
            self.canvas.line(points[k : k + 2], look.lighter(colour, 0.5), 1.5)
        for k in range(0, len(points) - 1, 2):
            self.canvas.line(points[k : k + 2], colour, 2.25)

    def _draw_damper(self) -> None:
        canvas, y = self.canvas, 200.0
        wall, end = place.WALL + self.ground, self.carriage - place.HALF_BODY
        left, right = wall + 14, wall + 0.62 * place.SPRING
        canvas.line([(wall, y), (left, y)], look.GREY, 2.5)
        canvas.box(left, y - 7, right, y + 7, self._fluid(look.PALE, is_carriage=True))
        canvas.line([(right, y - 7), (left, y - 7), (left, y + 7), (right, y + 7)], look.GREY, 2.0)
        middle = 0.5 * (left + right)  # its stroke is smaller, so that it stays in the cylinder
        piston = middle + 0.4 * (end - wall - place.SPRING)
        canvas.line([(piston, y), (end, y)], look.GREY, 2.5)
        canvas.line([(piston, y - 5), (piston, y + 5)], look.INK, 3.5)

    def _fluid(self, usual: Colour, *, is_carriage: bool) -> Colour:
        """Return the colour of a damper's fluid: the darker, the more an actuated one damps."""
        row = self.subject.damped_row
        if not row or (row == at.D) != is_carriage:
            return usual
        low, high = self.subject.damping_range
        return look.mixed(usual, look.DAMPING, (self.past.now(at.DAMPING) - low) / (high - low))

    def _draw_carriage(self) -> None:
        canvas, middle = self.canvas, self.carriage
        left, right = middle - place.HALF_BODY, middle + place.HALF_BODY
        turned = self.view.angle(self.past.now(at.X1), place.WHEEL)
        for x in (left + 40, right - 40):
            centre = (x, place.GROUND - place.WHEEL - 1)
            canvas.disc(centre, place.WHEEL, look.INK)
            canvas.disc(centre, place.WHEEL - 3, look.PALE)
            spoke = (place.WHEEL - 3) * cos(turned), (place.WHEEL - 3) * sin(turned)
            canvas.line(
                [
                    (centre[0] - spoke[0], centre[1] - spoke[1]),
                    (centre[0] + spoke[0], centre[1] + spoke[1]),
                ],
                look.INK,
                2.0,
            )
        canvas.box(left, place.TOP, right, place.BOTTOM, look.INK, radius=4)
        canvas.box(left + 2, place.TOP + 2, right - 2, place.BOTTOM - 2, look.BODY, radius=3)
        tip = place.GROUND - 3
        canvas.polygon(
            [(middle - 6, place.BOTTOM), (middle + 6, place.BOTTOM), (middle, tip)], look.INK
        )
        self._draw_track()

    def _draw_track(self) -> None:
        """Draw what the sphere rolls on: a film, a rough surface, or nothing."""
        canvas, middle, top = self.canvas, self.carriage, place.TOP
        left, right = middle - place.POST + 14, middle + place.POST - 14
        if self.subject.interface == "viscous":
            canvas.box(
                left, top - place.FILM, right, top + 1, self._fluid(look.FILM, is_carriage=False)
            )
        elif self.subject.interface != "none":
            for k in range(int((right - left) / 8.0)):
                x = left + 8.0 * k
                canvas.polygon(
                    [(x, top + 1), (x + 4, top - place.FILM), (x + 8, top + 1)], look.INK
                )
        if not self.subject.has_sphere:
            return
        canvas.line([(middle, top + 2), (middle, top + 8)], look.GREY, 1.5)
        limit = self.subject.rail_limit
        if limit is not None and limit * self.view.scale <= 1.1 * place.TRAVEL:
            for side in (-1.0, 1.0):
                x = middle + side * limit * self.view.scale
                self._draw_stop(x, top, 18.0, side)

    def _draw_springs(self) -> None:
        """Draw the sphere's springs: the pitch of the coils is as large as their stretch."""
        canvas, middle, y = self.canvas, self.carriage, place.TOP - place.FILM - place.RADIUS
        low, high = self.subject.stretch_range
        stretch, sphere = max(self.past.now(at.STRETCH), UNSTRETCHED), middle + self.offset
        for side in (-1.0, 1.0):
            post = middle + side * place.POST
            length = place.POST - side * self.offset
            mine = stretch * length / place.POST
            coils = place.POST / (PITCH * stretch)
            colour = look.spring_colour(stretch_fraction(mine, low, high))
            half = COIL / sqrt(max(mine, 0.5))  # the material keeps its volume
            self._draw_coils(sphere, post, y, coils=coils, half=half, colour=colour)
            canvas.line([(post, place.TOP), (post, place.POST_TOP)], look.INK, 6.0)
            canvas.disc((post, y), 6.0, look.INK)

    def _draw_sphere(self) -> None:
        canvas, radius = self.canvas, place.RADIUS
        film = 0.0 if self.subject.interface == "none" else place.FILM
        centre = self.carriage + self.offset, place.TOP - film - radius
        turned = self.view.angle(self.past.now(at.X2) - self.past.now(at.X1), radius)
        canvas.disc(centre, radius, look.INK)
        canvas.disc(centre, radius - 2, look.SHINE)
        for begin in (0.0, pi):
            canvas.sector(centre, radius - 2, turned + begin, look.SHADE)
        canvas.disc(centre, 3.5, look.INK)

    def _draw_forces(self) -> None:
        """Draw arrows of the forces on the masses, and one of the ground's acceleration."""
        canvas, subject, past = self.canvas, self.subject, self.past
        arrows: list[tuple[float, Colour]] = []
        largest = max(subject.force_limit or 0.0, subject.disturbance, past.disturbance)
        if subject.force_limit is not None:
            arrows.append((past.now(at.FORCE) / largest, look.CONTROL))
        if subject.is_between:  # its reaction, on the sphere
            centre = self.carriage + self.offset, place.TOP - place.FILM - place.RADIUS
            canvas.arrow(centre, -ARROW * past.now(at.FORCE) / largest, look.CONTROL)
        if subject.disturbance:
            arrows.append((past.now(rows.PUSH) / largest, look.DISTURBANCE))
        if subject.impulse and can_be_seen(subject):
            part = recent_impulse(subject, past) / subject.impulse
            arrows.append((min(max(part, -1.0), 1.0), look.DISTURBANCE))
        heights = {0: (), 1: (189.0,), 2: (178.0, 200.0), 3: (174.0, 188.0, 202.0)}[len(arrows)]
        for (part, colour), y in zip(arrows, heights, strict=True):
            canvas.line([(self.carriage, y - 9), (self.carriage, y + 9)], look.GREY, 1.5)
            canvas.arrow((self.carriage, y), ARROW * part, colour)
        if subject.acceleration:
            part = past.now(rows.SHAKE) / max(subject.acceleration, past.acceleration)
            start = 640.0 + self.ground, place.GROUND - 12
            canvas.line([(start[0], start[1] - 9), (start[0], start[1] + 12)], look.GREY, 1.5)
            canvas.arrow(start, 70.0 * part, look.DISTURBANCE)


def stretch_fraction(stretch: float, low: float, high: float) -> float:
    """Return where a stretch lies on the scale of colours."""
    return (stretch - low) / (high - low)
