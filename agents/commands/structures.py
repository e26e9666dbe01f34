"""Search on every structure of ``configs/structures`` with default settings, and table the costs.

For example ``python -m agents structures --seconds 300``. A structure that is tabled already is
left as it is, but for searches that are asked for: ``--searches gradient``.
``docs/structure_scores.json`` has them, and the table of docs/structures.md follows from it.
"""

import json
import os
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

from pydantic import BaseModel, Field

from agents.controllers.registry import laws
from agents.errors import command
from agents.evolution.search import EvolveSettings, evolve
from agents.gradient.descent import descend
from agents.gradient.settings import GradientSettings
from agents.scoring import evaluate
from agents.training.config import CONFIGS, Positive, TrainSettings
from agents.training.parts import agent_of, best_controller, recorded_parts
from agents.training.reinforcement import train
from agents.training.runs import MOST_BYTES, Run, checked
from mm_gym import DesignError, load_scene
from mm_gym.errors import check_name
from mm_gym.files import read_json, write_text
from mm_gym.scene import Document

DOCS = Path(__file__).parents[2] / "docs"
SCORES, PAGE = DOCS / "structure_scores.json", DOCS / "structures.md"
BEGIN, END = "<!-- scores: python -m agents structures -->", "<!-- end of scores -->"

EPISODES = 100  # held-out episodes

SEARCHES: dict[str, tuple[Any, Callable[..., None]]] = {
    "evolved": (EvolveSettings, evolve),
    "gradient": (GradientSettings, descend),
    "PPO": (TrainSettings, train),
}


class Arguments(Document):
    """What is searched, and for how long."""

    seconds: Positive = 300.0
    """length of each search [s]"""
    structures: tuple[str, ...] = ()
    """names of files in configs/structures; by default all"""
    searches: tuple[Literal["evolved", "gradient", "PPO"], ...] = ()
    """to make anew; by default those of structures that have none"""


class _Found(BaseModel, strict=True, allow_inf_nan=False):
    """What a search came to."""

    cost: float
    seconds: float


class Scores(BaseModel, strict=True, allow_inf_nan=False):
    """What is known of a structure."""

    scene_digest: str
    best_controller: str = Field(alias="best controller")
    no_control: float = Field(alias="no control")
    best: float
    evolved: _Found | None
    gradient: _Found | None
    PPO: _Found | None


@command
def main(arguments: Arguments) -> None:
    """Search from the command line."""
    files = {file.stem: file for file in sorted((CONFIGS / "structures").glob("*.toml"))}
    for name in arguments.structures:
        check_name("structures", name, files)
    rows = _read()
    for file in files.values():
        if arguments.structures and file.stem not in arguments.structures:
            continue
        known, digest = rows.get(file.stem, {}), load_scene(file).digest
        is_known = known.get("scene_digest") == digest
        if is_known and not arguments.searches:
            continue
        searches = arguments.searches if is_known else tuple(SEARCHES)
        row = {"scene_digest": digest, **_controllers(file)}
        row |= {what: _searched(file, what, arguments.seconds) for what in searches}
        print(file.stem, row)
        rows = _read()  # others may have written to it
        before = rows.get(file.stem, {})
        rows[file.stem] = (before if before.get("scene_digest") == digest else {}) | row
        write_text(SCORES, json.dumps(dict(sorted(rows.items())), indent=2) + "\n")
    text = PAGE.read_text("utf-8")
    before, _, rest = text.partition(BEGIN)
    write_text(PAGE, f"{before}{BEGIN}\n\n{table(rows)}\n\n{END}{rest.partition(END)[2]}")


def _read() -> dict[str, dict[str, Any]]:
    """Return the rows that are known, by structure; raise `SceneError` if they are damaged."""
    if not os.path.lexists(SCORES):
        return {}
    rows: Any = read_json(SCORES, most=MOST_BYTES)
    checked(dict[str, Scores], rows, SCORES, "a file of scores")
    return rows


def _controllers(file: Path) -> dict[str, Any]:
    """Return the costs of no control and of the best controller."""
    scene = load_scene(file)
    best = best_controller(scene)
    row: dict[str, Any] = {"best controller": best.name}
    for what, name in (("no control", "no-control"), ("best", best.name)):
        row[what] = evaluate(scene, laws(scene)[name](scene), episodes=EPISODES).cost
    return row


def _searched(file: Path, what: str, seconds: float) -> dict[str, float] | None:
    """Return the cost of what a search returns, and its time [s]; None without gradients."""
    scene, (kind, search) = load_scene(file), SEARCHES[what]
    settings = kind.of({"scene": str(file), "name": what, "time_budget": seconds})
    with TemporaryDirectory() as folder:
        run = Run(what, folder)
        try:
            search(settings, run, bar=False)
        except DesignError:  # of episodes that end early
            return None
        parts = recorded_parts(scene, run.read(), trust=False)
        cost = evaluate(scene, agent_of(run, parts), episodes=EPISODES).cost
    return {"cost": cost, "seconds": seconds}


def table(rows: dict[str, dict[str, Any]]) -> str:
    """Return the table of the costs in Markdown."""
    lines = [
        "| structure | no control | best controller | name | evolved | gradient | PPO | time [s] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, row in sorted(rows.items()):
        made = [row[what] for what in SEARCHES]
        numbers = ["-" if one is None else f"{one['cost']:.4g}" for one in made]
        known = f"{row['no control']:.4g} | {row['best']:.4g} | {row['best controller']}"
        times = ", ".join("-" if one is None else f"{one['seconds']:g}" for one in made)
        cells = " | ".join([name.replace("_", " "), known, *numbers, times])
        lines.append(f"| {cells} |")
    return "\n".join(lines)
