"""Policies as other programs run them: compiled C, an ONNX runtime."""

import ctypes
import shutil
import subprocess

import numpy as np

from agents.exports.c_source import c_source
from agents.exports.onnx_graph import onnx_bytes

FLAGS = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2", "-shared", "-fPIC"]


def in_c(policy, episodes, folder, real="double"):
    """Return the actions (episodes, steps, k) of the compiled source for observations."""
    source, library = folder / "policy.c", folder / f"{real}.so"
    source.write_text(c_source(policy))
    command = [shutil.which("cc"), *FLAGS, f"-DREAL={real}", source, "-o", library, "-lm"]
    subprocess.run(command, check=True)
    code, dtype = ctypes.CDLL(str(library)), {"double": "f8", "float": "f4"}[real]
    actions = np.empty((*episodes.shape[:2], policy.sizes[-1]), dtype)
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

    content = onnx_bytes(policy)
    onnx.checker.check_model(onnx.load_from_string(content), full_check=True)
    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    state, actions = policy.begin(len(episodes)), []
    for step in range(episodes.shape[1]):
        given = {"observation": episodes[:, step]}
        if len(session.get_inputs()) == 1:
            (action,) = session.run(None, given)
        else:
            action, state = session.run(["action", "next_state"], given | {"state": state})
        actions.append(action)
    return np.stack(actions, axis=1)


def in_numpy(policy, episodes):
    """Return the same of the policy itself."""
    state = policy.begin(len(episodes))
    steps = range(episodes.shape[1])
    return np.stack([policy.act(episodes[:, step], state) for step in steps], axis=1)
