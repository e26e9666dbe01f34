"""The matching stretch: an absorber tuned to a force whose frequency is known."""

from __future__ import annotations

from typing import TYPE_CHECKING

from agents.controllers.actuators import Command, require_stable_rest
from agents.controllers.controller import Controller
from agents.controllers.registry import Entry
from agents.scoring import FREQUENCY
from mm_gym.analysis import stretch_for_stiffness

if TYPE_CHECKING:
    from agents.controllers.controller import Acted, Info, Memory, Observation, Reads
    from mm_gym import MovingMassVectorEnv, Scene


class MatchingStretch(Controller):
    """Hold the stretch at which the sphere resonates with a known harmonic force.

    Its stiffness is k2 = m2 w^2. Den Hartog, *Mechanical Vibrations* (1956), section 3.2: at that
    frequency an undamped absorber stills the carriage.

    Raises `DesignError` if the carriage is unstable at rest.
    """

    name = "matching stretch (knows the frequency)"
    reads: Reads = "episode"

    def __init__(self, scene: Scene) -> None:
        require_stable_rest(scene, "matching stretch")
        self.command = Command(scene, "stretch")

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        """Compute each lane's stretch from its frequency."""
        k2 = env.drawn("sphere.mass") * env.drawn(FREQUENCY) ** 2
        return {"stretch": stretch_for_stiffness(k2, env.drawn("springs.stiffness"))}

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        """Return the action towards the matching stretch."""
        present = self.command.present(info["applied"])
        return self.command(memory["stretch"], present), memory


def _unknown_frequency(scene: Scene) -> str | None:
    if FREQUENCY in scene.randomization:
        return None
    return f"which reads {FREQUENCY}, and randomization does not draw it"


ENTRIES = (
    Entry(
        "matching-stretch",
        ("stretch",),
        MatchingStretch,
        60,
        "informed",
        refuses=_unknown_frequency,
    ),
)
