"""A trained policy as a controller."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from agents.controllers.controller import Reads, Values
    from agents.policies import AnyPolicy
    from mm_gym import MovingMassVectorEnv


class Learned:
    """The mean action of a trained policy."""

    reads: Reads = "observation"

    def __init__(self, policy: AnyPolicy, name: str = "learned") -> None:
        self.policy = policy
        self.name = name

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Begin; raise `PolicyError` if the policy is for other observations or actions."""
        self.policy.check(env.single_observation_space.shape[0], env.single_action_space.shape[0])
        self.sums = self.policy.begin(env.num_envs)

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> Values:
        """Return the policy's mean action."""
        return self.policy.act(observation, self.sums)
