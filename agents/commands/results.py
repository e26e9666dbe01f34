"""Train the agents of a sweep and write ``docs/results.md``.

For example ``python -m agents results configs/results.toml``. The file is that of a sweep, see
``python -m agents sweep``. The costs of finished trainings are put into ``docs/results.json``, and
the page is written from these data alone; ``--no-train`` writes it without training. Agents of a
task are also scored on its robust variant, with an observer. A training
that these data or ``runs/`` have is not repeated; ``python -m agents sweep`` repeats those that
only the data have. The policy of the median seed of every row is published with the page:
``python -m agents evaluate --published`` scores these policies again. Robust variants are on the
page of ``python -m agents robustness``.
"""

import os
from collections.abc import Sequence
from pathlib import Path

from agents.commands.sweep import sweep
from agents.errors import command
from agents.report import published
from agents.report.results_page import draw_results, page
from agents.sweeps.results import (
    NOTHING,
    Results,
    cells_of,
    known_names,
    merged,
    read_results,
    save,
    training_of,
    with_observed,
    with_references,
)
from agents.sweeps.trials import SweepSettings, result_file
from agents.training.config import RunSettings
from agents.training.runs import Run
from mm_gym.files import check_outputs, write_text


class ResultsSettings(SweepSettings):
    """The trainings of a sweep, and the page that is written of them."""

    name: str = "results"
    """folder under `runs`, with a folder for each training"""
    train: bool = True
    """train what is not trained yet"""
    out: str = "docs/results.md"
    """the page, a name that ends in .md; next to it are the data under its name (.json), its
    figures in a folder of its name, the folder ``policies`` with the policy of the median seed of
    every row, and the page ``published.md``"""


@command
def main(settings: ResultsSettings) -> str | None:
    """Train and write from the command line."""
    if len(settings.variants) > 1:
        got = ", ".join(settings.variants)
        return f"error: variants: got {got}; allowed: one; a row is a task, an algorithm and a seed"
    out = Path(settings.out)
    if out.suffix != ".md":  # its data and figures have the same name with other endings
        return f"error: --out: got {settings.out!r}; allowed: a name that ends in .md"
    data, trials = out.with_suffix(".json"), settings.trials()
    check_outputs([out, data, _published(out)])
    known, problem = read_results(data) if os.path.lexists(data) else NOTHING, None
    if settings.train:
        problem = sweep(settings, known=known_names(known, trials))
    return problem or write(settings, trials, known)


def write(settings: ResultsSettings, trials: Sequence[RunSettings], known: Results) -> str | None:
    """Write data, page, figures and policies; return what is wrong, or None.

    Trainings of the sweep that are finished are added to the results that are known.
    """
    folder, out = Path("runs") / settings.name, Path(settings.out)
    data, figures = out.with_suffix(".json"), out.with_suffix("")
    done = [trial for trial in trials if result_file(Run(trial.name, folder)).exists()]
    rows = [training_of(trial, folder) for trial in done]
    if not rows and not known.trainings:
        return f"error: {folder}: no finished training here, and none in {data}"
    known = with_observed(with_references(merged(known, rows)), done, folder)
    save(known, data)
    policies, told = out.with_name(published.FOLDER.name), _published(out)
    found = published.publish(cells_of(known.trainings), done, folder, policies)
    write_text(told, published.page(found))
    write_text(out, page(known, figures.name))
    draw_results(known, figures, policies)
    print(f"written: {out}, {data}, {figures}/, {told}, {policies}/")
    return None


def _published(out: Path) -> Path:
    """Return the path of the page of published policies."""
    return out.with_name(published.PAGE.name)
