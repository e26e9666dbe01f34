"""Do policies act as they were trained to, and can no file of a run execute code?"""

from __future__ import annotations

import base64
import io
import json
import pickle
import subprocess
import sys
import zipfile
from pathlib import Path

import cloudpickle
import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box
from stable_baselines3 import PPO
from torch import nn

from agents.commands import evaluate as command
from agents.policies import LARGEST, PolicyError, load_policy
from agents.training.algorithms import open_trusted, policy_of
from agents.training.arrays import load_checkpoint
from agents.training.config import TrainSettings
from agents.training.runs import Run, RunError

ROOT = Path(__file__).parents[2]


class Spaces(gymnasium.Env):
    """An environment that has nothing but spaces, and random observations."""

    observation_space = Box(-np.inf, np.inf, (12,))
    action_space = Box(-1.0, 1.0, (2,))

    def reset(self, *, seed=None, options=None):  # noqa: ARG002 - Gymnasium's signature
        super().reset(seed=seed)
        return self.np_random.standard_normal(12).astype(np.float32), {}

    def step(self, action):
        observation, _ = self.reset()
        return observation, -float(action @ action), bool(observation[0] > 0.5), False, {}


def model(**kwargs: object) -> PPO:
    return PPO(
        "MlpPolicy", Spaces(), n_steps=64, batch_size=64, seed=1, device="cpu", policy_kwargs=kwargs
    )


@pytest.fixture(scope="module")
def trained() -> PPO:
    return model(net_arch=[64, 64]).learn(256)


class Bomb:
    """Unpickled, it makes a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return Path.touch, (self.path,)


@pytest.mark.parametrize(
    "kwargs",
    [
        {"net_arch": [64, 64]},
        {"net_arch": [32], "activation_fn": nn.ReLU},
        {"net_arch": []},
    ],
)
def test_policy_acts_as_the_model_that_it_is_from(kwargs, tmp_path) -> None:
    source = model(**kwargs)
    rng = np.random.default_rng(0)
    with torch.no_grad():  # a fresh network hardly acts: larger weights reach the bounds
        for parameter in source.policy.action_net.parameters():
            parameter.copy_(torch.as_tensor(rng.normal(0.0, 0.3, parameter.shape)))
    policy_of(source).save(tmp_path / "policy.safetensors")
    observations = rng.standard_normal((10_000, 12)).astype(np.float32)
    want, _ = source.predict(observations, deterministic=True)
    action = load_policy(tmp_path / "policy.safetensors").act(observations)
    # The model computes in single precision: sums of 64 products of order 0.3 round by 1e-7.
    np.testing.assert_allclose(action, want, rtol=0.0, atol=1e-6)
    assert (np.abs(action) == 1.0).any()
    assert (np.abs(action) < 1.0).any()


def test_model_of_another_kind_is_refused() -> None:
    with pytest.raises(PolicyError, match="tanh or ReLU"):
        policy_of(model(activation_fn=nn.ELU))


def archive_with_bombs(source: PPO, path: Path, marker: Path) -> None:
    """Write an archive in whose pickled data and whose tensors there are bombs."""
    whole = io.BytesIO()
    source.save(whole)
    bomb = base64.b64encode(cloudpickle.dumps(Bomb(marker))).decode()
    with zipfile.ZipFile(whole) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "data":
                data = json.loads(content)
                data["ep_success_buffer"] = {":type:": "bomb", ":serialized:": bomb}
                content = json.dumps(data).encode()
            new.writestr(name, content)


def run_folder(root: Path) -> Run:
    run = Run("given", root)
    run.open(TrainSettings(task="mm_gym/CarriageForce-v0", name="given"))
    return run


def test_evaluation_of_a_folder_with_bombs_runs_nothing(
    trained: PPO, tmp_path: Path, monkeypatch
) -> None:
    run, marker = run_folder(tmp_path), tmp_path / "marker"
    for name in ("model.zip", "best.zip", "checkpoint.zip", "archive.zip"):
        archive_with_bombs(trained, run.folder / name, marker)
    objects = np.array([Bomb(marker)], dtype=object)
    contents = {
        "pickle": pickle.dumps(Bomb(marker)),
        "zip": (run.folder / "model.zip").read_bytes(),
    }
    for name, write in (("npy", np.save), ("npz", lambda f, a: np.savez(f, description=a))):
        write(stream := io.BytesIO(), objects)
        contents[name] = stream.getvalue()
    for content in contents.values():
        run.policy.write_bytes(content)
        monkeypatch.setattr("sys.argv", ["evaluate", str(run.folder)])
        assert "not a policy that `train` wrote" in (command.main() or "")
    arguments = ["evaluate", str(run.folder), "--policy", str(run.folder / "archive.zip")]
    monkeypatch.setattr("sys.argv", arguments)
    assert "can execute code in it; open it with --trust" in (command.main() or "")
    assert not marker.exists()
    # The bombs are real: who trusts the archive is hit.
    open_trusted(run.folder / "archive.zip")
    assert marker.exists()


def test_checkpoint_with_bombs_is_refused_and_runs_nothing(trained: PPO, tmp_path: Path) -> None:
    marker, path = tmp_path / "marker", tmp_path / "checkpoint.npz"
    objects = np.array([Bomb(marker)], dtype=object)
    contents = [pickle.dumps(Bomb(marker))]
    for write in (np.save, lambda f, a: np.savez(f, **{"model/steps": a})):
        write(stream := io.BytesIO(), objects)
        contents.append(stream.getvalue())
    trained.save(tmp_path / "archive.zip")
    np.savez(tmp_path / "other.npz", steps=np.ones(3))
    contents += [(tmp_path / name).read_bytes() for name in ("archive.zip", "other.npz")]
    for content in contents:
        path.write_bytes(content)
        with pytest.raises(RunError, match="not a checkpoint of a training"):
            load_checkpoint(path)
    assert not marker.exists()


def test_trusted_archive_is_scored(trained: PPO, tmp_path: Path) -> None:
    trained.save(tmp_path / "archive.zip")
    policy = command.read_policy(tmp_path / "archive.zip", trust=True)
    assert policy.sizes == [12, 64, 64, 2]


def test_huge_missing_and_cut_policies_are_refused(trained: PPO, tmp_path: Path) -> None:
    file = tmp_path / "policy.safetensors"
    with pytest.raises(PolicyError, match="no such file"):
        load_policy(file)
    policy_of(trained).save(file)
    content = file.read_bytes()
    for length in (0, 1, 100, len(content) // 2, len(content) - 1):
        file.write_bytes(content[:length])
        with pytest.raises(PolicyError, match="not a policy"):
            load_policy(file)
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("description.npy", bytes(LARGEST + 1))
    with pytest.raises(PolicyError, match="unpacks to"):
        load_policy(file)


def test_policy_for_another_scene_is_refused(trained: PPO, tmp_path: Path) -> None:
    run = run_folder(tmp_path)
    policy_of(trained).save(run.policy)
    with pytest.raises(PolicyError, match="got 12 observed numbers and 2 actions; the scene has"):
        command.report_run(run, episodes=3)


def test_evaluation_does_without_torch() -> None:
    code = "import sys, agents.evaluate; print('torch' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert done.stdout.strip() == "False"
