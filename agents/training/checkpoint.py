"""The arrays from which a training of PPO continues.

They hold the policy, the optimiser, the random numbers' generators, the lanes with their streams,
the best policy so far and the validations. On the same machine and versions a continued training
ends as one that was never interrupted, bitwise. What differs: times, the progress bar, and
tensorboard's log, which shows steps twice that a killed process made after its last checkpoint.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
import torch

from agents.training.arrays import part_of

if TYPE_CHECKING:
    from stable_baselines3 import PPO

    from agents.training.arrays import Arrays
    from agents.training.lanes import TrainingLanes


def state_of(model: PPO) -> Arrays:
    """Return copies of all that the next steps depend on, between two rollouts."""
    optimiser = model.policy.optimizer.state_dict()["state"]
    moments = {
        f"{i}/{name}": tensor.numpy(force=True).copy()
        for i, tensors in optimiser.items()
        for name, tensor in tensors.items()
    }
    parts = {
        "policy": parameters_of(model),
        "optimiser": moments,
        "lanes": _lanes(model).get_state(),
        "model": {
            "steps": np.asarray(model.num_timesteps),
            "updates": np.asarray(model._n_updates),  # noqa: SLF001 - SB3 keeps them to itself
            "observations": np.array(model._last_obs),  # noqa: SLF001
            "starts": np.array(model._last_episode_starts),  # noqa: SLF001
        },
        "random": _generators(),
    }
    return {f"{part}/{name}": array for part in parts for name, array in parts[part].items()}


def restore(model: PPO, arrays: Arrays) -> None:
    """Restore what `state_of` returned."""
    restore_parameters(model, part_of(arrays, "policy"))
    moments: dict[int, dict[str, torch.Tensor]] = {}
    for key, array in part_of(arrays, "optimiser").items():
        number, name = key.split("/")
        moments.setdefault(int(number), {})[name] = torch.from_numpy(array.copy())
    optimiser = model.policy.optimizer
    optimiser.load_state_dict(optimiser.state_dict() | {"state": moments})
    _lanes(model).set_state(part_of(arrays, "lanes"))
    own = part_of(arrays, "model")
    model.num_timesteps = int(own["steps"])
    model._n_updates = int(own["updates"])  # noqa: SLF001
    model._last_obs = own["observations"]  # noqa: SLF001
    model._last_episode_starts = own["starts"]  # noqa: SLF001
    _restore_generators(part_of(arrays, "random"))


def parameters_of(model: PPO) -> Arrays:
    """Return copies of the policy's parameters."""
    parameters = model.policy.state_dict()
    return {name: tensor.numpy(force=True).copy() for name, tensor in parameters.items()}


def restore_parameters(model: PPO, parameters: Arrays) -> None:
    """Restore what `parameters_of` returned."""
    model.policy.load_state_dict(
        {name: torch.from_numpy(array.copy()) for name, array in parameters.items()}
    )


def _lanes(model: PPO) -> TrainingLanes:
    return cast("TrainingLanes", model.get_env())


def _generators() -> Arrays:
    """Return the states of the generators from which PPO draws actions and batches."""
    state = np.random.get_state(legacy=False)  # noqa: NPY002 - the generator that SB3 uses
    return {
        "torch": torch.get_rng_state().numpy().copy(),
        "numpy": state["state"]["key"].copy(),
        "position": np.asarray(state["state"]["pos"]),
        "has_normal": np.asarray(state["has_gauss"]),
        "normal": np.asarray(state["gauss"]),
    }


def _restore_generators(arrays: Arrays) -> None:
    torch.set_rng_state(torch.from_numpy(arrays["torch"].copy()))
    np.random.set_state(  # noqa: NPY002
        {
            "bit_generator": "MT19937",
            "state": {"key": arrays["numpy"], "pos": int(arrays["position"])},
            "has_gauss": int(arrays["has_normal"]),
            "gauss": float(arrays["normal"]),
        }
    )
