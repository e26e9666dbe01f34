"""What every controller is: a function of its memory and of what it reads, over many lanes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from math import inf
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mm_gym import DesignError, MovingMassVectorEnv, Plant, Scene, compile_scene
from mm_gym.analysis import spring_force

Values: TypeAlias = NDArray[np.float64]

Memory: TypeAlias = dict[str, NDArray[Any]]
"""All that an episode leaves in a controller: arrays by name, whose first axis is the lanes.

Memories are not changed: a step returns a new one. So lanes can be taken out, begun anew and
written to a file without knowing the controller.
"""

Acted: TypeAlias = tuple[Values, Memory]
"""Actions (lanes, k), or what leads to them, and the memory then."""

STATES = ("x1", "x2", "v1", "v2")

Observation: TypeAlias = NDArray[np.float32]
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

    def note(self, memory: Memory, action: Values) -> Memory:
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
    def action(self, memory: Memory, state: Values, applied: Values) -> Acted:
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

    @property
    def remembers(self) -> bool:
        """Whether an action depends on more than the present state."""
        return bool(self.begin(1))


class StateSource(Protocol):
    """What tells a law the state: the truth, or an estimate from the observation."""

    reads: Reads

    def begin(self, lanes: int) -> Memory:
        """Return the memory of so many new episodes."""
        ...

    def read(
        self, memory: Memory, observation: Observation, info: Info
    ) -> tuple[Values, Values, Memory]:
        """Return the states (lanes, 4), what the actuators have (lanes, k), and the memory."""
        ...

    def note(self, memory: Memory, action: Values) -> Memory:
        """Return the memory after the actions (lanes, k) that were chosen."""
        ...


def joined(**parts: Memory) -> Memory:
    """Return one memory of several; `part` returns each again."""
    return {f"{name}/{key}": array for name, own in parts.items() for key, array in own.items()}


def part(memory: Memory, name: str) -> Memory:
    """Return the part of a memory that was joined under a name."""
    begin = f"{name}/"
    return {key.removeprefix(begin): memory[key] for key in memory if key.startswith(begin)}


def chosen(lanes: NDArray[np.bool_], where: Values, elsewhere: Values) -> Values:
    """Return rows of one array in the lanes that are chosen, and of another elsewhere."""
    return np.where(lanes.reshape(-1, *[1] * (where.ndim - 1)), where, elsewhere)


def drawn_but(scene: Scene, *prefixes: str) -> dict[str, tuple[float, float]]:
    """Return what a scene draws, but for names that begin so: "sensors." of other sensors."""
    drawn = scene.randomization.items()
    return {name: ends for name, ends in drawn if not name.startswith(prefixes)}


def nominal(scene: Scene, name: str) -> float:
    """Return a number by dotted name or, if it is drawn, the middle of its range.

    What is not stated is infinite, as a rate limit is.
    """
    stated = scene.value_of(name)
    return float(np.mean(scene.range_of(name, np.inf if stated is None else stated)))


def sphere_springs(scene: Scene) -> Callable[[Values], Values]:
    """Return the springs' force [N] on the carriage over relative displacements x2 - x1 [m].

    The sphere feels the opposite. See (5) and (6) of docs/model.md.
    """
    kind = scene.springs.kind
    if kind == "none":
        return np.zeros_like
    stiffness = nominal(scene, "springs.stiffness")
    if kind == "linear":
        cubic = nominal(scene, "springs.cubic_coefficient")
        return lambda offset: stiffness * (1.0 + cubic * offset**2) * offset
    stretch = nominal(scene, "springs.stretch")
    length = nominal(scene, "springs.rest_length") if kind == "finite_stretch" else 0.0
    return lambda offset: spring_force(offset, stretch, stiffness, length)


def plant_of(scene: Scene) -> Plant:
    """Return what a scene compiles to, once for all scenes of one content."""
    key = scene.digest
    if key not in _PLANTS:
        if len(_PLANTS) == MOST_PLANTS:
            _PLANTS.pop(next(iter(_PLANTS)))
        _PLANTS[key] = compile_scene(scene)
    return _PLANTS[key]


MOST_PLANTS = 32
_PLANTS: dict[str, Plant] = {}


def columns(scene: Scene) -> tuple[str, ...]:
    """Return the names of the actuators, in the order of the action."""
    return scene.actuation.names


def require_actuator(scene: Scene, name: str) -> None:
    """Raise `DesignError` if the scene lacks an actuator: "force", "stretch" or "damping"."""
    if getattr(scene.actuation, name) is None:
        msg = f"actuation.{name}: missing; the scene must have a {name} actuator"
        raise DesignError(msg)


def require_number(name: str, value: float, low: float = 0.0, high: float = inf) -> None:
    """Raise `DesignError` unless a number is finite, at least `low` and at most `high`."""
    if not (low <= value <= high and abs(value) < inf):
        end = "" if high == inf else f" and at most {high:g}"
        msg = f"{name}: got {value!r}; allowed: a finite number of at least {low:g}{end}"
        raise DesignError(msg)


def force_weight(scene: Scene) -> float:
    """Return the cost of the force [1/N^2].

    Raise `DesignError` if there is no force, it is commanded by its rate or costs nothing.
    """
    actuator, weight = scene.actuation.force, scene.objective.effort_weight
    if actuator is None:
        msg = (
            "actuation.force: missing; "
            "a regulator needs a force (a stretch or a damping is no input of the linear plant: it "
            "multiplies the state)"
        )
        raise DesignError(msg)
    if scene.actuation.device is not None:
        msg = (
            f"actuation.{scene.actuation.names[-1]}: a regulator commands only the force; a "
            "damping multiplies the state, so it is no input of the linear plant"
        )
        raise DesignError(msg)
    if actuator.command == "rate":
        msg = "actuation.force.command: got 'rate'; allowed: 'position'"
        raise DesignError(msg)
    if weight == 0.0:
        msg = (
            "objective.effort_weight: got 0; "
            "allowed: greater than 0 (the Riccati equation needs a weight on the force)"
        )
        raise DesignError(msg)
    return weight / actuator.limit**2
