"""Structures as matrices, their modes, and one mode as the carriage of a scene."""

# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
# SciPy's linear algebra is typed in part only

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn, cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigh

from mm_gym.arrays import Array
from mm_gym.errors import StructureError, finite_numbers, positive_number, refuse, whole_number
from mm_gym.files import write_text
from mm_gym.plant.compile import compile_scene
from mm_gym.scene.scene import Scene
from mm_gym.scene.toml_file import toml_of
from mm_gym.simulation.simulate import record_of, simulate
from mm_gym.simulation.trajectory import Trajectory
from mm_gym.structure.ground import Entry, Shaking, scaled_draws

if TYPE_CHECKING:
    from mm_gym.simulation.simulate import Policy
    from mm_gym.tuning.closed_forms import Absorber
ASYMMETRY = 1e-8
"""Difference of a matrix from its transpose, relative to its largest entry, that passes as
round-off of what computed it; published digits are copied to both sides."""

NODE = 1e-3
"""A device sits at a node where the mode shape is below this, relative to its largest value: the
generalised mass there is above a million times that at the largest value."""

EQUAL = 1e-9
"""Relative difference of two squared frequencies below which round-off alone decides the shapes."""

ROUND_OFF = 1e-12
"""Relative to the largest eigenvalue of a damping matrix: a smaller negative one passes as 0."""


class Structure:
    """A linear structure on a ground that moves: M q'' + C q' + K q = -M r a_g.

    Parameters
    ----------
    mass, stiffness
        (n, n) M [kg] and K [N/m], symmetric and positive definite.
    damping
        (n, n) C [N s/m], symmetric and positive semidefinite; or the damping ratio of all modes
        [-]; or (n,) those of each mode, slowest first.
    influence
        (n,) r [-]: displacements when the ground moves by 1 and nothing deforms. By default ones,
        which holds for horizontal displacements under horizontal motion.
    storeys
        Whether the degrees of freedom are the displacements of floors, lowest first, so that
        interstorey drifts are defined.

    Raises
    ------
    StructureError
        If a matrix contains anything but finite numbers, has the wrong shape, or is not symmetric
        and definite, or a damping ratio is not at least 0 and below 1.

    Examples
    --------
    >>> frame = Structure.of_storeys([45e3] * 5, [5.482e6] * 5, damping=0.05)
    >>> round(float(frame.frequencies[0]), 4)
    3.1415
    """

    def __init__(
        self,
        mass: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike,
        *,
        influence: ArrayLike | None = None,
        storeys: bool = False,
    ) -> None:
        self.mass = _definite("mass", mass, None)
        count = len(self.mass)
        self.stiffness = _definite("stiffness", stiffness, count)
        self.influence = _influence(influence, count)
        self.storeys = storeys
        self.damping = _damping(damping, self.mass, self.stiffness)
        for array in (self.mass, self.stiffness, self.influence, self.damping):
            array.setflags(write=False)

    @classmethod
    def of_storeys(cls, masses: ArrayLike, stiffnesses: ArrayLike, damping: ArrayLike) -> Structure:
        """Return a shear building: floors that move horizontally, and storeys that act as springs.

        Parameters
        ----------
        masses, stiffnesses
            (n,) masses of the floors [kg] and stiffnesses of the storeys below them [N/m], lowest
            first.
        damping
            As for the class.

        Raises
        ------
        StructureError
            If a value is not positive, or the lengths differ; also as for the class.
        """
        m, k = _positive("masses", masses), _positive("stiffnesses", stiffnesses)
        if len(m) != len(k):
            _refuse("stiffnesses", f"{len(k)}", f"{len(m)}, as many as masses")
        drifts = drift_matrix(len(m))
        return cls(np.diag(m), drifts.T @ np.diag(k) @ drifts, damping, storeys=True)

    @property
    def count(self) -> int:
        """Number n of degrees of freedom."""
        return len(self.mass)

    @cached_property
    def modes(self) -> tuple[Array, Array]:
        """Undamped frequencies (n,) [rad/s], slowest first, and mode shapes (n, n) in columns.

        The shapes are scaled to a generalised mass of 1 kg.
        """
        return modes_of(self.mass, self.stiffness)

    @property
    def frequencies(self) -> Array:
        """Undamped natural frequencies (n,) [rad/s], slowest first."""
        return self.modes[0]

    @property
    def damping_ratios(self) -> Array:
        """Damping ratios (n,) [-] of the modes, from the diagonal of C in modal coordinates."""
        frequencies, shapes = self.modes
        return np.einsum("ik,ij,jk->k", shapes, self.damping, shapes) / (2.0 * frequencies)

    def reduce(self, device: int, mode: int = 1) -> Reduction:
        """Return one mode of the structure as a carriage that carries a device.

        Parameters
        ----------
        device
            Degree of freedom at which the device sits, 1 to n.
        mode
            Number of the mode, 1 (the slowest) to n.

        Raises
        ------
        StructureError
            If there is no such degree of freedom or mode, if two modes have this frequency (the
            mode shape is then not unique), or if the device sits at a node of the mode.
        """
        place, number = self._counted("device", device), self._counted("mode", mode)
        frequencies, shapes = self.modes
        squares = frequencies**2
        others = np.delete(squares, number)
        if np.any(np.abs(others - squares[number]) <= EQUAL * squares[number]):
            _refuse(
                "mode",
                f"{mode}; another mode has the same frequency, {frequencies[number]:g} rad/s, so "
                "their mode shapes are not unique",
                "a mode whose frequency no other mode has",
            )
        shape = shapes[:, number]
        share = abs(shape[place]) / np.abs(shape).max()
        if share < NODE:
            best = int(np.argmax(np.abs(shape))) + 1
            _refuse(
                "device",
                f"{device}, a node of mode {mode}, whose shape there is {share:.1e} of its "
                "largest value",
                f"at least {NODE:g} of it; it is largest at {best}",
            )
        return Reduction(self, place + 1, number + 1, shape / shape[place])

    def _counted(self, name: str, value: int) -> int:
        """Return a number that users count from 1, counted from 0."""
        return whole_number(f"structure.{name}", value, most=self.count, error=StructureError) - 1


def drift_matrix(count: int) -> Array:
    """Return (n, n): what gives interstorey drifts from floors' displacements, lowest first."""
    return np.eye(count) - np.eye(count, k=-1)


def modes_of(mass: Array, stiffness: Array) -> tuple[Array, Array]:
    """Return frequencies (n,) [rad/s] and shapes (n, n) with a generalised mass of 1 kg."""
    squares, shapes = eigh(stiffness, mass)
    return np.sqrt(squares), np.asarray(shapes, np.float64)


def rayleigh_damping(
    mass: ArrayLike, stiffness: ArrayLike, ratios: Sequence[float], modes: Sequence[int] = (1, 2)
) -> Array:
    """Return C = a M + b K (n, n) [N s/m] with given damping ratios in two modes.

    Parameters
    ----------
    mass, stiffness
        (n, n) M [kg] and K [N/m].
    ratios
        The two damping ratios [-].
    modes
        The numbers of the two modes, counted from 1.

    Raises
    ------
    StructureError
        If a matrix is not allowed in a `Structure`, if two such modes and ratios are not given, or
        if the modes have the same frequency.

    Notes
    -----
    The ratio of a mode of frequency w is a / (2 w) + b w / 2. Between the two modes the ratio is
    lower, outside it is higher (Chopra, *Dynamics of Structures*, section 11.4).
    """
    bare = Structure(mass, stiffness, 0.0)
    if np.shape(modes) != (2,) or modes[0] == modes[1]:
        _refuse("modes", f"{modes!r}", "two different modes")
    wanted = _numbers("ratios", ratios)
    if wanted.shape != (2,):
        _refuse("ratios", f"{ratios!r}", "two damping ratios, one a mode")
    places = [bare._counted("modes", mode) for mode in modes]  # noqa: SLF001 # pyright: ignore[reportPrivateUsage]
    w = bare.frequencies[places]
    if abs(w[0] ** 2 - w[1] ** 2) <= EQUAL * w[0] ** 2:
        got = f"{modes!r}, both of {w[0]:g} rad/s"
        _refuse("modes", got, "two modes of different frequencies")
    a, b = np.linalg.solve(np.column_stack([0.5 / w, 0.5 * w]), _ratios(wanted))
    return a * bare.mass + b * bare.stiffness


def _refuse(name: str, got: str, allowed: str) -> NoReturn:
    refuse(f"structure.{name}", got, allowed, StructureError)


def _numbers(name: str, value: ArrayLike) -> Array:
    return finite_numbers(f"structure.{name}", value, StructureError)


def _positive(name: str, value: ArrayLike) -> Array:
    numbers = _numbers(name, value)
    if numbers.ndim != 1 or len(numbers) == 0:
        _refuse(name, f"shape {numbers.shape}", "(n,), one a storey")
    if numbers.min() <= 0.0:
        place = int(np.argmin(numbers))
        _refuse(name, f"{numbers[place]:g} in storey {place + 1}", "greater than 0")
    return numbers


def _symmetric(name: str, value: ArrayLike, count: int | None) -> Array:
    """Return a symmetric matrix; of (count, count) where a count is given."""
    matrix = _numbers(name, value)
    shape = matrix.shape
    allowed = "(n, n)" if count is None else f"({count}, {count})"
    square = len(shape) == 2 and shape[0] == shape[1] > 0  # noqa: PLR2004
    if not square or (count is not None and shape[0] != count):
        _refuse(name, f"shape {shape}", allowed)
    difference = np.abs(matrix - matrix.T)
    if difference.max() > ASYMMETRY * np.abs(matrix).max():
        i, j = np.unravel_index(int(np.argmax(difference)), shape)
        _refuse(
            name,
            f"{matrix[i, j]:g} in row {i + 1}, column {j + 1}, and {matrix[j, i]:g} across the "
            "diagonal",
            "a symmetric matrix",
        )
    return 0.5 * (matrix + matrix.T)


def _definite(name: str, value: ArrayLike, count: int | None) -> Array:
    matrix = _symmetric(name, value, count)
    least = float(eigh(matrix, eigvals_only=True)[0])
    if least <= ROUND_OFF * np.abs(matrix).max() * 1e-3:
        hint = {
            "mass": "condense degrees of freedom without mass",
            "stiffness": "a structure must not move without deforming",
        }[name]
        _refuse(name, f"the eigenvalue {least:g}", f"a positive definite matrix; {hint}")
    return matrix


def _influence(value: ArrayLike | None, count: int) -> Array:
    if value is None:
        return np.ones(count)
    numbers = _numbers("influence", value)
    if numbers.shape != (count,):
        _refuse("influence", f"shape {numbers.shape}", f"({count},)")
    if not numbers.any():
        _refuse("influence", "only zeros", "at least one number that is not 0")
    return numbers


def _ratios(value: Array) -> Array:
    if value.min() < 0.0 or value.max() >= 1.0:
        wrong = value.min() if value.min() < 0.0 else value.max()
        _refuse("damping", f"a damping ratio of {wrong:g}", "0 to below 1")
    return value


def _damping(value: ArrayLike, mass: Array, stiffness: Array) -> Array:
    """Return C (n, n) of a matrix, or of damping ratios of the modes."""
    numbers = _numbers("damping", value)
    count = len(mass)
    if numbers.ndim < 2:  # noqa: PLR2004 - a matrix
        if numbers.ndim == 1 and len(numbers) != count:
            allowed = f"one number, {count} of them, or a matrix ({count}, {count})"
            _refuse("damping", f"{len(numbers)} damping ratios", allowed)
        frequencies, shapes = modes_of(mass, stiffness)
        weighted = mass @ shapes
        return weighted @ np.diag(2.0 * _ratios(numbers.ravel()) * frequencies) @ weighted.T
    matrix = _symmetric("damping", numbers, count)
    eigenvalues = eigh(matrix, eigvals_only=True)
    if eigenvalues[0] < -ROUND_OFF * max(eigenvalues[-1], 0.0):
        allowed = "a positive semidefinite matrix"
        _refuse("damping", f"the eigenvalue {eigenvalues[0]:g}, which would feed energy", allowed)
    return matrix


MOST_SHOWN = 12  # values of a mode shape that are shown without leaving some out


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
        """Fraction r_j [-] of the ground's acceleration that the device feels; 1 in a building."""
        return float(self.structure.influence[self.device - 1])

    @property
    def shaking(self) -> Shaking:
        """How the ground moves the mode and its device."""
        return Shaking(self.participation, self.ground, self.mass)

    @property
    def effective_mass_ratio(self) -> float:
        """Effective modal mass Gamma^2 m1 over r' M r [-], the mode's share of the base shear."""
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
        coupled = both > 0.0
        return float(np.max(cross[coupled] / both[coupled], initial=0.0))

    def explain(self) -> str:
        """Return the reduction in words and numbers."""
        hertz = self.structure.frequencies / (2.0 * np.pi)
        values = [f"{value:.4g}" for value in self.shape]
        if len(values) > MOST_SHOWN:
            values[3:-3] = ["..."]
        shape = ", ".join(values)
        total = f"effective modal mass {self.effective_mass_ratio:.2%} of the total"
        lines = [
            f"mode {self.mode} of {self.structure.count}, device at {self.place}",
            f"frequency {hertz[self.mode - 1]:.6g} Hz, damping ratio {self.damping_ratio:.4g}",
            f"mode shape {shape}",
            f"m1 {self.mass:.6g} kg, k1 {self.stiffness:.6g} N/m, d {self.damping:.6g} N s/m",
            f"participation factor {self.participation:.6g}, {total}",
        ]
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
        time. Noise, random impulses, and records that draw their file or the value that they are
        scaled to would differ between two entries. They become one entry, scaled by
        (Gamma m1 + r_j m2) / (m1 + m2), (S6); `balanced_error` returns the error.

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
            If the mapping is unknown, an entry has an unknown kind or another target, or the factor
            of a record with `scale_to` is not above 0.
        """
        shaken = self.shaking.entries(ground, mass, mapping)
        return [effect.entry for group in shaken for effect in group]

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
            `excitation` are forces on the carriage, at the device's degree of freedom. Strengths
            in `randomization` are of the ground's motion, and are scaled as its entry is.

        Raises
        ------
        SceneError
            If the scene is not valid; `StructureError` for an argument of this function.
        """
        positive_number("mass", mass, StructureError)
        tuned = self._absorber(mass, absorber)
        twice = {"carriage", "sphere", *tuned} & set(fields)
        if twice:
            name = min(twice)
            msg = f"{name}: got twice; it follows from the structure, `mass` or `absorber`"
            raise StructureError(msg)
        forces = cast("Sequence[object]", fields.pop("excitation", ()))
        shaken = self.shaking.entries(ground, mass, mapping)
        if "randomization" in fields:
            fields["randomization"] = scaled_draws(fields["randomization"], shaken)
        return Scene(
            carriage={"mass": self.mass, "stiffness": self.stiffness, "damping": self.damping},
            sphere={"mass": mass},
            excitation=[*(effect.entry for group in shaken for effect in group), *forces],
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
