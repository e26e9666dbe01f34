"""The pages of committed scores: tasks, ranking, rigs that differ, sealed episodes."""

import re
from collections.abc import Iterator, Mapping, Sequence
from inspect import signature
from math import isnan, nan
from operator import itemgetter
from pathlib import Path
from typing import Any

from agents.control.trajectories import ends_of
from agents.evaluation.aggregates import Estimate
from agents.evaluation.headroom import CLASSICAL, LEARNED, SCORES, least_cost
from agents.evaluation.rigs import CONTROLLERS, DELAYS, OBSERVED, task_of
from agents.evaluation.rigs import EPISODES as OF_RIGS
from agents.evaluation.sealed import EPISODES as SEALED_EPISODES
from agents.evaluation.sealed import first_seed
from agents.report.pages import render
from agents.sweeps.results import Results, cells_of
from agents.sweeps.trials import EPISODES as PENALTIES
from mm_gym import Scene, compile_scene, load_scene, over_rigs
from mm_gym.files import read_text
from mm_gym.scene import Part
from mm_gym.tasks import ids, path_of, robust_ids, short_name

Row = Mapping[str, Any]

TASKS, RANKING, ROBUSTNESS, SEALED = (
    SCORES.with_name(f"{name}.md") for name in ("tasks", "ranking", "robustness", "sealed")
)

COLUMNS = {
    "zero": ("zero",),
    "best constant": ("constant",),
    "passive optimum": ("passive",),
    "best controller": CLASSICAL,
    "predictive": ("predictive",),
    "learned": (LEARNED,),
}
"""Heading of the ranking -> roles."""

SHOWN = "mm_gym/PreStretchNoiseRobust-v0"  # variant whose ranges are shown
MARGIN = 1e-3  # relative differences of costs up to this one count as none
NEAR = 0.01  # part of its cost by which a controller is at most above what is possible
NO_BETTER = "no better than the best constant"

TARGETS = ("force", "ground")  # in the order in which docstrings give the units of an amplitude

TERMS = {
    "displacement": ("x1", "m"),
    "velocity": ("v1", "m/s"),
    "stroke": ("(x2 - x1)", "m"),
    "effort": ("sum of squared actions", ""),
    "carriage_acceleration": ("a1", "m/s^2"),
    "sphere_acceleration": ("a2", "m/s^2"),
    "coupling_force": ("force between the masses", "N"),
}
"""Weight of the objective -> what is squared over its scale, and the scale's unit."""


def least(rows: Sequence[Row], *roles: str) -> float | None:
    """Return the least cost of some roles, if there is one."""
    return min((float(row["cost"]) for row in rows if row["role"] in roles), default=None)


def tasks_page(scores: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the page of all tasks with these scores, as of ``docs/task_scores.json``."""
    tasks = [
        {"name": name, "file": path_of(name), "scene": load_scene(name), **scores[name]}
        for name in ids()
    ]
    return render(
        "tasks",
        tasks=tasks,
        limited=[f"`{one['name']}`" for one in tasks if ends_of(one["scene"].objective)],
        classical=CLASSICAL,
        observing=(*CLASSICAL, LEARNED),
        least=least,
        about=about,
        describe=describe,
    )


def about(file: Path) -> str:
    """Return what the scene file's comment says after the task's id, and a space; else nothing."""
    lines = [line for line in read_text(file).splitlines() if line.startswith("# ")]
    text = lines[0].partition(": ")[2] if lines else ""
    return text and f"{text[0].upper()}{text[1:]} "


def describe(scene: Scene) -> str:
    """Return observation, action, reward, disturbance, start and plant of a scene as Markdown."""
    objective = scene.objective
    limits = {"x1": objective.displacement_limit, "x2 - x1": objective.rail_half_length}
    drawn = {f"initial.{name}": value for name, value in scene.initial} | dict(scene.randomization)
    return render(
        "scene",
        scene=scene,
        plant=compile_scene(scene),
        reward=_reward(scene),
        parts=_parts(scene),
        drawn=_drawn(scene, drawn),
        ends=[f"|{what}| exceeds {most:g} m" for what, most in limits.items() if most is not None],
    ).rstrip("\n")


def _reward(scene: Scene) -> str:
    found: list[str] = []
    for name, (what, unit) in TERMS.items():
        weight = getattr(scene.objective, f"{name}_weight")
        scaled = f"{what} / {getattr(scene.objective, f'{name}_scale'):g} {unit}" if unit else what
        if weight:
            term = f"({scaled})^2" if unit else f"({scaled})"
            found.append(term if weight == 1.0 else f"{weight:g} {term}")
    return " + ".join(found)


def _parts(scene: Scene) -> list[list[str]]:
    parts = {name: getattr(scene, name) for name in ("carriage", "sphere", "interface", "springs")}
    parts |= {f"excitation.{i}": part for i, part in enumerate(scene.excitation)}
    rows = [[name, _fields(part)] for name, part in parts.items()]
    return rows if scene.excitation else [*rows, ["excitation", "none"]]


def _fields(part: Part) -> str:
    words: list[str] = []
    for name, value in part:
        if name == "kind":
            words.insert(0, str(value).replace("_", " "))
        elif value is not None:
            words.append(f"{name.replace('_', ' ')} {_number(value)}{_unit(part, name)}")
    return ", ".join(words)


def _unit(part: Part, name: str) -> str:
    """Return the unit from the field's docstring; of two, the second is that of ground motion."""
    units = re.findall(r"\[([^\]]+)\]", type(part).model_fields[name].description or "")
    second = len(units) == len(TARGETS) and getattr(part, "target", None) == "ground"
    unit = units[second] if units else "-"
    return "" if unit == "-" else f" {unit}"


def _drawn(scene: Scene, values: Mapping[str, object]) -> list[list[str]]:
    """Return field, unit and ends of each range among the values of fields."""
    rows: list[list[str]] = []
    channels = {channel.name: channel.unit for channel in compile_scene(scene).observed}
    ranges = {name: ends for name, ends in values.items() if isinstance(ends, tuple)}
    for name, ends in ranges.items():
        owner: Any = scene
        *path, field = name.split(".")
        for word in path:
            owner = owner[int(word)] if word.isdigit() else getattr(owner, word)
        unit = _unit(owner, field).strip() if isinstance(owner, Part) else channels[field]
        rows.append([f"`{name}`", unit or "-", *(f"{end:.6g}" for end in ends)])
    return rows


def _number(value: object) -> str:
    if isinstance(value, tuple):
        return f"{value[0]:g} to {value[1]:g}"
    return f"{value:g}" if isinstance(value, float) else str(value).replace("_", " ")


def ranking_page(scores: Mapping[str, Mapping[str, Sequence[Row]]]) -> str:
    """Return the page that ranks all that is known, as of ``docs/task_scores.json``."""
    rows = {task: of_task["rows"] for task, of_task in scores.items()}
    told = {"columns": COLUMNS, "least": least, "least_cost": least_cost, "surprises": surprises}
    return render("ranking", tasks=rows, **told)


def surprises(rows: Sequence[Row]) -> list[str]:
    """Return what is unexpected in the order of a task's controllers, as sentences.

    Unexpected is: what does no better than the best constant; a controller of more knowledge that
    costs more than one of less; a passive damper that costs less than all classical controllers; a
    simple controller that costs less than the LQR.
    """
    return [sentence[0].upper() + sentence[1:] for sentence in _unexpected(rows)]


def _unexpected(rows: Sequence[Row]) -> Iterator[str]:
    of: dict[str, list[Row]] = {}
    for row in rows:
        of.setdefault(row["role"], []).append(row)
    (constant,) = of["constant"]
    for role in ("passive", "law", "predictive", "informed", LEARNED, "planner"):
        for row in of.get(role, []):
            if _beats(constant, row):
                yield f"{row['controller']} is {NO_BETTER}."
    laws = of.get("law", [])
    regulators = [row for row in laws if row["controller"].startswith("LQR")]
    yield from _pairs(
        [row for row in laws if row["controller"].startswith("velocity feedback")], regulators
    )
    for role, above in (("law", "predictive"), ("predictive", "informed")):
        yield from _pairs(_best(of.get(role, [])), of.get(above, []))
    observing = [row for role in ("law", "predictive", LEARNED) for row in of.get(role, [])]
    yield from _pairs(observing, of.get("planner", []))
    yield from _pairs(of.get("passive", []), _best(laws))


def _pairs(better: Sequence[Row], worse: Sequence[Row]) -> Iterator[str]:
    for one in better:
        for other in worse:
            if _beats(one, other):
                yield f"{one['controller']} costs less than {other['controller']}."


def _best(rows: Sequence[Row]) -> list[Row]:
    return sorted(rows, key=itemgetter("cost"))[:1]


def _beats(one: Row, other: Row) -> bool:
    return one["cost"] < other["cost"] * (1.0 - MARGIN)


def robustness_page(scores: Mapping[str, Any], results: Results) -> str:
    """Return the page of rigs that differ: of ``docs/robustness_scores.json``, and trainings."""
    compared = {name: _compared(scores[name]["rows"]) for name in scores}
    references = {one.task: one for one in results.controllers}
    observed = cells_of(results.observed)
    of_variants = [*cells_of(results.trainings), *observed]
    cells = {
        variant: min(every, key=lambda cell: cell.validation)
        for variant in scores
        if (every := [one for one in of_variants if one.task == variant])
    }
    ratios = {short_name(name): one.cost(references[name]) for name, one in cells.items()}
    return render(
        "robustness",
        episodes=OF_RIGS,
        variants={name: task_of(name) for name in robust_ids()},
        shown=short_name(SHOWN),
        task=short_name(task_of(SHOWN)),
        drawn=_drawn(load_scene(SHOWN), load_scene(SHOWN).randomization),
        widths={name: one.default for name, one in signature(over_rigs).parameters.items()},
        delays=DELAYS,
        most_above=NEAR,
        scores=scores,
        compared={short_name(name): rows for name, rows in compared.items() if rows[2]},
        near=[
            short_name(name)
            for name, (best, _, _, plan) in compared.items()
            if best and plan and plan["rigs"] > (1.0 - NEAR) * best["rigs"]
        ],
        unplanned=[short_name(name) for name, rows in compared.items() if rows[3] is None],
        not_better=[
            short_name(name)
            for name, (best, _, agent, _) in compared.items()
            if not (best and agent and agent["rigs"] < best["rigs"])
        ],
        trained=cells,
        observed=observed,
        references=references,
        ratios=ratios,
        of_trained=standing(ratios, len(scores)),
        of_cells=PENALTIES,
    )


def _compared(rows: Sequence[Row]) -> list[Row | None]:
    """Return the best controller, specialist and agent for the rigs, and the planner."""
    wanted = [(CONTROLLERS, "rigs"), (("specialist",), "late 0")]
    wanted += [(("over the rigs", OBSERVED), "rigs"), (("planner",), "rigs")]
    return [
        min((row for row in rows if row["role"] in roles), key=itemgetter(where), default=None)
        for roles, where in wanted
    ]


def sealed_page(data: Mapping[str, Any]) -> str:
    """Return the page of the sealed episodes of a release, as of ``docs/sealed_scores.json``."""
    again = [
        f"{algorithm_named(task, row['controller'])} on {short_name(task)}"
        for task, rows in data["tasks"].items()
        for row in rows["rows"]
        if row.get("again")
    ]
    return render(
        "sealed",
        **data,
        again=again,
        episodes=SEALED_EPISODES,
        seed=first_seed(data["release"]),
        of_sealed=of_sealed(data),
        algorithm=algorithm_named,
    )


def algorithm_named(task: str, name: str) -> str:
    """Return a controller's name, or the algorithm of trainings whose folders begin with a task."""
    return name.removeprefix(f"{short_name(task)}-").removesuffix("-plain")


def of_sealed(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return how the best agents stand to the best controllers on sealed episodes."""
    ratios = {
        short_name(task): Estimate(one["value"], one.get("low", nan), one.get("high", nan))
        for task, rows in data["tasks"].items()
        for one in rows["compared"]
    }
    return standing(ratios, len(ratios)) | {"episodes": SEALED_EPISODES}


def standing(ratios: Mapping[str, Estimate], count: int) -> dict[str, Any]:
    """Return the tasks, of so many, whose agent costs less than the controller, and the others.

    Parameters
    ----------
    ratios
        Name of a task -> cost of its best agent over that of its best controller.
    """
    return {
        "count": count,
        "surely": [name for name, ratio in ratios.items() if ratio.high < 1.0],
        "below": [name for name, ratio in ratios.items() if ratio.value < 1.0 <= ratio.high],
        "alone": [name for name, r in ratios.items() if r.value < 1.0 and isnan(r.high)],
        "above": [name for name, ratio in ratios.items() if not ratio.value < 1.0],
        "margin": f"{MARGIN:.1%}".replace("%", " %"),
        "hardly": [name for name, ratio in ratios.items() if 1.0 - MARGIN < ratio.value < 1.0],
    }
