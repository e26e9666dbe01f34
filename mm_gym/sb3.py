"""A native Stable-Baselines3 `VecEnv`: no loop over environments, and correct ends of episodes."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.error import DependencyNotInstalled
from gymnasium.vector import AutoresetMode, VectorEnv

try:
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    msg = 'Stable-Baselines3 is not installed, run `pip install "mm-gym[agents]"`'
    raise DependencyNotInstalled(msg) from error

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    Indices = None | int | Iterable[int]


def make_vec_env(id: str, num_envs: int, **kwargs: Any) -> VectorEnvAdapter:  # noqa: A002, ANN401 - Gymnasium's signature
    """Make a registered environment as a Stable-Baselines3 `VecEnv`.

    Parameters
    ----------
    id
        A registered id with a vector entry point, such as "mm_gym/PreStretch-v0".
    num_envs
        Number of lanes.
    **kwargs
        Passed to the environment, for example ``scene``.

    Raises
    ------
    ValueError
        If ``copy`` is false: Stable-Baselines3 keeps observations over the next step.

    Examples
    --------
    >>> from mm_gym.sb3 import make_vec_env
    >>> make_vec_env("mm_gym/PreStretch-v0", 64).num_envs
    64
    """
    if not kwargs.get("copy", True):
        message = "copy: got False; allowed: True: observations are kept over the next step"
        raise ValueError(message)
    env = gymnasium.make_vec(
        id,
        num_envs=num_envs,
        vectorization_mode="vector_entry_point",
        autoreset_mode=AutoresetMode.SAME_STEP,
        **kwargs,
    )
    return VectorEnvAdapter(env)


class VectorEnvAdapter(VecEnv):
    """Any Gymnasium `VectorEnv` with same-step autoreset, as a Stable-Baselines3 `VecEnv`.

    At an episode's end the lane's info holds ``terminal_observation``, ``TimeLimit.truncated``
    (truncated and not terminated) and ``episode`` (return, length, seconds) as Stable-Baselines3's
    `Monitor` would write it.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        mode = env.metadata.get("autoreset_mode")
        if mode != AutoresetMode.SAME_STEP:
            message = f"autoreset_mode: got {mode}; allowed: {AutoresetMode.SAME_STEP}"
            raise ValueError(message)
        self.env = env
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)  # pyright: ignore[reportUnknownMemberType] - SB3 and Gymnasium write a bare Space
        self._returns = np.zeros(env.num_envs)
        self._lengths = np.zeros(env.num_envs, np.int64)
        self._began = time.perf_counter()
        self._actions: NDArray[Any] = np.zeros(0)

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
        self.reset_infos = self._split(infos)
        self._returns[:], self._lengths[:] = 0.0, 0
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the actions until `step_wait`."""
        self._actions = actions

    def step_wait(
        self,
    ) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.bool_], list[dict[str, Any]]]:
        """Make the step."""
        observations, rewards, terminated, truncated, info = self.env.step(self._actions)
        done = terminated | truncated
        self._returns += rewards
        self._lengths += 1
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if not np.count_nonzero(done):  # the common case
            return observations, rewards, done, infos
        for i in np.flatnonzero(done):
            infos[i] = {
                "terminal_observation": info["final_obs"][i],
                "TimeLimit.truncated": bool(truncated[i] and not terminated[i]),
                "episode": {
                    "r": float(self._returns[i]),
                    "l": int(self._lengths[i]),
                    "t": time.perf_counter() - self._began,
                },
            }
        self._returns[done], self._lengths[done] = 0.0, 0
        return observations, rewards, done, infos

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """Return an attribute of the environment, once per lane asked for."""
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
        """Call a method of the environment once and return its result per lane asked for."""
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

    def _split(self, infos: dict[str, Any]) -> list[dict[str, Any]]:
        names = [name for name in infos if not name.startswith("_")]
        return [
            {name: infos[name][i] for name in names if infos[f"_{name}"][i]}
            for i in range(self.num_envs)
        ]
