"""The mechanism: ground, springs, damper, carriage and sphere, with the forces on them."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, floor, pi, sin, sqrt

import numpy as np

from mm_gym.lanes import layout
from mm_gym.rendering import history as rows
from mm_gym.rendering import look
from mm_gym.rendering.canvas import Canvas
from mm_gym.rendering.history import Past
from mm_gym.rendering.look import (
    FINE_STEPS,
    PIXELS,
    Colour,
    Point,
    Unit,
    round_down,
    round_up,
    text_of,
    unit_of,
)
from mm_gym.rendering.subject import UNSTRETCHED, Subject
from mm_gym.simulation.response import acceleration

DOTS = 96.0 / 0.0254 / PIXELS  # units of a picture to a metre of a screen that has 96 dots per inch

# Places and lengths of the mechanism.
WALL, SPRING = 35.0, 165.0
HALF_BODY = 175.0
REST = WALL + SPRING + HALF_BODY
GROUND, BOTTOM, TOP = 232.5, 213.75, 162.5
"""Heights of the ground's surface and of the carriage's underside and top."""
POST, POST_TOP = 165.0, 98.0
"""Where the sphere's springs are held, from the carriage's middle, and how high up."""
RADIUS, WHEEL = 33.0, 9.0
FILM = 4.0  # thickness of the interface
ROOM = 88.0  # largest displacement of the carriage, that of the ground included
TRAVEL = POST - RADIUS - 16.0  # largest offset of the sphere


@dataclass(frozen=True)
class View:
    """The scale of a picture."""

    magnification: float  # of displacements on a screen of 96 dots per inch [-]
    unit: Unit  # of the lengths that the picture states

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


SHOWN = 0.3  # time [s] on the screen for which an impulse is shown

MOST_TURN = 0.7
"""Longest control step, times the carriage's natural frequency [rad]: the trapezoidal rule's error
of what other forces do is then below 5 % of the velocity's change."""

LEAST = 0.05  # smallest impulse that is told from that error, of the largest one


def can_be_seen(subject: Subject) -> bool:
    """Tell whether the control steps are short enough to find impulses, and all forces known."""
    if subject.support.is_general:
        return False
    largest = subject.impulse or subject.ground_impulse
    return largest > 0.0 and 2.0 * pi * subject.time_step <= MOST_TURN * subject.period


def recent_impulse(subject: Subject, past: Past) -> float:
    """Return the newest impulse within `SHOWN`, 0 if there is none.

    That on the carriage [N s], or, in a scene that has none of them, the jump of the ground's
    velocity [m/s].
    """
    count = max(2, round(SHOWN * subject.frames)) + 1
    now = past.rows[:, -count:]
    mass = past.lane[layout.M1]
    if now.shape[1] < 2 or mass == 0.0:  # noqa: PLR2004 - a change needs two states
        return 0.0
    before, after = now[:, :-1].copy(), now[:, 1:]
    held = [layout.FORCE, layout.STRETCH, layout.DAMPING]
    before[held] = after[held]  # over the control step
    mean = 0.0
    for ends in (before, after):
        motion = ends[: layout.V2 + 1].T, ends[held].T, ends[rows.PUSH]
        absolute = acceleration(subject.support, past.lane, *motion)[:, 0]
        mean = mean + 0.5 * (absolute - ends[rows.SHAKE])
    jumps = after[layout.V1] - before[layout.V1] - subject.time_step * mean
    sizes = mass * jumps if subject.impulse else -jumps
    found = np.flatnonzero(np.abs(sizes) > LEAST * (subject.impulse or subject.ground_impulse))
    return float(sizes[found[-1]]) if found.size else 0.0


COILS = 7  # coils of the carriage's spring
PITCH = 20.0  # distance of the coils of the sphere's springs where they are not stretched
COIL = 9.0  # half the width of springs where they are not stretched
ARROW = 128.0  # length of the arrow of the largest force


@dataclass(frozen=True)
class Mechanism:
    """Draws the mechanism as it is now."""

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
        return REST + self.ground + self._shown(self.past.now(layout.X1))

    @property
    def offset(self) -> float:
        """The sphere's offset."""
        return self._shown(self.past.now(layout.X2) - self.past.now(layout.X1))

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
        wall = WALL + ground
        canvas.box((-20, GROUND), (look.WIDTH + 20, GROUND + 14), look.PALE)
        canvas.box((-20, 128), (wall, GROUND + 14), look.PALE)
        for k in range(-1, 54):
            x = 16.0 * k + ground % 16.0
            canvas.line([(x + 8, GROUND + 3), (x, GROUND + 14)], look.HATCH, 1.5)
        for k in range(7):
            y = 134 + 14.0 * k
            canvas.line([(wall - 2, y), (wall - 12, y + 11)], look.HATCH, 1.5)
        canvas.line([(wall, 128), (wall, GROUND)], look.INK, 2.5)
        canvas.line([(wall, GROUND), (look.WIDTH + 20, GROUND)], look.INK, 2.5)
        self._draw_ruler()
        self._draw_stops(self.subject.displacement_limit, 1.2 * ROOM, (REST + ground, GROUND), 12.0)

    def _draw_ruler(self) -> None:
        canvas, view = self.canvas, self.view
        middle, top = REST + self.ground, GROUND + 14.0
        each = round_up(40.0 / view.scale / view.unit.size)
        parts = 4 if f"{each:e}".startswith("2") else 5
        spacing = each / parts * view.unit.size * view.scale
        reach = floor(1.3 * ROOM / spacing)
        for k in range(-reach, reach + 1):
            x, is_labelled = middle + k * spacing, k % parts == 0
            canvas.line([(x, top), (x, top + (7 if is_labelled else 4))], look.GREY, 1.25)
            if is_labelled:
                label = text_of(k // parts * each) if k else f"0 {view.unit.name}"
                canvas.text(label, (x, top + 15), look.SMALL, look.GREY, 0.5)

    def _draw_stops(self, limit: float | None, room: float, foot: Point, height: float) -> None:
        """Draw where an episode ends, on both sides of a foot, if there is room."""
        if limit is None or limit * self.view.scale > room:
            return
        for side in (-1.0, 1.0):
            x, top = foot[0] + side * limit * self.view.scale, foot[1] - height
            self.canvas.box((x - 1.25, top), (x + 1.25, foot[1]), look.LIMIT)
            self.canvas.polygon([(x, top), (x, top + 7), (x + side * 8, top + 3.5)], look.LIMIT)

    def _draw_carriage_spring(self) -> None:
        start, end, y = WALL + self.ground, self.carriage - HALF_BODY, 174.0
        extended = self.past.now(layout.X1) / max(self.subject.displacement, self.past.displacement)
        colour = look.spring_colour(0.5 + 0.5 * extended)
        self.canvas.line([(start, y), (start + 10, y)], colour, 2.25)
        self.canvas.line([(end - 10, y), (end, y)], colour, 2.25)
        self._draw_coils(end - 10, start + 10, y, coils=COILS, half=COIL, colour=colour)

    def _draw_coils(
        self, start: float, end: float, y: float, *, coils: float, half: float, colour: Colour
    ) -> None:
        """Draw a helix of so many coils from one place to another, the far sides paler."""
        pitch = (end - start) / coils
        turns = [*(0.5 * k for k in range(floor(2.0 * coils) + 1)), coils]
        points = [(start + pitch * t, y + half * (4.0 * abs(t % 1.0 - 0.5) - 1.0)) for t in turns]
        for k in range(1, len(points) - 1, 2):
            self.canvas.line(points[k : k + 2], look.mixed(colour, look.PAPER, 0.5), 1.5)
        for k in range(0, len(points) - 1, 2):
            self.canvas.line(points[k : k + 2], colour, 2.25)

    def _draw_damper(self) -> None:
        canvas, y = self.canvas, 200.0
        wall, end = WALL + self.ground, self.carriage - HALF_BODY
        left, right = wall + 14, wall + 0.62 * SPRING
        canvas.line([(wall, y), (left, y)], look.GREY, 2.5)
        canvas.box((left, y - 7), (right, y + 7), self._fluid(look.PALE, is_carriage=True))
        canvas.line([(right, y - 7), (left, y - 7), (left, y + 7), (right, y + 7)], look.GREY, 2.0)
        middle = 0.5 * (left + right)  # its stroke is smaller, so that it stays in the cylinder
        piston = middle + 0.4 * (end - wall - SPRING)
        canvas.line([(piston, y), (end, y)], look.GREY, 2.5)
        canvas.line([(piston, y - 5), (piston, y + 5)], look.INK, 3.5)

    def _fluid(self, usual: Colour, *, is_carriage: bool) -> Colour:
        """Return the colour of a damper's fluid: the darker, the more an actuated one damps."""
        row = self.subject.damped_row
        if not row or (row == layout.D) != is_carriage:
            return usual
        low, high = self.subject.damping_range
        return look.mixed(usual, look.DAMPING, (self.past.now(layout.DAMPING) - low) / (high - low))

    def _draw_carriage(self) -> None:
        canvas, middle = self.canvas, self.carriage
        left, right = middle - HALF_BODY, middle + HALF_BODY
        turned = self.view.angle(self.past.now(layout.X1), WHEEL)
        for x in (left + 40, right - 40):
            centre = (x, GROUND - WHEEL - 1)
            canvas.disc(centre, WHEEL, look.INK)
            canvas.disc(centre, WHEEL - 3, look.PALE)
            across, down = (WHEEL - 3) * cos(turned), (WHEEL - 3) * sin(turned)
            ends = [(centre[0] + k * across, centre[1] + k * down) for k in (-1, 1)]
            canvas.line(ends, look.INK, 2.0)
        canvas.box((left, TOP), (right, BOTTOM), look.INK, radius=4)
        canvas.box((left + 2, TOP + 2), (right - 2, BOTTOM - 2), look.BODY, radius=3)
        tip = GROUND - 3
        canvas.polygon([(middle - 6, BOTTOM), (middle + 6, BOTTOM), (middle, tip)], look.INK)
        self._draw_track()

    def _draw_track(self) -> None:
        """Draw what the sphere rolls on: a film, a rough surface, or nothing."""
        canvas, middle, top = self.canvas, self.carriage, TOP
        left, right = middle - POST + 14, middle + POST - 14
        if self.subject.interface == "viscous":
            colour = self._fluid(look.FILM, is_carriage=False)
            canvas.box((left, top - FILM), (right, top + 1), colour)
        elif self.subject.interface != "none":
            for k in range(int((right - left) / 8.0)):
                x = left + 8.0 * k
                canvas.polygon([(x, top + 1), (x + 4, top - FILM), (x + 8, top + 1)], look.INK)
        if not self.subject.has_sphere:
            return
        canvas.line([(middle, top + 2), (middle, top + 8)], look.GREY, 1.5)
        self._draw_stops(self.subject.rail_limit, 1.1 * TRAVEL, (middle, top), 18.0)

    def _draw_springs(self) -> None:
        """Draw the sphere's springs: the pitch of the coils is as large as their stretch."""
        canvas, middle, y = self.canvas, self.carriage, TOP - FILM - RADIUS
        low, high = self.subject.stretch_range
        stretch, sphere = max(self.past.now(layout.STRETCH), UNSTRETCHED), middle + self.offset
        for side in (-1.0, 1.0):
            post = middle + side * POST
            length = POST - side * self.offset
            mine = stretch * length / POST
            coils = POST / (PITCH * stretch)
            colour = look.spring_colour((mine - low) / (high - low))
            half = COIL / sqrt(max(mine, 0.5))  # the material keeps its volume
            self._draw_coils(sphere, post, y, coils=coils, half=half, colour=colour)
            canvas.line([(post, TOP), (post, POST_TOP)], look.INK, 6.0)
            canvas.disc((post, y), 6.0, look.INK)

    def _draw_sphere(self) -> None:
        canvas, radius = self.canvas, RADIUS
        film = 0.0 if self.subject.interface == "none" else FILM
        centre = self.carriage + self.offset, TOP - film - radius
        turned = self.view.angle(self.past.now(layout.X2) - self.past.now(layout.X1), radius)
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
            arrows.append((past.now(layout.FORCE) / largest, look.CONTROL))
        if subject.is_between:  # its reaction, on the sphere
            centre = self.carriage + self.offset, TOP - FILM - RADIUS
            canvas.arrow(centre, -ARROW * past.now(layout.FORCE) / largest, look.CONTROL)
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
            start = 640.0 + self.ground, GROUND - 12
            canvas.line([(start[0], start[1] - 9), (start[0], start[1] + 12)], look.GREY, 1.5)
            canvas.arrow(start, 70.0 * part, look.DISTURBANCE)
