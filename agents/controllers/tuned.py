"""The classical controllers of a scene, tuned on the validation episodes.

All but the informed ones read what an agent observes.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeVar

from agents.control.controller import Controller, Law
from agents.control.feedback import Feedback
from agents.controllers.constant import best_constant, uncontrolled
from agents.controllers.registry import Role, entries
from agents.controllers.searched import cheapest_of
from agents.network.files import PolicyError
from mm_gym import CompileError, DesignError, Scene, SimulationError

Designed = TypeVar("Designed", bound="Controller")

NOT_SCORED = (CompileError, DesignError, PolicyError, SimulationError)
"""What keeps a controller from being scored on a scene, though others can be."""


class Baselines(NamedTuple):
    """The classical controllers of a scene."""

    controllers: list[Controller]  # those that can be designed
    not_scored: dict[str, str]  # the names of the others, with the reason


def baselines(scene: Scene) -> Baselines:
    """Return the classical controllers of a scene, but for predictive control.

    The first is the one that ratios refer to: the best constant stretch, or no control where there
    is no stretch.
    """
    still: list[Controller] = [uncontrolled(scene)]
    if scene.actuation.stretch is not None:
        still.insert(0, best_constant(scene))
    found, not_scored = designed(scene, makers(scene, "law", "filter", "informed"))
    return Baselines([*still, *found], not_scored)


def designed(
    scene: Scene, made: Mapping[str, Callable[[Scene], Designed]]
) -> tuple[list[Designed], dict[str, str]]:
    """Return the controllers that can be designed for a scene, and why the others cannot."""
    found: list[Designed] = []
    not_scored: dict[str, str] = {}
    for name, make in made.items():
        try:
            found.append(make(scene))
        except NOT_SCORED as error:
            not_scored[name] = str(error)
    return found, not_scored


def makers(scene: Scene, *roles: Role) -> Mapping[str, Callable[[Scene], Controller]]:
    """Return what makes the controllers of some roles, by label."""
    return {
        entry.title: entry.make
        for entry in entries(scene, *roles)
        if entry.told or entry.refuses(scene) is None
    }


def classical_laws(scene: Scene) -> list[Feedback]:
    """Return the tuned laws that read the observation, those that can be designed."""
    found, _ = designed(scene, makers(scene, "law"))
    return [one for one in found if isinstance(one, Feedback)]


def further_laws(scene: Scene) -> list[Controller]:
    """Return what is scored on the page of the tasks alone: it is slow, or takes extras.

    Those that cannot be designed for the scene are left out. Raise
    `gymnasium.error.DependencyNotInstalled` without Slycot or OSQP (extras: robust, mpc), if the
    scene has a force alone.
    """
    return designed(scene, makers(scene, "further"))[0]


def best_law(scene: Scene, laws: Sequence[Feedback]) -> Law:
    """Return the law of least cost; where there is none, no control."""
    return cheapest_of(scene, laws or [uncontrolled(scene)]).law
