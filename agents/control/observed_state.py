"""The state from the observation: read off where that is exact, else estimated."""

import control
import numpy as np
from numpy.typing import NDArray

from agents.control.controller import (
    Info,
    Memory,
    Observation,
    Read,
    StateSource,
    chosen,
    looked_up,
)
from agents.control.kalman_state import KalmanState
from agents.control.model import covariance, model_of, state_scales
from agents.control.observed_actuators import ObservedActuators
from agents.control.scene import plant_of
from mm_gym import DesignError, Scene
from mm_gym.arrays import Array

FLOOR = 1e-4
"""Least noise of a channel over its scale [-], so that the equations stay well conditioned."""


DELAY, MISLEADING = "sensors.delay", ("sensors.dropout", "sensors.bias.")


class ObservedState(ObservedActuators):
    """Estimate the state from what an agent observes.

    Without noise, bias and dropout, if the channels show the whole state, it is read off. Otherwise
    the scene's own model, which knows no disturbance, predicts each frame, and the frame corrects
    it by the gain of the stationary Kalman filter (`control.dlqe`) of the plant linearised about
    rest; the covariance of what disturbs the model is measured on simulated episodes. From a late
    frame the model predicts the present. Raise `DesignError` if the channels do not show the state:
    it is not detectable from them.

    Parameters
    ----------
    delays
        Of the sensors [control steps]; by default that of the scene. Of several, each lane may have
        another one, and the memory says how unlikely its frames were: the sum of the squares of
        what the model missed, over the covariance that the filter expects of it.
    """

    tunes = ("stretch",)

    def __init__(self, scene: Scene, delays: range | None = None) -> None:
        super().__init__(scene)
        self.scene = scene
        self.is_weighed, delay = delays is not None, plant_of(scene).delay
        self.delays = range(delay, delay + 1) if delays is None else delays
        noise = self.frame.noise[self.shown]
        self.noise = np.maximum(noise, FLOOR * self.unit)
        whole = bool(self.shown) and np.linalg.matrix_rank(self.c) == 4  # noqa: PLR2004
        # Sensors may be biased, or show a frame again.
        drawn = any(name.startswith(MISLEADING) for name in scene.randomization)
        wrong = drawn or scene.sensors.dropout > 0.0 or any(scene.sensors.bias.values())
        self.exact = bool(whole and not (noise.any() or wrong or self.is_weighed))
        self.inverse = np.linalg.pinv(self.c)
        self.gains = self.inverse[None] if self.exact else self._gains()
        self.model = model_of(scene) if self.delays[-1] > 0 or not self.exact else None

    def begin(self, lanes: int) -> Memory:
        """Begin before the first frame.

        What was applied since the frame before the newest one is pending; "own" are the interface's
        own states at the estimate.
        """
        begun = super().begin(lanes)
        if self.model is None:
            return begun
        begun |= {
            "estimate": np.zeros((lanes, 4)),
            "own": self.model.at_rest(lanes),
            "pending": np.zeros((lanes, self.delays[-1] + 1, len(self.begun))),
        }
        if self.is_weighed:
            begun |= {"delay": np.full(lanes, self.delays[0]), "unlikely": np.zeros(lanes)}
        return begun

    def read(self, memory: Memory, observation: Observation, info: Info) -> Read:
        frame = self.frame.values(observation)
        if self.model is None:  # the newest frame shows the present state
            memory = self._seen(memory, frame)
            return frame[:, self.shown] @ self.inverse.T, memory["applied"], memory
        step, delay = memory["step"], self._delay(memory)
        shown, estimate, own = frame[:, self.shown], memory["estimate"], memory["own"]
        if (step == 0).any():
            estimate = chosen(step == 0, shown @ self.inverse.T, estimate)
        predicted, later = estimate, step > delay
        applied = looked_up(memory["pending"], self.delays[-1] - delay)
        nearest = self.nearest(applied)
        if later.any():
            moved, moved_own = self._predicted(estimate, own, applied)
            predicted, own = chosen(later, moved, estimate), chosen(later, moved_own, own)
            estimate = chosen(later, self._corrected(predicted, shown, nearest), estimate)
        memory = {**self._seen(memory, frame), "estimate": estimate, "own": own}
        if self.is_weighed:
            missed = (shown - predicted @ self.c.T) / self.unit
            squared = np.einsum("ni,nij,nj->n", missed, self.precisions[nearest], missed)
            memory["unlikely"] = memory["unlikely"] + squared
        return self._present(memory, np.minimum(step, delay)), memory["applied"], memory

    def note(self, memory: Memory, action: Array) -> Memory:
        memory = super().note(memory, action)
        if self.model is None:
            return memory
        pending = np.concatenate([memory["pending"][:, 1:], memory["applied"][:, None]], axis=1)
        return {**memory, "pending": pending}

    def _delay(self, memory: Memory) -> NDArray[np.int64]:
        return memory.get("delay", np.full(len(memory["step"]), self.delays[0]))

    def _predicted(self, estimate: Array, own: Array, applied: Array) -> tuple[Array, Array]:
        """Return the states and own states a step later, as far as a model is asked for them."""
        assert self.model is not None  # noqa: S101 - asked for
        if self.exact and not self.model.own_rows:
            return estimate, own
        self.model.begin(estimate, own)
        return self.model.advance(applied)[0].copy(), self.model.own

    def _corrected(self, predicted: Array, shown: Array, nearest: NDArray[np.intp]) -> Array:
        """Return the estimate at the frame that has come: read off, or the prediction corrected."""
        if self.exact:
            return shown @ self.gains[0].T
        missed = shown - predicted @ self.c.T
        return predicted + np.einsum("nij,nj->ni", looked_up(self.gains[None], nearest), missed)

    def _present(self, memory: Memory, late: NDArray[np.int64]) -> Array:
        """Return the state now: the newest frame's, moved on by what was applied since.

        That are so many steps (lanes,): an episode's first frame is not late.
        """
        present, pending = memory["estimate"], memory["pending"]
        assert self.model is not None  # noqa: S101 - as below
        if not late.any():
            return present
        self.model.begin(present, memory["own"])
        first = pending.shape[1] - late
        for moved in range(self.delays[-1]):
            place = np.minimum(first + moved, pending.shape[1] - 1)
            state, _ = self.model.advance(looked_up(pending, place))
            present = chosen(late == moved + 1, state, present)
        return present

    def _gains(self) -> Array:
        plant = plant_of(self.scene)
        names = ", ".join(plant.channels)
        if not self.shown:
            msg = f"sensors.channels: the state cannot be estimated from {names}"
            raise DesignError(msg)
        # In units of the scales, in which the Riccati equation is well conditioned.
        scene, units, kept = self.scene, state_scales(self.scene), [0, 1, 2, 3]
        free = scene.interface.kind == "none" and scene.springs.kind == "none"
        if free and not scene.actuation.is_between and not self.c[:, [1, 3]].any():
            kept = [0, 2]  # not a sphere that nothing shows and nothing couples
        units, rows = units[kept], np.ix_(kept, kept)
        c = self.c[:, kept] * units / self.unit[:, None]
        disturbance = covariance(self.scene)[rows] / np.outer(units, units)
        noise = np.diag((self.noise / self.unit) ** 2)
        gains: list[Array] = []
        self.spreads: list[Array] = []  # covariances of the estimate at the newest frame
        precisions: list[Array] = []
        for stretch in self.grid:
            a = plant.discrete(stretch)[0][rows] * units / units[:, None]
            try:
                _, p, _ = control.dlqe(a, np.eye(len(a)), c, disturbance, noise, method="scipy")
            except (np.linalg.LinAlgError, control.ControlArgument, ValueError) as error:
                msg = f"sensors.channels: the state cannot be estimated from {names}: {error}"
                raise DesignError(msg) from error
            precisions.append(np.linalg.inv(c @ p @ c.T + noise))
            gain = p @ c.T @ precisions[-1]
            whole, spread = np.zeros((4, len(self.unit))), np.zeros((4, 4))
            whole[kept] = gain * units[:, None] / self.unit
            spread[rows] = (np.eye(len(a)) - gain @ c) @ p * np.outer(units, units)
            gains.append(whole)
            self.spreads.append(spread)
        self.precisions = np.stack(precisions)  # of what is missed of a frame over its units
        return np.stack(gains)


class ObservedDelay(StateSource):
    """Estimate the state where each episode draws the delay of its sensors.

    A lane has an estimate for each delay, and the state is that under which the frames of the
    episode so far were least unlikely: an action shows in the frames as late as they are. Anderson
    and Moore, *Optimal Filtering* (1979), chapter 10. Raise `DesignError` as `ObservedState` does.

    Parameters
    ----------
    source
        Of several delays.
    """

    def __init__(self, source: ObservedState) -> None:
        self.source, self.count = source, len(source.delays)

    def begin(self, lanes: int) -> Memory:
        memory = self.source.begin(lanes * self.count)
        memory["delay"] = np.tile(self.source.delays, lanes)
        return self._by_lane(memory)

    def read(self, memory: Memory, observation: Observation, info: Info) -> Read:
        each = np.repeat(observation, self.count, axis=0)
        states, applied, after = self.source.read(self._by_estimate(memory), each, info)
        unlikely = np.nan_to_num(after["unlikely"], nan=np.inf)  # a model may have grown too far
        likeliest = np.argmin(unlikely.reshape(-1, self.count), axis=1)
        rows = np.arange(len(likeliest)) * self.count + likeliest
        return states[rows], applied[rows], self._by_lane(after)

    def note(self, memory: Memory, action: Array) -> Memory:
        each = np.repeat(action, self.count, axis=0)
        return self._by_lane(self.source.note(self._by_estimate(memory), each))

    def observed(self, state: Array) -> tuple[list[int], Array]:
        """Return what an observation shows, as `ObservedState` does."""
        return self.source.observed(state)

    def _by_lane(self, memory: Memory) -> Memory:
        """Return arrays (lanes, delays, ...) of those (lanes * delays, ...) of all estimates."""
        return {
            name: array.reshape(len(array) // self.count, self.count, *array.shape[1:])
            for name, array in memory.items()
        }

    def _by_estimate(self, memory: Memory) -> Memory:
        return {
            name: array.reshape(len(array) * self.count, *array.shape[2:])
            for name, array in memory.items()
        }


def observed_state(scene: Scene, make: type[ObservedState] = ObservedState) -> StateSource:
    """Return what estimates the state from the observation, also where its delay is drawn.

    Where only accelerations tell the state, it is the Kalman filter, which knows the excitation.
    """
    try:
        if DELAY not in scene.randomization:
            return make(scene)
        low, high = scene.randomization[DELAY]
        return ObservedDelay(make(scene, range(int(low), int(high) + 1)))
    except DesignError:
        if make is not ObservedState:
            raise
        return KalmanState(scene)


def missed_covariance(scene: Scene) -> Array:
    """Return what estimates add to how states differ from the model's prediction, a covariance.

    A step's difference has the errors of the estimates before and after it. They are taken as
    independent, which overrates them; of a range of stretches the middle one counts.

    Returns
    -------
    ndarray
        (4, 4) of x1, x2 [m], v1, v2 [m/s]; 0 where the sensors show the present state exactly, and
        where they do not show it, so that only the true state can be fed back.
    """
    try:
        source = ObservedState(scene)
    except DesignError:
        return np.zeros((4, 4))
    if source.exact and not source.delays[-1]:
        return np.zeros((4, 4))
    middle = len(source.grid) // 2
    spread = np.zeros((4, 4)) if source.exact else source.spreads[middle]
    turn, disturbance = plant_of(scene).discrete(source.grid[middle])[0], covariance(scene)
    for _ in range(source.delays[-1]):
        spread = turn @ spread @ turn.T + disturbance
    return spread + turn @ spread @ turn.T
