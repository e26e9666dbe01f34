"""A trained policy as a controller, alone or added to another controller's action."""

import numpy as np

from agents.control.controller import Acted, Controller, Info, Memory, Observation, joined, part
from agents.policies import AnyPolicy, Policy
from mm_gym import MovingMassVectorEnv
from mm_gym.arrays import Array, Single


class Learned(Controller):
    """The mean action of a trained policy."""

    def __init__(self, policy: AnyPolicy, name: str = "learned") -> None:
        self.policy, self.name = policy, name

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        self.policy.check(env.single_observation_space.shape[0], env.single_action_space.shape[0])
        return {"policy": self.policy.begin(env.num_envs)}

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        action, after = self.policy.step(observation, memory["policy"])
        return action, {"policy": after}


def observed(observation: Single, proposed: Array) -> Single:
    """Return what the agent observes, (lanes, n + k): the environment's, and the base's action."""
    return np.concatenate([observation, proposed.astype(np.float32)], 1)


class Residual(Controller):
    """A controller's action plus `authority` times a policy's, clipped.

    The policy reads the base's action, too.
    """

    def __init__(
        self, base: Controller, policy: Policy, authority: float, name: str = "learned"
    ) -> None:
        self.base, self.policy, self.authority = base, policy, authority
        self.name, self.reads = name, base.reads

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        actions = env.single_action_space.shape[0]
        self.policy.check(env.single_observation_space.shape[0] + actions, actions)
        own = {"memory": self.policy.begin(env.num_envs)}
        return joined(base=self.base.begin(env), policy=own)

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        proposed, base = self.base.propose(part(memory, "base"), observation, info)
        seen = observed(observation, proposed)
        added, after = self.policy.step(seen, part(memory, "policy")["memory"])
        action = np.clip(proposed + self.authority * added, -1.0, 1.0)
        return action, joined(base=base, policy={"memory": after})

    def note(self, memory: Memory, action: Array) -> Memory:
        base = self.base.note(part(memory, "base"), action)
        return joined(base=base, policy=part(memory, "policy"))
