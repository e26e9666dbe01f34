"""A user's own cost of a control step, in the place of the scene's reward."""

from __future__ import annotations

import inspect
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.vector import VectorWrapper
from numba import vectorize

from agents.controllers.controller import columns
from agents.controllers.observed_state import ROWS
from agents.user_code import load
from mm_gym import SceneError, compile_scene
from mm_gym.errors import suggest

if TYPE_CHECKING:
    from collections.abc import Callable

    from gymnasium.vector import VectorEnv
    from numpy.typing import NDArray

    from mm_gym import Scene

    Values = NDArray[np.float64]
    Wrapper = VectorWrapper[Any, Any, Any, Any, Any]
else:  # a class without parameters before Gymnasium 1.4
    Wrapper = VectorWrapper

ACTUATORS = {"applied_force": "force", "stretch": "stretch"}
"""Channels that are what the actuators have."""


class OwnCost:
    """A user's function of channels: the cost of a control step; the reward is minus the cost.

    Its arguments are named after channels (docs/excitation.md), each a number in the channel's SI
    unit at the step's end; it returns a number. Those of the motion and the actuators are exact;
    others have to be observed without noise and delay. The function is compiled, or, if numba
    cannot, called for each lane.

    Raises
    ------
    SceneError
        If the file, the function or an argument is wrong.
    """

    def __init__(self, scene: Scene, reward: str) -> None:
        function = load(reward, "reward")
        self.reward, plant = reward, compile_scene(scene)
        self.frame = len(plant.observed)
        actuators = {name: k for k, name in enumerate(columns(scene))}
        exact = {n: actuators[a] for n, a in ACTUATORS.items() if a in actuators}
        seen = {
            channel.name: (k, channel)
            for k, channel in enumerate(plant.observed)
            if not plant.delay and not channel.noise
        }
        allowed = {**ROWS, **exact, **seen}
        names = list(inspect.signature(function).parameters)
        for name in names or [""]:
            if name not in allowed:
                msg = (
                    f"reward: {reward}: got the argument {name!r}{suggest(name, allowed)}; "
                    f"allowed: {', '.join(allowed)}; others have to be among sensors.channels, "
                    "without noise and delay"
                )
                raise SceneError(msg)
        self.readers = [_reader(name, exact, seen, self.frame) for name in names]
        self.cost = _compiled(function, len(names), reward)

    def rewards(self, observation: NDArray[np.float32], info: dict[str, Any]) -> Values:
        """Return the rewards (lanes,) of a step.

        Parameters
        ----------
        observation, info
            (lanes, n) and the information, at the step's end.

        Raises
        ------
        SceneError
            If the function raises an error or returns what is not finite.
        """
        try:
            costs = self.cost(*(read(observation, info) for read in self.readers))
        except Exception as error:
            msg = f"reward: {self.reward} failed: {type(error).__name__}: {error}"
            raise SceneError(msg) from error
        if not np.isfinite(costs).all():
            msg = f"reward: {self.reward} returned what is not finite"
            raise SceneError(msg)
        return -costs


def _reader(
    name: str, exact: dict[str, int], seen: dict[str, Any], frame: int
) -> Callable[[NDArray[np.float32], dict[str, Any]], Values]:
    """Return what reads a channel (lanes,) in its SI unit from observation and information."""
    if name in ROWS:
        row = np.array(ROWS[name])
        return lambda _, info: info["state"] @ row
    if name in exact:
        column = exact[name]
        return lambda _, info: info["applied"][:, column]
    place, channel = seen[name]
    return lambda observation, _: (
        observation[:, place - frame].astype(np.float64) / channel.factor + channel.zero
    )


def _compiled(function: Callable[..., float], count: int, reward: str) -> Callable[..., Any]:
    """Return a function of arrays."""
    try:
        return vectorize([f"float64({', '.join(['float64'] * count)})"])(function)
    except Exception:  # noqa: BLE001 - numba raises many kinds; the function has not been run
        print(f"reward: {reward} cannot be compiled; it is called for each lane", file=sys.stderr)
        return np.vectorize(function, otypes=[np.float64])


class OwnReward(Wrapper):
    """Reward the steps of a vector environment with same-step autoreset by an own cost."""

    def __init__(self, env: VectorEnv[Any, Any, Any], cost: OwnCost) -> None:
        super().__init__(env)
        self.cost = cost

    def step(
        self, actions: NDArray[np.floating]
    ) -> tuple[NDArray[np.float32], Values, NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Make the step."""
        observation, _, terminated, truncated, info = self.env.step(actions)
        rewards = self.cost.rewards(*at_end(observation, info, terminated | truncated))
        return observation, rewards, terminated, truncated, info


def at_end(
    observation: NDArray[np.float32], info: dict[str, Any], ended: NDArray[np.bool_]
) -> tuple[NDArray[np.float32], dict[str, Any]]:
    """Return observation, state and what was applied at a step's end, before any restart."""
    known = {name: info[name] for name in ("state", "applied")}
    if not ended.any():
        return observation, known
    last = observation.copy()
    last[ended] = np.stack(info["final_obs"][ended])
    return last, {
        name: np.where(ended[:, None], info["final_info"][name], rows)
        for name, rows in known.items()
    }
