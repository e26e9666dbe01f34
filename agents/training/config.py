"""The settings of a training run: a file of `configs/agents/`, then flags over it."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Annotated, Self, TypeVar

from pydantic import Field, JsonValue, Strict, model_validator
from tyro import cli
from tyro.constructors import PrimitiveConstructorSpec

from mm_gym import Scene, SceneError, load_scene
from mm_gym.files import read_toml
from mm_gym.scene import Part
from mm_gym.tasks import path_of

if TYPE_CHECKING:
    from pathlib import Path

Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]
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

SEED_BITS, LANE_BITS = 32, 31
"""Bits of a training's seed, and of the number of a lane."""

LONGEST_NAME = 200
"""Most bytes of a run's name: file systems allow 255, and the name may be numbered."""


Settings = TypeVar("Settings", bound="RunSettings")


class PPOSettings(Part):
    """Proximal policy optimisation (Schulman et al., 2017), in Stable-Baselines3's terms."""

    learning_rate: Positive = 1e-3
    """at the start; it falls linearly to zero"""
    rollout: Count = 100
    """control steps per lane between updates"""
    batch_size: Annotated[int, Field(ge=2)] = 3200
    """samples of one gradient step"""
    epochs: Count = 8
    """passes over each rollout"""
    discount: Annotated[float, Field(gt=0, le=1)] = 0.97
    """gamma"""
    gae_lambda: Annotated[float, Field(ge=0, le=1)] = 0.95
    """trade of bias for variance in the advantage"""
    hidden: Annotated[tuple[Count, ...], Strict(False)] = (64, 64)
    """units of the hidden layers, of policy and value alike"""
    initial_log_std: float = -0.5
    """logarithm of the initial exploration noise"""
    reward_scale: Positive = 0.05
    """factor on the reward, so that the value function is of order one"""


class RunSettings(Part):
    """What a policy is for, and where it is written."""

    task: str = "mm_gym/PreStretch-v0"
    """a registered id"""
    scene: str | None = None
    """path of a scene file to use instead of the task's own"""
    changes: Changes = Field(default_factory=dict[str, JsonValue])
    """fields of the scene to change, by dotted name: '{"control.steps": 200}'"""
    name: str = "run"
    """folder under `runs`"""
    seed: Annotated[int, Field(ge=0, lt=1 << SEED_BITS)] = 0
    """of the training; no two seeds have an episode in common, nor one with the evaluations"""

    @model_validator(mode="after")
    def _can_be_found(self) -> Self:
        path_of(self.task)
        if not _is_plain(self.name):
            allowed = "a printable file name without separators, which begins with no dot"
            msg = f"name: got {self.name!r}; allowed: {allowed}"
            raise ValueError(msg)
        return self

    def load_scene(self) -> Scene:
        """Return the scene to train on.

        Raises
        ------
        SceneError
            If its file cannot be read, or a change is not allowed.
        """
        scene = load_scene(self.task if self.scene is None else self.scene)
        return scene.replace(**self.changes)


class TrainSettings(RunSettings):
    """What is trained, for how long, and where it is written."""

    lanes: Annotated[int, Field(ge=1, le=1 << LANE_BITS)] = 128
    """environments side by side"""
    steps: Count = 1_000_000
    """control steps of all lanes together"""
    time_budget: Positive = 3600.0
    """[s] of training, without interruptions, after which it stops even if steps are left"""
    evaluations: Count = 10
    """validations during training; the best model is kept"""
    threads: Count = 1
    """of the gradient computation; more hardly help networks of this size"""
    ppo: PPOSettings = PPOSettings()

    @model_validator(mode="after")
    def _has_samples(self) -> Self:
        if self.lanes * self.ppo.rollout == 1:
            msg = "lanes: got 1 with ppo.rollout = 1; allowed: two samples between updates, or more"
            raise ValueError(msg)
        return self


def _is_plain(name: str) -> bool:
    """Tell whether a text can name a folder, on any system and in any terminal."""
    return (
        name == name.strip()
        and name.isprintable()
        and not name.startswith(".")
        and not set(name) & {"/", "\\"}
        and 0 < len(name.encode()) <= LONGEST_NAME
    )


def read_settings(path: str | Path, kind: type[Settings]) -> Settings:
    """Read settings from a TOML file; raise `SceneError` with every finding."""
    data = read_toml(path)
    try:
        return kind.of(data)
    except SceneError as error:
        msg = "\n".join(f"{path}: {line}" for line in str(error).splitlines())
        raise SceneError(msg) from None


def settings_from_command_line(kind: type[Settings], description: str) -> Settings:
    """Read ``[FILE.toml | TASK] [--flags]``: the file or task first, then flags over it.

    A task may leave out ``mm_gym/`` and ``-v0``; a run of it has the task's name if none is given.
    """
    arguments = sys.argv[1:]
    default = kind()
    if arguments and arguments[0].endswith(".toml"):
        default = read_settings(arguments.pop(0), kind)
    elif arguments and not arguments[0].startswith("-"):
        short = arguments.pop(0).removeprefix("mm_gym/").removesuffix("-v0")
        default = kind.of({"task": f"mm_gym/{short}-v0", "name": short})
    return cli(kind, default=default, args=arguments, description=description)
