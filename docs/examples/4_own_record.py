"""
A record of your own
====================

An accelerogram in a file shakes a frame with and without an absorber. The file here is made on the
spot, as text with a time and an acceleration per line; PEER's AT2, CSV, MATLAB and NumPy files are
read in the same way.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from mm_gym import Scene, simulate
from mm_gym.analysis import response_spectrum
from mm_gym.records import read_record
from mm_gym.tuning import tune

# %%
# Twelve seconds of filtered noise under an envelope, as an earthquake would be recorded.
times = np.arange(0.0, 12.0, 0.01)
noise = np.random.default_rng(4).normal(size=times.size)
shape = np.convolve(
    noise, np.exp(-np.arange(60) / 12.0) * np.cos(np.arange(60) / 6.0), "same"
)
acceleration = 0.5 * shape * (times / 3.0) ** 2 * np.exp(2.0 - 2.0 * times / 3.0)
file = Path(tempfile.mkdtemp()) / "record.csv"
np.savetxt(
    file,
    np.column_stack([times, acceleration]),
    delimiter=",",
    header="time,acceleration",
)

# %%
# The frame, and the best passive absorber for ground motion.
frame = Scene(
    carriage={"mass": 5.0, "stiffness": 1250.0, "damping": 1.6},
    sphere={"mass": 0.25},
    interface={"kind": "viscous", "damping": 0.3},
    springs={"kind": "linear", "stiffness": 50.0},
    excitation=[{"kind": "record", "file": str(file), "unit": "m/s^2"}],
    control={"time_step": 0.01, "steps": 1500},
)
tuned = tune(frame, excitation="ground", criterion="h2").tuned
bare = frame.replace(
    **{"sphere.mass": 1e-9, "interface.damping": 0.0, "springs.stiffness": 1e-9}
)

# %%
# Its response spectrum tells what the record does to frames of other periods.
spectrum = response_spectrum(read_record(file, unit="m/s^2"), damping=0.05)
figure, (left, right) = plt.subplots(
    1, 2, figsize=(7.0, 2.8), layout="constrained", width_ratios=(2, 1)
)
for name, scene, look in (
    ("without absorber", bare, {"color": "0.7"}),
    ("tuned absorber", tuned, {"linewidth": 1.0}),
):
    motion = simulate(scene)
    left.plot(motion.time, 1e3 * motion.state[:, 0], label=name, **look)
left.set(xlabel="time [s]", ylabel="frame x₁ [mm]")
left.legend()
right.semilogx(spectrum.periods, spectrum.absolute_acceleration[0])
right.set(xlabel="period [s]", ylabel="spectral acceleration [m/s²]")
plt.show()
