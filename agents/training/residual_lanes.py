"""Lanes in which an agent adds to a base's action, wherever in time their episodes begin."""

from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from agents.control.controller import Controller, Memory, chosen, joined, part
from agents.controllers.learned import observed
from agents.training.arrays import Arrays, check_like
from mm_gym.arrays import Array, Single

if TYPE_CHECKING:
    Wrapper = VectorWrapper[Any, Any, Any, Any, Any]
else:  # a class without parameters before Gymnasium 1.4
    Wrapper = VectorWrapper


class ResidualLanes(Wrapper):
    """Add `authority` times the agent's actions to those of a base, which the agent observes too.

    Parameters
    ----------
    env
        A vector environment with same-step autoreset over `MovingMassVectorEnv`.

    Attributes
    ----------
    memory
        The base's, of every lane's own episode.
    proposed
        (lanes, k) the base's actions for the last observation.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any], base: Controller, authority: float) -> None:
        super().__init__(env)
        self.base, self.authority = base, authority
        own, actions = env.single_observation_space, env.single_action_space
        self.single_observation_space = Box(
            np.concatenate([own.low, actions.low]), np.concatenate([own.high, actions.high])
        )
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)
        self.memory: Memory = {}
        self.proposed = np.zeros(env.action_space.shape)

    def reset(self, **arguments: Any) -> tuple[Single, dict[str, Any]]:  # noqa: ANN401 - Gymnasium's
        """Begin an episode in every lane."""
        observation, info = self.env.reset(**arguments)
        self.proposed, self.memory = self._begun(observation, info)
        return observed(observation, self.proposed), info

    def step(
        self, actions: NDArray[np.floating]
    ) -> tuple[Single, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Apply the sums."""
        total = np.clip(self.proposed + self.authority * actions, -1.0, 1.0)
        memory = self.base.note(self.memory, total)
        observation, reward, terminated, truncated, info = self.env.step(total)
        ended = terminated | truncated
        last, known = _at_end(observation, info, ended)
        self.proposed, self.memory = self.base.propose(memory, last, self.base.known(known))
        if ended.any():
            finals = observed(last, self.proposed)
            for lane in np.flatnonzero(ended):
                info["final_obs"][lane] = finals[lane]
            proposed, memory = self._begun(observation, info)
            self.proposed = chosen(ended, proposed, self.proposed)
            self.memory = {
                name: chosen(ended, begun, self.memory[name]) for name, begun in memory.items()
            }
        return observed(observation, self.proposed), reward, terminated, truncated, info

    def _begun(self, observation: Single, info: dict[str, Any]) -> tuple[Array, Memory]:
        """Return the base's actions and memory in episodes that begin in all lanes."""
        memory = self.base.begin(self.env.unwrapped)  # pyright: ignore[reportArgumentType] - as required
        return self.base.propose(memory, observation, self.base.known(info))

    def get_state(self) -> Arrays:
        """Return the base's memory, and the actions that it proposes."""
        return {"proposed": self.proposed.copy(), **joined(memory=self.memory)}

    def set_state(self, arrays: Arrays) -> None:
        """Continue from what `get_state` returned, after the environment has continued."""
        begun = self.base.begin(self.env.unwrapped)  # pyright: ignore[reportArgumentType] - as required
        check_like(arrays, {"proposed": self.proposed, **joined(memory=begun)})
        self.proposed = np.array(arrays["proposed"])
        self.memory = part(arrays, "memory")


def _at_end(
    observation: Single, info: dict[str, Any], ended: NDArray[np.bool_]
) -> tuple[Single, dict[str, Any]]:
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
