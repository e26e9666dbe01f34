"""One mode of a structure as the carriage of a scene, and how the ground moves both masses.

Equations are those of `docs/structures.md`.
"""

# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
# SciPy's linear algebra is typed in part only

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from mm_gym.errors import StructureError, suggest
from mm_gym.files import write_text
from mm_gym.plant.compile import compile_scene
from mm_gym.scene.part import Part
from mm_gym.scene.scene import Scene
from mm_gym.scene.toml_file import toml_of
from mm_gym.simulation.simulate import record_of, simulate

if TYPE_CHECKING:
    from collections.abc import Sequence
    from os import PathLike

    from numpy.typing import ArrayLike, NDArray

    from mm_gym.simulation.simulate import Policy
    from mm_gym.simulation.trajectory import Trajectory
    from mm_gym.structure.structure import Structure
    from mm_gym.tuning.closed_forms import Absorber

    Array = NDArray[np.float64]
    Entry = Mapping[str, object] | Part

MOST_SHOWN = 12
"""Values of a mode shape that are shown without leaving some out."""

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

SAME = 1e-12
"""Relative difference of the ground's effect on both masses that is round-off."""


@dataclass(frozen=True, eq=False)
class Reduction:
    """One mode of a structure, as a mass on a spring and a damper that carries a device.

    The coordinate of the mode is the displacement x1 of the device's degree of freedom, where the
    mode shape is 1. q = shape * x1 approximates the displacements of the structure.

    Attributes
    ----------
    structure, device, mode
        The structure, the device's degree of freedom and the mode, counted from 1.
    shape
        (n,) mode shape, 1 at the device.
    """

    structure: Structure
    device: int
    mode: int
    shape: Array

    @property
    def place(self) -> str:
        """Location of the device, in words."""
        name = "floor" if self.structure.storeys else "degree of freedom"
        return f"{name} {self.device}"

    @property
    def mass(self) -> float:
        """Generalised mass m1 = shape' M shape [kg], (S3)."""
        return float(self.shape @ self.structure.mass @ self.shape)

    @property
    def stiffness(self) -> float:
        """Generalised stiffness k1 = shape' K shape [N/m], (S3)."""
        return float(self.shape @ self.structure.stiffness @ self.shape)

    @property
    def damping(self) -> float:
        """Generalised damping d = shape' C shape [N s/m], (S3)."""
        return max(0.0, float(self.shape @ self.structure.damping @ self.shape))

    @property
    def frequency(self) -> float:
        """Undamped natural frequency [rad/s]."""
        return float(self.structure.frequencies[self.mode - 1])

    @property
    def damping_ratio(self) -> float:
        """Damping ratio [-] of the mode."""
        return self.damping / (2.0 * self.mass * self.frequency)

    @property
    def participation(self) -> float:
        """Participation factor Gamma = shape' M r / m1 [-]; the mode shape is 1 at the device."""
        return float(self.shape @ self.structure.mass @ self.structure.influence) / self.mass

    @property
    def ground(self) -> float:
        """r_j [-]: fraction of the ground's acceleration that the device feels; 1 in a building."""
        return float(self.structure.influence[self.device - 1])

    @property
    def effective_mass_ratio(self) -> float:
        """Effective modal mass Gamma^2 m1 over r' M r [-]: the mode's share of the base shear."""
        r = self.structure.influence
        return self.participation**2 * self.mass / float(r @ self.structure.mass @ r)

    @property
    def damping_coupling(self) -> float:
        """Largest coefficient [-] by which C couples another mode to this one, in magnitude.

        It is |shape' C other| / sqrt(shape' C shape * other' C other): 0 for classical damping,
        at most 1.
        """
        others = np.delete(self.structure.modes[1], self.mode - 1, axis=1)
        own = np.einsum("ik,ij,jk->k", others, self.structure.damping, others)
        cross = np.abs(self.shape @ self.structure.damping @ others)
        both = np.sqrt(np.maximum(own * self.damping, 0.0))
        return float(
            np.max(np.divide(cross, both, out=np.zeros_like(both), where=both > 0.0), initial=0.0)
        )

    def explain(self) -> str:
        """Return the reduction in words and numbers."""
        hertz = self.structure.frequencies / (2.0 * np.pi)
        values = [f"{value:.4g}" for value in self.shape]
        if len(values) > MOST_SHOWN:
            values[3:-3] = ["..."]
        shape = ", ".join(values)
        lines = [
            f"mode {self.mode} of {self.structure.count}, device at {self.place}",
            f"frequency {hertz[self.mode - 1]:.6g} Hz, damping ratio {self.damping_ratio:.4g}",
            f"shape {shape}",
            f"m1 {self.mass:.6g} kg, k1 {self.stiffness:.6g} N/m, d {self.damping:.6g} N s/m",
        ]
        lines.append(
            f"participation factor {self.participation:.6g}, "
            f"effective modal mass {self.effective_mass_ratio:.2%} of the total"
        )
        others = np.delete(hertz, self.mode - 1)
        if others.size:
            nearest = others[np.argmin(np.abs(others - hertz[self.mode - 1]))]
            lines.append(
                f"left out: {others.size} modes, the nearest at {nearest:.6g} Hz; "
                f"damping couples them by {self.damping_coupling:.2g} at most"
            )
        return "\n".join(lines)

    def excitation(
        self, ground: Entry | Sequence[Entry], mass: float, mapping: str = "exact"
    ) -> list[dict[str, object]]:
        """Return the entries of a scene's excitation that represent motions of the ground.

        The ground's acceleration a moves the carriage as Gamma a, and the device as r_j a. An entry
        for the ground moves both alike, so a force -(Gamma - r_j) m1 a on the carriage is added,
        (S5). This is exact for harmonics, sweeps, records, and impulses of one size at a given
        time. Noise and random impulses would differ between two entries. They become one entry,
        scaled by (Gamma m1 + r_j m2) / (m1 + m2), (S6); `balanced_error` returns the error.

        Parameters
        ----------
        ground
            One entry or several, each as in a scene; the target, if stated, is "ground".
        mass
            m2 of the device [kg].
        mapping
            "exact", or "balanced", which uses one scaled entry for every kind.

        Raises
        ------
        StructureError
            If the mapping is unknown, or an entry has an unknown kind or another target.
        """
        return [entry for group in self._shaken(ground, mass, mapping) for entry in group]

    def _shaken(
        self, ground: Entry | Sequence[Entry], mass: float, mapping: str
    ) -> list[list[dict[str, object]]]:
        """Return the one or two entries that stand for each motion of the ground."""
        if mapping not in MAPPINGS:
            nearest = suggest(str(mapping), MAPPINGS)
            msg = f"mapping: got {mapping!r}{nearest}; allowed: 'exact' or 'balanced'"
            raise StructureError(msg)
        _check_mass(mass)
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
            msg = f"{name}.kind: got {kind!r}{nearest}; allowed: {', '.join(SIZES)}"
            raise StructureError(msg)
        if entry.setdefault("target", "ground") != "ground":
            msg = f"{name}.target: got {entry['target']!r}; allowed: 'ground'"
            raise StructureError(msg)
        gamma, own = self.participation, self.ground
        if abs(gamma - own) <= SAME * abs(gamma):  # one storey: the ground moves both alike
            return [_scaled(entry, own)]
        if mapping == "balanced" or not _is_repeated(entry):
            return [_scaled(entry, self._balance(mass))]
        difference = (gamma - own) * self.mass
        if kind == "record":
            force = entry | {"target": "force", "inertial_mass": difference}
        else:
            force = _scaled(entry, -difference) | {"target": "force"}
        return ([_scaled(entry, own)] if own != 0.0 else []) + [force]

    def _balance(self, mass: float) -> float:
        return (self.participation * self.mass + self.ground * mass) / (self.mass + mass)

    def scene(
        self,
        mass: float,
        absorber: Absorber | None = None,
        *,
        ground: Entry | Sequence[Entry] = (),
        mapping: str = "exact",
        **fields: object,
    ) -> Scene:
        """Return a scene: the mode is the carriage, the device is the sphere.

        Parameters
        ----------
        mass
            m2 of the device [kg].
        absorber
            An optimum of `mm_gym.tuning.closed_form`: springs and a viscous interface tuned to the
            mode. Without it, give `interface` and `springs` among the fields.
        ground, mapping
            Motions of the ground, see `excitation`.
        fields
            Further fields of the scene, such as control, actuation and objective. Entries of
            `excitation` are forces on the carriage, at the device's degree of freedom.

        Raises
        ------
        SceneError
            If the scene is not valid; `StructureError` for an argument of this function.
        """
        _check_mass(mass)
        tuned = self._absorber(mass, absorber)
        twice = {"carriage", "sphere", *tuned} & set(fields)
        if twice:
            name = min(twice)
            msg = f"{name}: got twice; it follows from the structure, `mass` or `absorber`"
            raise StructureError(msg)
        forces = cast("Sequence[object]", fields.pop("excitation", ()))
        shaken = self._shaken(ground, mass, mapping)
        _check_draws(fields.get("randomization"), shaken)
        return Scene(
            carriage={
                "mass": self.mass,
                "stiffness": self.stiffness,
                "damping": self.damping,
            },
            sphere={"mass": mass},
            excitation=[*(entry for group in shaken for entry in group), *forces],
            **tuned,
            **fields,
        )

    def _absorber(self, mass: float, absorber: Absorber | None) -> dict[str, object]:
        if absorber is None:
            return {}
        parts: dict[str, object] = {
            "interface": {"kind": "viscous", "damping": absorber.damping(mass, self.frequency)}
        }
        k2 = absorber.stiffness(mass, self.frequency)
        if k2 > 0.0:
            parts["springs"] = {"kind": "linear", "stiffness": k2}
        return parts

    def simulate(
        self,
        scene: Scene,
        ground: ArrayLike,
        *,
        duration: float | None = None,
        times: ArrayLike | None = None,
        action: ArrayLike | Policy | None = None,
        seed: int | None = None,
    ) -> Trajectory:
        """Simulate a scene with an additional ground motion, as `mm_gym.simulate` does.

        The ground moves carriage and device differently, see `excitation`; with
        `mm_gym.simulate(scene, ground=...)` it moves both alike.

        Parameters
        ----------
        scene
            A scene of this reduction; its own excitation is kept.
        ground
            (k, 2) increasing times [s] and accelerations [m/s^2], linear in between, zero outside.
        duration, times, action, seed
            As for `mm_gym.simulate`, also for the errors raised.
        """
        with record_of(ground) as record:
            entries = [*scene.excitation, *self.excitation(record, scene.sphere.mass)]
            plant = compile_scene(scene.replace(excitation=entries))
        return simulate(plant, duration=duration, times=times, action=action, seed=seed)

    def to_toml(self, scene: Scene, path: str | PathLike[str]) -> None:
        """Write a scene as a TOML file, whole or not at all.

        Comments at its head describe the reduction. Files of records are named relative to the
        file's folder.
        """
        head = "".join(f"# {line}\n" for line in self.explain().splitlines())
        write_text(path, f"{head}\n{toml_of(scene, Path(path).resolve().parent)}")


def _stated(entry: Entry) -> dict[str, object]:
    if not isinstance(entry, Part):
        return dict(entry)
    return {"kind": getattr(entry, "kind", None), **entry.model_dump(exclude_unset=True)}


def _check_mass(mass: float) -> None:
    if isinstance(mass, bool) or not isinstance(mass, int | float) or not 0.0 < mass < np.inf:
        msg = f"mass: got {mass!r}; allowed: a number greater than 0, the mass of the device [kg]"
        raise StructureError(msg)


def _check_draws(drawn: object, shaken: list[list[dict[str, object]]]) -> None:
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


class BalancedError(NamedTuple):
    """Error of a balanced mapping under white noise, relative to the exact one."""

    displacement: float  # of x1: root mean square of the difference over that of the exact motion
    stroke: float  # the same of x2 - x1
    displacement_rms: float  # relative change of the root mean square itself
    stroke_rms: float


def balanced_error(reduction: Reduction, scene: Scene) -> BalancedError:
    """Return the error of the mapping "balanced" under white noise of the ground.

    The scene is linearised about equilibrium. The difference of the mappings is a pair of forces
    m1 m2 / (m1 + m2) (Gamma - r_j) a between carriage and device, (S7), so it vanishes with m2.

    Raises
    ------
    StructureError
        If the motion has no finite variance, because the scene is not asymptotically stable.
    """
    a, _ = compile_scene(scene).linear()
    shift = np.array([[1.0, 0.0], [-1.0, 1.0]])  # x1, x2 - x1
    turn = np.kron(np.eye(2), shift)
    a = turn @ a @ np.linalg.inv(turn)
    gamma, own, mass = reduction.participation, reduction.ground, scene.sphere.mass
    balance = reduction._balance(mass)  # noqa: SLF001 # pyright: ignore[reportPrivateUsage]
    exact, scaled = (
        np.array([0.0, 0.0, *(shift @ column)]) for column in ([-gamma, -own], [-balance, -balance])
    )
    if np.linalg.eigvals(a).real.max() >= 0.0:
        msg = "scene: the motion has no variance under white noise; allowed: damping and springs"
        raise StructureError(msg)
    difference, one, other = (
        np.sqrt(np.diag(solve_continuous_lyapunov(a, -np.outer(b, b)))[:2])
        for b in (exact - scaled, exact, scaled)
    )
    return BalancedError(*map(float, (*(difference / one), *(other / one - 1.0))))
