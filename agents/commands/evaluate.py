"""Score a trained agent against the quick classical controllers.

For example ``python -m agents evaluate runs/first``. Writes tables and figures into the run's
folder and prints the ranking by the task's cost. Nothing in the folder is run: policies are files
of numbers. An archive of Stable-Baselines3 can run code when it is opened; it needs ``--trust``.

Your own controller (docs/controllers.md), whose file is executed: ``python -m agents evaluate
PreStretch --controller my_file.py:MyLaw``.

Several runs and controllers in one table, on one or more tasks (docs/evaluation.md): ``python -m
agents evaluate baselines lqr "runs/ppo-*" --tasks CarriageForce``.
"""

import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from agents.control.controller import Controller
from agents.controllers.tuned import NOT_SCORED, baselines
from agents.controllers.user_defined import user_defined
from agents.errors import command
from agents.evaluation.changed_scenes import Records, check_records
from agents.evaluation.conclusions import conclude
from agents.evaluation.contestants import BASELINES, Episodes, read_field
from agents.evaluation.measurement import Studies, measure
from agents.policies import AnyPolicy, PolicyError, load_policy
from agents.report.charts import draw_costs, draw_response
from agents.report.comparison import report_comparison
from agents.report.pages import (
    print_ranking,
    print_table,
    printed,
    write_episodes,
    write_scores,
)
from agents.report.published import read_published, scored_again
from agents.scoring import HELD_OUT_SEED, Evaluation, evaluate
from agents.training.config import Count
from agents.training.parts import agent_of, recorded_parts, trained_parts
from agents.training.runs import Run
from mm_gym import Scene, SceneError, load_scene, rewarded
from mm_gym.errors import refuse
from mm_gym.files import check_outputs
from mm_gym.scene import Document
from mm_gym.tasks import task_or_scene

OF_COMPARISONS = (
    *("tasks", "seeds", "first_seed", "robustness", "records", "unit", "frequency", "effort"),
)
"""Flags that only a comparison has."""

SINGLE = 200  # held-out episodes of a single run


class Arguments(Document):
    """What to evaluate."""

    subjects: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """either one finished run, runs/NAME (with --controller a task or a scene file); or several
    subjects to compare, or one with --tasks: a controller's name (a wrong one lists them),
    "baselines" for the quick ones, the folder of a run, a pattern of folders in quotes for the
    seeds of one training, a policy's file, or FILE.py:NAME"""
    tasks: tuple[str, ...] = ()
    """tasks to compare on, such as Hybrid, or scene files; by default those of the runs, or all"""
    episodes: Count | None = None
    """held-out episodes: 200, or 64 of each seed"""
    seeds: int | None = None
    """seeds of each subject: 5, or as many as the training has"""
    first_seed: int = HELD_OUT_SEED
    """seed of the first episode"""
    robustness: bool = False
    """compare also under other masses, stiffnesses and dampings, noise and delay"""
    records: tuple[Path, ...] = ()
    """also with recorded motions instead of the excitation"""
    unit: str | None = None
    """unit of --records, such as g or cm/s^2; by default g for AT2 files, else m/s^2 or N"""
    frequency: bool = False
    """measure the steady response of the closed loop over frequency"""
    effort: bool = False
    """measure response and effort over no control and over the best passive damper"""
    processes: Count = os.cpu_count() or 1
    """number of tasks scored at once; results do not depend on it"""
    policy: Path | None = None
    """a policy to score instead of the run's own: a policy's file, or a .zip archive of
    Stable-Baselines3 with --trust"""
    trust: bool = False
    """open an archive of Stable-Baselines3, and run the own base and reward of runs, although that
    can run any code"""
    controller: str | None = None
    """a controller of your own, FILE.py:NAME, in place of a run's policy"""
    reward: str | None = None
    """a cost of your own, FILE.py:NAME, to score by in place of the objective: docs/scenes.md"""
    published: bool = False
    """score the published policies again, and compare with docs/published.md"""
    out: Path | None = None
    """folder for tables and figures of --controller, and of what is compared; without it they are
    only printed"""

    @property
    def compares(self) -> bool:
        """Whether this is a comparison, and not the report of one run or of --controller."""
        fields = Arguments.model_fields
        asked = any(getattr(self, name) != fields[name].default for name in OF_COMPARISONS)
        if asked or len(self.subjects) > 1 or (self.out is not None and self.controller is None):
            return True
        (only,) = self.subjects
        named = "*" in only or not ("/" in only or Path(only).is_dir())
        return named and self.controller is None and self.policy is None


def report_run(
    run: Run,
    episodes: int = SINGLE,
    *,
    policy: AnyPolicy | None = None,
    name: str = "learned",
    others: Sequence[Controller] = (),
    trust: bool = False,
    reward: str | None = None,
    folder: Path | None = None,
) -> list[Evaluation]:
    """Evaluate a policy, by default the run's own, and the baselines on the same held-out episodes.

    The results are printed and written to a folder, by default the run's. Other controllers may
    join the baselines. The reward, FILE.py:NAME, is by default the one that the run was trained
    for; with another the results go into `scored-by-NAME` in the folder. The reference baseline is
    the first, the learned agent the last.
    """
    record = run.read()
    if policy is None:
        run.require_finished()
    if reward is None:
        parts = recorded_parts(run.scene(), record, run.record, trust=trust)
        scene = parts.scene
    else:  # asked for, so its file may be run, and the run's own only where a part is tuned by it
        scene = rewarded(run.scene(), reward)
        parts = trained_parts(run, trust=trust, asked=scene.own_reward)
    learned = agent_of(run, parts, name) if policy is None else parts.controller(policy, name)
    folder = folder or run.folder
    if reward not in {None, record["settings"].get("reward")}:  # the folder's own scores stay
        folder /= f"scored-by-{reward.rpartition(':')[2]}"
    return report([*others, learned], scene, episodes, folder)


def report(
    controllers: Sequence[Controller], scene: Scene, episodes: int, folder: Path | None
) -> list[Evaluation]:
    """Evaluate the baselines, then controllers; print the ranking, and write it to a folder."""
    score = partial(evaluate, scene, episodes=episodes)
    (reference, *others), not_scored = baselines(scene)
    results = [score(reference)]
    for controller in others:
        try:
            results.append(score(controller))
        except NOT_SCORED as error:
            not_scored[controller.name] = str(error)
    results += [score(controller) for controller in controllers]
    print_ranking(results, scene, not_scored)
    if folder is not None:
        write_scores(results, folder / "scores.csv")
        write_episodes(results, folder / "episodes.csv")
        draw_costs(results, scene, folder / "costs.png")
        draw_response(results[0], results[-1], scene, folder / "response.png")
        print(f"written: {folder}/")
    return results


def read_policy(path: Path, *, trust: bool) -> AnyPolicy:
    """Read a policy from a file of numbers, or from an archive if it is trusted.

    Raise `PolicyError` if the file is no policy, or an archive that is not trusted.
    """
    if path.suffix != ".zip":
        return load_policy(path)
    if not trust:
        msg = (
            f"{path}: opening an archive of Stable-Baselines3 can execute code in it; "
            "open it with --trust"
        )
        raise PolicyError(msg)
    from agents.training.algorithms import open_trusted  # noqa: PLC0415 - torch, which else is unused

    return open_trusted(path)


def compare_several(arguments: Arguments) -> None:
    """Compare what the command line names; refuse flags of a single run."""
    for flag in ("policy", "controller"):
        if getattr(arguments, flag) is not None:
            msg = f"--{flag}: allowed for one run; name the file or FILE.py:NAME among the subjects"
            raise SceneError(msg)
    if arguments.unit is not None and not arguments.records:
        msg = f"--unit: got {arguments.unit!r} without --records; it is the unit of their values"
        raise SceneError(msg)
    compared = read_field(
        arguments.subjects, arguments.tasks, arguments.reward, trust=arguments.trust
    )
    episodes = Episodes.of_field(
        compared, arguments.seeds, arguments.episodes, first=arguments.first_seed
    )
    studies = Studies(
        arguments.robustness,
        Records(arguments.records, arguments.unit),
        arguments.frequency,
        arguments.effort,
    )
    if arguments.out is not None:
        check_outputs([arguments.out / "comparison.csv"])
    check_records(compared.scenes.values(), studies.records)
    results = measure(compared, episodes, studies, arguments.processes)
    report_comparison(conclude(results, compared.scenes, episodes), arguments.out)


def evaluate_one(arguments: Arguments) -> None:
    """Report on one run or on --controller; raise `SceneError` for flags that do not fit."""
    episodes = SINGLE if arguments.episodes is None else arguments.episodes
    subject, path = Path(arguments.subjects[0]), arguments.policy
    if arguments.controller is not None:
        if path is not None:
            refuse("--policy", f"{path} and --controller", "one of them")
        scene = rewarded(load_scene(task_or_scene(subject.as_posix())), arguments.reward)
        report(user_defined(arguments.controller, scene), scene, episodes, arguments.out)
        return
    run = Run(subject.name, subject.parent)
    given = {"trust": arguments.trust, "reward": arguments.reward}
    if path is not None:
        policy = read_policy(path, trust=arguments.trust)
        given |= {"policy": policy, "name": path.stem, "folder": run.folder / path.stem}
    report_run(run, episodes, **given)


def score_published() -> str | None:
    """Score the published policies again; return which of them have another cost, or None."""
    found = list(scored_again(read_published()))
    rows = [(row.name, printed(row.cost), printed(cost)) for row, cost in found]
    print_table("published policies", ("policy", "cost published", "cost now"), rows)
    other = [
        f"{name}: published {was}, now {now}"
        for (row, cost), (name, was, now) in zip(found, rows, strict=True)
        if not row.has(cost)
    ]
    return "\n".join(["error: published policies have other costs", *other]) if other else None


@command
def main(arguments: Arguments) -> str | None:
    """Evaluate from the command line."""
    if arguments.published and arguments.subjects:
        got = " ".join(arguments.subjects)
        return f"error: --published: got {got} too; allowed: nothing else to evaluate"
    if arguments.published:
        return score_published()
    if not arguments.subjects:
        return f"error: got nothing to evaluate; allowed: the folder of a run, or {BASELINES}"
    (compare_several if arguments.compares else evaluate_one)(arguments)
    return None
