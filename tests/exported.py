"""Policies of every kind, as other programs run them: compiled C, an ONNX runtime."""

import ctypes
import itertools
import shutil
import subprocess

import numpy as np

from agents.network.c_source import c_source
from agents.network.layers import GRU, Append, Clip, Dense, Residual
from agents.network.onnx import onnx_bytes
from agents.policies import Policy, network


def policy_of(sizes, activation, r=0, m=0, seed=0, *, back=False, fade=None, **more):
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
    if back:
        optional["back"] = drawn(m, k)
    if fade is not None:
        optional |= {"early": 0.5 * drawn(m, m + n + k), "fade": [fade]}
    return network(
        weights=tuple(drawn(after, before) for before, after in itertools.pairwise(widths)),
        biases=tuple(drawn(after) for after in widths[1:]),
        activation=activation,
        low=np.full(k, -1.0, np.float32),
        high=np.ones(k, np.float32),
        **optional,
        **more,
    )


POLICIES = {
    "evolved": policy_of([18, 8, 2], "rational", r=3),
    "evolved with a linear memory": policy_of([15, 8, 1], "rational", r=2, m=4),
    "linear memory alone": policy_of([6, 4, 2], "rational", m=3),
    "observer": policy_of([15, 8, 1], "rational", r=2, m=4, back=True),
    "observer of two actions": policy_of([6, 4, 2], "rational", m=3, back=True),
    "observer that settles": policy_of([6, 4, 2], "rational", r=1, m=3, back=True, fade=0.9),
    "deep": policy_of([12, 64, 64, 1], "tanh"),
    "relu": policy_of([5, 32, 2], "relu"),
    "linear": policy_of([4, 1], "tanh"),
    "squashed": policy_of([5, 16, 2], "relu", squashed=True),
}


def drawn(seed, *shapes):
    rng = np.random.default_rng(seed)
    return [rng.normal(0.0, 0.4, shape).astype(np.float32) for shape in shapes]


def recurrent(seed, observed, units, actions):
    cell = drawn(seed, (4 * units, observed), (4 * units, units), (4 * units,))
    return policy_of([units, 16, actions], "tanh", cell=cell)


def residual(policy, base, authority):
    return Policy((Residual(policy.layers, base, authority),), policy.observed - len(base))


POLICIES["recurrent"] = recurrent(1, 5, 8, 2)
POLICIES["residual"] = residual(policy_of([7, 16, 2], "rational", r=3), drawn(2, (2, 6))[0], 0.5)
POLICIES["residual recurrent"] = residual(recurrent(3, 7, 8, 2), drawn(4, (2, 6))[0], 0.25)


def gated(seed, observed, units, actions):
    arrays = drawn(seed, (3 * units, observed), (3 * units, units), (4 * units,))
    dense, ends = drawn(seed, (actions, observed + units), (actions,)), np.ones(actions, np.float32)
    return Policy((Append((GRU(*arrays),)), Dense(*dense), Clip(-ends, ends)), observed)


POLICIES["gated"] = gated(5, 6, 8, 2)


def episodes_for(policy):
    """10,000 observations: 100 episodes of 100 steps."""
    shape = 100, 100, policy.sizes[0]
    return np.random.default_rng(1).standard_normal(shape).astype(np.float32)


FLAGS = [
    "-std=c99",
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Werror",
    "-pedantic",
    "-O2",
    "-shared",
    "-fPIC",
]


def in_c(policy, episodes, folder, real="double"):
    """Return the actions (episodes, steps, k) of the compiled source for observations."""
    source, library = folder / "policy.c", folder / f"{real}.so"
    source.write_text(c_source(policy.graph()).text)
    command = [shutil.which("cc"), *FLAGS, f"-DREAL={real}", source, "-o", library, "-lm"]
    subprocess.run(command, check=True)
    code, dtype = ctypes.CDLL(str(library)), {"double": "f8", "float": "f4"}[real]
    actions = np.empty((*episodes.shape[:2], policy.actions), dtype)
    state = (ctypes.c_double * 1000)()
    for seen, acted in zip(episodes.astype(dtype), actions, strict=True):
        code.policy_begin(state)
        for y, a in zip(seen, acted, strict=True):
            code.policy_act(state, *(ctypes.c_void_p(v.ctypes.data) for v in (y, a)))
    return actions


def in_onnx(policy, episodes):
    """Return the same of ONNX Runtime, with the episodes as lanes."""
    import onnx  # noqa: PLC0415 - extras
    import onnxruntime  # noqa: PLC0415

    content = onnx_bytes(policy.graph())
    onnx.checker.check_model(onnx.load_from_string(content), full_check=True)
    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    state, actions = policy.begin(len(episodes)), []
    for step in range(episodes.shape[1]):
        given = {"observation": episodes[:, step]}
        if len(session.get_inputs()) == 1:
            (action,) = session.run(None, given)
        else:
            action, state = session.run(["action", "next_memory"], given | {"memory": state})
        actions.append(action)
    return np.stack(actions, axis=1)


def in_numpy(policy, episodes):
    """Return the same of the policy itself."""
    state = policy.begin(len(episodes))
    steps = range(episodes.shape[1])
    return np.stack([policy.act(episodes[:, step], state) for step in steps], axis=1)
