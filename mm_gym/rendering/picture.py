"""A whole picture: captions, the mechanism, the scale of the springs' colours, the charts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mm_gym.lanes import layout as at
from mm_gym.rendering import history as rows
from mm_gym.rendering import look
from mm_gym.rendering.canvas import Canvas
from mm_gym.rendering.chart import Chart, strips_of
from mm_gym.rendering.impulses import can_be_seen, recent_impulse
from mm_gym.rendering.mechanism import Mechanism
from mm_gym.rendering.numbers import DASH, TIMES, reading, text_of
from mm_gym.rendering.subject import UNSTRETCHED
from mm_gym.rendering.view import view_of
from mm_gym.step.channels import CHANNELS

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mm_gym.rendering.history import Past
    from mm_gym.rendering.subject import Subject
    from mm_gym.rendering.view import View

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
        frame = ""
        if subject.acceleration:
            frame = f"camera follows the ground below {subject.camera_frequency:.2g} Hz"
        notes = [
            subject.speed,
            f"displacements {TIMES} {text_of(view.magnification)} at 96 dpi",
            frame,
        ]
        for k, note in enumerate(filter(None, notes)):
            canvas.text(note, (look.WIDTH - 16, 20 + 16 * k), look.SMALL, look.GREY, 1.0)

    def _draw_readings(self, past: Past) -> None:
        """Write the numbers of what the arrows show, in their colours."""
        subject, canvas = self._subject, self._canvas
        entries: list[tuple[str, look.Colour]] = []
        if subject.force_limit is not None:
            force = reading(past.now(at.FORCE), subject.force_limit)
            entries.append((f"control {force} N", look.CONTROL))
        if subject.disturbance:
            push = reading(past.now(rows.PUSH), subject.disturbance)
            entries.append((f"disturbance {push} N", look.DISTURBANCE))
        if subject.acceleration:
            shake = reading(past.now(rows.SHAKE), subject.acceleration)
            entries.append((f"ground {shake} m/s²", look.DISTURBANCE))
        if can_be_seen(subject):
            entries.append(
                (_impulse_text(subject, recent_impulse(subject, past)), look.DISTURBANCE)
            )
        if subject.has_springs and past.now(at.STRETCH) >= UNSTRETCHED:
            entries.append((f"stretch λ = {past.now(at.STRETCH):.2f}", look.STRETCH))
        if subject.damped_row:
            held = reading(past.now(at.DAMPING), subject.damping_range[1])
            entries.append(
                (f"{subject.device} {held} {CHANNELS[subject.device].unit}", look.DAMPING)
            )
        if subject.interface == "dry_friction":
            slip = abs(past.now(at.V2) - past.now(at.V1))
            slips = slip > past.lane[at.VR]
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
