"""Do exported policies act as the originals, step after step?"""

import itertools
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exported import in_c, in_numpy, in_onnx
from tasks import CARRIAGE_FORCE

from agents import export as command
from agents.controllers.feedback import Feedback
from agents.controllers.residual import Residual
from agents.evaluation.episodes import evaluate
from agents.exports.c_source import c_source, constants
from agents.exports.linear_base import linear_base
from agents.policies import Policy, PolicyError, load_policy
from agents.training.config import TrainSettings
from agents.training.parts import base_controller
from agents.training.runs import Run


def policy_of(sizes, activation, r=0, m=0, seed=0):
    rng = np.random.default_rng(seed)
    n, *_, k = sizes
    widths = [n + m + r, *sizes[1:]]

    def drawn(*shape):
        return rng.normal(0.0, 1.0 / np.sqrt(shape[-1]), shape).astype(np.float32)

    optional = {"direct": drawn(k, n + m + r)} if r or m else {}
    if r:
        columns = [np.linspace(0.0, 0.97, r), np.full(r, 1e-3), rng.normal(size=r), np.ones(r)]
        units = np.stack(columns, axis=1).astype(np.float32)
        optional |= {"pairs": drawn(r, 2, n + m), "units": units}
    if m:
        optional |= {"keep": 0.5 * drawn(m, m), "enter": drawn(m, n)}
    return Policy(
        weights=tuple(drawn(after, before) for before, after in itertools.pairwise(widths)),
        biases=tuple(drawn(after) for after in widths[1:]),
        activation=activation,
        low=np.full(k, -1.0, np.float32),
        high=np.ones(k, np.float32),
        **optional,
    )


POLICIES = {
    "evolved": policy_of([18, 8, 2], "rational", r=3),
    "evolved with a linear memory": policy_of([15, 8, 1], "rational", r=2, m=4),
    "linear memory alone": policy_of([6, 4, 2], "rational", m=3),
    "deep": policy_of([12, 64, 64, 1], "tanh"),
    "relu": policy_of([5, 32, 2], "relu"),
    "linear": policy_of([4, 1], "tanh"),
    "squashed": replace(policy_of([5, 16, 2], "relu"), squashed=True),
}


def drawn(seed, *shapes):
    rng = np.random.default_rng(seed)
    return [rng.normal(0.0, 0.4, shape).astype(np.float32) for shape in shapes]


def recurrent(seed, observed, units, actions):
    after = policy_of([units, 16, actions], "tanh")
    cell = drawn(seed, (4 * units, observed), (4 * units, units), (4 * units,))
    return replace(after, cell=tuple(cell))


POLICIES["recurrent"] = recurrent(1, 5, 8, 2)
POLICIES["residual"] = replace(
    policy_of([7, 16, 2], "rational", r=3), base=drawn(2, (2, 6))[0], authority=0.5
)
POLICIES["residual recurrent"] = replace(
    recurrent(3, 7, 8, 2), base=drawn(4, (2, 6))[0], authority=0.25
)


def episodes_for(policy):
    """10,000 observations: 100 episodes of 100 steps."""
    shape = 100, 100, policy.sizes[0]
    return np.random.default_rng(1).standard_normal(shape).astype(np.float32)


@pytest.mark.parametrize("name", POLICIES)
def test_file_acts_as_the_policy(name, tmp_path):
    POLICIES[name].save(tmp_path / "policy.npz")
    loaded, episodes = load_policy(tmp_path / "policy.npz"), episodes_for(POLICIES[name])
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
    assert export(monkeypatch, run.folder, "--out", tmp_path / "whole.npz") is None
    whole = load_policy(tmp_path / "whole.npz")
    assert whole.sizes == [4, 8, 1]
    scene = CARRIAGE_FORCE
    asked = []

    class Asked(Residual):
        def act(self, observation, info):
            action = super().act(observation, info)
            asked.append((observation.copy(), action))
            return action

    evaluate(scene, Asked(base_controller(scene, base), policy, 0.25), episodes=100)
    for observation, action in asked[::10]:
        # The law's gains are rounded to single precision, as what a residual agent observes is.
        np.testing.assert_allclose(whole.act(observation), action, rtol=0.0, atol=1e-6)


class Law:
    """A law in need of `action`."""

    name = "own"

    def begin(self, lanes):
        self.last = np.zeros((lanes, 1))


class Shifted(Law):
    def action(self, state, _):
        return 0.25 + state[:, 2:3]


class Switching(Law):
    def action(self, state, _):
        return 0.5 * np.sign(state[:, 2:3])


class Remembering(Law):
    def action(self, state, _):
        before, self.last = self.last, state[:, 2:3]
        return before + self.last


@pytest.mark.parametrize("law", [Switching(), Remembering()])
def test_law_that_switches_or_remembers_is_not_taken_for_a_linear_one(law):
    assert linear_base(Feedback(CARRIAGE_FORCE, law), CARRIAGE_FORCE) is None


def test_law_that_is_linear_but_for_a_constant_is_found():
    gains = linear_base(Feedback(CARRIAGE_FORCE, Shifted()), CARRIAGE_FORCE)
    assert gains[0, -1] == 0.25


def test_agent_around_another_law_says_what_is_missing(tmp_path, monkeypatch, capsys):
    run = begun(tmp_path, base="lqr", authority=0.25, changes={"sensors.delay": 2})
    policy_of([5, 8, 1], "tanh").save(run.policy)
    assert export(monkeypatch, run.folder, "--out", tmp_path / "p.c") is None
    said = (
        "Its last 1 inputs are the action of the law lqr, which is not in it; "
        "apply clip(law + 0.25 * action, -1, 1)."
    )
    assert said in capsys.readouterr().out
    assert said in (tmp_path / "p.c").read_text()


def test_own_code_of_a_run_is_not_run_without_trust(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text("raise SystemExit('it was run')")
    run = begun(tmp_path, base="own.py:Law")
    policy_of([5, 8, 1], "tanh").save(run.policy)
    assert "--trust allows it" in export(monkeypatch, run.folder)


def test_command_writes_the_source_and_says_what_it_costs(tmp_path, monkeypatch, capsys):
    policy = POLICIES["evolved"]
    policy.save(tmp_path / "policy.npz")
    assert export(monkeypatch, tmp_path / "policy.npz", "--out", tmp_path / "p.c") is None
    assert (tmp_path / "p.c").read_text() == c_source(policy)
    printed = capsys.readouterr().out
    # Pairs 3 x 2 x 18, units 3 x 4, direct 2 x 21, layers 8 x 21 + 8 and 2 x 8 + 2, bounds 4.
    assert constants(policy) == 108 + 12 + 42 + 176 + 18 + 4
    # Inputs 18 + 3, next 8, value 8.
    assert "constants 1440 bytes, state 24 bytes, arrays on the stack 148 bytes" in printed
    assert "ns on this machine" in printed


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["absent"], "absent: no such file"),
        (["runs"], "runs/policy.npz: no such file"),
        (["p.zip"], "p.zip: an archive of Stable-Baselines3: opening it can run code"),
        (["p.npz", "--out", "p.txt"], "--out: got 'p.txt'; allowed: a name that ends in .c, .onnx"),
        (["p.npz", "--out", "p.npz"], "p.npz: cannot be written: it is an input of this command"),
        (["p.npz", "--out", "p.npz/p.c"], "p.npz/p.c: cannot be written"),
        (["p.npz", "--out", "p.onnx"], 'needs onnx, run `pip install "mm-gym[onnx]"`'),
    ],
)
def test_bad_input_is_named_and_writes_nothing(tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "onnx", None)
    Path("runs").mkdir()
    POLICIES["linear"].save("p.npz")
    content = Path("p.npz").read_bytes()
    assert message in export(monkeypatch, *words)
    assert sorted(path.name for path in Path().rglob("*")) == ["p.npz", "runs"]
    assert Path("p.npz").read_bytes() == content


def test_base_of_another_shape_is_refused(tmp_path):
    file = tmp_path / "policy.npz"
    file.write_bytes(replace(POLICIES["residual"], base=np.zeros((2, 9), np.float32)).to_bytes())
    with pytest.raises(PolicyError, match=r"base: got shape \(2, 9\)"):
        load_policy(file)


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
    policy.save("policy.npz")
    act, rng = lines_of_the_page("def act(y, sums)"), np.random.default_rng(2)
    sums, own = np.zeros((3, 2)), policy.begin(1)
    for _ in range(100):
        observation = rng.standard_normal(18).astype(np.float32)
        want = policy.act(observation[None], own)[0]
        np.testing.assert_allclose(act(observation, sums), want, atol=1e-6)


def test_lines_of_the_page_act_as_the_policy_of_ppo(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    POLICIES["deep"].save("policy.npz")
    act = lines_of_the_page("def act(y)")
    observations = np.random.default_rng(2).standard_normal((100, 12))
    for observation, want in zip(observations, POLICIES["deep"].act(observations), strict=True):
        np.testing.assert_allclose(act(observation), want, atol=1e-12)
