"""Train on all tasks and write ``docs/results.md``.

For example ``python -m agents results configs/results.toml``. The file is that of a sweep, see
``python -m agents sweep``. Finished trainings are not repeated, and ``--no-train`` writes
the page of what there is. The policy of the median seed of every row is published with it:
``python -m agents evaluate --published`` scores them again.
"""

from pathlib import Path

from agents.commands.sweep import sweep
from agents.errors import command
from agents.report import published
from agents.report.results_figures import draw_results
from agents.report.results_page import page, with_others
from agents.sweeps.on_task import on_task, trainings_of
from agents.sweeps.trials import SweepSettings, result_file
from agents.training.runs import Run
from mm_gym.files import write_text


class ResultsSettings(SweepSettings):
    """The trainings of a sweep, and the page that is written of them."""

    name: str = "results"
    """folder under `runs`, with a folder for each training"""
    train: bool = True
    """train what is not trained yet"""
    out: str = "docs/results.md"
    """the page; its figures are written to a folder of its name, and next to it the folder
    ``policies`` with the policy of the median seed of every row, and the page ``published.md``"""
    page: bool = True
    """write the page; without it the policies are published, and the page tells of them alone"""


@command
def main(settings: ResultsSettings) -> str | None:
    """Train and write from the command line."""
    problem = sweep(settings) if settings.train else None
    return problem or write(settings)


def write(settings: ResultsSettings, root: Path = Path("runs")) -> str | None:
    """Write the page and its figures; return what is wrong, or None."""
    folder, out = root / settings.name, Path(settings.out)
    done = [trial for trial in settings.trials() if result_file(Run(trial.name, folder)).exists()]
    if not done:
        return f"error: {folder}: no finished training here; leave --no-train out"
    tasks = {task: [t for t in done if t.task == task] for task in (trial.task for trial in done)}
    policies, told = out.with_name(published.FOLDER.name), out.with_name(published.PAGE.name)
    known = [on_task(task, trials, folder) for task, trials in tasks.items() if settings.page]
    trainings = {one.task: one.trainings for one in known} or {
        task: trainings_of(trials, folder)[0] for task, trials in tasks.items()
    }
    found = published.publish(trainings, folder, policies, with_results=settings.page)
    write_text(told, published.page(found))
    print(f"written: {told}, {policies}/")
    if settings.page:
        write_text(out, page(known, draw_results(known, out.with_suffix("")), found))
    elif out.exists():
        write_text(out, with_others(out.read_text("utf-8"), found))
    print(f"written: {out}")
    return None
