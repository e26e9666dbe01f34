"""What the searches around a controller share as commands: the search, then its held-out cost."""

from collections.abc import Callable
from typing import TypeVar

from agents.report.pages import decimals
from agents.scoring import evaluate
from agents.training.config import TimedSettings
from agents.training.own_scene import print_misfits
from agents.training.parts import agent_of, make_parts
from agents.training.progress import notes_of
from agents.training.runs import Run

Settings = TypeVar("Settings", bound="TimedSettings")

EPISODES = 100  # held-out episodes of the cost that is printed


def search_and_score(settings: Settings, search: Callable[[Settings, Run], None]) -> None:
    """Search, and print the cost on the held-out episodes."""
    run = Run(settings.name)
    print_misfits(settings)
    with run.advised():
        search(settings, run)
        parts = make_parts(settings, run)
        cost = evaluate(parts.scene, agent_of(run, parts), episodes=EPISODES).cost
    compare = f"compare it with classical controllers: {run.scoring}"
    told = f"{cost:.{decimals([cost], 4)}f} is its cost on {EPISODES} held-out episodes"
    print(told, compare, *notes_of(run), sep="\n")
