"""The states that inputs reach: by the zeros of the matrices, and by their numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

REACHED = 1e-9
"""Part of a direction of size 1 below which it is round-off."""

ROUNDS = 200
"""Most rounds of balancing; a few suffice."""


def kept_by_zeros(a: Array, b: Array) -> NDArray[np.bool_]:
    """Return which of the n states inputs (n, m) can move, as far as exact zeros of A tell."""
    kept = (b != 0.0).any(axis=1)
    for _ in range(len(a)):
        kept = kept | ((a != 0.0) & kept).any(axis=1)
    return kept


def reachable_basis(a: Array, b: Array) -> tuple[Array, Array]:
    """Return a basis (n, r) of what inputs reach, and its inverse on it (r, n).

    Krylov's space of B, A B, ..., orthonormal in balanced coordinates: positions and velocities
    differ by a factor of their frequency, and forces and accelerations by more.
    """
    scale = _balance(a)
    generator = a * scale / scale[:, None]
    start = b / scale[:, None]
    sizes = np.linalg.norm(start, axis=0)
    start = start[:, sizes > 0.0] / sizes[sizes > 0.0]
    generator = generator / max(np.linalg.norm(generator, 2), np.finfo(np.float64).tiny)
    basis = np.zeros((len(a), 0))
    while start.shape[1]:
        for _ in range(2):  # twice is enough (Kahan and Parlett)
            start = start - basis @ (basis.T @ start)
        left, spread, _ = np.linalg.svd(start, full_matrices=False)
        new = left[:, spread > REACHED]
        basis = np.hstack([basis, new])
        start = generator @ new
    return scale[:, None] * basis, basis.T / scale


def _balance(a: Array) -> Array:
    """Return a scale (n,) of powers of 2 with which rows and columns of A have like sizes."""
    scale, size = np.ones(len(a)), np.abs(a)
    np.fill_diagonal(size, 0.0)
    for _ in range(ROUNDS):
        balanced = size * scale / scale[:, None]
        rows, columns = balanced.sum(axis=1), balanced.sum(axis=0)
        some = (rows > 0.0) & (columns > 0.0)
        factor = np.ones(len(a))
        factor[some] = 2.0 ** np.clip(np.rint(0.25 * np.log2(rows[some] / columns[some])), -8, 8)
        if (factor == 1.0).all():
            break
        scale = scale * factor
    return scale
