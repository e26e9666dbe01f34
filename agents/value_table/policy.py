"""The law of value iteration: the stretch of least cost to come, looked up in a table."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from agents.network.files import Arrays, FilePolicy, numbers
from agents.network.interface import Interface
from agents.value_table.kernel import NODES, choose
from mm_gym.arrays import Array, Single
from mm_gym.errors import refuse
from mm_gym.scene import Document


@dataclass(frozen=True, eq=False)
class TablePolicy(FilePolicy):
    """A table of the cost to come, over the motion and the stretch after a control step.

    In each step the stretches of the grid that are within reach are tried, and the ends of what is,
    for the step's cost and the cost to come.
    """

    # (stretches, 4, n, n, n, sizes) float32, see `agents.value_table.kernel`.
    after: Single
    # stretches, squares, moves, cost, reads, travel, is_rate: as of the problem
    stretches: Array
    squares: Array
    moves: Array
    cost: Array
    reads: Array
    travel: float
    is_rate: bool

    observed: int = field(init=False)
    actions: int = field(init=False, default=1)

    def __post_init__(self) -> None:
        object.__setattr__(self, "observed", self.reads.shape[1] - 1)

    def step(self, observation: ArrayLike, memory: Array) -> tuple[Array, Array]:
        """Return the actions for observations, and the memory."""
        return self.act(observation), memory

    def act(self, observation: ArrayLike) -> Array:
        """Return the actions (lanes, 1) for observations (lanes, n) as the environment has them."""
        known = np.asarray(observation, np.float64) @ self.reads[:, 1:].T + self.reads[:, 0]
        low, high = self.stretches[0], self.stretches[-1]
        spacing = (high - low) / (len(self.stretches) - 1)
        present, chosen = (known[:, 4] - low) / spacing, np.empty(len(known))
        choose(
            *(self.after, self.moves, self.cost, self.squares),
            *(np.ascontiguousarray(known[:, :4]), present, self.travel, chosen),
        )
        if self.is_rate:
            action = (chosen - present) / self.travel
        else:
            action = 2.0 * chosen / (len(self.stretches) - 1) - 1.0
        return np.clip(action, -1.0, 1.0)[:, None]

    def _content(self) -> tuple[dict[str, Any], Arrays]:
        description = {"format": 1} | {name: getattr(self, name) for name in NUMBERS}
        return description, {name: getattr(self, name) for name in ("after", *ARRAYS)}


ARRAYS = ("stretches", "squares", "moves", "cost", "reads")
NUMBERS = ("travel", "is_rate")
"""What a file holds other than the table: as arrays, and in its JSON text."""


class Description(Document):
    """What the file of a table says in JSON."""

    format: Literal[1]
    """its only format"""
    travel: Annotated[float, Field(gt=0)]
    """as of the problem"""
    is_rate: bool
    """as of the problem"""
    interface: Interface | None = None
    """what it is connected to, if it was exported with that"""


def table_policy(description: Mapping[str, object], arrays: Arrays) -> TablePolicy:
    """Return the policy of a file; raise `ValueError` where it is wrong."""
    described_as = Description.of(description)
    lengths = {name: np.atleast_1d(arrays.get(name, ())).shape for name in ("after", *ARRAYS)}
    stretches, sizes = (max(lengths[name][0], 2) for name in ("stretches", "squares"))
    n = max((*lengths["after"][2:3], NODES))
    shapes = {
        "stretches": (stretches,),
        "squares": (sizes,),
        "moves": (stretches, 4, 4),
        "cost": (4,),
        "reads": (5, max(lengths["reads"][-1], 2)),
    }
    own = {name: numbers(arrays, name, shapes[name]) for name in ARRAYS}
    after = numbers(arrays, "after", (stretches, 4, n, n, n, sizes), np.float32)
    rise = [np.diff(own[name]).min() for name in ("stretches", "squares")]
    if min(rise) <= 0.0 or own["squares"][0] != 0.0:
        allowed = "numbers that increase, squares from 0"
        refuse("stretches, squares", "no increase", allowed, ValueError)
    unknown = sorted(set(arrays) - {"description", "after", *ARRAYS})
    if unknown:
        msg = f"{unknown[0]}: unknown; allowed: description, after, {', '.join(ARRAYS)}"
        raise ValueError(msg)
    return TablePolicy(after, **own, travel=described_as.travel, is_rate=described_as.is_rate)
