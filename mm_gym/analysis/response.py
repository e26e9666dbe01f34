"""Steady harmonic response of the linear plant about equilibrium."""

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
    """Complex amplitudes of x1 and x2 (the columns) under excitation exp(i w t).

    Attributes
    ----------
    frequencies
        (n,) [rad/s].
    force
        (n, 2) complex128 [m/N]: receptance, per unit force on the carriage.
    ground
        (n, 2) complex128 [s^2]: per unit acceleration of the ground; displacements are relative to
        the ground.
    """

    frequencies: NDArray[np.float64]
    force: NDArray[np.complex128]
    ground: NDArray[np.complex128]


def frequency_response(scene: Scene, frequencies: ArrayLike) -> FrequencyResponse:
    """Return the steady response to harmonic excitation (eq. 20 of docs/model.md).

    A range is replaced by its middle, a cubic spring by its tangent, and dry friction by its slope
    in stick. With ``carriage.linear_coefficient`` < 0 the equilibrium x1 = 0 is unstable. No motion
    then approaches the returned steady solution by itself, but a control design needs it.

    Parameters
    ----------
    scene
        Any scene; its own excitation is ignored.
    frequencies
        (n,) [rad/s], greater than 0, because a free sphere has no definite equilibrium.

    Returns
    -------
    FrequencyResponse
        Amplitudes of x1 and x2 per unit force [m/N] and per unit ground acceleration [s^2]; they
        are infinite at an undamped resonance.

    Raises
    ------
    SceneError
        If a frequency is not a finite number greater than 0.
    """
    w = np.atleast_1d(np.asarray(frequencies, np.float64))
    if w.ndim != 1 or not np.all(np.isfinite(w) & (w > 0.0)):
        msg = "frequencies: allowed: a one-dimensional array of finite numbers greater than 0 rad/s"
        raise SceneError(msg)
    m1, m2, k1, k2, c, d = linear_values(scene)
    s = 1j * w
    coupling = k2 + c * s
    # The sphere's row is divided by s, or digits cancel at low frequencies without springs.
    carriage, sphere, link = k1 + m1 * s * s + d * s, m2 * s, coupling / s
    # det / s = carriage (sphere + link) + sphere coupling
    determinant = carriage * (sphere + link) + sphere * coupling
    with np.errstate(divide="ignore", invalid="ignore"):
        force = np.column_stack([(sphere + link) / determinant, link / determinant])
        # The ground pushes the masses with -m1 and -m2.
        x1 = -(m1 * (sphere + link) + m2 * link) / determinant
        x2 = -(m2 * (carriage + coupling) / s + m1 * link) / determinant
    return FrequencyResponse(frequencies=w, force=force, ground=np.column_stack([x1, x2]))
