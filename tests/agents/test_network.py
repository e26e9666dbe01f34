"""Do NumPy, torch, C and ONNX read the same layers, and a laboratory the same policy?"""

import ctypes
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import torch
from exported import FLAGS, POLICIES, episodes_for, in_c, in_numpy, in_onnx, policy_of
from torch.nn import GRUCell, LSTMCell

from agents.commands import export as command
from agents.network.c_source import c_source
from agents.network.graph import Graph
from agents.network.interface import Interface
from agents.network.layers import GRU, KINDS, LSTM, Append, Clip, Dense, Layer
from agents.network.module import Module
from agents.policies import Deployed, Policy, PolicyError, load_deployed, load_policy
from mm_gym import DesignError, MovingMassVectorEnv, load_scene

RIG = Path(__file__).parents[1] / "rig.c"


@pytest.mark.parametrize("name", POLICIES)
def test_torch_acts_as_the_policy_and_gives_it_back(name):
    policy, episodes = POLICIES[name], episodes_for(POLICIES[name])[:, :20]
    module = Module(policy).double()
    memory, found = module.begin(len(episodes)).double(), []
    for step in range(episodes.shape[1]):
        action, memory = module(torch.tensor(episodes[:, step]).double(), memory)
        found.append(action.detach().numpy())
    np.testing.assert_allclose(np.stack(found, 1), in_numpy(policy, episodes), atol=1e-13)
    for key, array in Module(policy).policy().arrays.items():
        np.testing.assert_array_equal(array, policy.arrays[key])


def test_cells_are_those_of_torch():
    rng, values = np.random.default_rng(0), torch.randn(7, 5, dtype=torch.float64)
    for kind, of_torch, gates, biases in ((GRU, GRUCell, 3, 4), (LSTM, LSTMCell, 4, 4)):
        cell = of_torch(5, 6, dtype=torch.float64)
        enter, recur = (one.detach().numpy() for one in (cell.weight_ih, cell.weight_hh))
        inner = rng.normal(size=6)
        with torch.no_grad():
            cell.bias_hh[:] = 0.0
            if kind is GRU:
                cell.bias_hh[12:] = torch.tensor(inner)
        bias = np.append(cell.bias_ih.detach(), inner)[: 6 * biases]
        layer = kind(enter, recur, bias)
        assert len(layer.recur) == 6 * gates
        memory, state = np.zeros((7, layer.remembers)), None
        for _ in range(3):
            made, memory = layer.forward(np, values.numpy(), memory)
            state = cell(values, state)
        want = state if kind is GRU else state[0]
        np.testing.assert_allclose(made, want.detach(), atol=1e-14)


def test_torch_trains_all_arrays_but_those_that_are_fixed():
    module = Module(POLICIES["residual"])
    trained = {name for name, _ in module.named_parameters()}
    fixed = {name for name, _ in module.named_buffers()}
    assert {name.rpartition("_")[2] for name in fixed} == {"units", "low", "high"}
    assert {name.rpartition("_")[2] for name in trained} == {
        *("pairs", "direct", "weight", "bias", "base"),
    }


@dataclass(frozen=True, eq=False)
class Leaky(Layer):
    """A layer of a user's own: the values, and how they were, forgotten by degrees."""

    part: np.ndarray

    @property
    def remembers(self):
        return len(self.part)

    def outputs(self, inputs):
        self.require(part=(inputs,))
        return inputs

    def forward(self, xp, values, memory):
        memory = memory + self.part * (xp.tanh(values) - memory)
        return values - memory, memory


def test_a_new_layer_is_written_once(tmp_path):
    assert KINDS["leaky"] is Leaky
    rng = np.random.default_rng(0)
    inner = Leaky(rng.uniform(0.1, 0.9, 3).astype(np.float32))
    dense = Dense(rng.normal(size=(2, 6)).astype(np.float32), np.zeros(2, np.float32))
    bounds = -np.ones(2, np.float32), np.ones(2, np.float32)
    policy = Policy((Append((inner,)), dense, Clip(*bounds)), 3)
    policy.save(tmp_path / "policy.safetensors")
    policy = load_policy(tmp_path / "policy.safetensors")
    episodes = episodes_for(policy)[:5, :30]
    want = in_numpy(policy, episodes)
    np.testing.assert_allclose(in_c(policy, episodes, tmp_path), want, atol=1e-13)
    np.testing.assert_allclose(in_onnx(policy, episodes), want, atol=1e-7)
    memory = Module(policy).begin(5)
    action, memory = Module(policy)(torch.tensor(episodes[:, 0]), memory)
    np.testing.assert_allclose(action.detach(), want[:, 0], atol=1e-5)
    action.sum().backward()


def test_what_cannot_be_exported_is_refused():
    signal = Graph().input("observation", 3)
    with pytest.raises(TypeError):
        np.sort(signal)
    with pytest.raises(TypeError, match="cannot be exported"):
        signal[0]


TASKS = {"mm_gym/Hybrid-v0": 2, "mm_gym/PreStretchNoise-v0": 1, "mm_gym/CarriageForce-v0": 1}


def episode(task, policy):
    """Return times, what was measured, and the commands by the actions that were applied."""
    scene = load_scene(task)
    env, interface = MovingMassVectorEnv(scene, 1), Interface.of_scene(scene)
    observation, _ = env.reset(seed=3)
    memory, told = policy.begin(1), []
    units = np.array([(c.zero, c.factor) for c in interface.channels])
    for step in range(50):
        measured = observation[0, -len(units) :] / units[:, 1] + units[:, 0]
        action = policy.act(observation, memory)
        told.append((step * interface.time_step, measured, interface.commanded(action[0])))
        observation, *_ = env.step(action)
    return interface, told


@pytest.mark.parametrize("task", TASKS)
def test_laboratory_has_the_commands_of_the_environment_in_si_units(task, tmp_path):
    interface = Interface.of_scene(load_scene(task))
    policy = policy_of([interface.observed, 8, TASKS[task]], "rational", r=2)
    interface, told = episode(task, policy)
    policy.save(tmp_path / "policy.safetensors", interface)
    deployed = load_deployed(tmp_path / "policy.safetensors")
    assert deployed.interface == interface
    low, high = np.array([one.limits for one in interface.commands]).T
    for _ in range(2):  # t = 0 begins again
        for t, measured, wanted in told:
            found = deployed.act_si(measured, t)
            # What is measured is an observation of single precision, divided by its scale.
            np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-6 * np.max(high - low))


def test_rate_that_is_drawn_is_commanded_as_its_middle():
    changes = {"randomization": {"actuation.stretch.rate_limit": [20.0, 60.0]}}
    (stretch,) = Interface.of_scene(
        load_scene("mm_gym/PreStretchNoise-v0").replace(
            **{"actuation.stretch.command": "rate"}, **changes
        )
    ).commands
    assert (stretch.low, stretch.high) == (-40.0, 40.0)


def test_rig_in_c_replays_an_episode(tmp_path):
    task = "mm_gym/Hybrid-v0"
    policy = policy_of([Interface.of_scene(load_scene(task)).observed, 8, 2], "tanh", r=3, m=2)
    interface, told = episode(task, policy)
    (tmp_path / "policy.c").write_text(c_source(policy.graph(), interface).text)
    sizes = f"-DCHANNELS={len(interface.channels)}", f"-DCOMMANDS={len(interface.commands)}"
    flags = [flag for flag in FLAGS if flag not in {"-shared", "-fPIC"}]
    names = ["-DREAL=double", '-DPOLICY="policy.c"', *sizes, f"-I{tmp_path}"]
    compiled = [shutil.which("cc"), *flags, *names, RIG, "-o", tmp_path / "rig", "-lm"]
    subprocess.run(compiled, check=True)
    lines = [" ".join(map(repr, map(float, (t, *measured)))) for t, measured, _ in told]
    done = subprocess.run(
        [tmp_path / "rig"], input="\n".join(lines), capture_output=True, text=True, check=True
    )
    found = np.array([line.split() for line in done.stdout.splitlines()], np.float64)
    deployed = Deployed(policy, interface)
    want = [deployed.act_si(measured, t) for t, measured, _ in told]
    np.testing.assert_allclose(found, want, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("real", ["double", "float"])
def test_what_is_not_finite_changes_nothing(real, tmp_path):
    interface = Interface.of_scene(load_scene("mm_gym/CarriageForce-v0"))
    policy, dtype = policy_of([4, 8, 1], "rational", m=2), {"double": "f8", "float": "f4"}[real]
    number = {"double": ctypes.c_double, "float": ctypes.c_float}[real]
    source, library = tmp_path / "policy.c", tmp_path / "policy.so"
    source.write_text(c_source(policy.graph(), interface).text)
    command = [shutil.which("cc"), *FLAGS, f"-DREAL={real}", source, "-o", library, "-lm"]
    subprocess.run(command, check=True)
    compiled, deployed = ctypes.CDLL(str(library)), Deployed(policy, interface)
    state, found = ctypes.create_string_buffer(1000), np.zeros(1, dtype)
    for t, bad in zip((0.0, 0.01, 0.02), (np.nan, np.inf, -np.inf), strict=True):
        good = np.array([0.001, 0.002, 0.1, -0.1], dtype)
        wrong = np.where([True, True, False, True], good, bad).astype(dtype)
        kept = bytes(state), found.copy()
        for measured, time in ((wrong, t), (good, bad)):
            given, made = (one.ctypes.data_as(ctypes.c_void_p) for one in (measured, found))
            assert compiled.policy_act_si(state, given, number(time), made) == 1
            assert (bytes(state), found) == kept
            with pytest.raises(DesignError, match="got NaN or infinity; allowed: finite numbers"):
                deployed.act_si(measured, time)
        given, made = (one.ctypes.data_as(ctypes.c_void_p) for one in (good, found))
        assert compiled.policy_act_si(state, given, number(t), made) == 0
        np.testing.assert_allclose(found, deployed.act_si(good, t), rtol=0.0, atol=1e-5)


def test_header_tells_channels_commands_and_sample_time(tmp_path, monkeypatch):
    words = ["lqr", "--task", "CarriageForce", "--out", str(tmp_path / "lqr.c")]
    monkeypatch.setattr("sys.argv", ["export", *words])
    assert command.main() is None
    text = (tmp_path / "lqr.c").read_text()
    interface = Interface.of_scene(load_scene("mm_gym/CarriageForce-v0"))
    for said in (*interface.told, "policy_act_si(&state, measured, t, command)"):
        assert said in text
    assert f"sample time {interface.time_step:g} s" in text
    assert "[m/s]" in text
    assert "[N]" in text
    assert "4 observed numbers to 1 action in" in text
    assert "an observation is 1 frame of:" in text
    assert "the oldest first" not in text


def test_laboratory_that_does_not_begin_at_zero_or_fits_no_scene_is_told(tmp_path):
    interface = Interface.of_scene(load_scene("mm_gym/CarriageForce-v0"))
    policy = policy_of([4, 1], "tanh")
    with pytest.raises(DesignError, match="t: got 1 in the first step; allowed: 0"):
        Deployed(policy, interface).act_si(np.zeros(4), 1.0)
    for wrong in (np.zeros(3), np.zeros(1), 0.0, np.zeros((1, 4))):
        with pytest.raises(DesignError, match="a number each of carriage_displacement, sphere_off"):
            Deployed(policy, interface).act_si(wrong, 0.0)
    with pytest.raises(PolicyError, match="got 5 observed numbers"):
        Deployed(policy_of([5, 1], "tanh"), interface)
    policy.save(tmp_path / "policy.safetensors")
    with pytest.raises(PolicyError, match="has no interface"):
        load_deployed(tmp_path / "policy.safetensors")
