"""An agent for prompt, quiet sensors, and an observer of what these would show on a rig."""

import numpy as np

from agents.control.controller import Acted, Controller, Info, Memory, Observation, joined, part
from agents.control.observed_actuators import ACTUATED
from agents.control.observed_state import observed_state
from agents.control.scene import plant_of
from mm_gym import MovingMassVectorEnv, Scene
from mm_gym.arrays import Array, Single


class WithObserver(Controller):
    """Show an agent what its sensors would show now, without delay and noise.

    The agent was trained with sensors that are neither late nor noisy. An observer estimates the
    state from the frames that the rig's sensors show, and where each episode draws the delay it
    finds that. Frames of the estimate take the place of the observed ones: the agent acts as if
    they were true (certainty equivalence; Åström and Wittenmark, *Adaptive Control* (1995),
    chapter 1). Channels that show neither the motion nor an actuator stay as they are observed.

    Parameters
    ----------
    scene
        That of the rig: its sensors, and what episodes draw. Channels, history and actuators are
        those of the agent's scene. Raise `DesignError` if the sensors do not show the state.
    agent
        It reads the observation alone.
    """

    def __init__(self, scene: Scene, agent: Controller) -> None:
        self.source, self.agent = observed_state(scene), agent
        self.name = f"{agent.name}, with observer"
        plant = plant_of(scene)
        self.history, self.channels = plant.history, len(plant.channels)
        self.tuned = [
            (k, scene.actuation.names.index(ACTUATED.get(name, name)))
            for k, name in enumerate(plant.channels)
            if ACTUATED.get(name, name) in scene.actuation.names
        ]
        self.zero = np.array([channel.zero for channel in plant.observed])
        self.factor = np.array([channel.factor for channel in plant.observed])

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        lanes = env.num_envs
        own = {
            "begun": np.zeros(lanes, np.bool_),
            "frames": np.zeros((lanes, self.history, self.channels)),
        }
        return joined(source=self.source.begin(lanes), agent=self.agent.begin(env), own=own)

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        state, applied, source = self.source.read(part(memory, "source"), observation, info)
        own, now = part(memory, "own"), self._now(observation, state, applied)[:, None]
        # Before an episode's first frame stand copies of it.
        frames = np.where(own["begun"][:, None, None], own["frames"], now)
        frames = np.concatenate([frames[:, 1:], now], axis=1)
        shown: Single = frames.reshape(len(frames), -1).astype(np.float32)
        action, agent = self.agent.propose(part(memory, "agent"), shown, info)
        own = {"begun": np.ones_like(own["begun"]), "frames": frames}
        return action, joined(source=source, agent=agent, own=own)

    def note(self, memory: Memory, action: Array) -> Memory:
        source = self.source.note(part(memory, "source"), action)
        agent = self.agent.note(part(memory, "agent"), action)
        return joined(source=source, agent=agent, own=part(memory, "own"))

    def _now(self, observation: Observation, state: Array, applied: Array) -> Array:
        """Return the frame (lanes, channels) of a state and of what the actuators have."""
        frame = observation[:, -self.channels :].astype(np.float64)
        for k, actuator in self.tuned:
            frame[:, k] = (applied[:, actuator] - self.zero[k]) * self.factor[k]
        columns, numbers = self.source.observed(state)
        frame[:, columns] = numbers
        return frame
