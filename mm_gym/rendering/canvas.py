"""The sheet of a picture; a band of it is drawn in twice its resolution, for smooth edges."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from math import copysign, cos, hypot, pi, sin
from os import environ
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mm_gym.arrays import Array
from mm_gym.extras import optional
from mm_gym.rendering.look import BAR, INK, PAPER, PIXELS, SIZE, Colour, Point, spring_colour

FINE = 2  # pixels of the fine band to one of the picture, each way

BAND = 85.0, 255.0
"""Top and bottom of the fine band, at whole pixels: the mechanism, without captions and charts."""

BAND_SIZE = SIZE[0], int(PIXELS * (BAND[1] - BAND[0]))

RGB = 0xFF, 0xFF00, 0xFF0000, 0  # masks of red, green and blue: the order of their bytes in memory
TEXTS_KEPT = 512  # texts that are kept to be drawn again, at most

TEXT_SCALE = 3
"""Texts are written so much larger and then made smaller: their letters keep their distances."""


def load_pygame() -> Any:  # noqa: ANN401 - a module
    """Return pygame, or raise `DependencyNotInstalled`."""
    environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # it prints a line when it is imported
    return optional("pygame", "rendering needs pygame-ce; install the extra `render`")


class Canvas:
    """The sheet of a picture; all places and widths are in the units of `mm_gym.rendering.look`.

    Texts lie above everything else. Polygons, boxes, discs and lines are drawn in the fine band, or
    what of them lies in it; rules, dots and curves anywhere.
    """

    def __init__(self) -> None:
        self._pygame = load_pygame()
        # pygame, whose place pygame-ce takes, has no antialiased circles.
        self._circle = getattr(self._pygame.draw, "aacircle", self._pygame.draw.circle)
        # Surfaces with a depth of their own need no display. The picture's memory has the bytes
        # that `pixels` returns; resizing needs 32 bits.
        self._picture = self._pygame.Surface(SIZE, 0, 24, RGB)
        self._band = self._pygame.Surface(BAND_SIZE, 0, 32)
        self._fine = self._pygame.Surface((FINE * BAND_SIZE[0], FINE * BAND_SIZE[1]), 0, 32)
        self._fonts: dict[int, Any] = {}
        self._rendered = lru_cache(TEXTS_KEPT)(self._render)
        self._bar = self._pygame.Surface(BAR, 0, 24)
        for y in range(BAR[1]):
            self._bar.fill(spring_colour(1.0 - (y + 0.5) / BAR[1]), (0, y, BAR[0], 1))
        self._texts: list[tuple[Any, tuple[int, int]]] = []

    def clear(self) -> None:
        """Begin a picture."""
        self._picture.fill(PAPER)
        self._fine.fill(PAPER)
        self._texts.clear()

    def finish_band(self) -> None:
        """Put the fine band into the picture; what is drawn later lies above it."""
        self._pygame.transform.smoothscale(self._fine, BAND_SIZE, self._band)
        self._picture.blit(self._band, (0, PIXELS * BAND[0]))

    def finish(self) -> Any:  # noqa: ANN401 - pygame's types are known with pygame only
        """Return the picture as a surface, which the next one overwrites."""
        self._picture.blits(self._texts, doreturn=False)
        return self._picture

    def pixels(self) -> NDArray[np.uint8]:
        """Return the finished picture as an array (height, width, 3) of its own."""
        data = np.frombuffer(self._picture.get_buffer(), np.uint8)
        return data.reshape(SIZE[1], SIZE[0], 3).copy()

    def rule(self, left: float, top: float, right: float, bottom: float, colour: Colour) -> None:
        """Fill a rectangle whose edges are rounded to pixels; it is at least one wide and high."""
        x, y = round(PIXELS * left), round(PIXELS * top)
        size = max(1, round(PIXELS * right) - x), max(1, round(PIXELS * bottom) - y)
        self._picture.fill(colour, (x, y, *size))

    def colour_bar(self, left: float, top: float) -> None:
        """Put the scale of the springs' colours, of size `BAR`, the longest above."""
        self._picture.blit(self._bar, (round(PIXELS * left), round(PIXELS * top)))

    def dot(self, centre: Point, radius: float, colour: Colour) -> None:
        """Fill a small circle."""
        middle = PIXELS * centre[0], PIXELS * centre[1]
        self._circle(self._picture, colour, middle, PIXELS * radius)

    def curve(self, points: Array, colour: Colour) -> None:
        """Draw a curve through many points (n, 2)."""
        if len(points) > 1:
            for shift in (0.0, 0.6):  # antialiased curves are one pixel wide
                shifted = (PIXELS * points + (0.0, shift)).tolist()
                self._pygame.draw.aalines(self._picture, colour, False, shifted)

    def polygon(self, points: Sequence[Point], colour: Colour) -> None:
        """Fill a polygon."""
        self._pygame.draw.polygon(self._fine, colour, [_fine(*point) for point in points])

    def box(self, corner: Point, other: Point, colour: Colour, *, radius: int = 0) -> None:
        """Fill a rectangle from its upper left corner to the other, with round ones of a radius."""
        (x, y), (end, foot) = _fine(*corner), _fine(*other)
        frame = round(x), round(y), round(end) - round(x), round(foot) - round(y)
        corners = round(FINE * PIXELS * radius)
        self._pygame.draw.rect(self._fine, colour, frame, border_radius=corners)

    def disc(self, centre: Point, radius: float, colour: Colour) -> None:
        """Fill a circle."""
        self._circle(self._fine, colour, _fine(*centre), FINE * PIXELS * radius)

    def line(self, points: Sequence[Point], colour: Colour, width: float) -> None:
        """Draw straight lines from point to point, with round ends and joints."""
        for (x0, y0), (x1, y1) in pairwise(points):
            if length := hypot(x1 - x0, y1 - y0):
                dx, dy = 0.5 * width * (y0 - y1) / length, 0.5 * width * (x1 - x0) / length
                one_side = [(x0 + dx, y0 + dy), (x1 + dx, y1 + dy)]
                other_side = [(x1 - dx, y1 - dy), (x0 - dx, y0 - dy)]
                self.polygon([*one_side, *other_side], colour)
        if width > 2.0:  # noqa: PLR2004 - below it, ends are not seen
            for point in points:
                self.disc(point, 0.5 * width, colour)

    def sector(self, centre: Point, radius: float, begin: float, colour: Colour) -> None:
        """Fill a quarter of a circle, from an angle [rad] on, clockwise."""
        turns = [begin + 0.5 * pi * k / 16 for k in range(17)]
        arc = [(centre[0] + radius * cos(a), centre[1] + radius * sin(a)) for a in turns]
        self.polygon([centre, *arc], colour)

    def arrow(self, start: Point, length: float, colour: Colour, width: float = 7.0) -> None:
        """Draw an arrow to the right, or to the left if its length is negative.

        The shorter it is, the smaller is its head; without a length there is none.
        """
        if length == 0.0:
            return
        x, y = start
        head = min(2.2 * width, abs(length))
        wing, neck = head / 1.9, x + length - copysign(head, length)
        half = min(0.5 * width, wing)
        upper = [(x, y - half), (neck, y - half), (neck, y - wing)]
        lower = [(neck, y + wing), (neck, y + half), (x, y + half)]
        self.polygon([*upper, (x + length, y), *lower], colour)

    def text(
        self, text: str, place: Point, size: int, colour: Colour = INK, anchor: float = 0.0
    ) -> float:
        """Write a line of text; return its width.

        The place is its left end (anchor 0), middle (0.5) or right end (1), at half its height.
        """
        drawn = self._rendered(text, size, colour)
        width, height = drawn.get_size()
        left, top = PIXELS * place[0] - anchor * width, PIXELS * place[1] - 0.5 * height
        self._texts.append((drawn, (round(left), round(top))))
        return width / PIXELS

    def _render(self, text: str, size: int, colour: Colour) -> Any:  # noqa: ANN401 - as in finish
        """Write with the font that pygame brings along; others may call `pygame.quit`."""
        font = self._pygame.font
        if not font.get_init():
            font.init()
            self._fonts.clear()
        try:
            large = self._font(size).render(text, True, colour)
        except self._pygame.error:  # the font is one from before `pygame.quit`
            self._fonts.clear()
            large = self._font(size).render(text, True, colour)
        width, height = large.get_size()
        scale = PIXELS / TEXT_SCALE
        smaller = max(1, round(scale * width)), max(1, round(scale * height))
        return self._pygame.transform.smoothscale(large, smaller)

    def _font(self, size: int) -> Any:  # noqa: ANN401 - as in finish
        if size not in self._fonts:
            self._fonts[size] = self._pygame.font.Font(None, TEXT_SCALE * size)
        return self._fonts[size]


def _fine(x: float, y: float) -> Point:
    """Return where a place of the picture is in the fine band."""
    return FINE * PIXELS * x, FINE * PIXELS * (y - BAND[0])
