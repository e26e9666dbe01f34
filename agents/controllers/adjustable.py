"""Laws whose free numbers may change in every control step, and a policy that sets them."""

from abc import abstractmethod
from collections.abc import Mapping
from copy import copy
from typing import Any, Self

import numpy as np

from agents.control.controller import Acted, Controller, Law, Memory, joined, part
from agents.control.feedback import Feedback
from agents.controllers.registry import Free
from agents.policies import Policy
from mm_gym.arrays import Array


class Adjustable(Law):
    """A law whose free numbers may be others in each lane and in each control step.

    Attributes
    ----------
    free
        The numbers that may change, by name.
    numbers
        All its numbers by name, each a float or (lanes,).
    inputs
        How many numbers `situation` has.
    """

    inputs: int

    def __init__(self, free: Mapping[str, Free], numbers: Mapping[str, Any]) -> None:
        self.free, self.numbers = dict(free), dict(numbers)

    def told(self, authority: float) -> str:
        """Return in words what actions of a schedule, each from -1 to 1, make of the numbers."""
        return "; ".join(
            f"{name} = {self.numbers[name]:.6g} {'* exp(' if one.ratio else '+ '}"
            f"{authority * one.spread:.6g} * action{')' if one.ratio else ''}, "
            f"within [{one.low:g}, {one.high:g}]"
            for name, one in self.free.items()
        )

    def at(self, coordinates: Array) -> Self:
        """Return the law at coordinates (lanes, d) of a search that begins at its own numbers."""
        law, pairs = copy(self), zip(self.free.items(), coordinates.T, strict=True)
        law.numbers = self.numbers | {
            name: one.value(along, self.numbers[name]) for (name, one), along in pairs
        }
        return law

    @abstractmethod
    def situation(self, memory: Memory, state: Array) -> Array:
        """Return what its best numbers may depend on (lanes, inputs), of order one [-]."""


def adjustable(controller: Controller | None) -> Adjustable | None:
    """Return the law of a controller, if its numbers may change in each control step."""
    law = controller.law if isinstance(controller, Feedback) else None
    return law if isinstance(law, Adjustable) else None


class Scheduled(Law):
    """A law whose free numbers a policy sets in each control step: gain scheduling, learned.

    The policy reads the law's situation. Its action of 1 moves a number, or the logarithm of a
    ratio, by `authority` times the spread of a search's first trials. Rugh and Shamma, *Research on
    gain scheduling*, Automatica 36 (2000).
    """

    def __init__(self, law: Adjustable, policy: Policy, authority: float, name: str) -> None:
        policy.check(law.inputs, len(law.free), f"a schedule of the {law.name}")
        self.law, self.policy, self.authority, self.name = law, policy, authority, name

    def begin(self, lanes: int) -> Memory:
        return joined(law=self.law.begin(lanes), policy={"memory": self.policy.begin(lanes)})

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        own, known = part(memory, "law"), part(memory, "policy")["memory"]
        seen = self.law.situation(own, state).astype(np.float32)
        coordinates, after = self.policy.step(seen, known)
        action, own = self.law.at(self.authority * coordinates.astype(np.float64)).action(
            own, state, applied
        )
        return action, joined(law=own, policy={"memory": after})
