"""Episodes side by side, and the slopes of their cost, carried back through the exact physics."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from agents.controllers.lqr import motion_weight, require_weight
from agents.gradient.network import Network
from mm_gym import ActionError, DesignError, MovingMassVectorEnv, Scene
from mm_gym.arrays import Array, Single
from mm_gym.errors import refuse
from mm_gym.plant import Outputs
from mm_gym.sensitivity import TOLERANCE, Sensitivities

MOST = 10.0  # largest slope of a lane over the median of all lanes, by default


class Episodes:
    """Episodes of a scene as lanes.

    A slope of the cost over the motion is carried back by the Jacobians of the control steps.
    Parametric springs can pump energy: near a switching law slopes grow without bound from step to
    step, in few lanes by many orders of magnitude. So they fade by a factor in each step, which
    forgets what an action does long after, and no lane has more than `most` times the median. Raise
    `DesignError` if an episode may end early, or the motion has no weight.

    Parameters
    ----------
    scene
        The scene.
    lanes
        Number of episodes.
    most
        Largest slope of a lane over the median of all lanes.
    tolerance
        Of the motion and its derivatives, where an interface is followed by Runge-Kutta steps.
    """

    def __init__(
        self, scene: Scene, lanes: int, most: float = MOST, tolerance: float = TOLERANCE
    ) -> None:
        objective, self._tolerance = scene.objective, tolerance
        if objective.displacement_limit or objective.rail_half_length:
            msg = "objective: gradients need episodes that do not end early; remove its limits"
            raise DesignError(msg)
        self.lanes, self.steps, self.most = lanes, scene.control.steps, most
        self.env = MovingMassVectorEnv(scene, lanes, autoreset_mode="Disabled", info="none")
        self._begin(range(lanes))
        size, self.motion = len(self.physics.actuators), len(self.physics.state_rows)
        if not (scene.own_reward or self.env.plant.scores_reactions):
            require_weight(motion_weight(scene))
        self.effort = 0.0 if scene.own_reward else objective.effort_weight
        self.states: Array = np.empty((self.steps, self.motion, lanes))
        self.actions: Array = np.empty((self.steps, size, lanes))

    def _begin(self, seeds: Sequence[int]) -> Single:
        """Begin the episodes of the seeds; return what they show."""
        observation, _ = self.env.reset(seed=list(seeds))
        start, plant = self.env.get_state(), self.env.plant
        lanes = start["values"], start["streams"]
        constants = plant.model, plant.task
        self.physics = Sensitivities(plant.support, constants, lanes, tolerance=self._tolerance)
        self.outputs = Outputs(self.env.scene, plant, self.physics)
        return observation

    def run(self, network: Network, seeds: Sequence[int]) -> float:
        """Return the mean of -reward of the episodes of the seeds, as `evaluate` has.

        Raise `ActionError` if the network asks for no number.
        """
        observation = self._begin(seeds)
        self.jacobians, self.newest, total = [], [], 0.0
        self.slopes: list[tuple[Array, Array]] = []
        for step in range(self.steps):
            self.newest.append(step - self._ages(step))
            asked = network.act(step, observation.T)
            if np.isnan(asked).any():
                refuse("action", "nan", "finite numbers", ActionError)
            actions = self.actions[step] = np.clip(asked, -1.0, 1.0)
            found = self.physics.jacobian(actions)
            self.jacobians.append((found.state, found.action))
            self.states[step] = found.end[:, : self.motion].T
            observation, rewards, *_ = self.env.step(actions.T)
            self.slopes.append(self.outputs.slopes())
            total -= float(np.mean(rewards))
        return total / self.steps

    def _ages(self, step: int) -> NDArray[np.int64]:
        """Return the ages (lanes,) of the newest frames observed, in control steps."""
        row = self.env.plant.support.age_row
        if not row:
            return np.full(self.lanes, min(step, self.env.plant.delay))
        values: Array = self.env.get_state()["values"]  # pyright: ignore[reportAssignmentType] - of a snapshot
        return values[row].astype(np.int64)

    def back(
        self, network: Network, fade: float, feedback: float = 1.0, *, inwards: float = 0.0
    ) -> None:
        """Write the gradient of the mean cost, as far as it does not fade, into the network.

        Under the best policy no action can be bettered, whatever was observed: what a motion costs
        by changing later actions is nothing on average. Until then it is what lanes differ in most.

        Parameters
        ----------
        network
            That of the last `run`.
        fade
            Factor in each step.
        feedback
            Part of the slopes over the observations that is followed to the motion they show. With
            1, no fading, and `most` out of reach, the gradient is exact.
        inwards
            Part of the slope on the inner side of its limit that an action has that was clipped,
            where it leads back inside. The exact slope is zero: what always asks for too much never
            learns when it should ask for less. With all of it, what should be clipped asks for too
            little.
        """
        network.begin_back()
        part = 2.0 / (self.lanes * self.steps)
        history, every = self.env.plant.history, np.arange(self.lanes)
        rows, size = len(self.env.plant.observed), self.jacobians[0][0].shape[1]
        state: Array = np.zeros((size, self.lanes))
        # Of each step the ages of the frames observed, the newest first.
        ages = [
            [step - self.newest[max(step - k, 0)] for k in range(history)]
            for step in range(self.steps)
        ]
        oldest = max(int(np.max(of_step)) for of_step in ages)
        frames: Array = np.zeros((oldest + 1, rows, self.lanes))  # of this step and before
        scale = np.zeros(size)
        scale[: self.motion] = np.sqrt(np.mean(self.states**2, axis=(0, 2)))
        for step in range(self.steps - 1, -1, -1):
            _, cost = self.slopes[step]
            state[: len(cost)] += 0.5 * part * cost
            by_state, by_action = self.jacobians[step]
            action = np.einsum("lij,il->jl", by_action, state)
            action += part * self.effort * self.actions[step]
            state = np.einsum("lij,il->jl", by_state, state)
            factor = fade * _bounded(scale @ np.abs(state), self.most)
            state *= factor
            frames *= factor
            network.fade(factor)
            shown = network.back(step, action, inwards=inwards)
            for age, frame in zip(ages[step], shown.reshape(history, rows, -1)[::-1], strict=True):
                frames[age, :, every] += frame.T
            if step > 0:  # the frame is of the end of the step before
                by_channel, _ = self.slopes[step - 1]
                state[: len(cost)] += feedback * np.einsum("crl,cl->rl", by_channel, frames[0])
            frames[:-1] = frames[1:]
            frames[-1] = 0.0


def _bounded(sizes: Array, most: float) -> Array:
    """Return the factors (lanes,) that make no size larger than so many times the median."""
    half = sizes.size // 2
    largest = max(most * float(np.partition(sizes, half)[half]), np.finfo(float).tiny)
    return largest / np.maximum(sizes, largest)
