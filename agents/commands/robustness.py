"""Score controllers and agents on the robust variants, and write ``docs/robustness.md``.

Each variant of a task, such as ``PreStretchNoiseRobust``, draws a rig for each episode. Controllers
are designed for the middle of what is drawn, and tuned on validation episodes of the variant.
Agents are the published policies of the variant and of the task itself; ``--runs`` adds finished
runs. Scores of other variants stay as they are.
"""

import json
import time
from typing import Annotated

import tyro

from agents.errors import command
from agents.evaluation.contestants import agents_of
from agents.evaluation.rigs import EPISODES, FILE, read_robustness, scores_of, task_of
from agents.report.published import published_agents, read_published
from agents.report.score_pages import ROBUSTNESS, robustness_page
from agents.sweeps.results import read_results
from mm_gym import load_scene
from mm_gym.errors import check_name
from mm_gym.files import write_text
from mm_gym.scene import Document
from mm_gym.tasks import robust_ids, short_name, task_called


class Arguments(Document):
    """What to score."""

    tasks: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """names such as HybridRobust; all variants by default"""
    runs: tuple[str, ...] = ()
    """folders of finished runs, or patterns of folders in quotes"""
    controllers: bool = True
    """tune and score the controllers anew; without it their rows stay as they are"""


@command
def main(arguments: Arguments) -> None:
    """Score from the command line."""
    variants, agents = robust_ids(), agents_of(arguments.runs)
    wanted = list(map(task_called, arguments.tasks or variants))
    for variant in wanted:
        check_name("tasks", short_name(variant), map(short_name, variants))
    of_wanted = {*wanted, *map(task_of, wanted)}
    published = [row for row in read_published().rows if row.task in of_wanted]
    for row, _, agent in published_agents(published):
        agent.name = str(row.file)
        agents.setdefault(row.task, []).append(agent)
    scores, trained = read_robustness(), read_results()
    for variant in wanted:
        began = time.perf_counter()
        digest, before = load_scene(variant).digest, scores.get(variant)
        known = None
        if not arguments.controllers and before and before["scene_digest"] == digest:
            known = before["rows"]
        rows = scores_of(variant, agents, known)
        scores = read_robustness()  # another process may have written to it
        scores[variant] = {"scene_digest": digest, "episodes": EPISODES, "rows": rows}
        ordered = {name: scores[name] for name in variants if name in scores}
        write_text(FILE, json.dumps(ordered, indent=1) + "\n")
        write_text(ROBUSTNESS, robustness_page(ordered, trained))
        print(f"{variant}: {time.perf_counter() - began:.0f} s")
    print(f"written: {ROBUSTNESS}")
