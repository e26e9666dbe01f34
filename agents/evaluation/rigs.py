"""Controllers on rigs that differ, on late and noisy sensors, and on the true state."""

import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
from pydantic import BaseModel

from agents.control.controller import Controller
from agents.control.feedback import Feedback, TrueState
from agents.control.scene import drawn_but
from agents.controllers.h_infinity import HInfinity
from agents.controllers.newton_predictive_control import NewtonPredictiveControl
from agents.controllers.predictive_control import predictive_control
from agents.controllers.registry import entries
from agents.controllers.tuned import best_law, classical_laws, further_laws
from agents.controllers.with_observer import WithObserver
from agents.evaluation.headroom import MOST_BYTES, SCORES, Cost, Row, controllers_of, interval
from agents.evaluation.plans import Effort, Planner
from agents.scoring import VALIDATION_SEED, evaluate, tail_mean, written
from agents.training.runs import checked
from mm_gym import DesignError, MovingMassVectorEnv, Scene, compile_scene, load_scene
from mm_gym.arrays import Array
from mm_gym.files import read_json
from mm_gym.tasks import robust_ids, short_name

FILE = SCORES.with_name("robustness_scores.json")

EPISODES = 200
DELAYS = (0, 1, 2)  # control steps by which the sensors of the task itself are late
WORST = 0.1  # share of the episodes that cost most
OBSERVED = "with observer"  # role of a specialist that an observer shows the present

ROLES = {"zero": "zero", "constant": "constant", "law": "controller", "predictive": "predictive"}
"""Roles here of those that `headroom` has and that are scored."""

CONTROLLERS = "controller", "predictive"  # roles of those to which agents are compared
OF_RIGS = "predictive", "planner"
"""Roles that are scored on the variant alone: one is slow, and no sensor matters to the other."""

PLANNED = Effort(random=3, rounds=2, searches=0)  # a full search takes an hour


class OnRigs(BaseModel, extra="allow", strict=True, allow_inf_nan=False):
    """A row of `VariantScores`, with the cost for each delay of the task's sensors."""

    role: str
    controller: str
    rigs: Cost
    low: Cost
    high: Cost
    worst: Cost


class VariantScores(BaseModel, extra="allow", strict=True, allow_inf_nan=False):
    """What is known of a variant."""

    scene_digest: str
    rows: list[OnRigs]


def read_robustness() -> dict[str, Any]:
    """Return the scores of all variants that were scored, as data of `VariantScores`.

    There are none without the file. Raise `SceneError` if it cannot be read, or is damaged.
    """
    if not os.path.lexists(FILE):
        return {}
    scores: Any = read_json(FILE, most=MOST_BYTES)
    checked(dict[str, VariantScores], scores, FILE, "a file of scores on rigs")
    return scores


def task_of(variant: str) -> str:
    """Return the id of the task that a variant is of."""
    return f"mm_gym/{short_name(variant).removesuffix('Robust')}-v0"


def variant_of(task: str) -> str | None:
    """Return the id of a task's variant, or None for what has none."""
    return next((variant for variant in robust_ids() if task_of(variant) == task), None)


def rigs_of(variant: str) -> dict[str, Scene]:
    """Return the scenes to score on: over the rigs, then the task with each delay."""
    task = load_scene(task_of(variant))
    late = {f"late {n}": task.replace(**{"sensors.delay": n}) for n in DELAYS}
    return {"rigs": load_scene(variant), **late}


def scores_of(
    variant: str, agents: Mapping[str, Sequence[Controller]], known: Sequence[Row] | None = None
) -> list[Row]:
    """Return a row for each controller of a variant, and for each agent.

    Agents are given by the id of the task or variant that they were trained on; those of the task
    have another row with an observer. Rows of controllers and of the plan that are known are not
    made again. A plan starts from what the others did; there is none where an actuator cannot be
    planned for.
    """
    scenes = rigs_of(variant)
    trained = {"specialist": task_of(variant), "over the rigs": variant}
    rows = [row for row in known or () if row["role"] not in (*trained, OBSERVED)]
    new: list[tuple[str, Controller]] = []
    if not rows:
        every = controllers_of(scenes["rigs"])
        new = [(ROLES[role], one) for role, one in every if role in ROLES]
    new += [(role, one) for role, task in trained.items() for one in agents.get(task, ())]
    specialists = agents.get(task_of(variant), ())
    new += [(OBSERVED, WithObserver(scenes["rigs"], one)) for one in specialists]
    starts: dict[str, Array] = {}
    for role, one in new:
        row, starts[one.name] = _scored(role, one, scenes)
        rows.append(row)
    if all(row["role"] != "planner" for row in rows):
        with suppress(DesignError):  # an actuator that plans refuse: the page names the variant
            rows.append(_scored("planner", Planner(scenes["rigs"], starts, PLANNED), scenes)[0])
    return sorted(rows, key=lambda row: row["role"] == "planner")


def _scored(role: str, controller: Controller, scenes: Mapping[str, Scene]) -> tuple[Row, Array]:
    """Return a controller's row, and what it applied over the rigs (steps, lanes, k)."""
    names = ["rigs"] if role in OF_RIGS else list(scenes)
    found = {name: evaluate(scenes[name], controller, episodes=EPISODES) for name in names}
    over = found["rigs"]
    low, high = interval(over.penalties)
    costs = {name: one.cost for name, one in found.items()}
    costs |= {"low": low, "high": high, "worst": float(np.sqrt(tail_mean(over.penalties, WORST)))}
    return {"role": role, "controller": controller.name, **written(costs)}, over.applied


DELAY, NOISE, FEW = 2, 0.01, 20
"""Control steps; standard deviation over each channel's scale; and episodes of a score."""

RUNS, ACTIONS = 10, 10  # of the measurement of time


def late(scene: Scene) -> Scene:
    """Return the scene with late and noisy sensors; noise that it has already stays."""
    plant = compile_scene(scene)
    noise = {
        name: NOISE / channel.factor
        for name, channel in zip(plant.channels, plant.observed, strict=True)
        if name not in ("stretch", "applied_force")  # what the actuators report themselves
    }
    return scene.replace(
        randomization=drawn_but(scene, "sensors."),
        **{"sensors.delay": DELAY, "sensors.noise": noise | dict(scene.sensors.noise)},
    )


def at_once(scene: Scene) -> Scene:
    """Return the scene with sensors that show the motion, and nothing else, exactly and at once."""
    return scene.replace(sensors={}, randomization=drawn_but(scene, "sensors."))


def tuned(scene: Scene) -> list[Feedback]:
    """Return the laws, tuned with the scene's own sensors, predictive control last."""
    laws = classical_laws(scene)
    further = [law for law in further_laws(scene) if isinstance(law, Feedback)]
    return [*laws, *further, predictive_control(scene, best_law(scene, laws))]


def compare(scene: Scene, laws: Sequence[Feedback]) -> list[tuple[str, float | None, float | None]]:
    """Return each law's name and its costs with late sensors, from these and from the true state.

    A controller that filters the observation by itself is designed for the late sensors, and for
    those that show the state at once. None stands for what cannot be estimated or designed.
    """
    shown, rows = late(scene), []
    for law in [controller.law for controller in laws]:
        known = evaluate(shown, Feedback(shown, law, TrueState()), episodes=FEW).cost
        own = law  # plans for late sensors expect less from what these seem to show
        if isinstance(law, NewtonPredictiveControl):
            own = NewtonPredictiveControl(shown, law.steps)
        rows.append((law.name, _cost(shown, lambda scene, own=own: Feedback(scene, own)), known))
    if scene.actuation.names == ("force",):
        both = shown, at_once(scene)
        rows += [
            (name, *(_cost(own, make) for own in both)) for name, make in _filters(scene).items()
        ]
    return rows


def _filters(scene: Scene) -> dict[str, Callable[[Scene], Controller]]:
    """Return what makes the controllers that filter by themselves, with the scene's own numbers."""
    made: dict[str, Callable[[Scene], Controller]] = {}
    for entry in entries(scene, "filter"):
        if entry.refuses(scene) is None:
            made[entry.title] = entry.make
            if entry.tunable is not None:
                numbers = entry.tunable.numbers(scene)
                made[entry.title] = partial(entry.tunable.design, numbers=numbers)
    return made | {HInfinity.name: HInfinity}


def _cost(scene: Scene, make: Callable[[Scene], Controller]) -> float | None:
    """Return the cost of a controller; None if it cannot be made."""
    try:
        return evaluate(scene, make(scene), episodes=FEW).cost
    except DesignError:
        return None


def time_of_action(scene: Scene, controller: Feedback) -> float:
    """Return the processor time [s] in which a controller finds an action of one episode.

    The mean of ten actions, in the quickest of ten runs: others may load the machine.
    """
    env = MovingMassVectorEnv(scene, 1)
    observation, _ = env.reset(seed=VALIDATION_SEED)
    memory, spent = controller.begin(env), []
    for _ in range(RUNS * ACTIONS):
        began = time.process_time()
        action, memory = controller.act(memory, observation, {})
        spent.append(time.process_time() - began)
        observation, *_ = env.step(action)
    return min(sum(spent[k : k + ACTIONS]) for k in range(0, len(spent), ACTIONS)) / ACTIONS
