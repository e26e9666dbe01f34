"""
Identify a rig
==============

Five parameters of a rig from one noisy measurement, by least squares over exact simulations. Every
simulation is right to round-off, so the fit sees the rig and not the integrator.
"""

import matplotlib.pyplot as plt
import numpy as np
from mm_gym import Scene, simulate
from scipy.optimize import least_squares

# %%
# What the laboratory does not know, and the measurement that it has: both displacements, with noise.
TRUE = {
    "carriage.mass": 0.103,
    "carriage.stiffness": 412.0,
    "carriage.damping": 0.83,
    "interface.damping": 0.058,
    "springs.stiffness": 31.0,
}
drawing = Scene(
    springs={"kind": "linear", "stiffness": 25.0},
    initial={"carriage_displacement": 0.015},
    control={"time_step": 0.005, "steps": 300},
)
rng = np.random.default_rng(7)
measured = simulate(drawing.replace(**TRUE)).state[:, :2] + rng.normal(
    scale=1e-4, size=(301, 2)
)

# %%
# Start from the drawing. Logarithms keep the parameters positive and alike in size.
start = np.array([0.1, 400.0, 1.0, 0.1, 25.0])


def difference(logarithms: np.ndarray) -> np.ndarray:
    """Simulated minus measured displacements [m]."""
    changes = dict(zip(TRUE, start * np.exp(logarithms), strict=True))
    return (simulate(drawing.replace(**changes)).state[:, :2] - measured).ravel()


fit = least_squares(difference, np.zeros(start.size), x_scale=0.1)
deviation = np.sqrt(
    np.diag(np.linalg.inv(fit.jac.T @ fit.jac)) * 2.0 * fit.cost / fit.fun.size
)
for name, value, error, true in zip(
    TRUE, start * np.exp(fit.x), deviation, TRUE.values(), strict=True
):
    print(f"{name:20s} {value:9.4g} ± {value * error:.1g}   (true: {true:g})")

# %%
identified = simulate(
    drawing.replace(**dict(zip(TRUE, start * np.exp(fit.x), strict=True)))
)
figure, axes = plt.subplots(figsize=(7.0, 2.8), layout="constrained")
axes.plot(
    identified.time,
    1e3 * measured[:, 0],
    ".",
    ms=2.5,
    color="0.6",
    label="measured",
)
axes.plot(
    identified.time, 1e3 * simulate(drawing).state[:, 0], "--", label="drawing"
)
axes.plot(identified.time, 1e3 * identified.state[:, 0], label="identified")
axes.set(xlabel="time [s]", ylabel="carriage x₁ [mm]", xlim=(0.0, 0.8))
axes.legend()
plt.show()
