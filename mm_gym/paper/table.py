"""Numbers of the paper's systems: as the paper states them, as a reference has them, as computed.

Where the paper states nothing its column is empty. A reference is independent of this package; its
provenance says what it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from os import PathLike
from typing import NamedTuple

import numpy as np

from mm_gym.analysis import asymptotic_offset, critical_reference_velocity, modes
from mm_gym.analysis.linear import linear_values
from mm_gym.files import aligned, write_csv
from mm_gym.paper.scenes import CAPTION, friction_of, scene, stick_slope

HEADER = (
    *("system", "quantity", "unit", "stated"),
    *("reference", "provenance", "computed", "computed - reference"),
)

INTEGRAL, EQUILIBRIUM = "first integral", "equilibrium"
BALLS = "ball arithmetic"
ARITHMETIC = "arithmetic"

OFFSETS = {
    **dict.fromkeys(("fig2a", "fig2b", "fig2c", "fig2d"), 0.02),
    **dict.fromkeys(("fig2e", "fig2f"), 0.03),
    "fig5a": -0.004,
    "fig5b": 0.0,
    "fig6a": 0.03,
    "fig6d": 0.02,
    "fig9": 0.02,
    "fig12a": 0.0,
    "fig12d": 0.0,
    **{name: 0.03 if name[4] in "ef" else 0.02 for name in CAPTION},
}
"""Asymptotic offset [m]."""

DERIVED = ("fig5a",)
"""Systems whose offset the paper does not state: of 5A it has x1(0) and the distance, not x2."""

FRICTION = (
    ("fig8", 0.2, 0.1, 0.5, 0.02118596934948316902900216),
    ("fig10", 0.45, 0.0, 0.5, 0.02234337125201375656446111),
    ("fig10", 0.2, 0.0, 0.5, 0.02192014965621152942287607),
    ("fig10", 0.4, 0.1, 0.5, 0.02120564588670682972359145),
    ("fig10", 0.2, 0.1, 0.5, 0.02117073990786067495299682),
    ("fig10", 0.05, 0.1, 0.5, 0.01996046545426309304670892),
    ("fig10", 0.001, 0.1, 0.5, 0.02075423942209533346671364),
    ("fig10", 0.463, 0.1, 0.5, 0.02104317184609508494031381),
    ("fig10", 0.2, 1.0, 0.5, 0.01923361088790639360107075),
    ("fig10", 0.3, 0.1, 0.8, 0.01989326244175091887215473),
    ("fig10", 0.3, 0.1, 1.0, 0.01990344544880140595584292),
)
"""System, v_r [m/s], chi [N s/m], mu2 / mu1, asymptotic offset [m] by ball arithmetic."""

CRITICAL_STATED, CRITICAL = 0.4635, 0.46352342782555818
"""Critical reference velocity [m/s], stated and by ball arithmetic."""

EIGENVALUES = {
    "fig2a": -24.86619629693306649987986 + 95.5041339377560936966882j,
    "fig2c": -12.36977492166819750595748 + 97.94462593895297816589438j,
    "fig5b": -0.2714966452340620939380879 + 4.560384170223883387619265j,
    "fig12a": -1.743101073615168666474717 + 46.36201421087134619710211j,
    "fig12d": -4.083729456360725425608914 + 46.34029414718465642982086j,
}
"""The slowest oscillating mode's [1/s] by ball arithmetic."""


STIFFNESS = 159.25925925925925925925925926  # k2 [N/m] of figure 12 A, by arithmetic


class Row(NamedTuple):
    """One quantity of a system: the stated and the computed value."""

    system: str
    quantity: str
    unit: str
    stated: float | None
    reference: float
    provenance: str
    computed: float


def rows() -> list[Row]:
    """Return every number."""
    slope = stick_slope(friction_of(scene("fig9")))
    k2 = linear_values(scene("fig12a")).k2
    return [
        *_offsets(),
        *_friction_rows(),
        Row("fig9", "mu1 F_N / v_r", "N s/m", 1.0, 1.0000314, ARITHMETIC, slope),
        *_eigenvalues(),
        Row("fig12a", "k2 at stretch 1.5", "N/m", None, STIFFNESS, ARITHMETIC, k2),
    ]


def _offsets() -> Iterator[Row]:
    for name, value in OFFSETS.items():
        provenance = INTEGRAL if scene(name).springs.kind == "none" else EQUILIBRIUM
        offset = asymptotic_offset(scene(name))
        stated = None if name in DERIVED else value
        yield Row(name, "asymptotic offset", "m", stated, value, provenance, offset)


def _friction_rows() -> Iterator[Row]:
    for name, velocity, chi, ratio, value in FRICTION:
        static = friction_of(scene(name)).static_coefficient
        own = {"reference_velocity": velocity, "slip_damping": chi}
        own["kinetic_coefficient"] = static * ratio
        point = scene(name).replace(**{f"interface.{field}": own[field] for field in own})
        title = f"asymptotic offset at v_r = {velocity:g} m/s; chi = {chi:g}; mu2/mu1 = {ratio:g}"
        yield Row(name, title, "m", None, value, BALLS, asymptotic_offset(point))
    system = scene("fig10")
    critical = critical_reference_velocity(system)
    there = asymptotic_offset(system.replace(**{"interface.reference_velocity": critical}))
    title = "critical reference velocity (rounded up)"
    yield Row("fig10", title, "m/s", CRITICAL_STATED, CRITICAL, BALLS, critical)
    yield Row("fig10", "asymptotic offset there", "m", 0.02, 0.02, INTEGRAL, there)


def _eigenvalues() -> Iterator[Row]:
    for name, value in EIGENVALUES.items():
        eigenvalues = modes(scene(name)).eigenvalues
        oscillating = eigenvalues[eigenvalues.imag > 0.0]
        slowest = complex(oscillating[np.argmin(np.abs(oscillating))])
        pairs = (value.real, slowest.real), (value.imag, slowest.imag)
        for part, (wanted, got) in zip(("real", "imaginary"), pairs, strict=True):
            yield Row(name, f"{part} part of the eigenvalue", "1/s", None, wanted, BALLS, got)


def write_table(path: str | PathLike[str], found: list[Row]) -> None:
    """Write the rows as CSV, all digits kept."""
    columns = [*zip(*found, strict=True), [row.computed - row.reference for row in found]]
    write_csv(path, HEADER, columns)


def printed(found: list[Row]) -> str:
    """Return the rows as aligned text."""
    return "\n".join(aligned([HEADER, *map(_cells, found)], names=len(HEADER)))


def _cells(row: Row) -> tuple[str, ...]:
    names = row.system, row.quantity, row.unit
    stated = "" if row.stated is None else f"{row.stated:.12g}"
    reference, error = f"{row.reference:.12g}", f"{row.computed - row.reference:.1e}"
    return *names, stated, reference, row.provenance, f"{row.computed:.12g}", error
