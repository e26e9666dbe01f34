"""A search around a law as a command: settings, the search, the cost on held-out episodes."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, TypeVar

from agents.controllers.learned import Learned
from agents.errors import ERRORS
from agents.evaluation.episodes import evaluate
from agents.policies import load_policy
from agents.training.config import settings_from_command_line
from agents.training.ending import notes_of
from agents.training.runs import INTERRUPTED, Run
from mm_gym import SceneError

if TYPE_CHECKING:
    from collections.abc import Callable

    from agents.search.settings import TimedSettings

Settings = TypeVar("Settings", bound="TimedSettings")

EPISODES = 100
"""Held-out episodes of the cost that is printed."""


def search_from_command_line(
    kind: type[Settings], search: Callable[[Settings, Run], None], description: str
) -> str | int | None:
    """Search with the settings of the command line, and score; return what `leave` takes."""
    try:
        settings = settings_from_command_line(kind, description)
    except SceneError as error:
        return f"error: {error}"
    return search_and_score(settings, search)


def search_and_score(
    settings: Settings, search: Callable[[Settings, Run], None]
) -> str | int | None:
    """Search, and print the cost on the held-out episodes; return what `leave` takes."""
    run = Run(settings.name)
    try:
        search(settings, run)
        learned = Learned(load_policy(run.policy))
        cost = evaluate(settings.rewarded_scene(), learned, episodes=EPISODES).cost
        notes = notes_of(run)
    except ERRORS as error:
        return f"error: {error}"
    except KeyboardInterrupt as interrupt:
        print(run.advice(interrupt), file=sys.stderr)
        return INTERRUPTED
    compare = f"compare it with every controller: python -m agents.evaluate {run.folder}"
    print(f"{cost:.4f} is its cost on {EPISODES} held-out episodes", compare, *notes, sep="\n")
    return None
