"""Episodes of a controller on many lanes, and Minari datasets of them, written whole or not at all.

A dataset is a folder, ``<namespace>/<name>-v<version>``, below ``~/.minari/datasets`` or what
``MINARI_DATASETS_PATH`` says. It is written in a hidden folder next to the namespaces, which Minari
does not list, and renamed.
"""

import os
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

try:
    import h5py  # noqa: F401 - what Minari writes with, and does not need itself
    import minari
    from minari.data_collector import EpisodeBuffer
    from minari.dataset.minari_storage import MinariStorage
    from minari.namespace import create_namespace, list_local_namespaces
    from minari.storage import get_dataset_path
except ImportError as error:
    msg = "Minari is not installed: install the extra `datasets`"
    raise DependencyNotInstalled(msg) from error

from agents.control.controller import Controller
from agents.errors import DatasetError
from agents.rollout import Rollout
from mm_gym import MovingMassVectorEnv, Scene
from mm_gym.arrays import Array, Single
from mm_gym.errors import refuse

_ID = re.compile(
    r"(?P<name>(?:[-_\w]{2,}/(?:[-_\w]+/)*)?[-_\w]+?)(?:-v(?P<version>\d+))?", re.ASCII
)
"""Minari's own pattern lets `a//b` pass, and refuses namespaces of one character later."""


def free_id(wanted: str, *, new_version: bool) -> str:
    """Return the id under which a dataset can be written, with its version.

    Raise `DatasetError` if it is no id, or exists and no new version is asked for.

    Parameters
    ----------
    wanted
        ``<namespace>/<name>``, with or without ``-v<version>``; version 0 by default.
    new_version
        Whether to take the version after the newest one, if there is any.
    """
    match = _ID.fullmatch(wanted)
    if match is None:
        allowed = (
            "NAMESPACE/NAME-vVERSION of letters, digits, hyphens and underscores, the namespace of "
            "two or more, as mm_gym/CarriageForce/lqr-v0"
        )
        refuse("out", f"{wanted!r}", allowed, DatasetError)
    name, newest = match["name"], _newest_version(match["name"])
    if new_version and newest is not None:
        return f"{name}-v{newest + 1}"
    chosen = f"{name}-v{int(match['version'] or 0)}"
    folder = get_dataset_path(chosen)
    if folder.exists():
        msg = (
            f"{chosen}: exists at {folder}; choose another name with --out, or --new-version "
            f"for {name}-v{0 if newest is None else newest + 1}"
        )
        raise DatasetError(msg)
    return chosen


def _newest_version(name: str) -> int | None:
    folder = get_dataset_path(name).parent
    pattern = re.compile(re.escape(Path(name).name) + r"-v(\d+)", re.ASCII)
    matches = [pattern.fullmatch(path.name) for path in folder.glob("*")]
    return max((int(match[1]) for match in matches if match), default=None)


def write(
    dataset_id: str,
    env: gymnasium.Env[Any, Any],
    batches: Iterable[list[EpisodeBuffer]],
    description: dict[str, Any],
) -> minari.MinariDataset:
    """Write a dataset, and return it.

    The environment is as the episodes'; the description goes into the metadata. Raise
    `DatasetError` if it cannot be written, or another process has written one of this id meanwhile.
    Nothing of it is left, but after a kill a hidden folder.
    """
    # Minari joins a relative path to itself when it measures the size of a dataset.
    root, target = get_dataset_path().absolute(), get_dataset_path(dataset_id).absolute()
    try:
        namespace = dataset_id.rpartition("/")[0]
        if namespace and namespace not in list_local_namespaces():
            create_namespace(namespace)
        # Next to the target: a rename cannot move from one file system to another.
        with tempfile.TemporaryDirectory(prefix=".recording-", dir=root) as folder:
            whole = Path(folder, "dataset")
            data = whole / "data"
            data.mkdir(parents=True)
            storage = MinariStorage.new(
                data, env.observation_space, env.action_space, env.spec, data_format="hdf5"
            )
            for batch in batches:
                storage.update_episodes(batch)
            storage.update_metadata(
                {
                    "dataset_id": dataset_id,
                    "minari_version": minari.__version__,
                    "requirements": [f"mm-gym=={version('mm-gym')}"],
                    **description,
                }
            )
            for file in data.iterdir():
                _flush(file)
            whole.rename(target)
    except OSError as error:
        reason = "another process has written it" if target.exists() else error
        msg = f"{dataset_id}: cannot be written at {target}: {reason}"
        raise DatasetError(msg) from error
    return minari.load_dataset(dataset_id)


def _flush(file: Path) -> None:
    """Put a file on the disk before it gets its name."""
    handle = os.open(file, os.O_RDWR)  # Windows flushes no file that is open to be read
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def with_noise(
    actions: NDArray[np.floating[Any]], deviation: float, generator: np.random.Generator
) -> Single:
    """Return actions with Gaussian noise, within [-1, 1] and in the type of the action space.

    The environment would also take double precision and clip by itself; but what is recorded must
    be what was done.
    """
    noise = deviation * generator.standard_normal(actions.shape)
    return np.clip(actions + noise, -1.0, 1.0).astype(np.float32)


def play(
    scene: Scene,
    controller: Controller,
    seeds: Sequence[int],
    *,
    lanes: int,
    changed: Callable[[Array], Single],
) -> Iterator[list[EpisodeBuffer]]:
    """Play one episode a seed, so many lanes at a time, and yield each batch in the seeds' order.

    What is done in the place of the controller's actions is `changed` of them; the seed of an
    episode and its actions reproduce it to the last bit. Raise `ActionError` if the controller's
    actions are not finite; `PolicyError` if a trained policy is of other observations or actions;
    `SimulationError` if a motion cannot be followed.
    """
    for first in range(0, len(seeds), lanes):
        batch = list(seeds[first : first + lanes])
        env = MovingMassVectorEnv(scene, len(batch), autoreset_mode="Disabled")
        yield _play_batch(env, controller, batch, changed)


def _play_batch(
    env: MovingMassVectorEnv,
    controller: Controller,
    seeds: list[int],
    changed: Callable[[Array], Single],
) -> list[EpisodeBuffer]:
    rollout = Rollout(env, controller, seed=seeds, changed=changed)
    starts = [(rollout.observation, rollout.info["state"], rollout.info["applied"])]
    steps, length = [], np.zeros(len(seeds), np.int64)
    for made in rollout:
        starts.append((made.observation, made.info["state"], made.info["applied"]))
        steps.append((made.action, made.reward, made.terminated, made.truncated))
        length += made.ran
    observations, states, applied = (
        np.stack(column, axis=1) for column in zip(*starts, strict=True)
    )
    actions, rewards, terminations, truncations = (
        np.stack(column, axis=1) for column in zip(*steps, strict=True)
    )
    return [
        EpisodeBuffer(
            seed=seed,
            observations=observations[lane, : n + 1],
            actions=actions[lane, :n],
            rewards=rewards[lane, :n],
            terminations=terminations[lane, :n],
            truncations=truncations[lane, :n],
            infos={"state": states[lane, : n + 1], "applied": applied[lane, : n + 1]},
        )
        for lane, (seed, n) in enumerate(zip(seeds, length, strict=True))
    ]
