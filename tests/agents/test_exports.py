"""Do exported policies act as the originals, step after step?"""

import json
import operator
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from exported import POLICIES, episodes_for, in_c, in_numpy, in_onnx, policy_of, residual
from tasks import CARRIAGE_FORCE

from agents.commands import export as command
from agents.control.controller import Law, looked_up
from agents.control.feedback import Feedback
from agents.control.scene import ENDLESS
from agents.controllers.adjustable import adjustable
from agents.controllers.learned import Residual
from agents.exports.controllers import controller_policy
from agents.network.c_source import c_source
from agents.network.files import content_of, read_content
from agents.network.interface import Interface
from agents.policies import PolicyError, load_deployed, load_policy
from agents.training.config import TrainSettings
from agents.training.parts import Parts, base_controller
from agents.training.progress import Ending
from agents.training.runs import Run
from mm_gym import MovingMassVectorEnv, SceneError, load_scene


@pytest.mark.parametrize("name", POLICIES)
def test_file_acts_as_the_policy(name, tmp_path):
    POLICIES[name].save(tmp_path / "policy.safetensors")
    loaded, episodes = load_policy(tmp_path / "policy.safetensors"), episodes_for(POLICIES[name])
    np.testing.assert_array_equal(in_numpy(loaded, episodes), in_numpy(POLICIES[name], episodes))


# In single precision, sums of up to 70 products of order one round by some 1e-6.
@pytest.mark.parametrize(("real", "atol"), [("double", 1e-12), ("float", 1e-5)])
@pytest.mark.parametrize("name", POLICIES)
def test_c_source_acts_as_the_policy(name, real, atol, tmp_path):
    policy = POLICIES[name]
    episodes = episodes_for(policy)
    actions = in_c(policy, episodes, tmp_path, real)
    np.testing.assert_allclose(actions, in_numpy(policy, episodes), rtol=0.0, atol=atol)
    assert (np.abs(actions) < 1.0).any()


@pytest.mark.parametrize("name", POLICIES)
def test_onnx_file_acts_as_the_policy(name):
    pytest.importorskip("onnxruntime")
    policy = POLICIES[name]
    episodes = episodes_for(policy)
    # Actions up to 1 in single precision round by 2**-25.
    np.testing.assert_allclose(
        in_onnx(policy, episodes), in_numpy(policy, episodes), rtol=0.0, atol=1e-7
    )


def export(monkeypatch, *words):
    monkeypatch.setattr("sys.argv", ["export", *map(str, words)])
    return command.main()


def begun(folder, **fields):
    """Return the folder of a run that has settings, and no policy yet."""
    run = Run("given", folder)
    run.open(TrainSettings(**{"task": "mm_gym/CarriageForce-v0", "name": "given", **fields}))
    return run


def scene_of(task, **changes):
    return load_scene(f"mm_gym/{task}-v0").replace(**changes)


def held_against_itself(controller, scene, folder, *, steps=100, atol=1e-7):
    """Return the policy of a controller, that acts as it does in Python, C and ONNX.

    Rows of a table that end alike in single precision are one.
    """
    policy = controller_policy(controller, scene, "it")
    policy.save(folder / "it.safetensors")
    env = MovingMassVectorEnv(scene.replace(**ENDLESS), 8)
    observation, _ = env.reset(seed=3)
    memory, known, seen, acted = controller.begin(env), policy.begin(8), [], []
    for _ in range(min(steps, scene.control.steps)):
        seen.append(observation)
        wanted, memory = controller.act(memory, observation, {})
        np.testing.assert_allclose(policy.act(observation, known), wanted, rtol=0.0, atol=atol)
        acted.append(wanted)
        observation, *_ = env.step(wanted)
    episodes, wanted = np.stack(seen, axis=1), np.stack(acted, axis=1)
    loaded = load_policy(folder / "it.safetensors")
    np.testing.assert_array_equal(in_numpy(loaded, episodes), in_numpy(policy, episodes))
    np.testing.assert_allclose(in_c(policy, episodes, folder), wanted, rtol=0.0, atol=atol)
    np.testing.assert_allclose(in_onnx(policy, episodes), wanted, rtol=0.0, atol=10.0 * atol)
    in_c(policy, episodes, folder, "float")  # compiles without a warning
    return policy


CONTROLLERS = [
    ("CarriageForce", "lqr"),
    ("CarriageForce", "velocity-feedback"),
    ("CarriageForce", "finite-horizon-lqr"),
    ("CarriageForceDuffing", "feedback-linearisation"),
    ("CarriageForceDuffing", "h-infinity"),
    ("CarriageForceFriction", "inertial-drive"),
    ("CarriageForceDuffing", "gain-scheduled-lqr"),
    ("PreStretch", "extremum-seeking"),
    ("PreStretch", "frequency-locked-loop"),
    ("PreStretch", "linear-prediction"),
    ("SemiActiveDamper", "skyhook-continuous"),
    ("SemiActiveDamper", "clipped-optimal-on-off"),
    ("PreStretchShock", "weighted-clipped-lqr"),
    ("PreStretchShock", "resetting-stiffness"),
    ("ActiveMassDamper", "weighted-lqg"),
    ("Hybrid", "no-control"),
]


@pytest.mark.parametrize(("task", "name"), CONTROLLERS)
def test_controller_acts_alike_wherever_it_is_exported_to(task, name, tmp_path):
    pytest.importorskip("onnxruntime")
    scene = scene_of(task)
    # ONNX runtimes have the inverse cosine in single precision alone.
    atol = 1e-6 if name == "linear-prediction" else 1e-7
    held_against_itself(base_controller(scene, name), scene, tmp_path, atol=atol)


def test_lqg_keeps_the_gains_of_the_start_and_begins_at_the_mean(tmp_path):
    pytest.importorskip("onnxruntime")
    scene = CARRIAGE_FORCE.replace(
        **{"sensors.noise": {"carriage_displacement": 1e-5}},
        initial={"carriage_displacement": (0.005, 0.015)},
    )
    law = base_controller(scene, "lqg")
    filters = law.design.filters
    assert np.abs(filters[1] - filters[-1]).max() > 0.05 * np.abs(filters[-1]).max()
    assert law.design.start.any()
    held_against_itself(law, scene, tmp_path)


def test_what_actions_do_not_depend_on_is_not_remembered():
    lqr, lqg = (base_controller(CARRIAGE_FORCE, name) for name in ("lqr", "lqg"))
    # The law counts steps and knows what the actuator has; the action needs neither.
    assert controller_policy(lqr, CARRIAGE_FORCE, "lqr").remembers == 0
    # Its states, and the step.
    states = len(lqg.design.start)
    assert controller_policy(lqg, CARRIAGE_FORCE, "lqg").remembers == states + 1


class Shifted(Law):
    def action(self, memory, state, _):
        return 0.25 + state[:, 2:3], memory


class Switching(Law):
    def action(self, memory, state, _):
        return 0.5 * np.sign(state[:, 2:3]), memory


class Remembering(Law):
    def begin(self, lanes):
        return {"last": np.full((lanes, 1), 0.5)}

    def action(self, memory, state, _):
        return memory["last"] + state[:, 2:3], {"last": state[:, 2:3]}


class Counting(Law):
    def begin(self, lanes):
        return {"step": np.zeros(lanes, np.int64)}

    def action(self, memory, state, _):
        fades = 1.0 - (memory["step"] > 50) * (memory["step"] % 2 == 0)
        return fades[:, None] * state[:, 2:3], {"step": memory["step"] + 1}


class Everything(Law):
    """All that is followed: a chapter of NumPy on what a law has in its hands."""

    table = np.linspace(-0.2, 0.2, 12).reshape(4, 3)

    def begin(self, lanes):
        return {"matrix": np.ones((lanes, 2, 2)), "is_first": np.ones(lanes, np.bool_)}

    @np.errstate(divide="ignore", invalid="ignore")
    def action(self, memory, state, applied):
        x1, x2, v1, v2 = state.T
        place = np.rint(np.clip(np.abs(v1) * 20.0, 0.0, 3.0)).astype(np.intp)
        row = looked_up(self.table[None], place)
        both = np.column_stack([x1 - x2, np.nan_to_num(v1 / (v2 - v2), nan=0.1)])
        turned = np.einsum("nij,nj->ni", memory["matrix"], np.clip(both, -1.0, 1.0))
        calm = (np.abs(v1) < 0.01) & ~memory["is_first"] | np.isnan(x1 / x1)
        found = np.where(calm, np.sign(x1) * np.sqrt(np.abs(x1)), np.cos(9.0 * v1) * np.exp(-v2))
        found = found + row[:, [2, 0]].T[0]
        kept = np.where(calm[:, None], 0.9 * turned, turned) + applied[:, :1]
        matrix = np.concatenate([turned[:, None], kept[:, None]], axis=1) * 0.5
        after = {"matrix": matrix, "is_first": np.zeros_like(memory["is_first"])}
        return np.tanh(found + kept[:, 1] ** 2 - np.log(1.0 + x2**4))[:, None], after


class Undefined(Law):
    """Where the motion begins, at rest, it divides by 0."""

    @np.errstate(divide="ignore", invalid="ignore")
    def action(self, memory, state, _):
        ratio = (state[:, :1] - state[:, :1]) / (state[:, :1] - state[:, :1])
        turned = np.nan_to_num(np.clip(ratio, -1.0, 1.0), nan=0.3)
        endless = 0.0 * np.nan_to_num(1.0 / np.abs(0.0 * state[:, :1]))
        return turned + endless + np.nan_to_num(np.sign(ratio), nan=0.2), memory


@pytest.mark.parametrize("law", [Shifted(), Switching(), Remembering(), Undefined(), Everything()])
def test_law_of_arithmetic_is_exported(law, tmp_path):
    pytest.importorskip("onnxruntime")
    held_against_itself(Feedback(CARRIAGE_FORCE, law), CARRIAGE_FORCE, tmp_path)


class Choosing(Law):
    def action(self, memory, state, _):
        return state[:, 2:3] if (state[:, 0] > 0.0).all() else state[:, 3:4], memory


class Hiding(Law):
    """Its memory is where nobody looks."""

    def __init__(self):
        self.gain = 0.0

    def action(self, memory, state, _):
        self.gain += 0.1
        return self.gain * state[:, 2:3], memory


class Stumbling(Law):
    """In one step of the whole episode it acts otherwise."""

    def __init__(self):
        self.step = 0

    def action(self, memory, state, _):
        self.step += 1
        return (0.3 if self.step == 90 else 0.1) * state[:, 2:3], memory


class Of(Law):
    """A law of one line of NumPy."""

    def __init__(self, line):
        self.line = line

    def action(self, memory, state, _):
        return self.line(state), memory


@pytest.mark.parametrize(
    ("law", "said"),
    [
        (Counting(), "'mine'; allowed for an export: one that makes its action of observations"),
        (Choosing(), "array.all: cannot be exported; allowed: operators that make new arrays, @"),
        (
            Stumbling(),
            "'mine', which acts otherwise than its arithmetic in 0.01 of steps, as random",
        ),
        (Of(lambda x: np.stack([x[:, 2]], axis=1)), "np.stack: cannot be exported; allowed: opera"),
        (Of(lambda x: np.hypot(x[:, :1], 1.0)), "np.hypot: cannot be exported; allowed: operators"),
        (Of(lambda x: operator.iadd(x[:, 2:3], 0.1)), "np.add in place: cannot be exported; allow"),
        (Of(lambda x: x[:, 2]), "actions: got shape ('lanes',); allowed: ('lanes', 1)"),
        (Of(lambda x: x @ np.ones((3, 1))), "@ of shapes ('lanes', 4) and (3, 1): cannot be expo"),
        (Hiding(), "'mine', which acts otherwise than its arithmetic in 0.9"),
    ],
)
def test_law_that_does_something_else_is_refused(law, said):
    with pytest.raises(SceneError, match=re.escape(said)):
        controller_policy(Feedback(CARRIAGE_FORCE, law), CARRIAGE_FORCE, "mine")


@pytest.mark.parametrize(
    ("task", "name", "said"),
    [
        ("PreStretch", "matching-stretch", "which reads the episode"),
        ("CarriageForce", "linear-mpc", "allowed for an export: one that makes its action of"),
    ],
)
def test_controller_that_does_more_than_arithmetic_is_refused(task, name, said):
    scene = scene_of(task, **{"control.steps": 10})
    with pytest.raises(SceneError, match=said):
        controller_policy(base_controller(scene, name), scene, name)


@pytest.mark.parametrize(
    ("task", "base"), [("CarriageForce", "lqr"), ("PreStretchShock", "weighted-clipped-lqr")]
)
def test_agent_around_a_controller_is_exported_with_it(task, base, tmp_path, monkeypatch):
    scene = scene_of(task)
    n, k = Interface.of_scene(scene).observed, len(scene.actuation.names)
    run = begun(tmp_path, task=f"mm_gym/{task}-v0", base=base, authority=0.25)
    policy = policy_of([n + k, 8, k], "tanh")
    policy.save(run.policy)
    assert export(monkeypatch, run.folder, "--out", tmp_path / "whole.safetensors") is None
    whole = load_policy(tmp_path / "whole.safetensors")
    agent, env = Residual(base_controller(scene, base), policy, 0.25), MovingMassVectorEnv(scene, 9)
    observation, _ = env.reset(seed=1)
    memory, known = agent.begin(env), whole.begin(9)
    for _ in range(100):
        wanted, memory = agent.act(memory, observation, {})
        # What the agent observes of the controller's action is rounded to single precision.
        np.testing.assert_allclose(whole.act(observation, known), wanted, rtol=0.0, atol=1e-6)
        observation, *_ = env.step(wanted)


def test_agent_that_sets_the_numbers_of_a_law_is_exported_with_it(tmp_path):
    pytest.importorskip("onnxruntime")
    scene = scene_of("CarriageForceFriction")
    controller = base_controller(scene, "inertial-drive")
    law = adjustable(controller)
    policy = policy_of([law.inputs, 4, len(law.free)], "rational")
    parts = Parts(scene, controller, 0.5, law)
    held_against_itself(parts.controller(policy), scene, tmp_path, atol=1e-6)


def test_agent_around_another_law_says_what_is_missing(tmp_path, monkeypatch, capsys):
    late = {"sensors.delay": 2}  # and the plant is not linear: the engine estimates its state
    task = "mm_gym/CarriageForceDuffing-v0"
    run = begun(tmp_path, task=task, base="lqr", authority=0.25, changes=late)
    policy_of([5, 8, 1], "tanh").save(run.policy)
    assert export(monkeypatch, run.folder, "--out", tmp_path / "p.c") is None
    said = (
        "Its last input is the action of the controller lqr, which is not in it; "
        "apply clip(controller + 0.25 * action, -1, 1)."
    )
    assert said in capsys.readouterr().out
    assert said in (tmp_path / "p.c").read_text()


@pytest.mark.parametrize("name", ["velocity-feedback", "lqg", "predictive-control"])
def test_run_that_stands_for_a_controller_is_exported_as_that(name, tmp_path, monkeypatch, capsys):
    run = begun(tmp_path)
    policy_of([4, 8, 1], "tanh").save(run.policy)
    costs = {"cost": 0.2, "began_with": 0.2, "no_control": 0.3, "controller_cost": 0.1}
    words = {"unit": "generation", "began_as": "no control", "controller": name}
    Ending(done=1, total=1, time_budget=None, **words, **costs).write(run)
    out = tmp_path / "p.safetensors"
    answer = export(monkeypatch, run.folder, "--out", out)
    if name == "predictive-control":
        assert f"The agent is in {run.policy}" in answer
        assert not out.exists()
        return
    assert answer is None
    said = capsys.readouterr().out
    assert f"It is the controller {name}" in said
    observation = np.random.default_rng(0).standard_normal((9, 4)).astype(np.float32)
    controller = base_controller(CARRIAGE_FORCE, name)
    wanted = controller_policy(controller, CARRIAGE_FORCE, name).act(observation)
    np.testing.assert_array_equal(load_policy(out).act(observation), wanted)


def test_own_code_of_a_run_is_not_run_without_trust(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text("raise SystemExit('it was run')")
    run = begun(tmp_path, base="own.py:Law")
    policy_of([5, 8, 1], "tanh").save(run.policy)
    assert "allow it with --trust" in export(monkeypatch, run.folder)


def test_command_writes_the_source_and_says_what_it_costs(tmp_path, monkeypatch, capsys):
    policy = POLICIES["evolved"]
    policy.save(tmp_path / "policy.safetensors")
    assert export(monkeypatch, tmp_path / "policy.safetensors", "--out", tmp_path / "p.c") is None
    source = c_source(policy.graph())
    assert (tmp_path / "p.c").read_text() == source.text
    printed = capsys.readouterr().out
    # Pairs 3 x 2 x 18, units 3 x 4, direct 2 x 21, layers 8 x 21 + 8 and 2 x 8 + 2; what is one
    # number for all, as the floor and the scale of the units, is written where it is used.
    assert source.constants == 108 + (12 - 6) + 42 + 176 + 18
    assert f"constants {4 * source.constants} bytes, state 24 bytes, arrays on the" in printed
    assert "ns on this machine" in printed


@pytest.mark.parametrize("ends", ["1", "0"])
def test_compiler_that_does_not_work_ends_no_export(ends, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    compiler = Path("bin/cc")
    compiler.parent.mkdir()
    compiler.write_text(f"#!/bin/sh\nexit {ends}\n")  # with 0 it makes no program
    compiler.chmod(0o755)
    monkeypatch.setenv("PATH", str(compiler.parent.resolve()), prepend=":")
    POLICIES["linear"].save("p.safetensors")
    assert export(monkeypatch, "p.safetensors", "--out", "p.c") is None
    assert "4 products a step\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["absent"], "absent: no such file; a controller needs --task"),
        (["runs"], "runs/policy.safetensors: no such file"),
        (["p.zip"], "p.zip: opening an archive of Stable-Baselines3 can execute code"),
        (
            ["p.safetensors", "--out", "p.txt"],
            "--out: got 'p.txt'; allowed: a name that ends in .c, .onnx",
        ),
        (
            ["p.safetensors", "--out", "p.safetensors"],
            "p.safetensors: cannot be written: it is an input of this command",
        ),
        (["p.safetensors", "--out", "p.safetensors/p.c"], "p.safetensors/p.c: cannot be written"),
        (["p.safetensors", "--out", "p.onnx"], "needs onnx: install the extra `onnx`"),
    ],
)
def test_bad_input_is_named_and_writes_nothing(tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "onnx", None)
    Path("runs").mkdir()
    POLICIES["linear"].save("p.safetensors")
    content = Path("p.safetensors").read_bytes()
    assert message in export(monkeypatch, *words)
    assert sorted(path.name for path in Path().rglob("*")) == ["p.safetensors", "runs"]
    assert Path("p.safetensors").read_bytes() == content


def test_controller_of_a_file_is_exported(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = [
        "from agents.control.controller import Law",
        "class Mine(Law):",
        "    def __init__(self, scene): pass",
        "    def action(self, memory, state, applied):",
        "        return -0.3 * state[:, 2:3], memory",
    ]
    Path("own.py").write_text("\n".join(lines))
    words = "own.py:Mine", "--task", "CarriageForce", "--out", "p.safetensors"
    assert export(monkeypatch, *words) is None
    # A velocity of 0.5 m/s, its scale, is observed as 1.
    np.testing.assert_allclose(load_policy("p.safetensors").act([[0, 0, 1, 0]]), -0.15, rtol=1e-6)


class TestFilesThatKnowTheirScene:
    @pytest.fixture(autouse=True)
    def exported(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        POLICIES["linear"].save("p.safetensors", Interface.of_scene(CARRIAGE_FORCE))

    def test_scene_is_kept(self, monkeypatch):
        assert export(monkeypatch, "p.safetensors", "--out", "p.c") is None
        assert "policy_act_si" in Path("p.c").read_text()
        words = "p.safetensors", "--task", "CarriageForce", "--out", "again.safetensors"
        assert export(monkeypatch, *words) is None
        assert Path("again.safetensors").read_bytes() == Path("p.safetensors").read_bytes()

    def test_other_scene_is_refused(self, monkeypatch):
        Path("other.toml").write_text("base = 'CarriageForce'\ncontrol.time_step = 0.02\n")
        said = export(monkeypatch, "p.safetensors", "--task", "other.toml", "--out", "p.c")
        assert (
            "--task: got 'other.toml', which differs in time_step from the scene of p.saf" in said
        )
        assert "allowed: none, or the scene that the file was exported for" in said
        assert not Path("p.c").exists()

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"interface": None}, "interface: got None; allowed: a table"),
            ({"interface": {"history": 1}}, "channels: missing; time_step: missing"),
            ({"history": 2}, "the interface in p.safetensors has 8 and 1"),
            ({"history": 0}, "history: got 0; allowed: greater than or equal to 1"),
            ({"time_step": -0.01}, "time_step: got -0.01; allowed: greater than 0"),
            ({"layers": [{"kind": [1]}]}, "0.kind: got {'kind': [1]}; allowed: linear_memory"),
        ],
    )
    def test_damaged_interface_is_refused(self, changes, message, monkeypatch):
        described, arrays = read_content(Path("p.safetensors").read_bytes())
        inner = described["interface"]
        for name, value in changes.items():
            (inner if name in inner else described)[name] = value
        Path("p.safetensors").write_bytes(content_of(described, arrays))
        with pytest.raises(PolicyError, match=re.escape(message)):
            load_deployed("p.safetensors")
        assert message in export(monkeypatch, "p.safetensors", "--out", "p.c")
        assert not Path("p.c").exists()

    def test_run_has_its_own_scene(self, tmp_path, monkeypatch):
        run = begun(tmp_path)
        POLICIES["linear"].save(run.policy)
        said = export(monkeypatch, run.folder, "--task", "CarriageForceDuffing", "--out", "p.c")
        assert "--task: got 'CarriageForceDuffing' with the run" in said
        assert not Path("p.c").exists()


def arithmetic(operations, *, remembered=0):
    told = {"kind": "arithmetic", "operations": operations, "remembered": remembered}
    described = {"format": 4, "observed": 3, "layers": [told]}
    return content_of(described, {"0.constants": np.arange(6.0)})


HUGE = 10**30
DAMAGED = [
    *(["add", 0, 0], [[]], [["system", 0]], [[["add"], 0, 0]], [{"add": 0}]),
    *([["add", 0, one]] for one in (-1, 9, 0.5, "x", None, HUGE, [0], [5, 1, 2], [0, HUGE, 1])),
    *([["add", 0]], [["where", 0]], [["add", [0, 1, 3], [0, 1, 3]]], [["add", 0, [0, 3, 1]]]),
    *([["product", 0, [0, 2, 2]]], [["product", 0, [0, 1, 3], [0, 1, 2]]], [["product", 0, 0]]),
    *([["product", 0, [0, HUGE, 0]]], [["concatenate", 0, [0, 1, 3]]], [["concatenate"]]),
    *([["slice", 0, 2, 2]], [["slice", 0, -1, 2]], [["slice", 0, 0, HUGE]], [["slice", 0, 0.0, 1]]),
    *([["take", 0, [0, 3, 2]]], [["turned", 0, 1]], [["slice", 0, 0, 2], ["turned", 0, 2]]),
    [
        ["concatenate", 0, 0],
        *([["concatenate", k, k] for k in range(2, 900)]),
        ["slice", 900, 0, 1],
    ],
]


@pytest.mark.parametrize("operations", DAMAGED, ids=lambda one: str(one)[:50])
def test_arithmetic_that_is_damaged_is_refused(operations, tmp_path):
    (tmp_path / "p.safetensors").write_bytes(arithmetic(operations))
    with pytest.raises(PolicyError, match=r"arithmetic, operations|of shape|0\.operations"):
        load_policy(tmp_path / "p.safetensors")


@pytest.mark.parametrize("remembered", [-1, 3, 10**12])
def test_arithmetic_that_remembers_more_than_it_makes_is_refused(remembered, tmp_path):
    (tmp_path / "p.safetensors").write_bytes(arithmetic([["sign", 0]], remembered=remembered))
    with pytest.raises(PolicyError, match=r"arithmetic, remembered: got .*; allowed: 0 to 2"):
        load_policy(tmp_path / "p.safetensors")


def test_row_of_a_table_is_one_of_its_rows_wherever_it_is_looked_for(tmp_path):
    pytest.importorskip("onnxruntime")
    operations = [["slice", 0, 0, 1], ["take", 2, [0, 3, 2]]]
    (tmp_path / "p.safetensors").write_bytes(arithmetic(operations))
    policy = load_policy(tmp_path / "p.safetensors")
    episodes = np.zeros((1, 6, 3), np.float32)
    episodes[0, :, 0] = -np.inf, -1.0, 1.5, 7.0, np.inf, np.nan
    wanted = np.arange(6.0).reshape(3, 2)[[0, 0, 1, 2, 2, 0]][None]
    np.testing.assert_array_equal(in_numpy(policy, episodes), wanted)
    np.testing.assert_array_equal(in_onnx(policy, episodes), wanted)


def test_base_of_another_shape_is_refused():
    with pytest.raises(ValueError, match=r"residual, base: got shape \(2, 9\)"):
        residual(policy_of([7, 16, 2], "rational"), np.zeros((2, 9)), 0.5)


@pytest.mark.parametrize("name", ["format_2", "format_3", "recurrent"])
def test_files_of_earlier_versions_act_as_they_did(name):
    folder = Path(__file__).parents[1] / "data" / "policies"
    told = json.loads((folder / "actions.json").read_text())[name]
    policy = load_policy(folder / f"{name}.npz")
    memory = policy.begin(2)
    for seen, acted in zip(told["observation"], told["action"], strict=True):
        both = np.stack([seen, np.negative(seen)]).astype(np.float32)
        np.testing.assert_allclose(policy.act(both, memory), acted, rtol=0.0, atol=1e-15)


def lines_of_the_page(signature):
    """Return the function of a signature that a Python block of the page defines."""
    page = (Path(__file__).parents[2] / "docs" / "training.md").read_text()
    blocks = [block.split("```")[0] for block in page.split("```python\n")[1:]]
    (found,) = [block for block in blocks if signature in block]
    names = {}
    exec(found, names)  # noqa: S102 - our own page
    return names["act"]


def test_ten_lines_of_the_page_act_as_the_evolved_policy(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    policy = POLICIES["evolved"]
    policy.save("policy.safetensors")
    act, rng = lines_of_the_page("def act(y, sums)"), np.random.default_rng(2)
    sums, own = np.zeros((3, 2)), policy.begin(1)
    for _ in range(100):
        observation = rng.standard_normal(18).astype(np.float32)
        want = policy.act(observation[None], own)[0]
        np.testing.assert_allclose(act(observation, sums), want, atol=1e-6)


def test_lines_of_the_page_act_as_the_policy_of_ppo(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    POLICIES["deep"].save("policy.safetensors")
    act = lines_of_the_page("def act(y)")
    observations = np.random.default_rng(2).standard_normal((100, 12))
    for observation, want in zip(observations, POLICIES["deep"].act(observations), strict=True):
        np.testing.assert_allclose(act(observation), want, atol=1e-12)
