"""
LQR against PPO
===============

The optimal linear controller of python-control, and 100,000 steps of Stable-Baselines3, in the same
held-out episode. The plant is linear, so nothing beats the LQR while its force stays within the
limit. A network that learns from rewards alone comes near in seconds, and keeps a small error at rest.
"""

import control
import gymnasium
import matplotlib.pyplot as plt
import numpy as np
import torch
from mm_gym import compile_scene, load_scene
from mm_gym.sb3 import make_vec_env
from stable_baselines3 import PPO

torch.set_num_threads(1)  # the networks are small: more threads wait for each other
TASK = "mm_gym/CarriageForce-v0"

# %%
# The LQR, of the three states that the force can reach, with the weights of the task's own reward.
scene = load_scene(TASK)
objective, limit = scene.objective, scene.actuation.force.limit
states = [0, 2, 3]
a, b = compile_scene(scene).discrete()
weight = np.diag([objective.displacement_scale**-2, 0.0, 0.0])
weight[1, 1] = objective.velocity_weight / objective.velocity_scale**2
effort = [[objective.effort_weight / limit**2]]
gain = control.dlqr(a[np.ix_(states, states)], b[states], weight, effort)[0]

# %%
# PPO, for some seconds.
model = PPO(
    "MlpPolicy",
    make_vec_env(TASK, 32),
    n_steps=64,
    batch_size=512,
    gamma=0.97,
    learning_rate=1e-3,
    policy_kwargs={"log_std_init": -1.0},
    seed=1,
)
model = model.learn(100_000)

# %%
# One held-out episode of each.
laws = {
    "no control": lambda observation, state: np.zeros(1),
    "PPO, 100,000 steps": lambda observation, state: model.predict(
        observation, deterministic=True
    )[0],
    "LQR": lambda observation, state: -gain @ state[states] / limit,
}
figure, axes = plt.subplots(figsize=(7.0, 3.0), layout="constrained")
for (name, law), style in zip(laws.items(), (":", "--", "-"), strict=True):
    env = gymnasium.make(TASK)
    observation, info = env.reset(seed=1_000_003)
    motion, total, over = [info["state"][0]], 0.0, False
    while not over:
        action = np.clip(law(observation, info["state"]), -1.0, 1.0).astype(
            np.float32
        )
        observation, reward, terminated, truncated, info = env.step(action)
        motion.append(info["state"][0])
        total += reward
        over = terminated or truncated
    times = scene.control.time_step * np.arange(len(motion))
    label = f"{name}: return {total:.3f}"
    axes.plot(times, 1e3 * np.array(motion), style, label=label)
axes.set(xlabel="time [s]", ylabel="carriage x₁ [mm]", xlim=(0.0, 0.4))
axes.legend()
plt.show()
