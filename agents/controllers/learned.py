"""A trained policy as a controller."""

from __future__ import annotations

from typing import TYPE_CHECKING

from agents.controllers.controller import Controller

if TYPE_CHECKING:
    from agents.controllers.controller import Acted, Info, Memory, Observation
    from agents.policies import AnyPolicy
    from mm_gym import MovingMassVectorEnv


class Learned(Controller):
    """The mean action of a trained policy."""

    def __init__(self, policy: AnyPolicy, name: str = "learned") -> None:
        self.policy, self.name = policy, name

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        """Begin; raise `PolicyError` if the policy is for other observations or actions."""
        self.policy.check(env.single_observation_space.shape[0], env.single_action_space.shape[0])
        return {"policy": self.policy.begin(env.num_envs)}

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        """Return the policy's mean action."""
        action, after = self.policy.step(observation, memory["policy"])
        return action, {"policy": after}
