"""The arrays from which a training of Stable-Baselines3's algorithms continues.

They hold networks and optimisers, the replay buffer, the random numbers' generators, the lanes with
their streams, the normalisation, the best policy so far and the validations. On the same machine
and versions a continued training ends as one that was never interrupted, bitwise. What differs:
times, the progress bar, and tensorboard's log, which shows steps twice that a killed process made
after its last checkpoint.
"""

import json
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.save_util import recursive_getattr

from agents.network.files import check_shapes
from agents.training.arrays import Arrays, part_of
from agents.training.lanes import TrainingLanes
from mm_gym.errors import refuse

REPLAYED = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
"""Arrays of a replay buffer, (steps, lanes, ...)."""

KEPT = ("_last_obs", "_last_original_obs", "_last_episode_starts")
"""What a model keeps of the last step, where it does."""


def state_of(model: BaseAlgorithm) -> Arrays:
    """Return copies of all that the next steps depend on, between two rollouts."""
    parts = {
        **_networks(model),
        "lanes": _lanes(model).get_state(),
        "model": _own(model),
        "random": _generators(model),
        "normalisation": _normalisation(model),
        "replay": _replayed(model),
    }
    return {f"{part}/{name}": array for part in parts for name, array in parts[part].items()}


def restore(model: BaseAlgorithm, arrays: Arrays) -> None:
    """Restore what `state_of` returned.

    Raise `KeyError`, `IndexError`, `TypeError`, `ValueError` or `RuntimeError` if arrays are
    missing or have other types or shapes; the model is of no more use then.
    """
    _restore_networks(model, arrays)
    _lanes(model).set_state(part_of(arrays, "lanes"))
    own = part_of(arrays, "model")
    model.num_timesteps = _count(own, "steps")
    model._n_updates = _count(own, "updates")  # noqa: SLF001 - SB3 keeps them to itself
    for name in KEPT:
        if name in own:
            ends = name == "_last_episode_starts"
            check_shapes(own, {name: _seen(model)[:1] if ends else _seen(model)})
            setattr(model, name, own[name])
    if "memory" in own:
        _restore_memory(model, own["memory"])
    _restore_generators(model, part_of(arrays, "random"))
    _restore_normalisation(model, part_of(arrays, "normalisation"))
    _restore_replayed(model, part_of(arrays, "replay"))


def _count(arrays: Arrays, name: str) -> int:
    """Return one of several numbers; raise `ValueError` if it is not 0 or more."""
    check_shapes(arrays, {name: ()})
    number = int(arrays[name])  # pyright: ignore[reportArgumentType] - a number, as checked
    if number < 0:
        refuse(name, f"{number}", "0 or more", ValueError)
    return number


def _seen(model: BaseAlgorithm) -> tuple[int, ...]:
    """Return the shape of an observation of all lanes."""
    return _lanes(model).num_envs, *model.observation_space.shape


def _lanes(model: BaseAlgorithm) -> TrainingLanes:
    env = model.get_env()
    return cast("TrainingLanes", getattr(env, "venv", env))


def _networks(model: BaseAlgorithm) -> dict[str, Arrays]:
    """Return the parameters of networks and optimisers, and other tensors that are learned."""
    named, tensors = model._get_torch_save_params()  # noqa: SLF001
    parts: dict[str, Arrays] = {}
    for name in named:
        state = recursive_getattr(model, name).state_dict()
        if "param_groups" in state:
            state = {
                f"{i}/{key}": tensor
                for i, moments in state["state"].items()
                for key, tensor in moments.items()
            }
        parts[name] = {key: _copy(tensor) for key, tensor in state.items()}
    parts["tensors"] = {name: _copy(recursive_getattr(model, name)) for name in tensors}
    return parts


def _copy(tensor: torch.Tensor) -> Any:  # noqa: ANN401 - an array of the tensor's type
    return tensor.numpy(force=True).copy()


def _restore_networks(model: BaseAlgorithm, arrays: Arrays) -> None:
    named, tensors = model._get_torch_save_params()  # noqa: SLF001
    for name in named:
        target = recursive_getattr(model, name)
        state = {key: _tensor(array) for key, array in part_of(arrays, name).items()}
        if isinstance(target, torch.optim.Optimizer):
            moments: dict[int, dict[str, torch.Tensor]] = {}
            for key, tensor in state.items():
                number, moment = key.split("/")
                moments.setdefault(int(number), {})[moment] = tensor
            _check_moments(target, moments)
            target.load_state_dict(target.state_dict() | {"state": moments})
        else:
            target.load_state_dict(state)
    for name in tensors:
        recursive_getattr(model, name).data = _tensor(arrays[f"tensors/{name}"])


def _check_moments(
    optimiser: torch.optim.Optimizer, moments: dict[int, dict[str, torch.Tensor]]
) -> None:
    """Raise `ValueError` unless the moments are numbers, or have the shapes of the parameters."""
    parameters = [one for group in optimiser.param_groups for one in group["params"]]
    for number, own in moments.items():
        for name, moment in own.items():
            if moment.ndim and moment.shape != parameters[number].shape:
                msg = f"{name} of parameter {number}: got shape {tuple(moment.shape)}; "
                raise ValueError(msg + f"allowed: {tuple(parameters[number].shape)}")


def _tensor(array: Any) -> torch.Tensor:  # noqa: ANN401 - an array
    return torch.from_numpy(np.array(array))


def _own(model: BaseAlgorithm) -> Arrays:
    kept = {name: np.array(getattr(model, name)) for name in KEPT if _has(model, name)}
    if _has(model, "_last_lstm_states"):
        cells = model._last_lstm_states  # noqa: SLF001
        kept["memory"] = np.stack([_copy(tensor) for pair in cells for tensor in pair])
    return kept | {
        "steps": np.asarray(model.num_timesteps),
        "updates": np.asarray(model._n_updates),  # noqa: SLF001
    }


def _has(model: BaseAlgorithm, name: str) -> bool:
    return getattr(model, name, None) is not None


def _restore_memory(model: BaseAlgorithm, memory: Any) -> None:  # noqa: ANN401 - an array
    now = model._last_lstm_states  # noqa: SLF001
    shape = 4, *now[0][0].shape
    check_shapes({"memory": memory}, {"memory": shape})
    state, output, *others = (_tensor(array) for array in memory)
    model._last_lstm_states = type(now)((state, output), tuple(others))  # noqa: SLF001


def _generators(model: BaseAlgorithm) -> Arrays:
    """Return the states of the generators from which actions and batches are drawn."""
    state = np.random.get_state(legacy=False)  # noqa: NPY002 - the generator that SB3 uses
    sampler = model.action_space.np_random.bit_generator.state
    return {
        "torch": torch.get_rng_state().numpy().copy(),
        "numpy": state["state"]["key"].copy(),
        "position": np.asarray(state["state"]["pos"]),
        "has_normal": np.asarray(state["has_gauss"]),
        "normal": np.asarray(state["gauss"]),
        "first_actions": np.asarray(json.dumps(sampler)),
    }


def _restore_generators(model: BaseAlgorithm, arrays: Arrays) -> None:
    own = np.random.get_state(legacy=False)["state"]  # noqa: NPY002 - the generator that SB3 uses
    check_shapes(
        arrays, {"numpy": own["key"].shape, "position": (), "has_normal": (), "normal": ()}
    )
    torch.set_rng_state(torch.from_numpy(arrays["torch"].copy()))
    np.random.set_state(  # noqa: NPY002
        {
            "bit_generator": "MT19937",
            "state": {"key": arrays["numpy"], "pos": int(arrays["position"])},
            "has_gauss": int(arrays["has_normal"]),
            "gauss": float(arrays["normal"]),
        }
    )
    model.action_space.np_random.bit_generator.state = json.loads(str(arrays["first_actions"]))


def _normalisation(model: BaseAlgorithm) -> Arrays:
    """Return the running moments of observations and returns, if there are any."""
    statistics = model.get_vec_normalize_env()
    if statistics is None:
        return {}
    arrays: Arrays = {"returns": statistics.returns.copy(), "seen": statistics.old_obs.copy()}
    for name in ("obs_rms", "ret_rms"):
        moments = getattr(statistics, name, None)
        if moments is not None:
            arrays |= {
                f"{name}.{part}": np.array(getattr(moments, part))
                for part in ("mean", "var", "count")
            }
    return arrays


def _restore_normalisation(model: BaseAlgorithm, arrays: Arrays) -> None:
    statistics = model.get_vec_normalize_env()
    if statistics is None:
        return
    check_shapes(arrays, {"returns": _seen(model)[:1], "seen": _seen(model)})
    statistics.returns, statistics.old_obs = arrays["returns"], arrays["seen"]
    for key, array in arrays.items():
        name, _, part = key.partition(".")
        if part:
            moments = getattr(statistics, name)
            check_shapes(arrays, {key: np.shape(getattr(moments, part))})
            setattr(moments, part, array if array.ndim else array.item())


def _replay_buffer(model: BaseAlgorithm) -> ReplayBuffer | None:
    return model.replay_buffer if isinstance(model, OffPolicyAlgorithm) else None


def _replayed(model: BaseAlgorithm) -> Arrays:
    buffer = _replay_buffer(model)
    if buffer is None:
        return {}
    filled = buffer.buffer_size if buffer.full else buffer.pos
    arrays: Arrays = {name: getattr(buffer, name)[:filled].copy() for name in REPLAYED}
    return arrays | {"position": np.asarray(buffer.pos), "full": np.asarray(buffer.full)}


def _restore_replayed(model: BaseAlgorithm, arrays: Arrays) -> None:
    buffer = _replay_buffer(model)
    if buffer is not None:
        buffer.pos, buffer.full = _count(arrays, "position"), bool(arrays["full"])
        filled = buffer.buffer_size if buffer.full else buffer.pos
        if not buffer.pos <= filled <= buffer.buffer_size:
            refuse("position", f"{buffer.pos}", f"at most {buffer.buffer_size}", ValueError)
        for name in REPLAYED:
            own = getattr(buffer, name)
            check_shapes(arrays, {name: (filled, *own.shape[1:])})
            own[:filled] = arrays[name]
