"""Score controllers and finished runs on the sealed episodes of this release, once.

Each task has a thousand episodes on which nothing was tuned, trained or chosen. Writes
``docs/sealed.md``. Existing scores are kept, so an interrupted command continues.
"""

import json
import time
from collections.abc import Iterable, Mapping
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import tyro

from agents.errors import command
from agents.evaluation.contestants import agents_of, tasks_called
from agents.evaluation.sealed import (
    AGENT,
    EPISODES,
    FILE,
    Seal,
    fixed_and_classical,
    mark_again,
    read_sealed,
)
from agents.report.score_pages import SEALED, sealed_page
from agents.training.config import Count
from mm_gym import load_scene
from mm_gym.errors import refuse
from mm_gym.files import write_text
from mm_gym.scene import Document
from mm_gym.tasks import ids, path_of


class Arguments(Document):
    """What to score."""

    tasks: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """names such as Hybrid; by default those of the runs, or all of mm_gym"""
    runs: tuple[str, ...] = ()
    """folders of finished runs, or patterns of folders in quotes: the seeds of one training each"""
    folder: Path = Path("runs/sealed")
    """where the penalties are kept, a file a task"""
    episodes: Count = EPISODES
    """episodes of each task; with another number than the default the page is not written"""


def _label(text: str) -> str:
    """Return what the seeds of a pattern are called."""
    return Path(text).name.replace("*", "").strip("-_.")


def _check_labels(agents: Mapping[str, Iterable[str]]) -> None:
    """Refuse patterns of one label with runs of one task: the second would not be scored."""
    first: dict[tuple[str, str], str] = {}
    for text, tasks in agents.items():
        for task in tasks:
            other = first.setdefault((task, _label(text)), text)
            if other != text:
                got = f"{text} and {other}, both called {_label(text)!r} on {task}"
                refuse("--runs", got, "patterns whose last names differ")


@command
def main(arguments: Arguments) -> None:
    """Score from the command line."""
    release = version("mm-gym")
    read_sealed(FILE)  # what is wrong with it is told before the scores
    agents = {text: agents_of((text,)) for text in arguments.runs}
    _check_labels(agents)
    named = arguments.tasks or [task for found in agents.values() for task in found] or ids()
    summaries = {}
    for task in tasks_called(named):
        scene = load_scene(task)
        seal = Seal(
            arguments.folder / f"{path_of(task).stem}.safetensors",
            *(scene, release, arguments.episodes),
        )
        trained = [
            (_label(text), AGENT, found[task]) for text, found in agents.items() if task in found
        ]
        others = [(one.name, role, [one]) for role, one in fixed_and_classical(scene)]
        for name, role, controllers in [*others, *trained]:
            if name not in seal.scored:
                began = time.perf_counter()
                seal.score(name, role, controllers)
                spent = time.perf_counter() - began
                print(f"{task}: {name}: {seal.scored[name].cost:.4f}, in {spent:.0f} s")
        summaries[task] = partial(seal.summary, {name for name, *_ in others})
    if arguments.episodes == EPISODES:
        done = {task: summary() for task, summary in summaries.items()}
        known = read_sealed(FILE)
        tasks = known["tasks"] if known["release"] == release else {}
        for task in done.keys() & tasks.keys():
            mark_again(done[task]["rows"], tasks[task]["rows"])
        tasks = tasks | done
        data = {"release": release, "tasks": {task: tasks[task] for task in ids() if task in tasks}}
        write_text(FILE, json.dumps(data, indent=1) + "\n")
        write_text(SEALED, sealed_page(data))
        print(f"written: {SEALED}")
