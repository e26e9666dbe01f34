"""Colours and sizes of a picture, and round numbers of its scales."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from math import floor, inf, isfinite, log10
from typing import NamedTuple, TypeAlias

import numpy as np

Colour: TypeAlias = tuple[int, int, int]
Point: TypeAlias = tuple[float, float]

PIXELS = 0.8
"""Pixels to a unit, in which all other places and lengths are given; a video has few to spare."""

WIDTH, HEIGHT = 800, 480  # size of a picture in units

SIZE = int(PIXELS * WIDTH), int(PIXELS * HEIGHT)
"""Size of a picture [px]: multiples of 16, as video coders like them."""

BAR = 10, 80  # width and height of the scale of the springs' colours [px]

PAPER: Colour = (255, 255, 255)
INK: Colour = (34, 38, 46)
GREY: Colour = (98, 105, 117)
PALE: Colour = (222, 226, 231)
BODY: Colour = (232, 236, 240)

# Okabe and Ito's colours, as in the figures.
CONTROL: Colour = (0, 114, 178)
DISTURBANCE: Colour = (213, 94, 0)
OFFSET: Colour = (0, 136, 98)
STRETCH: Colour = (150, 60, 120)
DAMPING: Colour = (0, 100, 130)
LIMIT: Colour = (178, 24, 60)
FILM: Colour = (150, 205, 235)
HATCH: Colour = (190, 196, 204)
SHADE: Colour = (142, 151, 163)
SHINE: Colour = (250, 250, 250)

SMALL, TEXT, LARGE = 16, 18, 23  # sizes of the font, whose letters are two thirds of it high

PLASMA = np.array(
    [(13, 8, 135), (84, 2, 163), (139, 10, 165), (185, 50, 137), (219, 92, 104), (244, 136, 73)],
    np.float64,
)
"""Colours of the springs, from short to long: of even steps, also to colour-blind eyes."""

SHADES = 20  # steps of the scale: a video keeps a colour that does not change in no room


def spring_colour(fraction: float) -> Colour:
    """Return the colour of a spring: 0 for the shortest, 1 for the longest."""
    place = round(min(max(fraction, 0.0), 1.0) * SHADES) / SHADES * (len(PLASMA) - 1)
    k = min(int(place), len(PLASMA) - 2)
    red, green, blue = PLASMA[k] + (place - k) * (PLASMA[k + 1] - PLASMA[k])
    return int(red), int(green), int(blue)


def mixed(one: Colour, other: Colour, fraction: float) -> Colour:
    """Return a colour between two, at one of `SHADES` steps."""
    place = round(min(max(fraction, 0.0), 1.0) * SHADES) / SHADES
    red, green, blue = (int(a + place * (b - a)) for a, b in zip(one, other, strict=True))
    return red, green, blue


STEPS = (1.0, 2.0, 5.0, 10.0)  # round numbers within a decade
FINE_STEPS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # round numbers closer to each other

ROUND_OFF = 1e-9

MINUS, TIMES, DASH = "\N{MINUS SIGN}", "\N{MULTIPLICATION SIGN}", "\N{EN DASH}"

LEAST_PLAIN, MOST_PLAIN = -3, 4  # decades of numbers that are written without an exponent


class Unit(NamedTuple):
    """A unit of length: its size [m] and its name."""

    size: float
    name: str


UNITS = Unit(1.0, "m"), Unit(1e-3, "mm"), Unit(1e-6, "µm"), Unit(1e-9, "nm")


def _decade(value: float) -> float:
    return 10.0 ** floor(log10(value))


def round_up(value: float, steps: Sequence[float] = STEPS) -> float:
    """Return the least round number that is not below a positive value."""
    decade = _decade(value)
    return steps[bisect_left(steps, value / decade * (1.0 - ROUND_OFF))] * decade


def round_down(value: float, steps: Sequence[float] = STEPS) -> float:
    """Return the largest round number that is not above a positive value."""
    decade = _decade(value)
    return steps[bisect_right(steps, value / decade * (1.0 + ROUND_OFF)) - 1] * decade


def unit_of(length: float) -> Unit:
    """Return the unit in which a length [m] is between 1 and 1000, as far as there is one."""
    return next((unit for unit in UNITS if length >= unit.size), UNITS[-1])


def text_of(value: float) -> str:
    """Return a tick's number, with a minus sign of full width."""
    return f"{value:g}".replace("-", MINUS)


def reading(value: float, largest: float) -> str:
    """Return a measured number with three digits of the largest one, which keeps its width."""
    if not isfinite(value):
        return "?"
    magnitude = floor(log10(largest)) if 0.0 < largest < inf else 0
    if LEAST_PLAIN <= magnitude <= MOST_PLAIN:
        return f"{value:.{max(2 - magnitude, 0)}f}".replace("-", MINUS)
    return f"{value:.2e}".replace("-", MINUS)
