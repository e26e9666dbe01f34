"""A native Stable-Baselines3 `VecEnv`: no loop over environments, and correct ends of episodes."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import gymnasium
import gymnasium.wrappers.vector as vector_wrappers
import numpy as np
from gymnasium.error import DependencyNotInstalled
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper

from mm_gym.env.arguments import checked_autoreset_mode
from mm_gym.errors import refuse, whole_number

try:
    from stable_baselines3.common.monitor import Monitor, ResultsWriter
    from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
except ImportError as error:
    msg = "Stable-Baselines3 is not installed: install the extra `agents`"
    raise DependencyNotInstalled(msg) from error

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from os import PathLike

    from numpy.typing import NDArray

    Indices = None | int | Iterable[int]
    Info: TypeAlias = dict[str, Any]
    Lanes: TypeAlias = VectorEnv[Any, Any, Any]
    Wrapper: TypeAlias = VectorWrapper[Any, Any, Any, Any, Any]
else:  # a class without parameters before Gymnasium 1.4
    Wrapper = VectorWrapper

ENDS = ("final_obs", "final_info")
"""Entries of a vector environment's info on the episodes that a step ends."""


class Monitored(Wrapper):
    """Keeps the rewards of the last step before other wrappers change them."""

    rewards: NDArray[Any]

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Make the step."""
        result = self.env.step(actions)
        self.rewards = result[1].copy()
        return result


def make_vec_env(
    id: str,  # noqa: A002 - Gymnasium's name
    num_envs: int | None = None,
    seed: int | np.integer | None = None,
    *,
    n_envs: int | None = None,
    wrapper_class: Callable[..., Any] | None = None,
    wrapper_kwargs: Mapping[str, Any] | None = None,
    monitor_dir: str | PathLike[str] | None = None,
    every_info: bool = False,
    env_kwargs: Mapping[str, Any] | None = None,
    **kwargs: Any,  # noqa: ANN401 - those of the environment
) -> VecEnv:
    """Make a registered environment as a Stable-Baselines3 `VecEnv`.

    It takes most arguments of the function of this name in Stable-Baselines3. Its infos are those
    of `DummyVecEnv`.

    Parameters
    ----------
    id
        A registered id with a vector entry point, such as "mm_gym/PreStretch-v0".
    num_envs, n_envs
        Number of lanes, by either name; 1 by default.
    seed
        Lane i gets the seed + i. Sampled actions use the seed of the first lane.
    wrapper_class, wrapper_kwargs
        A vector wrapper of Gymnasium, a function that takes and returns a vector environment, or a
        `VecEnvWrapper` of Stable-Baselines3, and its arguments. As in Stable-Baselines3, episodes
        are monitored without it.
    monitor_dir
        Folder for a file ``monitor.csv``, as `stable_baselines3.common.monitor.load_results` reads
        it: one file for all lanes. An existing file is overwritten.
    every_info
        Whether the info of every step is split among the lanes. By default only that of a step that
        ends an episode is split, because a dictionary for each lane and step often takes longer
        than the motion.
    env_kwargs, **kwargs
        Passed to the environment, for example ``scene`` or ``changes``.

    Raises
    ------
    ValueError
        If ``copy`` is false, because Stable-Baselines3 uses observations after the next step; for
        another mode of autoreset than same-step; if the two numbers of lanes differ; for a seed
        that is negative or no integer; or if the wrapper is one for single environments.

    Examples
    --------
    >>> from mm_gym.sb3 import make_vec_env
    >>> make_vec_env("mm_gym/PreStretch-v0", 64).num_envs
    64
    """
    kwargs |= env_kwargs or {}
    if seed is not None:
        seed = whole_number("seed", seed, 0, error=ValueError)
    mode = checked_autoreset_mode(kwargs.pop("autoreset_mode", AutoresetMode.SAME_STEP))
    if mode is not AutoresetMode.SAME_STEP:
        refuse("autoreset_mode", f"{mode.value}", f"{AutoresetMode.SAME_STEP.value}", ValueError)
    if not kwargs.get("copy", True):
        refuse("copy", "False", "True: observations are kept over the next step", ValueError)
    if None not in (num_envs, n_envs) and num_envs != n_envs:
        refuse("num_envs", f"{num_envs} and n_envs = {n_envs}", "one of them", ValueError)
    lanes = gymnasium.make_vec(
        id,
        num_envs=next(count for count in (num_envs, n_envs, 1) if count is not None),
        vectorization_mode="vector_entry_point",
        autoreset_mode=mode,
        **kwargs,
    )
    arguments = wrapper_kwargs or {}
    outer = wrapper_class if _is_class(wrapper_class, VecEnvWrapper) else None
    if wrapper_class is None or outer is not None:
        env = VectorEnvAdapter(lanes, monitor_dir=monitor_dir, every_info=every_info)
    else:
        monitored = Monitored(lanes)
        wrapped = _wrapped(monitored, wrapper_class, arguments)
        env = VectorEnvAdapter(wrapped, monitor_dir=monitor_dir, every_info=every_info)
        env.monitored = monitored
    env.seed(seed)
    if seed is not None:
        env.action_space.seed(seed)  # pyright: ignore[reportUnknownMemberType] - a bare Space, as below
    return env if outer is None else outer(env, **arguments)


def _is_class(wrapper: object, of: type) -> bool:
    return isinstance(wrapper, type) and issubclass(wrapper, of)


def _wrapped(lanes: Lanes, wrapper_class: Callable[..., Any], arguments: Mapping[str, Any]) -> Any:  # noqa: ANN401 - the user's
    """Return the wrapped lanes; raise `ValueError` for a wrapper of single environments."""
    is_single = _is_class(wrapper_class, gymnasium.Wrapper)
    wrapped = None if is_single else wrapper_class(lanes, **arguments)
    if isinstance(wrapped, VectorEnv):
        return cast("Lanes", wrapped)
    name = getattr(wrapper_class, "__name__", repr(wrapper_class))
    message = f"wrapper_class: {name} wraps single environments; allowed: one for vectors"
    if name in vector_wrappers.__all__:
        message += f", such as gymnasium.wrappers.vector.{name}"
    raise ValueError(message)


class VectorEnvAdapter(VecEnv):
    """A Gymnasium `VectorEnv` with same-step autoreset, as a Stable-Baselines3 `VecEnv`.

    At an episode's end the lane's info holds what Stable-Baselines3's `DummyVecEnv` and `Monitor`
    would put there: the environment's own info of the last step, ``terminal_observation``,
    ``TimeLimit.truncated`` (truncated and not terminated) and ``episode`` (return, length,
    seconds). `reset_infos` holds the info of each lane's last reset.

    Parameters
    ----------
    env
        The vector environment.
    monitor_dir, every_info
        As for `make_vec_env`.
    """

    monitored: Monitored | None = None
    """What has the rewards that are monitored, if wrappers change them."""

    def __init__(
        self,
        env: Lanes,
        *,
        monitor_dir: str | PathLike[str] | None = None,
        every_info: bool = False,
    ) -> None:
        mode = env.metadata.get("autoreset_mode")
        if mode != AutoresetMode.SAME_STEP:
            refuse("autoreset_mode", f"{mode}", f"{AutoresetMode.SAME_STEP}", ValueError)
        self.env = env
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)  # pyright: ignore[reportUnknownMemberType] - SB3 and Gymnasium write a bare Space
        self._every_info = every_info
        self.metadata = self.metadata | {"render_fps": env.metadata.get("render_fps", 30)}
        self._returns = np.zeros(env.num_envs)
        self._lengths = np.zeros(env.num_envs, np.int64)
        self._began = time.time()
        self._writer = None if monitor_dir is None else self._opened(Path(monitor_dir))
        self._actions: NDArray[Any] = np.zeros(0)

    def _opened(self, folder: Path) -> ResultsWriter:
        name = "None" if self.env.spec is None else self.env.spec.id
        header: dict[str, float | str] = {"t_start": self._began, "env_id": name}
        return ResultsWriter(str(folder / Monitor.EXT), header=header)

    def reset(self) -> NDArray[Any]:
        """Begin an episode in every lane, with the seeds and options set before."""
        seeds = self._seeds
        seed = None if all(value is None for value in seeds) else list(seeds)
        try:
            observations, infos = self.env.reset(
                seed=seed,  # pyright: ignore[reportArgumentType] - Gymnasium's SyncVectorEnv takes a list too
                options=self._merged_options(),
            )
        finally:  # seeds and options that were refused, too
            self._reset_seeds()
            self._reset_options()
        self.reset_infos = [_of_lane(infos, i) for i in range(self.num_envs)]
        self._returns[:], self._lengths[:] = 0.0, 0
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the actions until `step_wait`."""
        self._actions = actions

    def step_wait(
        self,
    ) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.bool_], list[dict[str, Any]]]:
        """Make the step. Rewards are single precision, as Stable-Baselines3's own."""
        observations, rewards, terminated, truncated, info = self.env.step(self._actions)
        done = terminated | truncated
        self._returns += rewards if self.monitored is None else self.monitored.rewards
        self._lengths += 1
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if self._every_info:
            infos = [_of_lane(info, i) for i in range(self.num_envs)]
            for one in infos:
                one["TimeLimit.truncated"] = False
        if np.count_nonzero(done):  # rare
            seconds = round(time.time() - self._began, 6)
            for i in np.flatnonzero(done).tolist():
                self.reset_infos[i] = _of_lane(info, i)
                infos[i] = _of_lane(info.get("final_info", {}), i) | {
                    "terminal_observation": info["final_obs"][i],
                    "TimeLimit.truncated": bool(truncated[i] and not terminated[i]),
                    "episode": self._episode(i, seconds),
                }
            self._returns[done], self._lengths[done] = 0.0, 0
        return observations, rewards.astype(np.float32), done, infos

    def _episode(self, lane: int, seconds: float) -> dict[str, float]:
        """Return what a `Monitor` says of an episode, and write it to the file if there is one."""
        episode = {
            "r": round(float(self._returns[lane]), 6),
            "l": int(self._lengths[lane]),
            "t": seconds,
        }
        if self._writer is not None:
            self._writer.write_row(episode)
        return episode

    def close(self) -> None:
        """Close the environment and the monitor's file."""
        self.env.close()
        if self._writer is not None:
            self._writer.close()

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """Return an attribute of the environment, once for each selected lane."""
        return [getattr(self.env.unwrapped, attr_name)] * len(self._lanes(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:  # noqa: ANN401 - SB3's signature
        """Set an attribute of the environment, which all lanes share."""
        if len(self._lanes(indices)) != self.num_envs:
            message = f"{attr_name}: the lanes share one environment; set it for all of them"
            raise ValueError(message)
        setattr(self.env.unwrapped, attr_name, value)

    def env_method(
        self,
        method_name: str,
        *method_args: Any,  # noqa: ANN401 - SB3's signature
        indices: Indices = None,
        **method_kwargs: Any,  # noqa: ANN401 - SB3's signature
    ) -> list[Any]:
        """Call a method of the environment once; return its result for each selected lane."""
        result = getattr(self.env.unwrapped, method_name)(*method_args, **method_kwargs)
        return [result] * len(self._lanes(indices))

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]], indices: Indices = None
    ) -> list[bool]:
        """Return true for `Monitor` only: episodes are monitored, though without a wrapper."""
        return [issubclass(wrapper_class, Monitor)] * len(self._lanes(indices))

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return the rendered frames, if the environment renders."""
        frames = self.env.render()
        return [None] * self.num_envs if frames is None else list(frames)  # pyright: ignore[reportReturnType] - Gymnasium does not declare the type of a frame

    def _lanes(self, indices: Indices) -> list[int]:
        return list(self._get_indices(indices))

    def _merged_options(self) -> dict[str, Any]:
        """Return the lanes' options as one dictionary with a value per lane."""
        first = self._options[0]
        if any(options.keys() != first.keys() for options in self._options):
            message = "options: every lane must set the same fields"
            raise ValueError(message)
        return {name: np.array([options[name] for options in self._options]) for name in first}


def _of_lane(infos: Info, lane: int) -> Info:
    """Return a lane's own entries of the info of all lanes, but for those of an end."""
    return {
        name: _of_lane(cast("Info", value), lane) if isinstance(value, dict) else value[lane]
        for name, value in infos.items()
        if not name.startswith("_") and name not in ENDS and infos[f"_{name}"][lane]
    }
