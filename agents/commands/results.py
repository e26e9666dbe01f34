"""Train on all tasks and write ``docs/results.md``.

For example ``python -m agents results configs/results.toml``. The file is that of a sweep, see
``python -m agents sweep``. What is trained already is not trained again, and ``--no-train`` writes
the page of what there is.
"""

from __future__ import annotations

from pathlib import Path

from agents.commands.sweep import sweep
from agents.errors import command, leave
from agents.report.results_figures import draw_results
from agents.report.results_page import page
from agents.sweeps.on_task import on_task
from agents.sweeps.trials import SweepSettings, result_file
from agents.training.config import settings_from_command_line
from agents.training.runs import Run
from mm_gym.files import write_text


class ResultsSettings(SweepSettings):
    """The trainings of a sweep, and the page that is written of them."""

    name: str = "results"
    """folder under `runs`, with a folder for each training"""
    train: bool = True
    """train what is not trained yet"""
    out: str = "docs/results.md"
    """the page; its figures are written to a folder of its name"""


@command
def main() -> str | None:
    """Train and write from the command line."""
    settings = settings_from_command_line(ResultsSettings, __doc__ or "")
    problem = sweep(settings) if settings.train else None
    return problem or write(settings)


def write(settings: ResultsSettings, root: Path = Path("runs")) -> str | None:
    """Write the page and its figures; return what is wrong, or None."""
    folder, out = root / settings.name, Path(settings.out)
    done = [trial for trial in settings.trials() if result_file(Run(trial.name, folder)).exists()]
    if not done:
        return f"error: {folder}: no finished training here; leave --no-train out"
    tasks = dict.fromkeys(trial.task for trial in done)
    known = [on_task(task, [t for t in done if t.task == task], folder) for task in tasks]
    figures = draw_results(known, out.with_suffix(""))
    write_text(out, page(known, figures))
    print(f"written: {out}")
    return None


if __name__ == "__main__":
    leave(main())
