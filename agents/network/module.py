"""A policy as a module of torch: the same layers over tensors, whose gradients torch finds."""

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from agents.network.layers import every, run
from agents.network.policy import Policy


class Module(nn.Module):
    """Layers over tensors: parameters are their arrays but for those that are fixed.

    It begins as a policy.
    """

    def __init__(self, policy: Policy) -> None:
        super().__init__()
        self.start = policy
        fixed = {id(getattr(one, name)) for one in every(policy.layers) for name in one.fixed}
        self.tensors: dict[str, Tensor] = {}
        for name, array in policy.arrays.items():
            key, is_fixed = name.replace(".", "_"), id(array) in fixed  # torch allows no dots
            tensor = torch.tensor(array)
            self.tensors[name] = tensor if is_fixed else nn.Parameter(tensor)
            (self.register_buffer if is_fixed else self.register_parameter)(key, self.tensors[name])
        self.layers = policy.with_arrays(self.tensors).layers

    @property
    def trained(self) -> dict[str, Tensor]:
        """Parameters by the names of the policy's arrays."""
        return {name: one for name, one in self.tensors.items() if one.requires_grad}

    def begin(self, lanes: int) -> Tensor:
        """Return the memory (lanes, m) with which an episode begins."""
        return torch.zeros(lanes, self.start.remembers)

    def forward(self, observation: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        """Return the actions (lanes, k) for observations (lanes, n), and the memory after them."""
        return run(self.layers, torch, observation, memory)

    def policy(self, tensors: Mapping[str, Tensor] | None = None) -> Policy:
        """Return it as a policy of NumPy's arrays, by default of its own tensors."""
        given = self.tensors if tensors is None else tensors
        arrays = {name: one.detach().numpy().copy() for name, one in given.items()}
        return self.start.with_arrays(arrays)
