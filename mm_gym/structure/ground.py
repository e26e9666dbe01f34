"""How the ground moves a mode and its device, as entries of a scene's excitation.

Equations are those of `docs/structures.md`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, cast

import numpy as np

from mm_gym.errors import StructureError, refuse, suggest
from mm_gym.scene.part import Part

Entry = Mapping[str, object] | Part

SIZES = {
    "harmonic": "amplitude",
    "sweep": "amplitude",
    "noise": "rms",
    "kanai_tajimi": "rms",
    "clough_penzien": "rms",
    "impulse": "size",
    "record": "scale",
}
"""Kind of excitation -> the field that its strength is proportional to."""

REPEATED = ("harmonic", "sweep", "record")
"""Kinds that are the same function of time in two entries of one scene; so is an impulse of one
size at a given time."""

MAPPINGS = ("exact", "balanced")

SAME = 1e-12  # relative difference of the ground's effect on both masses that is round-off


class Shaking(NamedTuple):
    """The ground's acceleration moves the carriage as Gamma a, and the device as r_j a."""

    participation: float  # Gamma [-]
    ground: float  # r_j [-]
    mass: float  # m1 [kg]

    def entries(
        self, ground: Entry | Sequence[Entry], mass: float, mapping: str
    ) -> list[list[dict[str, object]]]:
        """Return the one or two entries that stand for each motion of the ground."""
        if mapping not in MAPPINGS:
            nearest = suggest(str(mapping), MAPPINGS)
            refuse("mapping", f"{mapping!r}{nearest}", "'exact' or 'balanced'", StructureError)
        check_mass(mass)
        entries = [ground] if isinstance(ground, Part | Mapping) else ground
        return [
            self._entries(f"ground.{place}", _stated(entry), mass, mapping)
            for place, entry in enumerate(entries)
        ]

    def _entries(
        self, name: str, entry: dict[str, object], mass: float, mapping: str
    ) -> list[dict[str, object]]:
        kind = entry.get("kind")
        if not isinstance(kind, str) or kind not in SIZES:
            nearest = suggest(kind, SIZES) if isinstance(kind, str) else ""
            refuse(f"{name}.kind", f"{kind!r}{nearest}", ", ".join(SIZES), StructureError)
        if entry.setdefault("target", "ground") != "ground":
            refuse(f"{name}.target", f"{entry['target']!r}", "'ground'", StructureError)
        gamma, own = self.participation, self.ground
        if abs(gamma - own) <= SAME * abs(gamma):  # one storey: the ground moves both alike
            return [_scaled(entry, own)]
        if mapping == "balanced" or not _is_repeated(entry):
            return [_scaled(entry, self.balance(mass))]
        difference = (gamma - own) * self.mass
        if kind == "record":
            force = entry | {"target": "force", "inertial_mass": difference}
        else:
            force = _scaled(entry, -difference) | {"target": "force"}
        return ([_scaled(entry, own)] if own != 0.0 else []) + [force]

    def balance(self, mass: float) -> float:
        """Return the factor of a motion that moves both alike, with a device of a mass [kg]."""
        return (self.participation * self.mass + self.ground * mass) / (self.mass + mass)


def check_mass(mass: float) -> None:
    """Refuse what is no mass of a device [kg]."""
    if isinstance(mass, bool) or not isinstance(mass, int | float) or not 0.0 < mass < np.inf:
        allowed = "a number greater than 0, the mass of the device [kg]"
        refuse("mass", f"{mass!r}", allowed, StructureError)


def check_draws(drawn: object, shaken: list[list[dict[str, object]]]) -> None:
    """Refuse draws of two entries that stand for one motion: each would draw its own."""
    pairs = [len(group) > 1 for group in shaken for _ in group]
    paired = {f"excitation.{place}" for place, is_pair in enumerate(pairs) if is_pair}
    for name in cast("dict[str, object]", drawn) if isinstance(drawn, dict) else ():
        if str(name).rpartition(".")[0] in paired:
            msg = (
                f"randomization.{name}: the ground's motion is two entries of the excitation, "
                "which would draw different values; set mapping='balanced'"
            )
            raise StructureError(msg)


def _stated(entry: Entry) -> dict[str, object]:
    if not isinstance(entry, Part):
        return dict(entry)
    return {"kind": getattr(entry, "kind", None), **entry.model_dump(exclude_unset=True)}


def _is_repeated(entry: Mapping[str, object]) -> bool:
    if entry["kind"] == "impulse":
        return not entry.get("rate") and isinstance(entry.get("size"), int | float)
    return entry["kind"] in REPEATED


def _scaled(entry: Mapping[str, object], factor: float) -> dict[str, object]:
    """Return an entry that is a factor stronger; what cannot be multiplied is left to the scene."""
    name = SIZES[cast("str", entry["kind"])]
    value = entry.get(name, 1.0 if name == "scale" else None)
    if factor == 1.0 or value is None:
        return dict(entry)
    if isinstance(value, list | tuple):
        ends = [end * factor for end in cast("Sequence[float]", value)]
        return {**entry, name: sorted(ends)}
    if name == "rms":  # a noise has no sign
        factor = abs(factor)
    return {**entry, name: value * factor} if isinstance(value, int | float) else dict(entry)
