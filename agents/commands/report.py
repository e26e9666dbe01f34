"""Write one web page of finished runs: tables and charts, without any network.

For example ``python -m agents report runs/first runs/second``. The page compares the runs with
the quick classical controllers on their task: costs with intervals, responses, spectra, an
animation, robustness, and what made each run. It is one file that can be sent to others and opened
anywhere.
"""

import os
from pathlib import Path
from typing import Annotated

import tyro

from agents.errors import command
from agents.evaluation.conclusions import conclude
from agents.evaluation.contestants import BASELINES, Episodes, read_field
from agents.evaluation.measurement import measure
from agents.report.web_page import LARGEST, STUDIED, report_page
from agents.scoring import HELD_OUT_SEED
from agents.training.config import Count
from mm_gym import SceneError
from mm_gym.files import check_outputs, write_text
from mm_gym.scene import Document


class Arguments(Document):
    """What to report on."""

    subjects: Annotated[tuple[str, ...], tyro.conf.Positional]
    """folders of finished runs, and all else that the command evaluate compares"""
    tasks: tuple[str, ...] = ()
    """tasks to compare on, such as Hybrid, or scene files; by default those of the runs, or all"""
    episodes: int | None = None
    """held-out episodes of each seed: 64"""
    seeds: int | None = None
    """seeds of each subject: 5, or as many as the training has"""
    first_seed: int = HELD_OUT_SEED
    """seed of the first episode"""
    reward: str | None = None
    """a cost of your own, FILE.py:NAME, to score by in place of the objective: docs/scenes.md"""
    baselines: bool = True
    """compare with all classical controllers too"""
    trust: bool = False
    """run the own base of runs, although that can run any code"""
    processes: Count = os.cpu_count() or 1
    """number of tasks scored at once"""
    out: Path = Path("report.html")
    """the page"""


@command
def main(arguments: Arguments) -> str | None:
    """Write the page from the command line."""
    if not arguments.subjects:
        return "error: got nothing to report on; allowed: the folder of a run, runs/NAME"
    write_report(arguments)
    return None


def write_report(wanted: Arguments) -> None:
    """Compare, and write the page.

    Raise `SceneError` if the page were too large, or cannot be written; and as `read_field` does.
    """
    out, named = wanted.out, wanted.subjects
    check_outputs([out])
    if wanted.baselines and BASELINES not in named:
        named = (*named, BASELINES)
    compared = read_field(named, wanted.tasks, wanted.reward, trust=wanted.trust)
    episodes = Episodes.of_field(compared, wanted.seeds, wanted.episodes, first=wanted.first_seed)
    results = measure(compared, episodes, STUDIED, wanted.processes)
    page = report_page(compared, conclude(results, compared.scenes, episodes))
    size = len(page.encode())
    if size >= LARGEST:
        msg = (
            f"{out}: {size / 2**20:.1f} MiB; allowed: less than {LARGEST / 2**20:g} MiB; report on "
            "fewer tasks or runs at once"
        )
        raise SceneError(msg)
    write_text(out, page)
    print(f"written: {out}")
