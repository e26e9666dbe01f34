"""
A figure of the paper
=====================

Figure 8 A: a sphere under dry friction ends elsewhere than the linear system predicts, because it
slips while the carriage moves fast. ``python -m mm_gym paper --out DIR`` draws all figures.
"""

import matplotlib.pyplot as plt
import numpy as np
from mm_gym import Scene, simulate
from mm_gym.analysis import asymptotic_offset

# %%
# The rig of the figure's caption. The linear system has the damping of stick.
friction = Scene(
    carriage={"mass": 0.1, "stiffness": 400.0, "damping": 1.0},
    sphere={"mass": 0.04},
    interface={
        "kind": "dry_friction",
        "static_coefficient": 0.509,
        "kinetic_coefficient": 0.2545,
        "reference_velocity": 0.2,
        "slip_damping": 0.1,
        "normal_force": 0.3924,
    },
    initial={"carriage_displacement": 0.01, "sphere_offset": 0.02},
)
linear = friction.replace(
    interface={"kind": "viscous", "damping": 0.509 * 0.3924 / 0.2},
)

# %%
# Each slip begins and ends at a time that is found, not stepped over.
times = np.linspace(0.0, 0.5, 2001)
motion = simulate(friction, times=times)
x1, x2, v1, v2 = 1e3 * motion.state.T
linear_end = 1e3 * asymptotic_offset(linear)

figure, (positions, velocity) = plt.subplots(
    2, 1, figsize=(7.0, 4.0), sharex=True, layout="constrained"
)
positions.plot(times, x1, label="carriage x₁")
positions.plot(times, x2, "--", label="sphere x₂")
positions.axhline(
    linear_end,
    color="0.4",
    linestyle=":",
    label="where the linear system would end",
)
positions.set(ylabel="position [mm]")
positions.legend(loc="right")
velocity.plot(times, 1e-3 * (v2 - v1))
for limit in (-0.2, 0.2):
    velocity.axhline(limit, color="0.4", linestyle=":")
velocity.text(0.495, 0.22, "it slips above $v_r$", ha="right", va="bottom")
velocity.set(xlabel="time [s]", ylabel="slip velocity [m/s]")
plt.show()
