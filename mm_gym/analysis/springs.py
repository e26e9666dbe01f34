"""Stiffness, force and energy of pre-stretched springs, and the stretch for a stiffness."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.errors import refuse
from mm_gym.law import springs


def spring_stiffness(stretch: ArrayLike, k0: ArrayLike) -> Array:
    """Return k2 [N/m] of springs about equilibrium: 2 k0 (1 + 2 / stretch**3).

    Parameters
    ----------
    stretch
        Pre-stretch [-], greater than 0. A scene's springs have at least 1: below it they would be
        compressed, and buckle.
    k0
        ``springs.stiffness`` [N/m].

    Raises
    ------
    SceneError
        If a stretch is 0 or negative, which no spring has.
    """
    stretched = np.asarray(stretch, np.float64)
    if (stretched <= 0.0).any():
        refuse("stretch", f"{stretched.min():g}", "greater than 0; in a scene, at least 1")
    return plain(springs.stiffness)(np.asarray(k0, np.float64), stretched)


def stretch_for_stiffness(k2: ArrayLike, k0: ArrayLike) -> Array:
    """Return the stretch [-] at which the springs have a given stiffness.

    Parameters
    ----------
    k2
        Stiffness [N/m]. The springs reach 2 k0 < k2 <= 6 k0: 2 k0 or less gives an infinite
        stretch, more than 6 k0 a stretch below 1, which a scene refuses.
    k0
        ``springs.stiffness`` [N/m].
    """
    excess = np.divide(k2, 2.0 * np.asarray(k0, np.float64)) - 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(excess > 0.0, (2.0 / excess) ** (1.0 / 3.0), np.inf)


def spring_force(offset: ArrayLike, stretch: ArrayLike, k0: float, l0: float = 0.0) -> Array:
    """Return the force [N] of the springs on the carriage; the sphere feels the opposite.

    Parameters
    ----------
    offset, stretch, k0, l0
        As for `spring_energy`.
    """
    stretched, moved = np.asarray(stretch, np.float64), np.asarray(offset, np.float64)
    return plain(springs.spring_force)(k0, l0, stretched, moved)


def spring_energy(offset: ArrayLike, stretch: ArrayLike, k0: float, l0: float = 0.0) -> Array:
    """Return the energy [J] of the springs above that with the sphere centred.

    Like the force, it is NaN where a spring of finite stretch is as short as nothing: where the
    magnitude of the offset is stretch times l0, or more.

    Parameters
    ----------
    offset
        x2 - x1 [m].
    stretch
        Pre-stretch [-], at least 1.
    k0
        ``springs.stiffness`` [N/m].
    l0
        ``springs.rest_length`` [m] of springs of finite stretch, or 0.
    """
    stretched, moved = np.asarray(stretch, np.float64), np.asarray(offset, np.float64)
    held = np.abs(moved) < stretched * l0 if l0 else True
    return np.where(held, plain(springs.spring_energy)(k0, l0, stretched, moved), np.nan)
