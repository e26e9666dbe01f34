"""The state from the observation: read off where that is exact, else estimated."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import control
import numpy as np

from agents.controllers.actuators import Actuators
from agents.controllers.controller import columns
from agents.controllers.disturbance import covariance, state_scales
from agents.controllers.model import Model
from mm_gym import DesignError, compile_scene

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from agents.controllers.controller import Reads, Values
    from mm_gym import Scene

ROWS = {
    "carriage_displacement": (1.0, 0.0, 0.0, 0.0),
    "sphere_displacement": (0.0, 1.0, 0.0, 0.0),
    "sphere_offset": (-1.0, 1.0, 0.0, 0.0),
    "carriage_velocity": (0.0, 0.0, 1.0, 0.0),
    "sphere_velocity": (0.0, 0.0, 0.0, 1.0),
    "slip_velocity": (0.0, 0.0, -1.0, 1.0),
}
"""The channels that show the state: rows of C in y = C x. The others are not used."""

FLOOR = 1e-4
"""Least noise of a channel over its scale [-], so that the equations stay well conditioned."""

STRETCHES = 9
"""Number of stretches at which the estimator's gain is computed; the nearest is used."""


class ObservedActuators:
    """What the actuators have, from the first frame and the actions since; the state reads zero.

    It is all that a law needs which does not read the state, whatever the sensors show.
    """

    reads: Reads = "observation"

    def __init__(self, scene: Scene) -> None:
        plant = compile_scene(scene)
        self.scene, self.frame = scene, len(plant.observed)
        self.zero = np.array([channel.zero for channel in plant.observed])
        self.unit = np.array([1.0 / channel.factor for channel in plant.observed])
        self.tuned = {  # column of an action -> that of the channel which shows what it tunes
            k: plant.channels.index(name)
            for k, name in enumerate(columns(scene))
            if name in plant.channels
        }

    def begin(self, lanes: int) -> None:
        """Forget the last episodes."""
        self.actuators = Actuators(self.scene)
        self.step = 0

    def read(self, observation: NDArray[np.float32], info: dict[str, Any]) -> tuple[Values, Values]:
        """Return zeros, and what the actuators have."""
        if self.step == 0:
            self.actuators.begin(self._first_applied(self._newest(observation)))
        self.step += 1
        return np.zeros((len(observation), 4)), self.actuators.applied

    def send(self, action: Values) -> None:
        """Advance the model of the actuators."""
        self.actuators.advance(action)

    def _newest(self, observation: NDArray[np.float32]) -> Values:
        """Return the newest frame, in the channels' units."""
        return observation[:, -self.frame :] * self.unit + self.zero

    def _first_applied(self, frame: Values) -> Values:
        """Return first stretch and damping as observed, else as the scene begins; no force."""
        actuators, lanes = self.actuators, len(frame)
        begun = [_beginning(self.scene, name) for name in columns(self.scene)]
        applied = np.tile(np.clip(begun, actuators.low, actuators.high), (lanes, 1))
        for k, channel in self.tuned.items():
            applied[:, k] = np.clip(frame[:, channel], actuators.low[k], actuators.high[k])
        return applied


def _beginning(scene: Scene, name: str) -> float:
    """Return what an actuator has when an episode begins, the middle of a range."""
    if name == "stretch":
        start = scene.initial.stretch
        values = scene.springs.stretch if start is None else start
    elif name in {"damping", "voltage"}:
        damped = str(scene.actuation.damped)
        part, field = damped.split(".")
        values = scene.range_of(damped, getattr(getattr(scene, part), field))
    else:
        return 0.0
    return float(np.mean(values))


class ObservedState(ObservedActuators):
    """Estimate the state from what an agent observes.

    Without noise, if the channels show the whole state, it is read off. Otherwise the scene's own
    model, which knows no disturbance, predicts each frame, and the frame corrects it by the gain of
    the stationary Kalman filter (`control.dlqe`) of the plant linearised about rest; the covariance
    of what disturbs the model is measured on simulated episodes. From a late frame the model
    predicts the present.

    Raises
    ------
    DesignError
        If the channels do not show the state: it is not detectable from them.
    """

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        plant = compile_scene(scene)
        self.delay = plant.delay
        self.shown = [i for i, name in enumerate(plant.channels) if name in ROWS]
        self.c = np.array([ROWS[plant.channels[i]] for i in self.shown]).reshape(-1, 4)
        noise = np.array([plant.observed[i].noise for i in self.shown])
        self.noise = np.maximum(noise, FLOOR * self.unit[self.shown])
        whole = bool(self.shown) and np.linalg.matrix_rank(self.c) == 4  # noqa: PLR2004
        self.exact = bool(whole and not noise.any())
        self.predicts = self.delay > 0 or not self.exact
        self.gains = np.linalg.pinv(self.c)[None] if self.exact else self._gains()

    def begin(self, lanes: int) -> None:
        """Forget the last episodes."""
        super().begin(lanes)
        self.model = Model(self.scene, lanes) if self.predicts else None
        self.own = None if self.model is None else self.model.own  # at the estimate
        self.pending: list[Values] = []

    def read(self, observation: NDArray[np.float32], info: dict[str, Any]) -> tuple[Values, Values]:
        """Return the present estimates."""
        frame = self._newest(observation)
        shown = frame[:, self.shown]
        if self.step == 0:
            self.actuators.begin(self._first_applied(frame))
            self.estimate = shown @ np.linalg.pinv(self.c).T
        elif self.step > self.delay:
            self.estimate = self._next(self.pending.pop(0), shown)
        self.step += 1
        return self._present(), self.actuators.applied

    def send(self, action: Values) -> None:
        """Advance the model of the actuators."""
        self.pending.append(self.actuators.advance(action))

    def _next(self, applied: Values, shown: Values) -> Values:
        """Return the estimate at the frame that has come: read off, or predicted and corrected."""
        predicted = self.estimate
        if self.model is not None and (self.model.own_rows or not self.exact):
            self.model.begin(self.estimate, self.own)
            predicted = self.model.advance(applied)[0].copy()
            self.own = self.model.own
        if self.exact:
            return shown @ self.gains[0].T
        gain = self.gains[self._nearest(applied)]
        missed = shown - predicted @ self.c.T
        return predicted + np.einsum("nij,nj->ni", gain, missed)

    def _present(self) -> Values:
        """Return the state now: the newest frame's, moved on by what was applied since."""
        if self.model is None or not self.pending:
            return self.estimate
        self.model.begin(self.estimate, self.own)
        for applied in self.pending:
            state, _ = self.model.advance(applied)
        return state.copy()

    def _grid(self) -> list[float | None]:
        actuator = self.scene.actuation.stretch
        if actuator is None:
            return [None]
        return [float(s) for s in np.linspace(actuator.minimum, actuator.maximum, STRETCHES)]

    def _nearest(self, applied: Values) -> NDArray[np.intp]:
        """Return the index of each lane's stretch in the grid."""
        actuator = self.scene.actuation.stretch
        if actuator is None:
            return np.zeros(len(applied), np.intp)
        stretch = applied[:, columns(self.scene).index("stretch")]
        share = (stretch - actuator.minimum) / (actuator.maximum - actuator.minimum)
        return np.rint(share * (STRETCHES - 1)).astype(np.intp)

    def _gains(self) -> Values:
        """Return the filter's gains (stretches, 4, channels)."""
        plant = compile_scene(self.scene)
        names = ", ".join(plant.channels)
        if not self.shown:
            msg = f"sensors.channels: the state cannot be estimated from {names}"
            raise DesignError(msg)
        # In units of the scales, in which the Riccati equation is well conditioned.
        units = state_scales(self.scene)
        c = self.c * units / self.unit[self.shown, None]
        disturbance = covariance(self.scene) / np.outer(units, units)
        noise = np.diag((self.noise / self.unit[self.shown]) ** 2)
        gains: list[Values] = []
        for stretch in self._grid():
            a = plant.discrete(stretch)[0] * units / units[:, None]
            try:
                _, p, _ = control.dlqe(a, np.eye(4), c, disturbance, noise, method="scipy")
            except (np.linalg.LinAlgError, control.ControlArgument, ValueError) as error:
                msg = f"sensors.channels: the state cannot be estimated from {names}: {error}"
                raise DesignError(msg) from error
            gain = p @ c.T @ np.linalg.inv(c @ p @ c.T + noise)
            gains.append(gain * units[:, None] / self.unit[self.shown])
        return np.stack(gains)
