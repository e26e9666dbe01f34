"""Do exported policies act as the originals, step after step?"""

import ctypes
import itertools
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from agents import export as command
from agents.exports.c_source import c_source, constants
from agents.policies import Policy, PolicyError, load_policy


def policy_of(sizes, activation, r=0, seed=0):
    rng = np.random.default_rng(seed)
    n, *_, k = sizes
    widths = [n + r, *sizes[1:]]

    def drawn(*shape):
        return rng.normal(0.0, 1.0 / np.sqrt(shape[-1]), shape).astype(np.float32)

    optional = {}
    if r:
        columns = [np.linspace(0.0, 0.97, r), np.full(r, 1e-3), rng.normal(size=r), np.ones(r)]
        units = np.stack(columns, axis=1).astype(np.float32)
        optional = {"direct": drawn(k, n + r), "pairs": drawn(r, 2, n), "units": units}
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
    "deep": policy_of([12, 64, 64, 1], "tanh"),
    "relu": policy_of([5, 32, 2], "relu"),
    "linear": policy_of([4, 1], "tanh"),
    "squashed": replace(policy_of([5, 16, 2], "relu"), squashed=True),
}


def test_recurrent_policy_is_refused():
    recurrent = replace(POLICIES["linear"], cell=(np.zeros((4, 4)), np.zeros((4, 1)), np.zeros(4)))
    with pytest.raises(PolicyError, match="policy: a recurrent one; allowed: dense layers"):
        c_source(recurrent)


def compiled(policy, folder, real):
    source, library = folder / "policy.c", folder / f"{real}.so"
    source.write_text(c_source(policy))
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2", "-shared", "-fPIC"]
    subprocess.run(
        [shutil.which("cc"), *flags, f"-DREAL={real}", source, "-o", library, "-lm"], check=True
    )
    return ctypes.CDLL(str(library))


# In single precision, sums of up to 70 products of order one round by some 1e-6.
@pytest.mark.parametrize(
    ("real", "dtype", "atol"), [("double", "f8", 1e-12), ("float", "f4", 1e-5)]
)
@pytest.mark.parametrize("name", POLICIES)
def test_c_source_acts_as_the_policy(name, real, dtype, atol, tmp_path):
    policy = POLICIES[name]
    policy.save(tmp_path / "policy.npz")
    policy = load_policy(tmp_path / "policy.npz")
    library = compiled(policy, tmp_path, real)
    observed, *_, k = policy.sizes
    rng = np.random.default_rng(1)
    episodes = rng.standard_normal((100, 100, observed)).astype(np.float32)  # episodes, steps
    actions = np.empty((100, 100, k), dtype)
    state = (ctypes.c_double * 100)()
    for seen, acted in zip(episodes.astype(dtype), actions, strict=True):
        library.policy_begin(state)
        for y, a in zip(seen, acted, strict=True):
            library.policy_act(state, *(ctypes.c_void_p(v.ctypes.data) for v in (y, a)))
    sums = policy.begin(100)
    for step in range(100):
        want = policy.act(episodes[:, step], sums)
        np.testing.assert_allclose(actions[:, step], want, rtol=0.0, atol=atol)
    assert (np.abs(actions) < 1.0).any()


def test_command_writes_the_source_and_says_what_it_costs(tmp_path, monkeypatch, capsys):
    policy = POLICIES["evolved"]
    policy.save(tmp_path / "policy.npz")
    monkeypatch.setattr("sys.argv", ["export", str(tmp_path), "--out", str(tmp_path / "p.c")])
    assert command.main() is None
    assert (tmp_path / "p.c").read_text() == c_source(policy)
    printed = capsys.readouterr().out
    # Pairs 3 x 2 x 18, units 3 x 4, direct 2 x 21, layers 8 x 21 + 8 and 2 x 8 + 2, bounds 4.
    assert constants(policy) == 108 + 12 + 42 + 176 + 18 + 4
    assert "constants 1440 bytes, state 24 bytes" in printed
    assert "ns on this machine" in printed


def test_missing_policy_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["export", str(tmp_path), "--out", str(tmp_path / "p.c")])
    assert f"{tmp_path}/policy.npz: no such file" in command.main()
    assert not list(tmp_path.iterdir())


def test_ten_lines_of_the_page_act_as_the_policy(tmp_path, monkeypatch):
    policy = POLICIES["evolved"]
    policy.save(tmp_path / "policy.npz")
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).parents[2] / "docs" / "training.md").read_text()
    names = {}
    exec(page.split("```python\n")[1].split("```")[0], names)  # noqa: S102 - our own page
    rng = np.random.default_rng(2)
    sums, own = np.zeros((3, 2)), policy.begin(1)
    for _ in range(100):
        observation = rng.standard_normal(18).astype(np.float32)
        want = policy.act(observation[None], own)[0]
        np.testing.assert_allclose(names["act"](observation, sums), want, atol=1e-6)
