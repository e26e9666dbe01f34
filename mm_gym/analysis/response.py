"""Steady harmonic response of the linear plant about rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mm_gym.analysis.values import linear_values
from mm_gym.errors import SceneError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from mm_gym.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Complex amplitudes of x1 and x2 (the columns) for excitations exp(i w t).

    Attributes
    ----------
    frequencies
        (n,) [rad/s].
    force
        (n, 2) complex128 [m/N]: per unit force on the carriage, the receptance.
    ground
        (n, 2) complex128 [s^2]: per unit acceleration of the ground, displacements relative to it.
    """

    frequencies: NDArray[np.float64]
    force: NDArray[np.complex128]
    ground: NDArray[np.complex128]


def frequency_response(scene: Scene, frequencies: ArrayLike) -> FrequencyResponse:
    """Return the response to harmonic excitation at each frequency, eq. 20 of docs/model.md.

    A range enters with its middle, a cubic spring with its tangent, dry friction with its slope in
    stick.

    Parameters
    ----------
    frequencies
        (n,) [rad/s], greater than 0: at rest a free sphere has no definite place.

    Raises
    ------
    SceneError
        If a frequency is not a positive number.

    Notes
    -----
    Infinite at the frequency of an undamped resonance.
    """
    w = np.atleast_1d(np.asarray(frequencies, np.float64))
    if w.ndim != 1 or not np.all(np.isfinite(w) & (w > 0.0)):
        msg = "frequencies: allowed: a row of finite frequencies greater than 0 rad/s"
        raise SceneError(msg)
    m1, m2, k1, k2, c, d = linear_values(scene)
    s = 1j * w
    coupling = k2 + c * s
    # With the sphere's row divided by s no digits cancel at low frequency without springs.
    carriage, sphere, link = k1 + m1 * s * s + d * s, m2 * s, coupling / s
    # det / s = carriage (sphere + link) + sphere coupling
    determinant = carriage * (sphere + link) + sphere * coupling
    with np.errstate(divide="ignore", invalid="ignore"):
        force = np.column_stack([(sphere + link) / determinant, link / determinant])
        # The ground pushes the masses with -m1 and -m2.
        x1 = -(m1 * (sphere + link) + m2 * link) / determinant
        x2 = -(m2 * (carriage + coupling) / s + m1 * link) / determinant
    return FrequencyResponse(frequencies=w, force=force, ground=np.column_stack([x1, x2]))
