"""A whole picture: captions, the mechanism, and charts of the last control steps."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mm_gym.arrays import Array
from mm_gym.lanes import layout
from mm_gym.rendering import history as rows
from mm_gym.rendering import look
from mm_gym.rendering.canvas import Canvas
from mm_gym.rendering.history import Past
from mm_gym.rendering.look import DASH, FINE_STEPS, MINUS, TIMES, Colour, reading, round_up, text_of
from mm_gym.rendering.mechanism import Mechanism, View, can_be_seen, recent_impulse, view_of
from mm_gym.rendering.subject import UNSTRETCHED, Subject
from mm_gym.step.channels import CHANNELS

LEFT, RIGHT = 55.0, 785.0
TOP, BOTTOM = 290.0, 455.0
WIDEST = 24  # largest width of a control step [px]
GAP = 26.0  # room above a strip for its legend
PERIODS = 20.0  # natural periods that the charts show, about


@dataclass(frozen=True)
class Series:
    """A line of a strip."""

    values: Array  # (n,) float64, one for each control step
    name: str  # with its unit
    colour: Colour
    is_held: bool = False  # whether a value was held over the control step that it ends
    limit: float | None = None  # magnitude at which an episode ends, or None


@dataclass(frozen=True)
class Strip:
    """Lines that share an axis."""

    low: float  # end of the axis
    high: float  # the other
    ticks: tuple[float, ...]  # values that are labelled
    series: tuple[Series, ...]  # the lines, the most important last


def width_of_step(subject: Subject) -> float:
    """Return the width of a control step: a whole number of pixels."""
    wanted, width = PERIODS * subject.period / subject.time_step, (RIGHT - LEFT) * look.PIXELS
    # A whole episode, if it fits, else about so many periods.
    pixels = int(width / subject.steps) if subject.steps <= wanted else round(width / wanted)
    return min(max(pixels, 1), WIDEST) / look.PIXELS


def columns(subject: Subject) -> int:
    """Return the number of control steps that the charts show."""
    return int((RIGHT - LEFT) / width_of_step(subject) + 1e-9) + 1


def strips_of(subject: Subject, past: Past, view: View) -> list[Strip]:
    """Return the strips of a scene."""
    strips = [_displacements(subject, past, view)]
    if subject.force_limit is not None:
        strips.append(_forces(subject, past))
    if subject.is_stretched:
        low, high = subject.stretch_range
        name = "stretch λ of the sphere's springs [-]"
        line = Series(past.rows[layout.STRETCH], name, look.STRETCH, is_held=True)
        strips.append(Strip(low, high, (low, high), (line,)))
    if subject.damped_row:
        low, high = subject.damping_range
        part = "carriage" if subject.damped_row == layout.D else "interface"
        name = f"{subject.device} of the {part} [{CHANNELS[subject.device].unit}]"
        line = Series(past.rows[layout.DAMPING], name, look.DAMPING, is_held=True)
        strips.append(Strip(low, high, (low, high), (line,)))
    return strips


def _displacements(subject: Subject, past: Past, view: View) -> Strip:
    size, unit = view.unit
    limits = [
        None if limit is None else limit / size
        for limit in (subject.displacement_limit, subject.rail_limit)
    ]
    x1 = past.rows[layout.X1] / size
    lines = [Series(x1, f"carriage x1 [{unit}]", look.INK, limit=limits[0])]
    largest = max(subject.displacement, past.displacement)
    if subject.has_sphere:
        offset = past.rows[layout.X2] / size - x1
        name = f"relative displacement x2 {MINUS} x1 [{unit}]"
        lines.insert(0, Series(offset, name, look.OFFSET, limit=limits[1]))
        largest = max(largest, subject.offset, past.offset)
    high = round_up(largest / size, FINE_STEPS)
    return Strip(-high, high, (-high, 0.0, high), tuple(lines))


def _forces(subject: Subject, past: Past) -> Strip:
    lines = [Series(past.rows[layout.FORCE], "control force [N]", look.CONTROL, is_held=True)]
    largest = subject.force_limit or 0.0
    if subject.disturbance:
        lines.insert(0, Series(past.rows[rows.PUSH], "disturbance [N]", look.DISTURBANCE))
        largest = max(largest, subject.disturbance, past.disturbance)
    return Strip(-largest, largest, (-largest, 0.0, largest), tuple(lines))


class Chart:
    """Draws the strips below each other over one axis of time."""

    def __init__(self, canvas: Canvas, subject: Subject, past: Past) -> None:
        self._canvas = canvas
        self._subject = subject
        self._steps = past.rows[rows.STEP]
        self._pitch = width_of_step(subject)
        # The chart fills from the left, then moves by whole pixels.
        self._first = max(0.0, self._steps[-1] - (columns(subject) - 1))
        self._shown = self._steps >= self._first
        self._x = LEFT + self._pitch * (self._steps - self._first)[self._shown]

    def draw(self, strips: list[Strip]) -> None:
        """Draw the strips and the axis of time."""
        height = (BOTTOM - TOP - GAP * (len(strips) - 1)) / len(strips)
        for k, strip in enumerate(strips):
            top = TOP + k * (height + GAP)
            self._draw_strip(strip, top, top + height)
        self._draw_times()

    def _draw_strip(self, strip: Strip, top: float, bottom: float) -> None:
        canvas, scale = self._canvas, (bottom - top) / (strip.high - strip.low)
        for tick in strip.ticks:
            y = bottom - (tick - strip.low) * scale
            canvas.rule(LEFT, y - 0.5, RIGHT, y + 0.5, look.PALE)
            canvas.text(text_of(tick), (LEFT - 8, y), look.SMALL, look.GREY, 1.0)
        x = LEFT
        for series in reversed(strip.series):
            canvas.rule(x, top - 14, x + 16, top - 11, series.colour)
            x += 46 + canvas.text(series.name, (x + 22, top - 12), look.SMALL, series.colour)
        for series in strip.series:
            if series.limit is not None and series.limit <= strip.high:
                for limit in (-series.limit, series.limit):
                    self._draw_dashes(bottom - (limit - strip.low) * scale, series.colour)
            values = np.clip(series.values[self._shown], strip.low, strip.high)
            points = np.stack([self._x, bottom - (values - strip.low) * scale], axis=1)
            canvas.curve(_steps(points) if series.is_held else points, series.colour)
            canvas.dot((points[-1, 0], points[-1, 1]), 3.5, series.colour)

    def _draw_dashes(self, y: float, colour: Colour) -> None:
        for x in range(round(LEFT), round(RIGHT), 12):
            self._canvas.rule(x, y - 0.5, x + 6, y + 0.5, colour)

    def _draw_times(self) -> None:
        canvas, step = self._canvas, self._subject.time_step
        each = round_up(90.0 / self._pitch * step)
        first, last = self._first * step, (self._first + columns(self._subject) - 1) * step
        for k in range(ceil(first / each - 1e-9), floor(last / each + 1e-9) + 1):
            x = LEFT + self._pitch * (k * each / step - self._first)
            canvas.rule(x - 0.5, BOTTOM, x + 0.5, BOTTOM + 5, look.GREY)
            label = f"{text_of(float(f'{k * each:.6g}'))} s"
            anchor = min(max(0.5, 0.5 + (x + 20 - RIGHT) / 40), 1.0)
            canvas.text(label, (x, BOTTOM + 13), look.SMALL, look.GREY, anchor)


def _steps(points: Array) -> Array:
    """Return points (2 n - 1, 2) of a line that runs level, then jumps to the next level."""
    stepped = np.repeat(points, 2, axis=0)[1:]
    stepped[1::2, 0], stepped[1::2, 1] = points[1:, 0], points[1:, 1]
    stepped[0::2, 1] = np.append(points[1:, 1], points[-1, 1])
    return stepped


READINGS, COLUMN = 180.0, 200.0
"""Left end of the readings, and the room of each: that of the longest, a jump of the ground."""


class Picture:
    """Draws pictures of one scene."""

    def __init__(self, subject: Subject) -> None:
        self._subject = subject
        self._canvas = Canvas()

    def draw(self, past: Past) -> Any:  # noqa: ANN401 - as of Canvas.finish
        """Draw the newest moment; return a surface, which the next picture overwrites."""
        subject, canvas, view = self._subject, self._canvas, view_of(self._subject, past)
        canvas.clear()
        Mechanism(canvas, subject, past, view).draw()
        canvas.finish_band()
        Chart(canvas, subject, past).draw(strips_of(subject, past, view))
        self._draw_colours(past, view)
        self._draw_captions(past, view)
        self._draw_readings(past)
        return canvas.finish()

    def pixels(self, past: Past) -> NDArray[np.uint8]:
        """Draw the newest moment; return (height, width, 3)."""
        self.draw(past)
        return self._canvas.pixels()

    def _draw_captions(self, past: Past, view: View) -> None:
        canvas, subject = self._canvas, self._subject
        time = past.now(rows.STEP) * subject.time_step
        decimals = min(len(f"{subject.time_step:.6f}".rstrip("0").partition(".")[2]), 6)
        canvas.text(f"t = {time:.{decimals}f} s", (16, 22), look.LARGE)
        magnified = f"displacements {TIMES} {text_of(view.magnification)} at 96 dpi"
        notes = [subject.speed, magnified]
        if subject.acceleration:
            notes.append(f"camera follows the ground below {subject.camera_frequency:.2g} Hz")
        for k, note in enumerate(notes):
            canvas.text(note, (look.WIDTH - 16, 20 + 16 * k), look.SMALL, look.GREY, 1.0)

    def _draw_readings(self, past: Past) -> None:
        """Write the numbers of what the arrows show, in their colours."""
        subject, canvas = self._subject, self._canvas
        entries: list[tuple[str, look.Colour]] = []
        if subject.force_limit is not None:
            force = reading(past.now(layout.FORCE), subject.force_limit)
            entries.append((f"control {force} N", look.CONTROL))
        if subject.disturbance:
            push = reading(past.now(rows.PUSH), subject.disturbance)
            entries.append((f"disturbance {push} N", look.DISTURBANCE))
        if subject.acceleration:
            shake = reading(past.now(rows.SHAKE), subject.acceleration)
            entries.append((f"ground {shake} m/s²", look.DISTURBANCE))
        if can_be_seen(subject):
            impulse = recent_impulse(subject, past)
            entries.append((_impulse_text(subject, impulse), look.DISTURBANCE))
        if subject.has_springs and past.now(layout.STRETCH) >= UNSTRETCHED:
            entries.append((f"stretch λ = {past.now(layout.STRETCH):.2f}", look.STRETCH))
        if subject.damped_row:
            held = reading(past.now(layout.DAMPING), subject.damping_range[1])
            unit = CHANNELS[subject.device].unit
            entries.append((f"{subject.device} {held} {unit}", look.DAMPING))
        if subject.interface == "dry_friction":
            slip = abs(past.now(layout.V2) - past.now(layout.V1))
            slips = slip > (past.lane[layout.VR] or subject.idle_velocity)
            entries.append(("the sphere slips" if slips else "the sphere sticks", look.OFFSET))
        for k, (entry, colour) in enumerate(entries):
            place = READINGS + COLUMN * (k % 2), 22.0 + 24.0 * (k // 2)
            canvas.text(entry, place, look.TEXT, colour)

    def _draw_colours(self, past: Past, view: View) -> None:
        """Draw the scale of the springs' colours, with what they mean for each spring."""
        canvas, subject = self._canvas, self._subject
        left, top, height = 700.0, 88.0, look.BAR[1] / look.PIXELS
        canvas.colour_bar(left, top)
        largest = max(subject.displacement, past.displacement) / view.unit.size
        for part in (0.0, 0.5, 1.0):
            y = top + height * (1.0 - part)
            value = reading((2.0 * part - 1.0) * largest, largest)
            canvas.text(value, (left - 6, y), look.SMALL, look.GREY, 1.0)
        canvas.text(f"x1 [{view.unit.name}]", (left - 6, top - 18), look.SMALL, look.GREY, 1.0)
        canvas.text("colour of springs", (left + 6, top + height + 16), look.SMALL, look.GREY, 0.5)
        if subject.has_springs:
            low, high = subject.stretch_range
            for part in (0.0, 0.5, 1.0):
                y = top + height * (1.0 - part)
                value = text_of(float(f"{low + part * (high - low):.3g}"))
                canvas.text(value, (left + 18, y), look.SMALL, look.GREY)
            canvas.text("λ [-]", (left + 18, top - 18), look.SMALL, look.GREY)


def _impulse_text(subject: Subject, impulse: float) -> str:
    unit, largest = ("N s", subject.impulse) if subject.impulse else ("m/s", subject.ground_impulse)
    value = DASH if impulse == 0.0 else f"{reading(impulse, largest)} {unit}"
    return f"impulse {value}" if subject.impulse else f"jump of the ground {value}"
