"""Training with an algorithm of Stable-Baselines3 or sb3-contrib, validated as it goes.

A training continues from arrays. They hold networks and optimisers, the replay buffer, the random
numbers' generators, the lanes with their streams, the normalisation, the best policy so far and the
validations. On the same machine and versions a continued training ends as one that was never
interrupted, bitwise. What differs: times, the progress bar, and tensorboard's log, which shows
steps twice that a killed process made after its last checkpoint.
"""

from __future__ import annotations

import json
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.save_util import recursive_getattr
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from agents.control.controller import joined, part
from agents.network.files import check_shapes
from agents.policies import AnyPolicy, policy_in
from agents.scoring import validation_cost
from agents.training.algorithms import algorithm_class, make_model, policy_of
from agents.training.arrays import Arrays
from agents.training.config import TrainSettings
from agents.training.lanes import TrainingLanes, make_lanes
from agents.training.own_scene import for_own_scene
from agents.training.parts import Parts, make_parts
from agents.training.runs import DivergedError, Run
from agents.training.search import LOGS, Log, Search
from mm_gym.errors import refuse

Report = Callable[[int, float], None]

EPISODES_LOGGED = 4  # between two entries of the log of an algorithm with a replay buffer


def train(
    settings: TrainSettings, run: Run, *, bar: bool = True, report: Report | None = None
) -> None:
    """Train until steps or time are used up, and write the best policy to the run's folder.

    A finished run goes on where the settings differ in that they have more steps or time. Raise as
    `Search.finish` does, and, before a folder is made, `SceneError` or `CompileError` if there is
    nothing to train on, `DependencyNotInstalled` if the algorithm needs a package that is missing.

    Parameters
    ----------
    bar
        Whether to draw a progress bar.
    report
        Called with the steps and the cost of each validation; what it raises ends the training.
    """
    algorithm_class(settings.algorithm)
    settings = for_own_scene(settings, run)
    search = Reinforcement(settings, make_parts(settings, run), run, report)
    search.finish(run, bar=bar)
    search.model.env.close()


class Reinforcement(Search):
    """A training whose rounds are rollouts, counted in control steps.

    Attributes
    ----------
    model
        Of Stable-Baselines3, as the last rollout left it.
    """

    unit = "control step"
    between_saves = 60.0  # a replay buffer may have hundreds of megabytes
    is_compared = False
    frames = 1

    def __init__(
        self, settings: TrainSettings, parts: Parts, run: Run, report: Report | None = None
    ) -> None:
        super().__init__(settings, parts.scene)
        self.settings: TrainSettings = settings
        self.parts, self.report, self.total = parts, report, settings.steps
        self.numbers = parts.numbers
        self.began_as = str(settings.base) if parts.base else "an untrained network"
        torch.set_num_threads(settings.threads)
        lanes = _normalised(settings, make_lanes(settings, parts))
        self.model: Any = make_model(settings, run.folder / LOGS, lanes)
        self.is_light = isinstance(self.model, OnPolicyAlgorithm)
        self.counts = settings.lanes * (self.model.n_steps if self.is_light else 1)

    def _to_the_end(self, run: Run, *, bar: bool) -> None:
        fresh = not run.checkpoint.exists()  # which holds lanes that have been reset
        left, name = self.settings.steps - self.rounds, self.settings.algorithm
        _, self.callback = self.model._setup_learn(left, None, fresh, name)  # noqa: SLF001
        with self._gentle_interrupts():
            super()._to_the_end(run, bar=bar)

    @contextmanager
    def _gentle_interrupts(self) -> Iterator[None]:
        """Let a first Ctrl-C wait for the end of a round whose state is not noted at its start."""
        if self.is_light or threading.current_thread() is not threading.main_thread():
            yield
            return

        def note(*_: object) -> None:
            self.interrupted = True
            signal.signal(signal.SIGINT, before)

        before = signal.signal(signal.SIGINT, note)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, before)

    def _advance(self) -> None:
        """Do what a pass of the loop in `learn` does."""
        model = self.model
        try:
            if self.is_light:
                model.collect_rollouts(
                    model.env, self.callback, model.rollout_buffer, model.n_steps
                )
                done = self.rounds + self.counts, self.settings.steps
                model._update_current_progress_remaining(*done)  # noqa: SLF001
                model.dump_logs(done[0] // self.counts)
                model.train()
                return
            model.collect_rollouts(
                *(model.env, self.callback, model.train_freq, model.replay_buffer),
                *(model.action_noise, model.learning_starts, EPISODES_LOGGED),
            )
            if model.num_timesteps > model.learning_starts:
                model.train(model.gradient_steps, model.batch_size)
        except ValueError as error:
            if "of distribution" not in str(error):  # what torch says of a spread of 0 or nan
                raise
            name = self.settings.algorithm
            msg = (
                f"diverged before {self.unit} {model.num_timesteps}; "
                f"a smaller {name}.learning_rate may help"
            )
            raise DivergedError(msg) from error

    def _is_due(self) -> bool:
        return self._has_passed(-(-self.settings.steps // self.settings.evaluations))

    def _validate(self, log: Log) -> None:
        super()._validate(log)
        if self.report is not None and self.rounds:
            self.report(self.rounds, float(self.progress.rows[-1, 2]))

    def _cost(self, parameters: Arrays) -> float:
        return validation_cost(self.scene, self.parts.controller(self._policy(parameters)))

    def _present(self) -> Arrays:
        return {"policy": np.frombuffer(policy_of(self.model).to_bytes(), np.uint8)}

    def _policy(self, parameters: Arrays) -> AnyPolicy:
        return policy_in(parameters["policy"].tobytes())

    def _state(self) -> Arrays:
        return state_of(self.model) if self.model._last_obs is not None else {}  # noqa: SLF001

    def _restore(self, arrays: Arrays) -> None:
        restore(self.model, arrays)
        self.rounds = self.model.num_timesteps
        if self.progress.best:
            self.policy()


def _normalised(settings: TrainSettings, lanes: VecEnv) -> VecEnv:
    observations, rewards = settings.normalise_observations, settings.normalise_rewards
    if not (observations or rewards):
        return lanes
    return VecNormalize(
        lanes,
        norm_obs=observations,
        norm_reward=rewards,
        clip_obs=np.inf,  # clipping would keep it out of the policy's weights
        gamma=settings.chosen.discount,
    )


REPLAYED = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
"""Arrays of a replay buffer, (steps, lanes, ...)."""

KEPT = ("_last_obs", "_last_original_obs", "_last_episode_starts")
"""What a model keeps of the last step, where it does."""

COUNTS = ("num_timesteps", "_n_updates", "pos")  # attributes that are numbers of at least 0


def _places(model: BaseAlgorithm) -> dict[str, tuple[Any, str]]:
    """Return where a model keeps what is not learned, by name: an object, and its attribute."""
    statistics, buffer = model.get_vec_normalize_env(), _buffer(model)
    found: list[tuple[str, Any, str]] = [
        *((f"model/{name}", model, name) for name in KEPT),
        ("model/steps", model, "num_timesteps"),
        ("model/updates", model, "_n_updates"),
        ("normalisation/returns", statistics, "returns"),
        ("normalisation/seen", statistics, "old_obs"),
        ("replay/position", buffer, "pos"),
        ("replay/full", buffer, "full"),
    ]
    for name in ("obs_rms", "ret_rms"):
        running = getattr(statistics, name, None)
        found += [(f"normalisation/{name}.{one}", running, one) for one in ("mean", "var", "count")]
    return {name: (owner, attribute) for name, owner, attribute in found if owner is not None}


def state_of(model: BaseAlgorithm) -> Arrays:
    """Return copies of all that the next steps depend on, between two rollouts."""
    kept = {name: getattr(*place, None) for name, place in _places(model).items()}
    arrays = {name: np.array(value) for name, value in kept.items() if value is not None}
    cells, buffer = getattr(model, "_last_lstm_states", None), _buffer(model)
    if cells is not None:
        arrays["model/memory"] = np.stack([_copy(tensor) for pair in cells for tensor in pair])
    if buffer is not None:
        replayed = {name: getattr(buffer, name)[: _filled(buffer)].copy() for name in REPLAYED}
        arrays |= joined(replay=replayed)
    state, random = _lanes(model).get_state(), _generators(model)
    return arrays | joined(**_networks(model), lanes=state, random=random)


def restore(model: BaseAlgorithm, arrays: Arrays) -> None:
    """Restore what `state_of` returned.

    Raise `KeyError`, `IndexError`, `TypeError`, `ValueError` or `RuntimeError` if arrays are
    missing or have other types or shapes; the model is of no more use then.
    """
    _restore_networks(model, arrays)
    _lanes(model).set_state(part(arrays, "lanes"))
    seen = _lanes(model).num_envs, *model.observation_space.shape
    begun = dict.fromkeys((*KEPT, "old_obs"), seen) | {"_last_episode_starts": seen[:1]}
    for name, (owner, attribute) in _places(model).items():
        if attribute in KEPT and name not in arrays:
            continue
        shape = begun.get(attribute) or np.shape(getattr(owner, attribute))
        check_shapes(arrays, {name: shape})
        value = arrays[name] if shape else arrays[name].item()
        if attribute in COUNTS and value < 0:
            refuse(name, f"{value}", "0 or more", ValueError)
        setattr(owner, attribute, value)
    if "model/memory" in arrays:
        cells = model._last_lstm_states  # noqa: SLF001 - SB3 keeps them to itself
        check_shapes(arrays, {"model/memory": (4, *cells[0][0].shape)})
        state, output, *others = (_tensor(array) for array in arrays["model/memory"])
        model._last_lstm_states = type(cells)((state, output), tuple(others))  # noqa: SLF001
    _restore_generators(model, part(arrays, "random"))
    buffer = _buffer(model)
    if buffer is not None:
        filled = _filled(buffer)
        if not buffer.pos <= filled <= buffer.buffer_size:
            refuse("position", f"{buffer.pos}", f"at most {buffer.buffer_size}", ValueError)
        for name, own in ((name, getattr(buffer, name)) for name in REPLAYED):
            check_shapes(arrays, {f"replay/{name}": (filled, *own.shape[1:])})
            own[:filled] = arrays[f"replay/{name}"]


def _buffer(model: BaseAlgorithm) -> ReplayBuffer | None:
    return getattr(model, "replay_buffer", None)


def _filled(buffer: ReplayBuffer) -> int:
    """Return how many steps are in a replay buffer."""
    return buffer.buffer_size if buffer.full else buffer.pos


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
        state = {key: _tensor(array) for key, array in part(arrays, name).items()}
        if isinstance(target, torch.optim.Optimizer):
            parameters = [one for group in target.param_groups for one in group["params"]]
            moments: dict[int, dict[str, torch.Tensor]] = {}
            for key, tensor in state.items():
                number, moment = key.split("/")
                shape = parameters[int(number)].shape
                if tensor.ndim and tensor.shape != shape:
                    refuse(f"{name}/{key}", f"shape {(*tensor.shape,)}", f"{(*shape,)}", ValueError)
                moments.setdefault(int(number), {})[moment] = tensor
            target.load_state_dict(target.state_dict() | {"state": moments})
        else:
            target.load_state_dict(state)
    for name in tensors:
        recursive_getattr(model, name).data = _tensor(arrays[f"tensors/{name}"])


def _tensor(array: Any) -> torch.Tensor:  # noqa: ANN401 - an array
    return torch.from_numpy(np.array(array))


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
