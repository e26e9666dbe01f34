"""Record a Minari dataset.

For example ``python -m agents record CarriageForce --controller lqr``. A controller or a trained
policy plays one episode for each seed, in parallel environments. The seed of an episode and its
actions reproduce it to the last bit, see docs/clients/minari.md. Needs the extra `datasets`.
"""

from functools import partial
from pathlib import PurePath
from typing import Annotated, Any

import gymnasium
import numpy as np
import tyro
from pydantic import Field, JsonValue

from agents.errors import command
from agents.evaluation.contestants import law_of
from agents.training.config import Changes
from mm_gym import load_scene
from mm_gym.scene import Document
from mm_gym.tasks import ids, is_id, short_name, task_or_scene

FIRST_SEED = 3_000_000  # apart from the seeds of the evaluations and of the trainings


class RecordSettings(Document):
    """What is recorded, and under which name."""

    task: Annotated[str, tyro.conf.Positional] = "CarriageForce"
    """a name such as Hybrid, or a scene file"""
    changes: Changes = Field(default_factory=dict[str, JsonValue])
    """fields of the scene to change, by dotted name: '{"control.steps": 200}'"""
    controller: str = "random"
    """a controller's name (a wrong one lists those of the task), FILE.py:NAME, the folder of a
    run, or a policy's file"""
    trust: bool = False
    """run the own base and reward of a run, although that can run any code"""
    lanes: Annotated[int, Field(ge=1)] = 64
    """number of parallel environments"""
    episodes: Annotated[int, Field(ge=1)] = 100
    """episodes to record, each whole"""
    noise: Annotated[float, Field(ge=0)] = 0.0
    """standard deviation of Gaussian noise on the actions, which are then clipped to [-1, 1]"""
    seed: Annotated[int, Field(ge=0, lt=1 << 62)] = FIRST_SEED
    """seed of the first episode; each episode takes the next seed"""
    out: str | None = None
    """the dataset's id, NAMESPACE/NAME-vVERSION; by default mm_gym/TASK/CONTROLLER-v0"""
    new_version: bool = False
    """take the next version of the id if there is one already; else it is refused"""

    @property
    def wanted_id(self) -> str:
        """The dataset's id, of which the version may be missing."""
        if self.out is not None:
            return self.out
        return f"mm_gym/{short_name(PurePath(self.task).stem)}/{PurePath(self.controller).stem}"


def record(settings: RecordSettings) -> str:
    """Record a dataset, print what it holds, and return its id.

    Raise `DatasetError` if the id is refused, or the dataset cannot be written; `ActionError`,
    `DesignError`, `PolicyError`, `RunError`, `SceneError` or `SimulationError` if the controller is
    refused, or fails.
    """
    from agents.recording import free_id, play, with_noise, write  # noqa: PLC0415 - needs an extra

    dataset_id = free_id(settings.wanted_id, new_version=settings.new_version)
    named = task_or_scene(settings.task)
    scene = load_scene(named).replace(**settings.changes)
    arguments: dict[str, Any] = {"changes": settings.changes} if settings.changes else {}
    task = named
    if not is_id(named):  # the dataset must not depend on the file: it has the whole scene
        task, arguments = ids()[0], {"scene": scene}
    generator = np.random.default_rng(settings.seed)
    law = law_of(settings.controller, scene, generator, trust=settings.trust)
    env = gymnasium.make(task, **arguments)
    dataset = write(
        dataset_id,
        env,
        play(
            scene,
            law,
            range(settings.seed, settings.seed + settings.episodes),
            lanes=settings.lanes,
            changed=partial(with_noise, deviation=settings.noise, generator=generator),
        ),
        {
            "algorithm_name": law.name,
            "description": f"{named}: {law.name}, action noise {settings.noise:g}",
            "scene_digest": scene.digest,
        },
    )
    print(f"{dataset.total_episodes} episodes, {dataset.total_steps} steps of {law.name}")
    print(f"written: {dataset.spec.data_path}")
    print(f'read it: minari.load_dataset("{dataset_id}")')
    return dataset_id


@command
def main(settings: RecordSettings) -> None:
    """Record from the command line."""
    record(settings)
