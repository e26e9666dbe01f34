"""Settings of runs and algorithms: a file of `configs`, then flags; and seeds of training lanes."""

import json
import sys
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, TypeAlias, TypeVar, get_args

from pydantic import (
    BaseModel,
    Field,
    JsonValue,
    SerializerFunctionWrapHandler,
    Strict,
    model_serializer,
    model_validator,
)
from tyro import cli
from tyro.constructors import PrimitiveConstructorSpec

from agents.control.scene import plant_of
from mm_gym import Scene, SceneError, load_scene, rewarded
from mm_gym.errors import refuse
from mm_gym.files import read_toml
from mm_gym.scene import Document, Part
from mm_gym.tasks import path_of, short_name, task_called, task_or_scene
from mm_gym.user_code import is_path, source, split

Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]
Batch = Annotated[int, Field(ge=2)]
Discount = Annotated[float, Field(gt=0, le=1)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Hidden = Annotated[tuple[Count, ...], Strict(False)]

Algorithm: TypeAlias = Literal["ppo", "sac", "td3", "tqc", "crossq", "recurrent_ppo"]


class AlgorithmSettings(Part):
    """What all algorithms have."""

    learning_rate: Positive = 1e-3
    """learning rate of the optimiser"""
    batch_size: Batch = 256
    """samples of one gradient step"""
    discount: Discount = 0.97
    """discount factor gamma"""
    hidden: Hidden = (64, 64)
    """units of the hidden layers, of policy and value alike"""
    reward_scale: Positive = 0.05
    """factor on the reward, so that the value function is of order one"""


class PPOSettings(AlgorithmSettings):
    """Proximal policy optimisation (Schulman et al., 2017)."""

    learning_rate: Positive = 1e-3
    """learning rate at the start; it falls linearly to zero"""
    rollout: Count = 100
    """control steps per lane between updates"""
    batch_size: Batch = 3200
    """samples of one gradient step, at most those of a rollout"""
    epochs: Count = 8
    """passes over each rollout"""
    gae_lambda: Fraction = 0.95
    """trade of bias for variance in the advantage"""
    initial_log_std: float = -0.5
    """logarithm of the initial exploration noise"""


class RecurrentPPOSettings(PPOSettings):
    """PPO with a long short-term memory cell before the layers."""

    hidden: Hidden = (64,)
    """units of the layers after the cell, of policy and value alike"""
    units: Count = 32
    """units of the cell"""


class OffPolicySettings(AlgorithmSettings):
    """What the algorithms with a replay buffer have."""

    buffer_size: Count = 300_000
    """control steps of all lanes that are remembered"""
    learning_starts: Annotated[int, Field(ge=0)] = 10_000
    """control steps of all lanes before the first gradient step"""
    gradient_steps: Count = 4
    """gradient steps after each control step of all lanes"""
    reward_scale: Positive = 1.0
    """factor on the reward, so that the value function is of order one"""


class SACSettings(OffPolicySettings):
    """Soft actor-critic (Haarnoja et al., 2018), with a learned temperature."""

    tau: Fraction = 0.005
    """fraction by which the target network follows in a gradient step"""
    initial_entropy: Positive = 0.1
    """temperature at the start"""


class TD3Settings(OffPolicySettings):
    """Twin delayed deep deterministic policy gradient (Fujimoto et al., 2018)."""

    tau: Fraction = 0.005
    """fraction by which the target network follows in a gradient step"""
    noise: Positive = 0.1
    """standard deviation of the exploration noise"""


class TQCSettings(SACSettings):
    """Truncated quantile critics (Kuznetsov et al., 2020)."""

    dropped_quantiles: Annotated[int, Field(ge=0, lt=25)] = 2
    """quantiles that are dropped, of the 25 of each critic"""


class CrossQSettings(OffPolicySettings):
    """CrossQ (Bhatt et al., 2024): batch normalisation instead of target networks."""

    initial_entropy: Positive = 0.1
    """temperature at the start"""


Changes = Annotated[
    dict[str, JsonValue],
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="JSON",
        instance_from_str=lambda texts: json.loads(texts[0]),
        is_instance=lambda value: isinstance(value, dict),
        str_from_instance=lambda value: [json.dumps(value)],
    ),
]
"""Dotted name -> value; one argument on the command line."""

FUTURE = 8  # control steps of a random force that a linear memory foretells

CONFIGS = Path(__file__).parents[2] / "configs"

SEED_BITS, LANE_BITS = 32, 31  # bits of a training's seed, and of the number of a lane

TRAINING = 1 << 63
"""The bit that seeds of training lanes have; those of validation and held-out episodes do not."""

LONGEST_NAME = 200
"""Most bytes of a run's name: file systems allow 255, and the name may be numbered."""

Settings = TypeVar("Settings", bound="Document")
OfRun = TypeVar("OfRun", bound="RunSettings")


def check_folder_name(name: str) -> None:
    """Raise `ValueError` for a name that a folder under `runs` cannot have everywhere."""
    plain = name == name.strip() and name.isprintable() and not name.startswith(".")
    if not (plain and not set(name) & {"/", "\\"} and 0 < len(name.encode()) <= LONGEST_NAME):
        allowed = "a printable file name without separators, which begins with no dot"
        refuse("name", f"{name!r}", allowed, ValueError)


class RunSettings(Document):
    """What a policy is for, and where it is written."""

    task: str = "mm_gym/PreStretch-v0"
    """a name such as Hybrid"""
    scene: str | None = None
    """path of a scene file to use instead of the task's own"""
    changes: Changes = Field(default_factory=dict[str, JsonValue])
    """fields of the scene to change, by dotted name: '{"control.steps": 200}'"""
    name: str = "run"
    """folder under `runs`"""
    reward: str | None = None
    """"FILE.py:NAME" of a cost to use instead of the scene's; see docs/training.md"""
    seed: Annotated[int, Field(ge=0, lt=1 << SEED_BITS)] = 0
    """seed of the training; no two seeds share an episode, with each other or with evaluations"""

    growing: ClassVar[tuple[str, ...]] = ()
    """Settings of which a finished run can be given more to go on; its size comes first."""

    suffix: ClassVar[str] = ""
    """After the task's name in a run's default name, so that commands do not take each other's."""

    folder: ClassVar[str | None] = None
    """Of `configs`, with a file of good settings for each task of which they are known."""

    fitted: ClassVar[tuple[str, ...]] = ("scene", "reward")
    """Settings for which those of a task's file were found; given others, the defaults hold."""

    own_code: ClassVar[tuple[str, ...]] = ("reward",)
    """Settings that may name something in a file of the user's."""

    @property
    def unused(self) -> dict[str, str]:
        """The names of settings, and tables of them, that have no effect, and with what they do."""
        return {}

    def refuse_unused(self, asked: Iterable[str]) -> None:
        """Refuse settings or flags of those names, as "--sac.tau", if they have no effect."""
        for name in asked:
            first = name.removeprefix("--").partition(".")[0].replace("-", "_")
            if first in self.unused:
                refuse(name, "a setting without effect", self.unused[first])

    def code(self) -> dict[str, str]:
        """Return the texts of the user's files that the settings name, by path."""
        named = {what: getattr(self, what) for what in self.own_code}
        paths = {w: split(text, w)[0] for w, text in named.items() if text and is_path(text)}
        return {str(path): source(path, what) for what, path in paths.items()}

    @model_validator(mode="before")
    @classmethod
    def _has_whole_name(cls, data: Any) -> Any:  # noqa: ANN401 - what pydantic is given
        if isinstance(data, dict) and isinstance(data.get("task"), str):
            return {**data, "task": task_called(data["task"])}
        return data

    @model_validator(mode="after")
    def _can_be_found(self) -> Self:
        check_folder_name(self.name)
        if self.reward is not None:
            split(self.reward, "reward")
        return self

    def load_scene(self) -> Scene:
        """Return the scene to train on.

        Raise `SceneError` if its file cannot be read, or a change is not allowed.
        """
        scene = load_scene(self.task if self.scene is None else self.scene)
        return scene.replace(**self.changes)

    def rewarded_scene(self) -> Scene:
        """Return the same with the reward of the settings, whose file is run.

        Raise `SceneError` if the scene or the reward is wrong.
        """
        return rewarded(self.load_scene(), self.reward)


class TrainSettings(RunSettings):
    """What is trained, for how long, and where it is written."""

    algorithm: Algorithm = "ppo"
    """its settings are in the table of its name"""
    base: str | None = None
    """controller that the agent is added to: a name, "FILE.py:NAME", or "none"; by default none,
    and for your own scene the best one; see docs/training.md"""
    authority: Annotated[float, Field(gt=0, le=2)] = 0.5
    """largest action that the agent adds to its base's, which ranges from -1 to 1"""
    lanes: Annotated[int, Field(ge=1, le=1 << LANE_BITS)] = 128
    """number of parallel environments"""
    steps: Count = 1_000_000
    """control steps of all lanes together"""
    time_budget: Positive | None = None
    """training time [s] without interruptions, after which it stops even if steps are left; by
    default none"""
    evaluations: Count = 10
    """validations during training; the best model is kept"""
    threads: Count = 1
    """threads of the gradient computation; more hardly help networks of this size"""
    normalise_observations: bool = False
    """subtract their running mean and divide by their spread; always for your own scene"""
    normalise_rewards: bool = False
    """divide by the spread of the discounted return; always for your own scene"""
    ppo: PPOSettings = PPOSettings()
    sac: SACSettings = SACSettings()
    td3: TD3Settings = TD3Settings()
    tqc: TQCSettings = TQCSettings()
    crossq: CrossQSettings = CrossQSettings()
    recurrent_ppo: RecurrentPPOSettings = RecurrentPPOSettings()

    growing: ClassVar[tuple[str, ...]] = ("steps", "time_budget")
    folder: ClassVar[str | None] = "agents"
    fitted: ClassVar[tuple[str, ...]] = ("scene", "algorithm")
    own_code: ClassVar[tuple[str, ...]] = ("base", "reward")

    @property
    def chosen(self) -> AlgorithmSettings:
        """The settings of the algorithm."""
        return getattr(self, self.algorithm)

    @property
    def unused(self) -> dict[str, str]:
        """Those of the other algorithms."""
        others = [name for name in get_args(Algorithm) if name != self.algorithm]
        return {name: f"with algorithm = {name}" for name in others}

    @model_validator(mode="after")
    def _has_samples(self) -> Self:
        for name in ("ppo", "recurrent_ppo"):
            if self.algorithm == name and self.lanes * getattr(self, name).rollout == 1:
                allowed = "two samples between updates, or more"
                refuse("lanes", f"1 with {name}.rollout = 1", allowed, ValueError)
        return self


LawName = Literal[
    "auto", "regulator", "lqg", "switching", "weighted", "tracking", "constant", "none"
]


class TimedSettings(RunSettings):
    """What ends a search, and how often it is validated."""

    time_budget: Positive | None = None
    """time [s] without interruptions, after which it stops even if rounds are left"""
    evaluations: Count = 20
    """validations during the run; the best policy is kept"""


SHARED: dict[str, Callable[[Scene], object]] = {
    "control.time_step": lambda scene: scene.control.time_step,
    "sensors.channels": lambda scene: plant_of(scene).channels,
    "sensors.history": lambda scene: scene.sensors.history,
    "actuation": lambda scene: scene.actuation.names,
}
"""What two scenes have in common that one network learns."""


class SearchSettings(TimedSettings):
    """What is searched around a controller, and where it is written."""

    law: LawName = "auto"
    """controller as which the network begins: "regulator" the LQR of the force, "switching" the
    clipped LQR of the stretch or clipped-optimal control of the damper (with a force and a stretch
    either name means both), "weighted" the clipped LQR with the free weights of
    `tune-controllers`, "lqg" the LQG of the force, "tracking" an absorber tuned to the frequency
    that it finds, "constant" the best constant command, "none" no control; "auto" takes the one
    that suits the actuators, unless another costs clearly less on the validation episodes, and
    for your own scene the cheapest"""
    hidden: Count = 8
    """units of the hidden layer"""
    extra: Annotated[int, Field(ge=0)] = 0
    """correlation units in addition to those of the controller, drawn at random"""
    memory: Annotated[int, Field(ge=0, le=FUTURE)] = 4
    """states of a linear memory that predicts a random force, if two frames show it"""
    also: str | None = None
    """a second scene, learned in some of the episodes: a task or the path of a scene file, with the
    same channels, frames, actuators and control step; for example Hybrid next to HybridRobust;
    `changes` and validations are of the first scene alone"""
    share: Annotated[float, Field(gt=0, lt=1)] = 0.5
    """fraction of the training episodes on the second scene"""

    @model_serializer(mode="wrap")
    def _without_what_is_not_asked_for(self, written: SerializerFunctionWrapHandler) -> Any:  # noqa: ANN401 - what pydantic makes
        unasked = self.unasked
        return {name: one for name, one in written(self).items() if name not in unasked}

    @property
    def unasked(self) -> tuple[str, ...]:
        """Settings that are not written: runs and results of before there were any go on."""
        return ("also", "share") if self.also is None else ()

    def code(self) -> dict[str, str]:
        """Return the texts of the user's files by path, and the digest of the other scene."""
        other = self.other_scene()
        return super().code() | ({} if other is None else {str(self.also): other.digest})

    def other_scene(self) -> Scene | None:
        """Return the scene of `also` with the reward of the settings, or None.

        Raises
        ------
        SceneError
            If it cannot be read, or an agent observes or does something else in it.
        """
        if self.also is None:
            return None
        own, other = self.load_scene(), load_scene(task_or_scene(self.also))
        for field, find in SHARED.items():
            here, there = find(own), find(other)
            if here != there:
                refuse(f"also: {self.also}: {field}", f"{there!r}", f"{here!r}, as in the scene")
        return rewarded(other, self.reward)

    def scenes(self, scene: Scene, episodes: int) -> list[tuple[Scene, int]]:
        """Return the scenes that are learned, and how many of the episodes are of each.

        Raise `SceneError` if there are fewer episodes than scenes.
        """
        other = self.other_scene()
        if other is None:
            return [(scene, episodes)]
        if episodes < 2:  # noqa: PLR2004 - one of each
            refuse("episodes", f"{episodes} with also = {self.also!r}", "at least 2")
        count = min(max(1, round(self.share * episodes)), episodes - 1)
        return [(scene, episodes - count), (other, count)]


def training_seeds(seed: int, count: int, first: int = 0) -> list[int]:
    """Return the seeds of a training's lanes, which no other training and no evaluation uses.

    The lanes are numbered from the first.

    The training's seed, of 32 bits, stands above the lane's number, of 31. With the environment's
    own rule, lane i = seed + i, trainings of neighbouring seeds would have all lanes but one in
    common.
    """
    return [TRAINING | seed << LANE_BITS | lane for lane in range(first, first + count)]


def read_settings(path: str | Path, kind: type[Settings]) -> Settings:
    """Read settings from a TOML file; raise `SceneError` with every finding."""
    data = read_toml(path)
    try:
        return kind.of(data)
    except SceneError as error:
        msg = "\n".join(f"{path}: {line}" for line in str(error).splitlines())
        raise SceneError(msg) from None


def good_settings(task: str, kind: type[OfRun]) -> OfRun:
    """Return what is known to be good for a task, or the defaults; the run is named after it.

    Raise `SceneError` if there is no such task, or its file of settings cannot be read.
    """
    own = {"task": task, "name": short_name(task) + kind.suffix}
    file = CONFIGS / (kind.folder or "") / path_of(task).name
    if kind.folder is None or not file.exists():
        return kind.of(own)
    return read_settings(file, kind).model_copy(update=own)


def settings_from_command_line(kind: type[Settings], description: str) -> Settings:
    """Read ``[FILE.toml | TASK] [--flags]``: the file or task first, then flags over it.

    A task may leave out ``mm_gym/`` and ``-v0``. It stands for its file of good settings, if there
    is one, but not with a scene or an algorithm for which they were not found. Raise `SceneError`
    if the first argument is neither a flag nor a task nor a settings file that can be read.
    """
    arguments, default = sys.argv[1:], kind()
    if arguments and arguments[0].endswith(".toml"):
        default = read_settings(arguments.pop(0), kind)
        if isinstance(default, RunSettings):  # its tables may be those of several algorithms
            tables = {name for name in default.unused if isinstance(getattr(default, name), Part)}
            default.refuse_unused(default.model_fields_set - tables)
    elif arguments and not arguments[0].startswith("-"):
        task = task_called(arguments.pop(0), "settings file", ", before the flags")
        default = kind.of({"task": task, "name": short_name(task) + getattr(kind, "suffix", "")})
        if issubclass(kind, RunSettings):
            good = good_settings(task, kind)
            found = _parsed(kind, arguments, description, good)
            if all(getattr(found, name) == getattr(good, name) for name in kind.fitted):
                return found
    return _parsed(kind, arguments, description, default)


def _parsed(
    kind: type[Settings], arguments: list[str], description: str, default: Settings
) -> Settings:
    with warnings.catch_warnings():
        # Of a default's type, which pydantic has checked; tyro cannot look into this one.
        warnings.filterwarnings("ignore", ".*'JsonValue'")
        found = cli(kind, default=default, args=arguments, description=description)
    words = [one.partition("=")[0] for one in arguments if one.startswith("--")]
    _forget_unasked(found, default, {word[2:].replace("-", "_") for word in words})
    if isinstance(found, RunSettings):
        found.refuse_unused(words)
    return found


def _forget_unasked(found: BaseModel, default: BaseModel, flags: set[str], place: str = "") -> None:
    """Leave as set what the default has set or a flag sets: the parser sets every field."""
    for name in type(found).model_fields:
        inner = getattr(found, name)
        if isinstance(inner, BaseModel):
            _forget_unasked(inner, getattr(default, name), flags, f"{place}{name}.")
    asked = {name for name in found.model_fields_set if place + name in flags}
    found.model_fields_set.intersection_update(default.model_fields_set | asked)
