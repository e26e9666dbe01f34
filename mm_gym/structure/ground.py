"""How the ground moves a mode and its device, as entries of a scene's excitation.

Equations are those of `docs/structures.md`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, cast

from mm_gym.errors import SceneError, StructureError, check_name, positive_number, refuse
from mm_gym.scene.excitation import Excitation
from mm_gym.scene.part import Part
from mm_gym.scene.scene import Scene

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

MEASURES = ("peak", "spectral_acceleration")  # fields of `scale_to` that may be drawn

SAME = 1e-12  # relative difference of the ground's effect on both masses that is round-off


class Effect(NamedTuple):
    """An entry of a scene, and the factor that multiplied its strength."""

    entry: dict[str, Any]
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
        positive_number("mass", mass, StructureError)
        entries = [ground] if isinstance(ground, Part | Mapping) else ground
        return [
            self._entries(f"ground.{place}", entry, mass, mapping)
            for place, entry in enumerate(entries)
        ]

    def _entries(self, name: str, entry: Entry, mass: float, mapping: str) -> list[Effect]:
        part = _part(name, entry)
        gamma, own = self.participation, self.ground

        def scaled(factor: float) -> Effect:
            return Effect(_scaled(name, part, factor), factor)

        if abs(gamma - own) <= SAME * abs(gamma):  # one storey: the ground moves both alike
            return [scaled(own)]
        if mapping == "balanced" or not _is_repeated(part):
            return [scaled(self.balance(mass))]
        difference = (gamma - own) * self.mass
        if part.kind == "record":
            force = scaled(1.0)
            force.entry.update(target="force", inertial_mass=difference)
        else:
            force = scaled(-difference)
            force.entry.update(target="force")
        return ([scaled(own)] if own != 0.0 else []) + [force]

    def balance(self, mass: float) -> float:
        """Return the factor of a motion that moves both alike, with a device of a mass [kg]."""
        return (self.participation * self.mass + self.ground * mass) / (self.mass + mass)


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
        if field == SIZES[entry["kind"]]:
            ranges[name] = _times(field, value, factor)
    return ranges


def _part(name: str, entry: Entry) -> Excitation:
    """Return an entry for the ground as a part of a scene."""
    stated = dict(entry)
    if isinstance(entry, Part):  # its defaults are not stated
        stated = {"kind": entry.value_of("kind"), **entry.model_dump(exclude_unset=True)}
    if stated.setdefault("target", "ground") != "ground":
        refuse(f"{name}.target", f"{stated['target']!r}", "'ground'", StructureError)
    try:
        (part,) = Scene(excitation=[stated]).excitation
    except SceneError as error:
        raise StructureError(str(error).replace("excitation.0", name)) from None
    return part


def _is_repeated(part: Excitation) -> bool:
    """Tell whether two such parts of one scene would be the same function of time."""
    if part.kind == "impulse":
        return part.rate == 0.0 and not isinstance(part.size, tuple)
    if part.kind == "record":
        draws_file = isinstance(part.files, str) or len(part.files or ()) > 1
        return not (draws_file or any(isinstance(m, tuple) for m in _measures(part).values()))
    return part.kind in {"harmonic", "sweep"}


def _measures(part: Part) -> dict[str, object]:
    """Return what a record is scaled to, by the fields of `scale_to` that may be drawn."""
    measures = {name: part.value_of(f"scale_to.{name}") for name in MEASURES}
    return {name: value for name, value in measures.items() if value is not None}


def _scaled(name: str, part: Excitation, factor: float) -> dict[str, Any]:
    """Return a part as an entry that is a factor stronger."""
    entry = part.model_dump(exclude_unset=True)
    size, measures = SIZES[part.kind], _measures(part)
    if factor == 1.0:
        return entry
    if not measures:
        return entry | {size: _times(size, part.value_of(size), factor)}
    if factor <= 0.0:  # a measure has no sign
        got = f"a record to multiply by {factor:g}"
        refuse(f"{name}.scale_to", got, "a factor above 0; set scale instead", StructureError)
    for key, value in measures.items():
        entry["scale_to"][key] = _times(key, value, factor)
    return entry


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
