"""What an observation shows; what a linear memory tells: the state, or a force to come."""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg import solve_discrete_lyapunov

from agents.control.kalman_filter import design_filter, excited_system, state_units, told_by
from agents.control.observed_actuators import ROWS, Frame
from agents.control.scene import ENDLESS, plant_of
from agents.controllers.lqg import DISTURBANCES
from agents.training.config import FUTURE
from mm_gym import CompileError, DesignError, LinearSystem, MovingMassVectorEnv, Scene
from mm_gym.arrays import Array

MOST_STATES = 64
"""Of the memory of a filter. Each late frame adds some; where there are more, the memory is reduced
to what it tells: of many late channels hardly more than the last actions."""

TOLD = 1e-6
"""Part of what a state of a memory tells, over the state that tells most, below which it is left
out where the memory is reduced."""

LANES, STEPS, SEED = 64, 300, 3_000_000
"""Episodes and steps that are simulated for a memory, apart from those of any evaluation."""

PAST = 32  # control steps that foretell a force
LONGEST = 0.98  # largest eigenvalue of a memory: what is older than some 50 steps is forgotten


class Estimate(NamedTuple):
    """What tells the state x1, x2, v1, v2 [m, m/s], of an observation and a linear memory."""

    state: Array  # (4, n + m): the state is nearest to `state` @ (observation, memory)
    # keep, enter: (m, m), (m, n), the memory
    keep: Array
    enter: Array


class Shown(Frame):
    """What an observation (n,) shows; the newest frame is the last.

    Parameters
    ----------
    scene
        What is observed.
    filtered
        Whether switching functions may read a Kalman filter's estimate.

    Attributes
    ----------
    count
        Numbers of an observation.
    actions
        Number of actuators.
    state
        (4, n): the state x1, x2, v1, v2 [m, m/s] is nearest to `state` @ observation.
    """

    def __init__(self, scene: Scene, *, filtered: bool = False) -> None:
        super().__init__(scene)
        self.scene, self.filtered, self.history = scene, filtered, plant_of(scene).history
        self.count, self.actions = len(self.names) * self.history, len(scene.actuation.names)
        self.state = self.frame_state(0)

    def frame_state(self, age: int) -> Array:
        """Return `state` of the frame so many steps ago."""
        rows = np.array([ROWS.get(name, np.zeros(4)) for name in self.names])
        state = np.zeros((4, self.history, len(self.names)))
        state[:, -1 - age] = np.linalg.pinv(rows) * self.unit
        return state.reshape(4, -1)

    def mean_force(self, age: int = 0) -> Array:
        """Return (n,) weights of the mean force on the carriage [N] in a control step.

        It follows from two frames: it changes the momentum, and balances damper and carriage
        spring, whatever the sphere's springs do. The integral of the spring's force is that of
        Hermite's cubic, of error (step w)^4 / 720.
        """
        x1, _, v1, v2 = self.frame_state(age)
        past = self.frame_state(age + 1)
        step, carriage = self.scene.control.time_step, self.scene.carriage
        momentum = carriage.mass * (v1 - past[2]) + self.scene.sphere.mass * (v2 - past[3])
        displacement = 0.5 * (x1 + past[0]) - step / 12.0 * (v1 - past[2])
        stiffness = carriage.stiffness * carriage.linear_coefficient
        return (momentum + carriage.damping * (x1 - past[0])) / step + stiffness * displacement

    def estimates(
        self, at: dict[str, float] | None = None, *, moving: bool = False
    ) -> list[Estimate]:
        """Return what tells the state, of which the best is to be found.

        That are the newest frame, and Kalman filters where switching functions may read them.

        Parameters
        ----------
        at
            Fields of the scene that are changed for the filters, by dotted name.
        moving
            Whether velocities that no channel shows are differences of two frames'.
        """
        state, plant, nothing = self.state.copy(), plant_of(self.scene), np.empty((0, 0))
        if moving and self.history > 1:
            passed = (state[:2] - self.frame_state(1)[:2]) / self.scene.control.time_step
            hidden = ~state[2:].any(axis=1)
            state[2:][hidden] = passed[hidden]
        found = [Estimate(state, nothing, nothing)]
        for unmodelled in DISTURBANCES if self.filtered else ():
            with suppress(CompileError, DesignError):
                system = excited_system(self.scene, at=at)
                gains = design_filter(self.scene, system, unmodelled).filters[-1]
                units = state_units(self.scene, plant, system)
                _, keep, enter = self.memory_of(system, gains, units)
                keep, enter, told = reduced(keep, enter, np.eye(4, len(keep)) * units[:4, None])
                found.append(Estimate(np.hstack([np.zeros((4, self.count)), told]), keep, enter))
        return found

    def memory_of(
        self, system: LinearSystem, gains: Array, units: Array
    ) -> tuple[Array, Array, Array]:
        """Return 1 - F C of a filter's gains F, and `keep` and `enter` of the memory that it is.

        The memory is the estimate x = (1 - F C) A x + F y, each state over its unit, of the newest
        frame y.
        """
        corrected = np.eye(len(system.A)) - gains @ system.C
        keep = corrected @ system.A * units / units[:, None]
        shown = [self.names.index(signal.name) for signal in system.outputs]
        enter = np.zeros((len(keep), self.count))
        enter[:, self.columns[shown]] = gains * self.unit[shown] / units[:, None]
        return corrected, keep, enter

    def stretch(self) -> Array | None:
        """Return (1 + n,) bias and weights of the stretch, or None if it is not shown."""
        if "stretch" not in self.names:
            return None
        row, column = np.zeros(1 + self.count), self.names.index("stretch")
        row[0], row[self.columns[column]] = self.zero[column], self.unit[column]
        return row


def reduced(keep: Array, enter: Array, told: Array) -> tuple[Array, Array, Array]:
    """Return a memory and what is told of it (p, m), with fewer states where they are too many.

    Moore, *Principal component analysis in linear systems*, IEEE Trans. Autom. Control 26 (1981):
    those states are left out that inputs hardly excite, or that are hardly told. Inputs that do not
    follow from another excite each of the others by one.
    """
    if len(keep) <= MOST_STATES:
        return keep, enter, told
    matters = told_by(keep, told.any(axis=0))
    keep, enter, told = keep[np.ix_(matters, matters)], enter[matters], told[:, matters]
    excited = solve_discrete_lyapunov(keep, enter @ enter.T)
    seen = solve_discrete_lyapunov(keep.T, told.T @ told)
    sizes, turned = np.linalg.eigh(excited)
    root = turned * np.sqrt(np.maximum(sizes, 0.0))
    parts, principal = np.linalg.eigh(root.T @ seen @ root)  # squares, the least first
    first = max(len(keep) - MOST_STATES, np.searchsorted(parts, TOLD**2 * parts[-1]))
    back = root @ principal[:, first:]
    to = (seen @ back / parts[first:]).T
    return to @ keep @ back, to @ enter, told @ back


def force_memory(shown: Shown, states: int) -> tuple[Array, Array]:
    """Return `keep` (m, m) and `enter` (m, n) of a `LinearMemory` that foretells a random force.

    The force of each step follows from two frames of the observation. Its best linear prediction
    from the past has few states: those combinations of the past that tell most of the future
    (Akaike, *Markovian representation of stochastic processes by canonical variables*, SIAM J.
    Control 13, 1975). They are fitted to episodes under random actions, in a tenth of a second, and
    have unit variance.

    Parameters
    ----------
    shown
        Of a scene of random excitation.
    states
        m, at most `FUTURE`.
    """
    scene = shown.scene.replace(**ENDLESS, **{"control.steps": STEPS})
    env = MovingMassVectorEnv(scene, LANES, info="none")
    observation, _ = env.reset(seed=SEED)
    generator, weights = np.random.default_rng(SEED), shown.mean_force()
    forces: list[Array] = []
    for _ in range(STEPS - 1):
        observation, *_ = env.step(generator.uniform(-1.0, 1.0, env.action_space.shape))
        forces.append(observation @ weights)
    force = np.array(forces[2:])  # without those of the first frames
    past = sliding_window_view(force[: len(force) - FUTURE], PAST, axis=0)
    future = sliding_window_view(force[PAST:], FUTURE, axis=0)
    predicted = past @ np.linalg.lstsq(np.vstack(past), np.vstack(future), rcond=None)[0]
    variances, directions = np.linalg.eigh(np.cov(np.vstack(predicted), rowvar=False))
    best = slice(None, -states - 1, -1)
    memory = predicted @ (directions[:, best] / np.sqrt(variances[best]))
    before = np.concatenate([memory[:-1], past[1:, :, -1:]], axis=2)
    found = np.linalg.lstsq(np.vstack(before), np.vstack(memory[1:]), rcond=None)[0].T
    keep, enter = found[:, :states], found[:, states]
    keep *= min(1.0, LONGEST / np.abs(np.linalg.eigvals(keep)).max())
    return keep, np.outer(enter, weights)
