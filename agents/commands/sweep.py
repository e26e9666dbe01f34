"""Train many agents: tasks, algorithms, settings and seeds.

For example ``python -m agents sweep --tasks PreStretch Hybrid --algorithms ppo sac --seeds 10``, or
with a file: ``python -m agents sweep sweep.toml``. ``--ray`` starts a Ray cluster on this machine,
and ``--ray ADDRESS`` uses one that runs.

Each training is a run folder in ``runs/NAME``, and ``results.csv`` there has a row for each. The
same command does the remaining trainings, and with more seeds or tasks the additional ones.
"""

from collections.abc import Collection
from pathlib import Path

from tqdm import tqdm

from agents.errors import command
from agents.sweeps.trials import (
    HERE,
    SweepSettings,
    check_scenes,
    check_settings,
    result_file,
    write_results,
)
from agents.sweeps.workers import work_here, work_on_ray
from agents.training.config import RunSettings
from agents.training.progress import notes_of
from agents.training.runs import Run


@command
def main(settings: SweepSettings) -> str | None:
    """Sweep from the command line."""
    return sweep(settings)


def sweep(
    settings: SweepSettings, root: Path = Path("runs"), known: Collection[str] = ()
) -> str | None:
    """Do the trainings that are left, but for those known by name; return what went wrong, or None.

    Raise `SceneError` if a setting of a training is wrong, or a scene differs. No folder is made.
    Raise `RunError` if another process is at work on this sweep, or a finished training has other
    settings.
    """
    trials, folder = settings.trials(), Run(settings.name, root)
    with folder.locked():
        whole = folder.folder.resolve()
        check_scenes(trials, whole)
        left: list[RunSettings] = []
        for trial in trials:
            run = Run(trial.name, whole)
            if result_file(run).exists():
                check_settings(trial, run)
            elif trial.name not in known:
                left.append(trial)
        problems: dict[str, str] = {}
        with tqdm(total=len(trials), initial=len(trials) - len(left), unit="training") as bar:

            def report(number: int, problem: str | None) -> None:
                bar.update()
                if problem is not None:
                    problems[left[number].name] = problem

            # Without defaults: what is not asked for is measured on an own scene.
            work = [(trial.model_dump_json(exclude_unset=True), str(whole)) for trial in left]
            try:
                if settings.ray is None:
                    work_here(work, settings.processes, report)
                else:
                    address = None if settings.ray == HERE else settings.ray
                    work_on_ray(work, address, settings.processes, report)
            except KeyboardInterrupt as interrupt:
                bar.close()
                advice = f"{folder.folder}: give the same command again to continue"
                raise KeyboardInterrupt(str(interrupt), advice) from None
            finally:
                path = write_results(trials, folder.folder)
    print(f"written: {path}")
    for trial in trials:
        for note in notes_of(Run(trial.name, whole)):
            print(f"{trial.name}: {note}")
    return "\n".join(f"{name}: {problem}" for name, problem in problems.items()) or None
