"""Do exported policies act as the originals, step after step?"""

import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exported import POLICIES, episodes_for, in_c, in_numpy, in_onnx, policy_of
from tasks import CARRIAGE_FORCE, HYBRID, PRE_STRETCH

from agents.commands import export as command
from agents.control.controller import Law
from agents.control.feedback import Feedback
from agents.controllers.learned import Learned, Residual
from agents.exports.controllers import controller_policy, linear_base, residual
from agents.network.c_source import c_source
from agents.network.files import content_of, read_content
from agents.network.interface import Interface
from agents.policies import PolicyError, load_deployed, load_policy
from agents.scoring import evaluate, validation_cost
from agents.training.config import TrainSettings
from agents.training.parts import base_controller
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
    run.open(TrainSettings(task="mm_gym/CarriageForce-v0", name="given", **fields))
    return run


@pytest.mark.parametrize("base", ["lqr", "velocity-feedback", "no-control"])
def test_agent_around_a_linear_law_is_exported_with_the_law(base, tmp_path, monkeypatch):
    run = begun(tmp_path, base=base, authority=0.25)
    policy = policy_of([5, 8, 1], "tanh")
    policy.save(run.policy)
    assert export(monkeypatch, run.folder, "--out", tmp_path / "whole.safetensors") is None
    whole = load_policy(tmp_path / "whole.safetensors")
    assert whole.sizes == [4, 8, 1]
    scene = CARRIAGE_FORCE
    asked = []

    class Asked(Residual):
        def propose(self, memory, observation, info):
            action, memory = super().propose(memory, observation, info)
            asked.append((observation.copy(), action))
            return action, memory

    evaluate(scene, Asked(base_controller(scene, base), policy, 0.25), episodes=100)
    for observation, action in asked[::10]:
        # The law's gains are rounded to single precision, as what a residual agent observes is.
        np.testing.assert_allclose(whole.act(observation), action, rtol=0.0, atol=1e-6)


def test_lqg_is_exported_with_the_first_and_the_stationary_gain(tmp_path):
    scene = CARRIAGE_FORCE.replace(**{"sensors.noise": {"carriage_displacement": 1e-5}})
    (policy, _), law = controller_policy("lqg", scene), base_controller(scene, "lqg")
    filters = law.design.filters[[0, -1]]
    assert np.abs(filters[0] - filters[1]).max() > 0.1 * np.abs(filters[1]).max()
    law.design = replace(law.design, filters=filters)
    env = MovingMassVectorEnv(scene, 4)
    observation, _ = env.reset(seed=0)
    memory, known, seen = policy.begin(4), law.begin(env), []
    for _ in range(50):
        seen.append(observation)
        wanted, known = law.act(known, observation, {})
        # The numbers of the policy are of single precision, and the filter forgets within steps.
        np.testing.assert_allclose(policy.act(observation, memory), wanted, rtol=0.0, atol=1e-5)
        observation, *_ = env.step(wanted)
    episodes = np.stack(seen, axis=1)
    np.testing.assert_allclose(
        in_c(policy, episodes, tmp_path), in_numpy(policy, episodes), rtol=0.0, atol=1e-12
    )


def test_export_of_an_lqg_tells_what_the_gains_of_its_start_are_worth():
    noise = {"carriage_displacement": 1e-3}
    channels = {"sensors.channels": ["carriage_displacement", "sphere_offset"]}
    scene = CARRIAGE_FORCE.replace(**channels, **{"sensors.noise": noise, "control.steps": 60})
    (policy, told), law = controller_policy("lqg", scene), base_controller(scene, "lqg")
    exported, own = (validation_cost(scene, one) for one in (Learned(policy), law))
    assert f"it costs {exported:.4g}, and lqg, whose gains settle" in told
    assert f"frames, {own:.4g}." in told
    assert exported < 1.05 * own
    law.design = replace(law.design, filters=law.design.filters[-1:])
    assert validation_cost(scene, law) > 1.5 * own  # the stationary gain alone is slow at first


def test_lqg_whose_estimate_begins_elsewhere_is_refused():
    scene = CARRIAGE_FORCE.replace(initial={"carriage_displacement": 0.01})
    with pytest.raises(SceneError, match=r"initial: got motions whose mean is not 0; allowed"):
        controller_policy("lqg", scene)


@pytest.mark.parametrize(
    ("task", "name"), [("PreStretchShock", "clipped-lqr"), ("ActiveMassDamper", "weighted-lqg")]
)
def test_controller_that_is_not_linear_is_refused(task, name):
    scene = load_scene(f"mm_gym/{task}-v0").replace(**{"control.steps": 10})
    with pytest.raises(SceneError, match="allowed for an export: the LQG, and controllers that"):
        controller_policy(name, scene)


class Shifted(Law):
    def action(self, memory, state, _):
        return 0.25 + state[:, 2:3], memory


class Switching(Law):
    def action(self, memory, state, _):
        return 0.5 * np.sign(state[:, 2:3]), memory


class Remembering(Law):
    def begin(self, lanes):
        return {"last": np.zeros((lanes, 1))}

    def action(self, memory, state, _):
        return memory["last"] + state[:, 2:3], {"last": state[:, 2:3]}


class Counting(Law):
    def begin(self, lanes):
        return {"step": np.zeros(lanes)}

    def action(self, memory, state, _):
        fades = 1.0 - (memory["step"] > 100)
        return fades[:, None] * state[:, 2:3], {"step": memory["step"] + 1}


@pytest.mark.parametrize("law", [Switching(), Remembering(), Counting()])
def test_law_that_switches_or_remembers_is_not_taken_for_a_linear_one(law):
    assert linear_base(Feedback(CARRIAGE_FORCE, law), CARRIAGE_FORCE) is None


@pytest.mark.parametrize("name", ["linear-prediction", "short-time-fourier"])
def test_law_that_waits_for_its_window_is_not_taken_for_a_constant(name):
    channels = ["carriage_displacement", "sphere_offset", "carriage_velocity", "slip_velocity"]
    with pytest.raises(SceneError, match="allowed for an export"):
        controller_policy(name, PRE_STRETCH.replace(**{"sensors.channels": channels}))


def test_actuator_that_is_held_from_the_first_step_on_is_a_constant():
    (force, stretch) = linear_base(base_controller(HYBRID, "no-control"), HYBRID)
    assert not force.any()
    assert not stretch[:-1].any()


def test_law_that_is_linear_but_for_a_constant_is_found():
    gains = linear_base(Feedback(CARRIAGE_FORCE, Shifted()), CARRIAGE_FORCE)
    assert gains[0, -1] == 0.25


def test_agent_around_another_law_says_what_is_missing(tmp_path, monkeypatch, capsys):
    run = begun(tmp_path, base="lqr", authority=0.25, changes={"sensors.delay": 2})
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
    if name == "lqg":
        assert "Its filter has the gain of an episode's first frame" in said
        return
    observation = np.random.default_rng(0).standard_normal((9, 4)).astype(np.float32)
    wanted = controller_policy(name, CARRIAGE_FORCE)[0].act(observation)
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
