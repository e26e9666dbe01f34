"""Table of the paper's numbers, stated and computed.

The stated values come from ball arithmetic and from a Taylor series of 60 digits, both independent
of this package.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mm_gym.analysis import asymptotic_offset, critical_reference_velocity, modes
from mm_gym.analysis.values import linear_values
from mm_gym.files import write_text
from mm_gym.paper.scenes import STATIC, scene

if TYPE_CHECKING:
    from os import PathLike

HEADER = ("system", "quantity", "unit", "stated", "computed", "difference")

OFFSETS = {
    "fig2a": 0.02,
    "fig2b": 0.02,
    "fig2c": 0.02,
    "fig2d": 0.02,
    "fig2e": 0.03,
    "fig2f": 0.03,
    "fig5a": -0.004,
    "fig5b": 0.0,
    "fig6a": 0.03,
    "fig6d": 0.02,
    "fig8": 0.02118596934948316902900216,
    "fig9": 0.02,
    "fig12a": 0.0,
    "fig12d": 0.0,
}
"""Asymptotic offset [m]."""

FIGURE_10 = (
    (0.45, 0.0, 0.5, 0.02234337125201375656446111),
    (0.2, 0.0, 0.5, 0.02192014965621152942287607),
    (0.4, 0.1, 0.5, 0.02120564588670682972359145),
    (0.2, 0.1, 0.5, 0.02117073990786067495299682),
    (0.05, 0.1, 0.5, 0.01996046545426309304670892),
    (0.001, 0.1, 0.5, 0.02075423942209533346671364),
    (0.463, 0.1, 0.5, 0.02104317184609508494031381),
    (0.2, 1.0, 0.5, 0.01923361088790639360107075),
    (0.3, 0.1, 0.8, 0.01989326244175091887215473),
    (0.3, 0.1, 1.0, 0.01990344544880140595584292),
)
"""v_r [m/s], chi [N s/m], mu2 / mu1, asymptotic offset [m]."""

EIGENVALUES = {
    "fig2a": -24.86619629693306649987986 + 95.5041339377560936966882j,
    "fig2c": -12.36977492166819750595748 + 97.94462593895297816589438j,
    "fig5b": -0.2714966452340620939380879 + 4.560384170223883387619265j,
    "fig12a": -1.743101073615168666474717 + 46.36201421087134619710211j,
    "fig12d": -4.083729456360725425608914 + 46.34029414718465642982086j,
}
"""Eigenvalue of the slowest oscillating mode [1/s]."""


class Row(NamedTuple):
    """One quantity of a system: the stated and the computed value."""

    system: str
    quantity: str
    unit: str
    stated: float
    computed: float


def rows() -> list[Row]:
    """Return a row for every number."""
    found = [
        Row(name, "asymptotic offset", "m", value, asymptotic_offset(scene(name)))
        for name, value in OFFSETS.items()
    ]
    figure_10 = scene("fig10")
    for velocity, chi, ratio, value in FIGURE_10:
        point = figure_10.replace(
            **{
                "interface.reference_velocity": velocity,
                "interface.slip_damping": chi,
                "interface.kinetic_coefficient": STATIC * ratio,
            }
        )
        title = f"asymptotic offset at v_r = {velocity:g} m/s; chi = {chi:g}; mu2/mu1 = {ratio:g}"
        found.append(Row("fig10", title, "m", value, asymptotic_offset(point)))
    critical = critical_reference_velocity(figure_10)
    found.append(Row("fig10", "critical reference velocity", "m/s", 0.46352342782555818, critical))
    for name, value in EIGENVALUES.items():
        eigenvalues = modes(scene(name)).eigenvalues
        oscillating = eigenvalues[eigenvalues.imag > 0.0]
        slowest = complex(oscillating[np.argmin(np.abs(oscillating))])
        found.append(Row(name, "eigenvalue, real part", "1/s", value.real, slowest.real))
        found.append(Row(name, "eigenvalue, imaginary part", "1/s", value.imag, slowest.imag))
    stiffness = linear_values(scene("fig12a")).k2
    found.append(
        Row("fig12a", "k2 at stretch 1.5", "N/m", 159.25925925925925925925925926, stiffness)
    )
    return found


def write_table(path: str | PathLike[str], found: list[Row]) -> None:
    """Write the rows as CSV with all digits."""
    lines = [",".join(HEADER)]
    for row in found:
        numbers = (row.stated, row.computed, row.computed - row.stated)
        lines.append(",".join((row.system, row.quantity, row.unit, *map(repr, numbers))))
    write_text(path, "\n".join(lines) + "\n")


def printed(found: list[Row]) -> str:
    """Return the rows as aligned text."""
    cells = [HEADER] + [
        (
            row.system,
            row.quantity,
            row.unit,
            f"{row.stated:.12g}",
            f"{row.computed:.12g}",
            f"{row.computed - row.stated:.1e}",
        )
        for row in found
    ]
    widths = [max(len(line[k]) for line in cells) for k in range(len(HEADER))]
    return "\n".join(
        "  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip()
        for line in cells
    )
