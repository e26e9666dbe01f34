"""Linear structures: mass, damping and stiffness matrices, and their modes."""

# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
# SciPy's linear algebra is typed in part only

from __future__ import annotations

from functools import cached_property
from operator import index
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh

from mm_gym.errors import StructureError
from mm_gym.structure.reduction import Reduction

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

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
            msg = f"structure.stiffnesses: got {len(k)}; allowed: {len(m)}, as many as masses"
            raise StructureError(msg)
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
            msg = (
                f"structure.mode: got {mode}; another mode has the same frequency, "
                f"{frequencies[number]:g} rad/s, so their mode shapes are not unique; "
                "allowed: a mode whose frequency no other mode has"
            )
            raise StructureError(msg)
        shape = shapes[:, number]
        share = abs(shape[place]) / np.abs(shape).max()
        if share < NODE:
            best = int(np.argmax(np.abs(shape))) + 1
            msg = (
                f"structure.device: got {device}, a node of mode {mode}, whose shape there is "
                f"{share:.1e} of its largest value; allowed: at least {NODE:g} of it; "
                f"it is largest at {best}"
            )
            raise StructureError(msg)
        return Reduction(self, place + 1, number + 1, shape / shape[place])

    def _counted(self, name: str, value: int) -> int:
        """Return a number that users count from 1, counted from 0."""
        try:
            number = index(value)
        except TypeError:
            number = 0
        if isinstance(value, bool) or not 1 <= number <= self.count:
            msg = f"structure.{name}: got {value!r}; allowed: 1 to {self.count}"
            raise StructureError(msg)
        return number - 1


def drift_matrix(count: int) -> Array:
    """Return (n, n): what gives interstorey drifts from floors' displacements, lowest first."""
    return np.eye(count) - np.eye(count, k=-1)


def modes_of(mass: Array, stiffness: Array) -> tuple[Array, Array]:
    """Return frequencies (n,) [rad/s] and shapes (n, n) with a generalised mass of 1 kg."""
    squares, shapes = eigh(stiffness, mass)
    return np.sqrt(squares), np.asarray(shapes, np.float64)


def rayleigh_damping(
    mass: ArrayLike,
    stiffness: ArrayLike,
    ratios: Sequence[float],
    modes: Sequence[int] = (1, 2),
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
        If a matrix is not allowed in a `Structure`, or if two such modes and ratios are not given.

    Notes
    -----
    The ratio of a mode of frequency w is a / (2 w) + b w / 2. Between the two modes the ratio is
    lower, outside it is higher (Chopra, *Dynamics of Structures*, section 11.4).
    """
    bare = Structure(mass, stiffness, 0.0)
    if len(modes) != 2 or modes[0] == modes[1]:  # noqa: PLR2004 - a and b
        msg = f"structure.modes: got {modes!r}; allowed: two different modes"
        raise StructureError(msg)
    wanted = np.atleast_1d(np.asarray(ratios, np.float64))
    if wanted.shape != (2,):
        msg = f"structure.ratios: got {ratios!r}; allowed: two damping ratios, one a mode"
        raise StructureError(msg)
    places = [bare._counted("modes", mode) for mode in modes]  # noqa: SLF001 # pyright: ignore[reportPrivateUsage]
    w = bare.frequencies[places]
    a, b = np.linalg.solve(np.column_stack([0.5 / w, 0.5 * w]), _ratios(wanted))
    return a * bare.mass + b * bare.stiffness


def _numbers(name: str, value: ArrayLike) -> Array:
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        array = np.asarray("")
    if array.dtype.kind not in "fiu":
        msg = f"structure.{name}: got {value!r}; allowed: real numbers"
        raise StructureError(msg)
    numbers = array.astype(np.float64)
    if not np.isfinite(numbers).all():
        msg = f"structure.{name}: got NaN or infinity; allowed: finite numbers"
        raise StructureError(msg)
    return numbers


def _positive(name: str, value: ArrayLike) -> Array:
    numbers = _numbers(name, value)
    if numbers.ndim != 1 or len(numbers) == 0:
        msg = f"structure.{name}: got shape {numbers.shape}; allowed: (n,), one a storey"
        raise StructureError(msg)
    if numbers.min() <= 0.0:
        place = int(np.argmin(numbers))
        msg = (
            f"structure.{name}: got {numbers[place]:g} in storey {place + 1}; "
            "allowed: greater than 0"
        )
        raise StructureError(msg)
    return numbers


def _symmetric(name: str, value: ArrayLike, count: int | None) -> Array:
    """Return a symmetric matrix; of (count, count) where a count is given."""
    matrix = _numbers(name, value)
    shape = matrix.shape
    allowed = "(n, n)" if count is None else f"({count}, {count})"
    square = len(shape) == 2 and shape[0] == shape[1] > 0  # noqa: PLR2004
    if not square or (count is not None and shape[0] != count):
        msg = f"structure.{name}: got shape {shape}; allowed: {allowed}"
        raise StructureError(msg)
    difference = np.abs(matrix - matrix.T)
    if difference.max() > ASYMMETRY * np.abs(matrix).max():
        i, j = np.unravel_index(int(np.argmax(difference)), shape)
        msg = (
            f"structure.{name}: got {matrix[i, j]:g} in row {i + 1}, column {j + 1}, and "
            f"{matrix[j, i]:g} across the diagonal; allowed: a symmetric matrix"
        )
        raise StructureError(msg)
    return 0.5 * (matrix + matrix.T)


def _definite(name: str, value: ArrayLike, count: int | None) -> Array:
    matrix = _symmetric(name, value, count)
    least = float(eigh(matrix, eigvals_only=True)[0])
    if least <= ROUND_OFF * np.abs(matrix).max() * 1e-3:
        hint = {
            "mass": "condense degrees of freedom without mass",
            "stiffness": "a structure must not move without deforming",
        }[name]
        msg = (
            f"structure.{name}: got the eigenvalue {least:g}; allowed: a positive definite matrix; "
            f"{hint}"
        )
        raise StructureError(msg)
    return matrix


def _influence(value: ArrayLike | None, count: int) -> Array:
    if value is None:
        return np.ones(count)
    numbers = _numbers("influence", value)
    if numbers.shape != (count,):
        msg = f"structure.influence: got shape {numbers.shape}; allowed: ({count},)"
        raise StructureError(msg)
    if not numbers.any():
        msg = "structure.influence: got only zeros; allowed: at least one number that is not 0"
        raise StructureError(msg)
    return numbers


def _ratios(value: Array) -> Array:
    if value.min() < 0.0 or value.max() >= 1.0:
        wrong = value.min() if value.min() < 0.0 else value.max()
        msg = f"structure.damping: got a damping ratio of {wrong:g}; allowed: 0 to below 1"
        raise StructureError(msg)
    return value


def _damping(value: ArrayLike, mass: Array, stiffness: Array) -> Array:
    """Return C (n, n) of a matrix, or of damping ratios of the modes."""
    numbers = _numbers("damping", value)
    count = len(mass)
    if numbers.ndim < 2:  # noqa: PLR2004 - a matrix
        if numbers.ndim == 1 and len(numbers) != count:
            msg = (
                f"structure.damping: got {len(numbers)} damping ratios; allowed: one number, "
                f"{count} of them, or a matrix ({count}, {count})"
            )
            raise StructureError(msg)
        frequencies, shapes = modes_of(mass, stiffness)
        weighted = mass @ shapes
        return weighted @ np.diag(2.0 * _ratios(numbers.ravel()) * frequencies) @ weighted.T
    matrix = _symmetric("damping", numbers, count)
    eigenvalues = eigh(matrix, eigvals_only=True)
    if eigenvalues[0] < -ROUND_OFF * max(eigenvalues[-1], 0.0):
        msg = (
            f"structure.damping: got the eigenvalue {eigenvalues[0]:g}, which would feed energy; "
            "allowed: a positive semidefinite matrix"
        )
        raise StructureError(msg)
    return matrix
