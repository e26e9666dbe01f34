"""The scene, the base and the reward of a run, made from its settings; and a scene's best base.

No search returns a worse agent than the best classical controller of its scene.
"""

import copy
import math
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from gymnasium.error import DependencyNotInstalled

from agents.control.controller import Acted, Controller, Info, Memory, Observation
from agents.control.feedback import Feedback
from agents.controllers.adjustable import Adjustable, Scheduled, adjustable
from agents.controllers.choices import recorded
from agents.controllers.learned import Learned, Residual
from agents.controllers.registry import RANDOM, laws, not_a_law, once
from agents.controllers.searched import least
from agents.controllers.tuned import NOT_SCORED
from agents.controllers.user_defined import user_defined
from agents.policies import AnyPolicy, PolicyError, load_policy
from agents.scoring import VALIDATION_EPISODES, VALIDATION_SEED, evaluate, tail_mean
from agents.training.config import RunSettings
from agents.training.progress import read_ending
from agents.training.runs import Run, RunError
from mm_gym import (
    ActionError,
    CompileError,
    DesignError,
    MovingMassVectorEnv,
    OwnReward,
    Scene,
    SceneError,
    rewarded,
)
from mm_gym.arrays import Array
from mm_gym.errors import refuse
from mm_gym.user_code import is_path, source, split

NO_BASE = "none"  # what asks for an agent that is added to no controller


@dataclass(frozen=True, eq=False)
class Parts:
    """The scene with the run's own reward, if any, and the controller that the agent is around."""

    scene: Scene
    base: Controller | None = None
    authority: float = 0.0
    scheduled: Adjustable | None = None  # the base's law, if the agent sets its numbers instead
    numbers: Sequence[float] = ()  # those that the base's searches chose

    def controller(self, policy: AnyPolicy, name: str = "learned") -> Controller:
        """Return a policy as a controller, around the base if there is one."""
        if self.base is None:
            return Learned(policy, name)
        if self.scheduled is None:
            return Residual(self.base, policy, self.authority, name)
        assert isinstance(self.base, Feedback)  # noqa: S101 - of a law
        law = Scheduled(self.scheduled, policy, self.authority, name)
        return Feedback(self.scene, law, self.base.source)


def make_parts(settings: RunSettings, run: Run | None = None) -> Parts:
    """Return the parts of a training; files that its settings name are run.

    The base is made with the numbers that its searches chose before, if it goes on with a run that
    has them. Raise `SceneError` if a part cannot be made.
    """
    known = (run.numbers(settings), run.record) if run else ()
    return _parts(settings.rewarded_scene(), settings.model_dump(), *known)


def agent_of(run: Run, parts: Parts, name: str = "learned") -> Controller:
    """Return what a finished run stands for: its policy, or a controller that costs less.

    Raise `RunError` if a file of the user's that is part of it has changed since the training.
    """
    _require_unchanged(run, parts)
    ending = read_ending(run)
    if ending is None or ending.returned is None:
        return parts.controller(load_policy(run.policy), name)
    make = partial(base_controller, parts.scene, ending.returned)
    controller = copy.copy(recorded(make, ending.numbers, run.ending)[0])  # some are cached
    controller.name = name
    return controller


def recorded_parts(
    scene: Scene, record: Mapping[str, Any], file: object = "run.json", *, trust: bool
) -> Parts:
    """Return the parts of a run, from its scene and what its record in a file says (`Record`).

    The record's own reward is added to the scene, if it has one and the settings name it. Raise
    `PolicyError` if they are in a file of the user's, which would be run, and it is not trusted;
    `SceneError` if a part cannot be made.
    """
    settings = record["settings"]
    base, reward = (settings.get(name) for name in ("base", "reward"))
    code = [text for text in (base, reward) if isinstance(text, str) and is_path(text)]
    if code and not trust:
        msg = (
            f"{', '.join(code)}: scoring executes this code of the run; evaluate, export, record "
            "and report allow it with --trust"
        )
        raise PolicyError(msg)
    return _parts(rewarded(scene, reward), settings, record.get("numbers"), file)


def trained_parts(run: Run, *, trust: bool, asked: OwnReward | None = None) -> Parts:
    """Return the parts of a run by which its agent acts as it did when it was trained.

    A base, or the controller that is returned, is tuned by the reward that the run was trained for,
    whatever reward scores it. Where there is neither, no reward has a part in the actions, and none
    is run. A reward that was asked for by the same name has been run, so it needs no trust. Raise
    as `recorded_parts` does, and `RunError` if a file that was run has changed since the training.
    """
    record, ending, scene = run.read(), read_ending(run), run.scene()
    settings = record["settings"]
    has_base = settings.get("base") not in (None, NO_BASE)
    if not has_base and (ending is None or ending.returned is None):
        settings = settings | {"reward": None}
    elif asked is not None and asked.given == settings.get("reward"):
        scene, settings = rewarded(scene, asked), settings | {"reward": None}
    parts = recorded_parts(scene, record | {"settings": settings}, run.record, trust=trust)
    _require_unchanged(run, parts)
    return parts


def _require_unchanged(run: Run, parts: Parts) -> None:
    """Raise `RunError` if a file of the parts holds another text than the run's record."""
    own = parts.scene.own_reward
    if parts.base is None and own is None:
        return
    record = run.read()
    used = {
        "base": parts.base is not None,
        "reward": own is not None and own.given == record["settings"].get("reward"),
    }
    for what in (name for name, is_used in used.items() if is_used):
        text = record["settings"].get(what)
        if not isinstance(text, str) or not is_path(text):
            continue
        path, _ = split(text, what)
        if source(path, what) != record.get("code", {}).get(str(path)):
            msg = (
                f"{run.folder}: {what}: {path} has changed since the training; "
                "restore the text that `code` in run.json holds, or train again"
            )
            raise RunError(msg)


def base_controller(scene: Scene, base: str, what: str = "base") -> Controller:
    """Return the controller that an agent is added to, tuned on the validation episodes.

    A law of a user's file is fed the state that `observed_state` estimates from the observation.
    Raise `SceneError`, which names the setting, if it cannot be made, or does not suit the scene.
    """
    if is_path(base):
        return user_defined(base, scene, what)[-1]
    applicable = laws(scene)
    if base not in applicable:
        raise not_a_law(base, scene, what, "or FILE.py:NAME")
    try:
        return applicable[base](scene)
    except (CompileError, DesignError) as error:
        msg = f"{what}: {base} cannot be designed for this scene: {error}"
        raise SceneError(msg) from error


def _parts(
    scene: Scene,
    settings: Mapping[str, Any],
    numbers: Sequence[float] | None = None,
    file: object = "run.json",
) -> Parts:
    base, schedules = settings.get("base"), settings.get("schedules", False)
    added: Controller | None = None
    if base is not None and base != NO_BASE:
        added, numbers = recorded(partial(base_controller, scene, base), numbers, file)
    law = adjustable(added) if schedules else None
    if schedules and law is None:
        refuse(
            "schedules",
            "no base" if added is None else f"base {base!r}",
            "a controller of this project whose numbers can change in each control step, as those "
            "of inertial-drive can",
        )
    return Parts(scene, added, settings.get("authority", 0.0), law, numbers or ())


PLANS = "predictive-control"
"""The controller that plans anew in each control step: it takes minutes on the validation
episodes, and is no base of a training."""

FEW, NEAR, CLEARLY = (10, 30), 1.1, 3.0
"""Episodes on which it is tried first, and by how much it may cost more there than the best of the
others: so many times as much, and so many standard errors of the mean difference of the penalties.
It is scored on all of them only then. One that costs the same in truth is left out in about 1 of
100 cases."""


class TooSlowError(RuntimeError):
    """A controller takes more time than it is given."""


class _Hurried(Controller):
    """A controller that raises `TooSlowError` beyond a time of the clock [s]."""

    def __init__(self, controller: Controller, until: float) -> None:
        self.controller, self.name, self.reads = controller, controller.name, controller.reads
        self.until = until

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        return self.controller.begin(env)

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        if time.perf_counter() > self.until:
            raise TooSlowError(self.name)
        return self.controller.propose(memory, observation, info)

    def note(self, memory: Memory, action: Array) -> Memory:
        return self.controller.note(memory, action)


class Best(NamedTuple):
    """A controller of a scene."""

    name: str  # the one that commands take
    cost: float  # on the validation episodes, on which it was tuned [-]
    left_out: str | None = None  # name of one that took too long to be scored


def best_controller(
    scene: Scene, *, plans: bool = True, worst: float = 1.0, seconds: float = math.inf
) -> Best:
    """Return the controller of least validation cost, of those that read the observation alone.

    It is no control where none costs less. Raise `SceneError` or `CompileError` if there is nothing
    to control.

    Parameters
    ----------
    scene
        What is controlled.
    plans
        Whether predictive control by plans of its own is among them.
    worst
        Share of the episodes, those that cost most, whose mean is the cost.
    seconds
        Longest time [s] of scoring these plans, after which they are left out.
    """
    MovingMassVectorEnv(scene, 1).close()
    return once(_best, scene, plans, worst, seconds if plans else math.inf)


def _best(scene: Scene, plans: bool, worst: float, seconds: float) -> Best:  # noqa: FBT001 - an argument of `once`
    if not plans:
        names = [name for name in laws(scene) if name not in {RANDOM, PLANS}]
        return Best(*least(names, lambda name, most: _cost(scene, name, worst, most)))
    best, until = once(_best, scene, False, worst, math.inf), time.perf_counter() + seconds
    try:
        if all(_may_be_best(scene, best, worst, episodes, until) for episodes in FEW):
            found = Best(PLANS, _cost(scene, PLANS, worst, best.cost, until))
            return min(best, found, key=lambda one: one.cost)
    except TooSlowError:
        return best._replace(left_out=PLANS)
    return best


def _may_be_best(scene: Scene, best: Best, worst: float, episodes: int, until: float) -> bool:
    """Tell from some of the episodes whether plans may cost less than the best of others."""
    others = _penalties(scene, best.name, worst, episodes=episodes)
    near = NEAR * float(np.sqrt(tail_mean(others, worst)))
    plans = _penalties(scene, PLANS, worst, near, episodes, until=until)
    if np.sqrt(tail_mean(plans, worst)) > near:
        return False
    more = plans - others
    error = more.std(ddof=1) / np.sqrt(episodes)
    return worst < 1.0 or bool(more.mean() <= CLEARLY * error)


def _cost(
    scene: Scene, name: str, worst: float, most: float = np.inf, until: float = math.inf
) -> float:
    """Return the cost of a controller on the validation episodes, as `validation_cost` does."""
    penalties = _penalties(scene, name, worst, most, until=until)
    return float(np.sqrt(tail_mean(penalties, worst)))


def _penalties(
    scene: Scene,
    name: str,
    worst: float,
    most: float = np.inf,
    episodes: int = VALIDATION_EPISODES,
    *,
    until: float = math.inf,
) -> Array:
    """Return a controller's penalties (episodes,), infinite ones if it has none.

    The episodes are ended once it is known that it costs more than `most`. Raise `TooSlowError` if
    they last beyond a time of the clock [s].
    """
    found, told = np.full(episodes, np.inf), {"episodes": episodes, "most": most, "worst": worst}
    with suppress(*NOT_SCORED, ActionError, DependencyNotInstalled):
        controller = laws(scene)[name](scene)
        if until < math.inf:
            controller = _Hurried(controller, until)
        if controller.reads == "observation":
            found = evaluate(scene, controller, seed=VALIDATION_SEED, **told).penalties
    return np.where(np.isfinite(found).all(), found, np.inf)
