"""Score a trained agent against every baseline: ``python -m agents.evaluate runs/first``.

Writes tables and figures into the run's folder and prints the ranking by the task's cost. Nothing
in the folder is run: policies are files of numbers. An archive of Stable-Baselines3 can run code
when it is opened; it needs ``--trust``.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path  # noqa: TC003 - tyro reads the annotation
from typing import Annotated

import tyro

from agents.evaluation.baselines import baselines
from agents.evaluation.episodes import Evaluation, evaluate
from agents.policies import Policy, PolicyError, load_policy
from agents.report.figures import draw_costs, draw_response
from agents.report.tables import print_ranking, write_episodes, write_scores
from agents.training.parts import recorded_parts
from agents.training.runs import Run, RunError
from mm_gym import Scene, SceneError


@dataclass(frozen=True)
class Arguments:
    """What to evaluate."""

    folder: Annotated[Path, tyro.conf.Positional]
    """folder of a finished run, runs/NAME"""
    episodes: int = 200
    """held-out episodes"""
    policy: Path | None = None
    """a policy to score instead of the run's own: a .npz file, or a .zip archive of
    Stable-Baselines3 with --trust"""
    trust: bool = False
    """open an archive of Stable-Baselines3, and run a run's own base and reward, although that can
    run any code"""


def report_run(
    run: Run,
    episodes: int = 200,
    *,
    policy: Policy | None = None,
    name: str = "learned",
    trust: bool = False,
) -> list[Evaluation]:
    """Evaluate a policy, by default the run's own, and the baselines on the same held-out episodes.

    The results are printed and written to the run's folder, those of another policy to the folder
    `name` in it.

    Returns
    -------
    list of Evaluation
        The reference baseline first, the learned agent last.
    """
    record = run.read()
    if policy is None and not run.finished:
        msg = f"{run.folder}: training is not over; continue it: python -m agents.train"
        raise RunError(msg)
    folder = run.folder if policy is None else run.folder / name
    scene = Scene(**record["scene"])
    parts = recorded_parts(scene, record["settings"], trust=trust)
    agent = parts.controller(policy or load_policy(run.policy), name)
    *others, learned = [
        evaluate(scene, controller, episodes=episodes, rewards_of=parts.rewards_of)
        for controller in (*baselines(scene), agent)
    ]
    results = [*others, learned]
    write_scores(results, folder / "scores.csv")
    write_episodes(results, folder / "episodes.csv")
    draw_costs(results, scene, folder / "costs.png")
    draw_response(results[0], results[-1], scene, folder / "response.png")
    print_ranking(results, scene)
    print(f"written: {folder}/")
    return results


def read_policy(path: Path, *, trust: bool) -> Policy:
    """Read a policy from a file of numbers, or from an archive if it is trusted.

    Raises
    ------
    PolicyError
        If the file is no policy, or an archive that is not trusted.
    """
    if path.suffix != ".zip":
        return load_policy(path)
    if not trust:
        msg = (
            f"{path}: an archive of Stable-Baselines3: opening it can run code that it carries; "
            "--trust opens it"
        )
        raise PolicyError(msg)
    from agents.training.archive import open_trusted  # noqa: PLC0415 - torch, which else is unused

    return open_trusted(path)


def main() -> str | None:
    """Evaluate from the command line."""
    arguments = tyro.cli(Arguments, description=__doc__)
    try:
        run = Run(arguments.folder.name, arguments.folder.parent)
        path, episodes = arguments.policy, arguments.episodes
        if path is None:
            report_run(run, episodes, trust=arguments.trust)
        else:
            policy = read_policy(path, trust=arguments.trust)
            report_run(run, episodes, policy=policy, name=path.stem, trust=arguments.trust)
    except (SceneError, RunError, PolicyError) as error:
        return f"error: {error}"
    return None


if __name__ == "__main__":
    sys.exit(main())
