"""The Smith predictor: an LQR on a model's present, corrected by what late sensors showed."""

import numpy as np

from agents.control.controller import Acted, Info, Memory, Observation, Read, looked_up
from agents.control.feedback import Feedback
from agents.control.model import model_of
from agents.control.observed_state import ObservedState, observed_state
from agents.control.scene import plant_of
from agents.controllers.lqr import LQR
from agents.controllers.registry import Entry, without_weight
from agents.controllers.searched import DECADES, searched
from mm_gym import Scene
from mm_gym.arrays import Array


class SmithPredictor(ObservedState):
    """The state that a model moved by the actions alone has, and what the plant was off by.

    Late sensors show the plant some steps ago. The model's present is corrected by the difference
    that plant and model had then: the loop is that of a plant without delay, as far as the model
    is right. What disturbs the plant is taken to stay as it was, where the state estimate alone
    moves it on by the model. Smith, *Closer control of loops with dead time*, Chem. Eng. Prog. 53
    (1957).
    """

    def __init__(self, scene: Scene, delays: range | None = None) -> None:
        super().__init__(scene, delays)
        self.plant = model_of(scene)

    def begin(self, lanes: int) -> Memory:
        moved = np.zeros((lanes, self.delays[-1] + 1, 4))
        return {**super().begin(lanes), "moved": moved, "model": self.plant.at_rest(lanes)}

    def read(self, memory: Memory, observation: Observation, info: Info) -> Read:
        late = np.minimum(memory["step"], self._delay(memory))
        _, applied, memory = super().read(memory, observation, info)
        moved = memory["moved"]
        then = looked_up(moved, self.delays[-1] - late)
        return moved[:, -1] + memory["estimate"] - then, applied, memory

    def note(self, memory: Memory, action: Array) -> Memory:
        memory = super().note(memory, action)
        moved = memory["moved"]
        self.plant.begin(moved[:, -1], memory["model"])
        state = self.plant.advance(memory["applied"])[0].copy()
        moved = np.concatenate([moved[:, 1:], state[:, None]], axis=1)
        return {**memory, "moved": moved, "model": self.plant.own.copy()}


class ScaledLQR(LQR):
    """The LQR, its gains times a factor: a prediction that is off does not suit the best ones."""

    def __init__(self, scene: Scene, factor: float) -> None:
        super().__init__(scene)
        self.name, self.factor = f"Smith predictor, LQR times {factor:.2g}", factor

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        action, memory = super().action(memory, state, applied)
        return self.factor * action, memory


def best_smith_predicted_lqr(scene: Scene) -> Feedback:
    """Search the factor of the gains over four decades."""
    source = observed_state(scene, SmithPredictor)
    return searched(scene, lambda e: ScaledLQR(scene, 10.0**e), DECADES, source=source)


def _refused(scene: Scene) -> str | None:
    if plant_of(scene).delay == 0:
        return "which predicts what late sensors do not show yet; sensors.delay: got 0"
    return without_weight(scene)


ENTRIES = (
    Entry("smith-predictor", ("force",), best_smith_predicted_lqr, 16, "filter", refuses=_refused),
)
