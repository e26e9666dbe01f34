"""How the ground moves a mode and its device, as entries of a scene's excitation.

Equations are those of `docs/structures.md`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, cast

import numpy as np

from mm_gym.errors import StructureError, check_name, refuse, suggest
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
"""Kinds that are the same function of time in two entries of one scene, unless each draws its
own record; so is an impulse of one size at a given time."""

MEASURES = ("peak", "spectral_acceleration")  # fields of `scale_to` that may be drawn

SAME = 1e-12  # relative difference of the ground's effect on both masses that is round-off


class Effect(NamedTuple):
    """An entry of a scene, and the factor that multiplied its strength."""

    entry: dict[str, object]
    factor: float


class Shaking(NamedTuple):
    """The ground's acceleration moves the carriage as Gamma a, and the device as r_j a."""

    participation: float  # Gamma [-]
    ground: float  # r_j [-]
    mass: float  # m1 [kg]

    def entries(
        self, ground: Entry | Sequence[Entry], mass: float, mapping: str
    ) -> list[list[Effect]]:
        """Return the one or two entries that stand for each motion of the ground."""
        check_name("mapping", mapping, ("exact", "balanced"), StructureError)
        check_mass(mass)
        entries = [ground] if isinstance(ground, Part | Mapping) else ground
        return [
            self._entries(f"ground.{place}", _stated(entry), mass, mapping)
            for place, entry in enumerate(entries)
        ]

    def _entries(
        self, name: str, entry: dict[str, object], mass: float, mapping: str
    ) -> list[Effect]:
        kind = entry.get("kind")
        if not isinstance(kind, str) or kind not in SIZES:
            nearest = suggest(kind, SIZES) if isinstance(kind, str) else ""
            refuse(f"{name}.kind", f"{kind!r}{nearest}", ", ".join(SIZES), StructureError)
        if entry.setdefault("target", "ground") != "ground":
            refuse(f"{name}.target", f"{entry['target']!r}", "'ground'", StructureError)
        gamma, own = self.participation, self.ground

        def scaled(factor: float) -> Effect:
            return Effect(_scaled(name, entry, factor), factor)

        if abs(gamma - own) <= SAME * abs(gamma):  # one storey: the ground moves both alike
            return [scaled(own)]
        if mapping == "balanced" or not _is_repeated(entry):
            return [scaled(self.balance(mass))]
        difference = (gamma - own) * self.mass
        if kind == "record":
            force = Effect(entry | {"target": "force", "inertial_mass": difference}, 1.0)
        else:
            force = Effect(scaled(-difference).entry | {"target": "force"}, -difference)
        return ([scaled(own)] if own != 0.0 else []) + [force]

    def balance(self, mass: float) -> float:
        """Return the factor of a motion that moves both alike, with a device of a mass [kg]."""
        return (self.participation * self.mass + self.ground * mass) / (self.mass + mass)


def check_mass(mass: float) -> None:
    """Refuse what is no mass of a device [kg]."""
    if isinstance(mass, bool) or not isinstance(mass, int | float) or not 0.0 < mass < np.inf:
        allowed = "a number greater than 0, the mass of the device [kg]"
        refuse("mass", f"{mass!r}", allowed, StructureError)


def scaled_draws(drawn: object, shaken: list[list[Effect]]) -> object:
    """Return a scene's randomization, whose strengths of the ground are multiplied as its entries.

    Draws of two entries that stand for one motion are refused: each would draw its own.
    """
    if not isinstance(drawn, dict):
        return drawn
    effects = [(effect, len(group) > 1) for group in shaken for effect in group]
    places = {f"excitation.{place}": effect for place, effect in enumerate(effects)}
    ranges = dict(cast("dict[str, object]", drawn))
    for name, value in ranges.items():
        prefix, _, field = str(name).rpartition(".")
        if prefix not in places:
            continue
        (entry, factor), is_pair = places[prefix]
        if is_pair:
            msg = (
                f"randomization.{name}: the ground's motion is two entries of the excitation, "
                "which would draw different values; set mapping='balanced'"
            )
            raise StructureError(msg)
        if field == SIZES[cast("str", entry["kind"])]:
            ranges[name] = _times(field, value, factor)
    return ranges


def _stated(entry: Entry) -> dict[str, object]:
    if not isinstance(entry, Part):
        return dict(entry)
    return {"kind": getattr(entry, "kind", None), **entry.model_dump(exclude_unset=True)}


def _is_repeated(entry: Mapping[str, object]) -> bool:
    if entry["kind"] == "impulse":
        return not entry.get("rate") and isinstance(entry.get("size"), int | float)
    return entry["kind"] in REPEATED and not _draws(entry)


def _draws(entry: Mapping[str, object]) -> bool:
    """Tell whether a record draws its file, or the value that it is scaled to."""
    files, target = entry.get("files"), _target(entry)
    if isinstance(files, list | tuple):
        is_set = len(cast("Sequence[object]", files)) > 1
    else:
        is_set = files is not None  # a pattern
    return is_set or any(isinstance(target.get(name), list | tuple) for name in MEASURES)


def _target(entry: Mapping[str, object]) -> dict[str, object]:
    """Return what a record is scaled to; empty if it is not, or if it is no table."""
    target = entry.get("scale_to")
    if isinstance(target, Part):
        return target.model_dump(exclude_unset=True)
    return dict(cast("Mapping[str, object]", target)) if isinstance(target, Mapping) else {}


def _scaled(name: str, entry: Mapping[str, object], factor: float) -> dict[str, object]:
    """Return an entry that is a factor stronger; what cannot be multiplied is left to the scene."""
    if factor == 1.0:
        return dict(entry)
    size = SIZES[cast("str", entry["kind"])]
    if size == "scale" and entry.get("scale_to") is not None:
        if factor <= 0.0:  # a measure has no sign
            got = f"a record to multiply by {factor:g}"
            refuse(f"{name}.scale_to", got, "a factor above 0; set scale instead", StructureError)
        target = _target(entry)
        measured = {key: _times(key, target[key], factor) for key in MEASURES if key in target}
        return {**entry, "scale_to": target | measured or entry["scale_to"]}
    value = entry.get(size, 1.0 if size == "scale" else None)
    return dict(entry) if value is None else {**entry, size: _times(size, value, factor)}


def _times(name: str, value: object, factor: float) -> object:
    """Return a number or a range that is a factor larger; anything else as it is."""
    if name == "rms":  # a noise has no sign
        factor = abs(factor)
    if isinstance(value, int | float):
        return value * factor
    if not isinstance(value, list | tuple):
        return value
    ends = [_times(name, end, factor) for end in cast("Sequence[object]", value)]
    return ends[::-1] if factor < 0.0 else ends
