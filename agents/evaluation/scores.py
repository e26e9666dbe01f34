"""The committed scores of tasks, ``docs/task_scores.json``, read within bounds."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Self, cast

from pydantic import BaseModel, Field, TypeAdapter, ValidationError, model_validator

from mm_gym import SceneError
from mm_gym.files import read_json

SCORES = Path(__file__).parents[2] / "docs" / "task_scores.json"

MOST_BYTES = 2**24  # largest file of scores

NEEDED = ("constant", "planner")
"""Roles that every task has a row of: others are compared with them."""

Cost = Annotated[float, Field(ge=0)]


class Plan(BaseModel, strict=True, allow_inf_nan=False):
    """The clairvoyant optimum of an episode."""

    cost: Cost
    start: str


class Scored(BaseModel, extra="allow", strict=True, allow_inf_nan=False):
    """A row of `agents.evaluation.headroom.Headroom`."""

    role: str
    controller: str
    reads: str
    cost: Cost
    low: Cost
    high: Cost
    displacement: float
    plans: list[Plan] = []


class Preview(BaseModel, strict=True, allow_inf_nan=False):
    """What `agents.evaluation.headroom.preview` returns."""

    expected: Cost
    foreseen: Cost


class TaskScores(BaseModel, extra="allow", strict=True, allow_inf_nan=False):
    """What is known of a task."""

    scene_digest: str
    rows: list[Scored]
    preview: Preview | None = None

    @model_validator(mode="after")
    def _has_roles(self) -> Self:
        roles = [row.role for row in self.rows if row.plans or row.role != "planner"]
        for role in NEEDED:
            if role not in roles:
                msg = f"rows: no {role}; allowed: one of each of {', '.join(NEEDED)}, or more"
                raise ValueError(msg)
        return self


def read_scores(path: Path = SCORES, tasks: Iterable[str] = ()) -> dict[str, dict[str, Any]]:
    """Return what is known of each task, by its id, as data of `TaskScores`.

    Some tasks must be in it. Raise `SceneError` if the file cannot be read, is damaged, or lacks a
    task.
    """
    data = read_json(path, most=MOST_BYTES)
    try:
        TypeAdapter(dict[str, TaskScores]).validate_python(data)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "its content"
        msg = f"{path}: not a file of scores: {where}: {first['msg']}"
        raise SceneError(msg) from None
    scores = cast("dict[str, dict[str, Any]]", data)
    for task in tasks:
        if task not in scores:
            msg = f"{path}: {task}: no scores; run: python -m agents headroom {task}"
            raise SceneError(msg)
    return scores
