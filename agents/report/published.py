"""Published policies: that of the median seed of each row of results, and what it scores."""

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, Field

from agents.control.controller import Controller
from agents.policies import PolicyError, load_policy
from agents.report.pages import printed, render
from agents.scoring import evaluate
from agents.sweeps.results import Cell
from agents.sweeps.trials import EPISODES, LEARNERS, Learner, algorithm_of
from agents.training.config import RunSettings
from agents.training.parts import recorded_parts
from agents.training.runs import Run, read_checked
from mm_gym import Scene, load_scene
from mm_gym.files import read_bytes, write_bytes, write_text
from mm_gym.tasks import ids, robust_ids, short_name

DOCS = Path(__file__).parents[2] / "docs"
FOLDER = DOCS / "policies"
PAGE = DOCS / "published.md"

RECORD = "published.json"  # the file in the folder that says what each policy is
LARGEST = 60_000  # size of a policy that is published [bytes]; a table of value iteration is larger
MOST_BYTES = 2**20  # largest record

NAMES = {"crossq": "CrossQ", "recurrent_ppo": "recurrent PPO"} | {
    name: name.upper() for name in ("ppo", "sac", "td3", "tqc")
}
"""Of algorithms, in prose."""

Cost = Annotated[float, Field(ge=0)]


ROUNDED = 1e-3
"""Relative, of a cost of an agent around a designed controller. Another kind of processor rounds
the design otherwise, and a law that switches amplifies that: so far to 3e-4."""


class Row(BaseModel, strict=True, allow_inf_nan=False):
    """A published policy, or one that is too large."""

    # task, scene_digest: what it was trained and scored on
    task: str
    scene_digest: str
    # algorithm, seed, seeds: what it was trained by; its seed is that of the median cost among so
    # many
    algorithm: Learner
    seed: int
    seeds: int
    # cost, least, most: its cost on the held-out episodes, and those of the best and the worst seed
    # [-]
    cost: Cost
    least: Cost
    most: Cost
    size: int  # of its file [bytes]
    # Its name in the folder, or None for a policy that is too large.
    file: Annotated[str, Field(pattern=r"^[\w-]+\.(safetensors|npz)$")] | None = None
    # base, authority: the controller that it is around, if any, and how much it may change
    base: str | None = None
    authority: float = 0.0
    schedules: bool = False  # whether it sets the controller's numbers instead
    numbers: list[float] | None = None  # those that the controller's searches chose
    scored: str  # what scored it

    @property
    def name(self) -> str:
        """Its task and algorithm, in words."""
        return f"{short_name(self.task)}, {self.algorithm}"

    @property
    def agent(self) -> str:
        """What it is called among other controllers of its task."""
        return f"{NAMES.get(self.algorithm, self.algorithm.replace('_', ' '))}, published"

    def has(self, cost: float) -> bool:
        """Tell whether a cost found today is that which it was published with, as printed."""
        rounding = ROUNDED * self.cost if self.base else 0.0
        return printed(cost) == printed(self.cost) or abs(cost - self.cost) < rounding


class Published(BaseModel, strict=True):
    """What ``published.json`` holds."""

    rows: list[Row]  # the policies


def publish(
    cells: Iterable[Cell], done: Iterable[RunSettings], runs: Path, folder: Path
) -> Published:
    """Write the policy of the median seed of every task and algorithm, and the record of them.

    What was published before stays for a task and an algorithm whose median seed is not here.

    Parameters
    ----------
    cells
        The trainings of each task and algorithm.
    done, runs
        The trainings that are finished here, and the folder that their runs are in.
    folder
        Where the policies go. Those that its record names and that have no row now are deleted.
    """
    rows: dict[tuple[str, str], Row] = {}
    if (folder / RECORD).exists():
        rows = {(row.task, row.algorithm): row for row in read_published(folder).rows}
    before = {row.file for row in rows.values() if row.file}
    here = {(one.task, algorithm_of(one), one.seed): Run(one.name, runs) for one in done}
    for cell in cells:
        run = here.get((cell.task, cell.algorithm, cell.median.seed))
        if run is None:
            continue
        content, record = read_bytes(run.policy, most=MOST_BYTES), run.read()
        name = f"{short_name(cell.task)}-{cell.algorithm}{run.policy.suffix}"
        fits = len(content) <= LARGEST
        if fits:
            write_bytes(folder / name, content)
        settings, numbers = record["settings"], record.get("numbers")
        median = cell.median.model_dump(include=set(Row.model_fields))
        rows[cell.task, cell.algorithm] = Row(
            **median,
            seeds=len(cell.trainings),
            least=float(cell.costs.min()),
            most=float(cell.costs.max()),
            size=len(content),
            file=name if fits else None,
            base=settings.get("base"),
            authority=settings.get("authority", 0.0),
            schedules=settings.get("schedules", False),
            numbers=numbers,
            scored=f"{cell.median.machine}, commit {cell.median.commit}",
        )
    for name in before - {row.file for row in rows.values()}:
        (folder / name).unlink(missing_ok=True)
    tasks = [*ids(), *robust_ids()]
    places = sorted(rows, key=lambda place: (tasks.index(place[0]), LEARNERS.index(place[1])))
    found = Published(rows=[rows[place] for place in places])
    write_text(folder / RECORD, json.dumps(found.model_dump(), indent=1) + "\n")
    return found


def read_published(folder: Path = FOLDER) -> Published:
    """Return the record of a folder of policies; raise `SceneError` if it is damaged."""
    return read_checked(Published, folder / RECORD, "a record of published policies", MOST_BYTES)


def published_agents(
    rows: Iterable[Row], folder: Path = FOLDER
) -> Iterator[tuple[Row, Scene, Controller]]:
    """Yield the published policies that have a file as controllers of their scenes.

    Raise `PolicyError` as `controller_of`.
    """
    for row in rows:
        if row.file is not None:
            scene = load_scene(row.task)
            yield row, scene, controller_of(row, scene, folder)


def controller_of(row: Row, scene: Scene, folder: Path = FOLDER) -> Controller:
    """Return a published policy, which has a file, as the controller of its scene.

    Raise `PolicyError` if it is missing or damaged, or was made for another scene.
    """
    file = folder / str(row.file)
    if scene.digest != row.scene_digest:
        msg = f"{file}: made for another scene than {row.task} has now"
        raise PolicyError(msg)
    settings = row.model_dump(include={"base", "authority", "schedules"})
    record = {"settings": settings, "numbers": row.numbers}
    parts = recorded_parts(scene, record, f"{folder / RECORD}: {row.name}", trust=False)
    return parts.controller(load_policy(file))


def scored_again(published: Published, folder: Path = FOLDER) -> Iterator[tuple[Row, float]]:
    """Yield every policy that is published with its cost on the held-out episodes today.

    Raise `PolicyError` as `controller_of`.
    """
    for row, scene, agent in published_agents(published.rows, folder):
        yield row, evaluate(scene, agent, episodes=EPISODES).cost


def page(published: Published) -> str:
    """Return the page of the published policies, ``docs/published.md``."""
    found, tasks = published.rows, ids()
    own = [row for row in found if row.task in tasks]  # the others are of variants
    known = dict.fromkeys(short_name(row.task) for row in own)
    missing: dict[str, str] = {}
    for name in sorted({row.algorithm for row in own}, key=LEARNERS.index):
        there = {short_name(row.task) for row in own if row.algorithm == name}
        if lacking := [task for task in known if task not in there]:
            missing[name] = ", ".join(lacking)
    return render(
        "published",
        rows=found,
        largest=LARGEST // 1000,
        rounded=f"{100.0 * ROUNDED:g}",
        episodes=EPISODES,
        scored=list(dict.fromkeys(row.scored for row in found)),
        missing=missing,
    )
