"""
Tune an absorber
================

The lowest peak that a passive absorber can reach, in the frequency responses of the bare, the
untuned and the tuned structure.
"""

import matplotlib.pyplot as plt
import numpy as np
from mm_gym import Scene
from mm_gym.analysis import frequency_response
from mm_gym.tuning import tune

# %%
# A floor of 5 kg at 2.5 Hz, and a mass of 0.25 kg on a spring and a damper that are a guess.
guess = Scene(
    carriage={"mass": 5.0, "stiffness": 1250.0, "damping": 1.6},
    sphere={"mass": 0.25},
    interface={"kind": "viscous", "damping": 0.3},
    springs={"kind": "linear", "stiffness": 80.0},
    actuation={"force": {"limit": 1.0}},
)
found = tune(guess, excitation="force")
print(found.table())

# %%
# Without the absorber the floor's peak is that of its own damping alone.
bare = guess.replace(
    **{"sphere.mass": 1e-9, "interface.damping": 0.0, "springs.stiffness": 1e-9}
)

frequencies = np.linspace(1.8, 3.2, 1401)
figure, axes = plt.subplots(figsize=(7.0, 3.0), layout="constrained")
for name, scene, look in (
    ("without absorber", bare, ":"),
    ("guessed", guess, "--"),
    ("tuned", found.tuned, "-"),
):
    response = frequency_response(scene, 2.0 * np.pi * frequencies)
    axes.semilogy(frequencies, 1e3 * np.abs(response.force[:, 0]), look, label=name)
axes.set(xlabel="frequency [Hz]", ylabel="|x₁| per newton [mm/N]")
axes.legend()
plt.show()
