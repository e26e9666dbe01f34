"""
Deploy in C
===========

A small network around a controller is evolved, written as C99, compiled, and run against the
simulated rig as a microcontroller would run it: numbers in, numbers out, no memory allocated.
"""

import ctypes
import subprocess
import sys
import tempfile
from pathlib import Path

import gymnasium
import matplotlib.pyplot as plt
import mm_gym  # noqa: F401 - registers the tasks
import numpy as np

TASK = "mm_gym/PreStretchShock-v0"
folder = Path(tempfile.mkdtemp())

# %%
# Evolve for a hundred generations, export, compile. The commands are those of a shell.
for command in (
    (
        sys.executable,
        "-m",
        "agents",
        "evolve",
        "PreStretchShock",
        "--generations",
        "100",
        "--name",
        "shock",
    ),
    (sys.executable, "-m", "agents", "export", "runs/shock", "--out", "policy.c"),
    (
        "cc",
        "-std=c99",
        "-O2",
        "-Wall",
        "-Wextra",
        "-shared",
        "-fPIC",
        "-o",
        "policy.so",
        "policy.c",
        "-lm",
    ),
):
    done = subprocess.run(
        command, cwd=folder, check=True, capture_output=True, text=True
    )
    print(done.stdout)

# %%
# The rig: each control step hands the observation to the C function, and takes the action from it.
policy = ctypes.CDLL(str(folder / "policy.so"))
memory = ctypes.create_string_buffer(256)
env = gymnasium.make(TASK)
step = env.unwrapped.scene.control.time_step


def episode(is_controlled: bool) -> np.ndarray:
    """Return the carriage's displacement [m] at each control step."""
    observation, info = env.reset(seed=1_000_002)
    action = np.zeros(1, np.float32)
    policy.policy_begin(memory)
    motion, over = [info["state"][0]], False
    while not over:
        if is_controlled:
            policy.policy_act(memory, observation.ctypes, action.ctypes)
        observation, _, terminated, truncated, info = env.step(action)
        motion.append(info["state"][0])
        over = terminated or truncated
    return np.array(motion)


figure, axes = plt.subplots(figsize=(7.0, 2.8), layout="constrained")
for name, is_controlled, look in (
    ("springs held", False, ":"),
    ("policy.c", True, "-"),
):
    motion = episode(is_controlled)
    rms = 1e3 * np.sqrt(np.mean(motion**2))
    axes.plot(
        step * np.arange(motion.size),
        1e3 * motion,
        look,
        label=f"{name}: {rms:.2f} mm rms",
    )
axes.set(xlabel="time [s]", ylabel="carriage x₁ [mm]")
axes.legend()
plt.show()
