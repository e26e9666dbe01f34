"""A linear system as matrices with names and units: the control engineer's view of a plant."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mm_gym.arrays import Array
from mm_gym.errors import DesignError, finite_numbers, refuse

REACHED = 1e-9  # part of a direction of size 1 below which it is round-off


class Signal(NamedTuple):
    """A state, an input or an output.

    Attributes
    ----------
    name, unit
        Its name and SI unit.
    point
        Its value at the point of linearisation; the system has deviations from it.
    """

    name: str
    unit: str
    point: float = 0.0


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """The system x' = A x + B u + drift, y = C x + D u; if sampled, x_next instead of x'.

    All signals are deviations from their `point`. For a linear plant about equilibrium every point
    is 0 except that of the stretch.

    Attributes
    ----------
    A, B, C, D
        (n, n), (n, m), (p, n) and (p, m) float64, SI.
    states, inputs, outputs
        Name, unit and point of each.
    drift
        (n,) rate (or step) of the state at the point itself; zero if the point is an equilibrium.
    process_noise
        (n, n): covariance that random excitation adds to the state in a control step; for a
        continuous system the intensity of white noise.
    sensor_noise
        (p, p): covariance of the sensor noise in a sample; for a continuous system the intensity
        with the same effect, covariance times control step.
    time_step
        Control step [s] of a sampled system, or None.
    dead_time
        (p,) delay of each output [s] that the states do not contain, because the system is
        continuous.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[Signal, ...]
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    drift: Array
    process_noise: Array
    sensor_noise: Array
    time_step: float | None
    dead_time: Array

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Eigenvalues (n,) in [1/s], or [-] for the map of a control step."""
        return np.linalg.eigvals(self.A).astype(np.complex128)

    def frequency_response(self, frequencies: ArrayLike) -> NDArray[np.complex128]:
        """Return the amplitudes (p, m, k) of the outputs under inputs exp(i w t).

        Parameters
        ----------
        frequencies
            (k,) w [rad/s].

        Raises
        ------
        DesignError
            If a frequency is not finite, or is that of an undamped eigenvalue.
        """
        w = np.atleast_1d(finite_numbers("frequencies", frequencies, DesignError))
        if w.ndim != 1:
            refuse("frequencies", f"shape {w.shape}", "(k,) [rad/s]", DesignError)
        s = 1j * w if self.time_step is None else np.exp(1j * w * self.time_step)
        pencil = s[:, None, None] * np.eye(len(self.A)) - self.A
        try:
            solved = np.linalg.solve(pencil, np.broadcast_to(self.B, (len(w), *self.B.shape)))
        except np.linalg.LinAlgError:
            msg = "frequencies: one is that of an eigenvalue without damping"
            raise DesignError(msg) from None
        response = self.C @ solved + self.D
        late = np.exp(-1j * np.outer(w, self.dead_time))
        return np.moveaxis(response * late[:, :, None], 0, -1).astype(np.complex128)

    def controllable(self, *, noise: bool = False) -> LinearSystem:
        """Return the subsystem that the inputs reach; the drift of a free sphere is left out.

        States that no input moves are removed. If the remaining system is still not controllable,
        its states are replaced by controllable combinations z1, z2, ...

        Parameters
        ----------
        noise
            Whether random excitation counts as an input, so that the states of its filters are
            kept.

        Raises
        ------
        DesignError
            If the inputs move no state.
        """
        moved = np.hstack([self.B, self.process_noise]) if noise else self.B
        kept = _kept_by_zeros(self.A, moved)
        if not kept.any():
            names = ", ".join(signal.name for signal in self.inputs) or "none"
            msg = f"inputs: {names} move nothing at this point; choose another point or input"
            raise DesignError(msg)
        part = self._selected(kept)
        moved = np.hstack([part.B, part.process_noise]) if noise else part.B
        basis, back = _reachable_basis(part.A, moved)
        return part if basis.shape[1] == len(part.A) else _within(part, basis, back)

    def observable(self) -> LinearSystem:
        """Return the subsystem that the outputs show: the dual of `controllable`.

        Raises
        ------
        DesignError
            If the outputs show no state.
        """
        kept = _kept_by_zeros(self.A.T, self.C.T)
        if not kept.any():
            names = ", ".join(signal.name for signal in self.outputs) or "none"
            msg = f"outputs: {names} show nothing of the states; choose other channels"
            raise DesignError(msg)
        part = self._selected(kept)
        back, basis = _reachable_basis(part.A.T, part.C.T)
        return part if back.shape[1] == len(part.A) else _within(part, basis.T, back.T)

    def to_control(self) -> Any:  # noqa: ANN401 - of an optional package
        """Return the system as `control.StateSpace`, sampled if this one is.

        Raises
        ------
        ImportError
            Without python-control (extra: agents).
        DesignError
            If the system is continuous and its outputs are delayed.
        """
        try:
            import control  # noqa: PLC0415 - optional
        except ImportError as error:
            msg = "to_control needs python-control; install the extra `agents`"
            raise ImportError(msg, name=error.name) from error
        if self.dead_time.any():
            msg = (
                f"sensors.delay: a delay of {self.dead_time.max():g} s has finitely many states "
                "only with sampled=True"
            )
            raise DesignError(msg)
        names = [
            [signal.name.replace(".", "_") for signal in signals]  # dots are python-control's own
            for signals in (self.inputs, self.outputs, self.states)
        ]
        return control.StateSpace(  # pyright: ignore[reportUnknownVariableType, reportUnknownMemberType]
            *(self.A, self.B, self.C, self.D, self.time_step or 0.0),
            inputs=names[0],
            outputs=names[1],
            states=names[2],
        )

    def _selected(self, kept: NDArray[np.bool_]) -> LinearSystem:
        """Return the system of some of the states."""
        rows = np.flatnonzero(kept)
        return replace(
            self,
            A=self.A[np.ix_(rows, rows)],
            B=self.B[rows],
            C=self.C[:, rows],
            drift=self.drift[rows],
            process_noise=self.process_noise[np.ix_(rows, rows)],
            states=tuple(self.states[row] for row in rows),
        )


def _within(system: LinearSystem, basis: Array, back: Array) -> LinearSystem:
    """Return the system of z with x = basis z and z = back x."""
    return replace(
        system,
        A=back @ system.A @ basis,
        B=back @ system.B,
        C=system.C @ basis,
        drift=back @ system.drift,
        process_noise=back @ system.process_noise @ back.T,
        states=tuple(Signal(f"z{k + 1}", "-") for k in range(basis.shape[1])),
    )


def _kept_by_zeros(a: Array, b: Array) -> NDArray[np.bool_]:
    """Return which of the n states inputs (n, m) can move, as far as exact zeros of A tell."""
    kept = (b != 0.0).any(axis=1)
    for _ in range(len(a)):
        kept = kept | ((a != 0.0) & kept).any(axis=1)
    return kept


def _reachable_basis(a: Array, b: Array) -> tuple[Array, Array]:
    """Return a basis (n, r) of what inputs reach, and its inverse on it (r, n).

    Krylov's space of B, A B, ..., orthonormal in balanced coordinates: positions and velocities
    differ by a factor of their frequency, and forces and accelerations by more.
    """
    from scipy import linalg  # noqa: PLC0415 - nothing else here needs it

    balance: Any = linalg.matrix_balance  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType] - untyped
    _, (scale, _) = balance(a, permute=False, separate=True)
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
