"""A trained policy added to another controller's action."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from agents.controllers.feedback import Feedback

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from agents.controllers.controller import Controller, Reads, Values
    from agents.policies import Policy
    from mm_gym import MovingMassVectorEnv


def propose(base: Controller, observation: NDArray[np.float32], info: dict[str, Any]) -> Values:
    """Return the base's actions (lanes, k), clipped, of which it is not told that they are applied.

    `info` is kept from a base that reads the observation alone.
    """
    known = {} if base.reads == "observation" else info
    if isinstance(base, Feedback):
        proposed = base.law.action(*base.source.read(observation, known))
    else:
        proposed = base.act(observation, known)
    return np.clip(proposed, -1.0, 1.0)


def send(base: Controller, action: Values) -> None:
    """Tell the base which actions (lanes, k) are applied, where it has a model to move on.

    A controller that is no `Feedback` is told by its method `send`, if it has one.
    """
    if isinstance(base, Feedback):
        base.source.send(action)
    elif hasattr(base, "send"):
        base.send(action)


def observed(observation: NDArray[np.float32], proposed: Values) -> NDArray[np.float32]:
    """Return what the agent observes, (lanes, n + k): the environment's, and the base's action."""
    return np.hstack([observation, proposed.astype(np.float32)])


class Residual:
    """A controller's action plus `authority` times a policy's, clipped.

    The policy reads the base's action besides the observation.
    """

    def __init__(
        self, base: Controller, policy: Policy, authority: float, name: str = "learned"
    ) -> None:
        self.base, self.policy, self.authority = base, policy, authority
        self.name = name

    @property
    def reads(self) -> Reads:
        """What the base reads."""
        return self.base.reads

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Begin; raise `PolicyError` if the policy is for other observations or actions."""
        actions = env.single_action_space.shape[0]
        self.policy.check(env.single_observation_space.shape[0] + actions, actions)
        self.base.reset(env)
        self.sums = self.policy.begin(env.num_envs)

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> Values:
        """Return the sum."""
        proposed = propose(self.base, observation, info)
        added = self.policy.act(observed(observation, proposed), self.sums)
        action = np.clip(proposed + self.authority * added, -1.0, 1.0)
        send(self.base, action)
        return action
