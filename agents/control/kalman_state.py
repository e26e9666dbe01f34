"""The state from the observation by a Kalman filter of the linear plant and its excitation."""

import numpy as np

from agents.control.controller import Info, Memory, Observation, Read, looked_up
from agents.control.kalman_filter import UNMODELLED, design_filter, excited_system
from agents.control.observed_actuators import ObservedActuators
from agents.control.scene import drawn_but
from mm_gym import Scene
from mm_gym.arrays import Array


class KalmanState(ObservedActuators):
    """Estimate the state from all channels that show the motion, accelerations included.

    An acceleration shows the excitation as well as the state, so that the excitation's filters are
    states too. The plant is linearised about rest, at the nearest of some stretches or dampings,
    with the middle of what is drawn, also of the sensors' delay. Raise `DesignError` if the
    channels do not show the state: it is not detectable from them.

    Anderson and Moore, *Optimal Filtering* (1979), chapter 3.
    """

    tunes = "stretch", "damping"

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        names = scene.actuation.names
        fields = {"stretch": "initial.stretch", "damping": str(scene.actuation.damped)}
        self.forces = [k for k, name in enumerate(names) if name == "force"]
        field = "" if self.tuned is None else fields[names[self.tuned]]
        points = [None if value is None else {field: value} for value in self.grid]
        systems = [
            excited_system(_at_once(scene), ["force"] * len(self.forces), at) for at in points
        ]
        designs = [
            design_filter(scene, system, UNMODELLED, steps=scene.control.steps)
            for system in systems
        ]
        self.a, self.b, self.c = (
            np.stack([getattr(system, name) for system in systems]) for name in "ABC"
        )
        self.drift = np.stack([system.drift for system in systems])
        longest = max(len(design.filters) for design in designs)
        self.filters = np.stack(
            [
                np.pad(design.filters, ((0, longest - len(design.filters)), (0, 0), (0, 0)), "edge")
                for design in designs
            ]
        )
        self.start = designs[0].start
        self.columns = [self.frame.names.index(signal.name) for signal in systems[0].outputs]

    def begin(self, lanes: int) -> Memory:
        return {**super().begin(lanes), "estimate": np.tile(self.start, (lanes, 1))}

    def read(self, memory: Memory, observation: Observation, info: Info) -> Read:
        frame, step, estimate = self.frame.values(observation), memory["step"], memory["estimate"]
        memory = self._seen(memory, frame)
        point = self.nearest(memory["applied"])
        missed = frame[:, self.columns] - np.einsum(
            "npj,nj->np", looked_up(self.c[None], point), estimate
        )
        steps = self.filters.shape[1]
        place = point * steps + np.minimum(step, steps - 1)
        gain = looked_up(self.filters.reshape(1, -1, *self.filters.shape[2:]), place)
        estimate = estimate + np.einsum("njp,np->nj", gain, missed)
        return estimate[:, :4], memory["applied"], {**memory, "estimate": estimate}

    def note(self, memory: Memory, action: Array) -> Memory:
        memory = super().note(memory, action)
        applied, point = memory["applied"], self.nearest(memory["applied"])
        moved = np.einsum("nij,nj->ni", looked_up(self.a[None], point), memory["estimate"])
        pushed = np.einsum("nik,nk->ni", looked_up(self.b[None], point), applied[:, self.forces])
        drift = looked_up(self.drift[None], point)
        return {**memory, "estimate": moved + pushed + drift}


def _at_once(scene: Scene) -> Scene:
    """Return the scene with a force that is reached at once, as `ObservedActuators` tells it."""
    if scene.actuation.force is None:
        return scene
    prompt = {"lag": 0.0, "rate_limit": None, "command": "position"}
    changes = {f"actuation.force.{name}": value for name, value in prompt.items()}
    return scene.replace(**changes, randomization=drawn_but(scene, "actuation."))
