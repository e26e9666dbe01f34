"""What every controller is: a function of its memory and of what it reads, over many lanes."""

from abc import ABC, abstractmethod
from math import prod
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mm_gym import MovingMassVectorEnv
from mm_gym.arrays import Array, Single

Memory: TypeAlias = dict[str, NDArray[Any]]
"""All that an episode leaves in a controller: arrays by name, whose first axis is the lanes.

Memories are not changed: a step returns a new one. So lanes can be taken out, begun anew and
written to a file without knowing the controller.
"""

Acted: TypeAlias = tuple[Array, Memory]
"""Actions (lanes, k), or what leads to them, and the memory then."""

Read: TypeAlias = tuple[Array, Array, Memory]
"""States (lanes, 4), what the actuators have (lanes, k), and the memory then."""

Observation: TypeAlias = Single
Info: TypeAlias = dict[str, Any]

Reads: TypeAlias = Literal["observation", "full state", "episode"]
"""What a controller may read: what an agent sees; also the true state; also what was drawn."""


class Controller(ABC):
    """What acts on many lanes at once.

    Its gains are made once, from the scene. What an episode changes is in the memory alone.
    """

    name: str = "controller"  # in tables and figures
    # What it reads; only one that reads the full state is given `info`.
    reads: Reads = "observation"

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        """Return the memory of the episodes that have just begun in the lanes of `env`."""
        return {}

    @abstractmethod
    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        """Return actions (lanes, k) in [-1, 1] and the memory, before any action is applied.

        Parameters
        ----------
        memory
            What the step before returned.
        observation
            (lanes, n): what an agent sees.
        info
            "state" (lanes, 4), x1, x2 [m], v1, v2 [m/s]; "applied" (lanes, k), what is actuated of
            force [N], stretch [-] and damping [N s/m]. Empty for a controller that reads the
            observation.
        """

    def note(self, memory: Memory, action: Array) -> Memory:
        """Return the memory after actions (lanes, k), which need not be those proposed."""
        return memory

    def act(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        """Return the actions, and the memory once they are applied."""
        action, memory = self.propose(memory, observation, info)
        return action, self.note(memory, action)

    def known(self, info: dict[str, Any]) -> dict[str, Any]:
        """Return what it may read of `info`."""
        return {} if self.reads == "observation" else info


class Law(ABC):
    """A control law: from the state to the action. One without memory has `action` alone."""

    name: str = "law"

    def begin(self, lanes: int) -> Memory:
        """Return the memory of so many new episodes."""
        return {}

    @abstractmethod
    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        """Return actions (lanes, k), which are clipped to [-1, 1] afterwards, and the memory.

        Parameters
        ----------
        memory
            What the step before returned.
        state
            (lanes, 4): x1, x2 [m], v1, v2 [m/s].
        applied
            (lanes, k): force [N], stretch [-] and damping [N s/m] that the actuators have.
        """


class StateSource(ABC):
    """What tells a law the state: the truth, or an estimate from the observation."""

    reads: Reads = "observation"

    def begin(self, lanes: int) -> Memory:
        """Return the memory of so many new episodes."""
        return {}

    @abstractmethod
    def read(self, memory: Memory, observation: Observation, info: Info) -> Read:
        """Return the states (lanes, 4), what the actuators have (lanes, k), and the memory."""

    def note(self, memory: Memory, action: Array) -> Memory:
        """Return the memory after the actions (lanes, k) that were chosen."""
        return memory


def joined(**parts: Memory) -> Memory:
    """Return one memory of several; `part` returns each again."""
    return {f"{name}/{key}": array for name, own in parts.items() for key, array in own.items()}


def part(memory: Memory, name: str) -> Memory:
    """Return the part of a memory that was joined under a name."""
    begin = f"{name}/"
    return {key.removeprefix(begin): memory[key] for key in memory if key.startswith(begin)}


def chosen(lanes: NDArray[np.bool_], where: Array, elsewhere: Array) -> Array:
    """Return rows of one array in the lanes that are chosen, and of another elsewhere."""
    return np.where(lanes.reshape(-1, *[1] * (where.ndim - 1)), where, elsewhere)


def looked_up(tables: Array, place: NDArray[np.intp]) -> Array:
    """Return the rows (lanes, ...) at places (lanes,) of tables (lanes, n, ...), or (1, n, ...).

    By a function that also takes what `agents.network.graph` follows, as an index does not.
    """
    lanes, count, *inner = tables.shape
    flat = tables.reshape(lanes, count, prod(inner))
    rows = np.take_along_axis(flat, place[:, None, None], axis=1)
    return rows.reshape(rows.shape[0], *inner)
