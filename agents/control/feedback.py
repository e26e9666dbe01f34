"""A law and what tells it the state: together a controller."""

import numpy as np

from agents.control.controller import (
    Acted,
    Controller,
    Info,
    Law,
    Memory,
    Observation,
    Read,
    Reads,
    StateSource,
    joined,
    part,
)
from agents.control.observed_state import observed_state
from mm_gym import MovingMassVectorEnv, Scene
from mm_gym.arrays import Array


class Feedback(Controller):
    """Feed the state back through a law.

    Parameters
    ----------
    law
        The law; it gives the controller its name.
    source
        Where the state comes from: by default an estimate from the observation. `TrueState` is a
        bound that no agent can use.
    """

    def __init__(self, scene: Scene, law: Law, source: StateSource | None = None) -> None:
        self.law = law
        self.source = source or observed_state(scene)
        self.name, self.reads = law.name, self.source.reads

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        return joined(source=self.source.begin(env.num_envs), law=self.law.begin(env.num_envs))

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        state, applied, source = self.source.read(part(memory, "source"), observation, info)
        action, law = self.law.action(part(memory, "law"), state, applied)
        return np.clip(action, -1.0, 1.0), joined(source=source, law=law)

    def note(self, memory: Memory, action: Array) -> Memory:
        source = self.source.note(part(memory, "source"), action)
        return joined(source=source, law=part(memory, "law"))


class TrueState(StateSource):
    """The state and the actuators' values from the environment's `info`: for bounds."""

    reads: Reads = "full state"

    def read(self, memory: Memory, observation: Observation, info: Info) -> Read:
        return info["state"], info["applied"], memory


class Both(Law):
    """One law for each actuator, in the order of the action."""

    def __init__(self, *laws: Law) -> None:
        self.name = " + ".join(law.name for law in laws)
        self.laws = laws

    def begin(self, lanes: int) -> Memory:
        return joined(**{str(k): law.begin(lanes) for k, law in enumerate(self.laws)})

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        found = [
            law.action(part(memory, str(k)), state, applied) for k, law in enumerate(self.laws)
        ]
        actions, memories = zip(*found, strict=True)
        return np.concatenate(actions, 1), joined(**{str(k): own for k, own in enumerate(memories)})
