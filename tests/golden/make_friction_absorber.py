"""Make friction_absorber.json: peaks under dry friction around the best design, by Runge and Kutta.

`python tests/golden/make_friction_absorber.py`; independent of mm_gym.

A carriage of 1 kg and 1e4 N/m without damping, a sphere of 0.05 kg, a harmonic force of 1 N on the
carriage, Coulomb friction with creep below 1 mm/s. For each design the largest amplitude of the
carriage over the frequencies, after 150 periods from rest, all side by side.
"""

import json
from pathlib import Path

import numpy as np

M1, K1, M2, REFERENCE = 1.0, 1e4, 0.05, 1e-3
STEPS, PERIODS = 1200, 150


def slopes(angle, w, state, friction, k2):
    """Return the derivatives with respect to the angle w t."""
    x1, x2, v1, v2 = state
    inner = friction * np.clip((v2 - v1) / REFERENCE, -1.0, 1.0) + k2 * (x2 - x1)
    return np.array([v1, v2, (np.sin(angle) - K1 * x1 + inner) / M1, -inner / M2]) / w


def amplitudes(w, friction, k2):
    """Return the largest carriage displacement of the last period about its mean."""
    state = np.zeros((4, *np.broadcast(w, friction, k2).shape))
    h = 2.0 * np.pi / STEPS
    high = low = None
    for step in range(STEPS * PERIODS):
        angle = h * (step % STEPS)
        if step == STEPS * (PERIODS - 1):
            high, low = state[0].copy(), state[0].copy()
        a = slopes(angle, w, state, friction, k2)
        b = slopes(angle + 0.5 * h, w, state + 0.5 * h * a, friction, k2)
        c = slopes(angle + 0.5 * h, w, state + 0.5 * h * b, friction, k2)
        d = slopes(angle + h, w, state + h * c, friction, k2)
        state = state + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        if high is not None:
            np.maximum(high, state[0], out=high)
            np.minimum(low, state[0], out=low)
    return 0.5 * (high - low)


def peaks(frictions, stiffnesses, w):
    """Return the largest amplitude of every pair (friction, k2)."""
    grid = np.meshgrid(frictions, stiffnesses, w, indexing="ij")
    found = amplitudes(grid[2].ravel(), grid[0].ravel(), grid[1].ravel())
    return found.reshape(grid[0].shape).max(axis=2).tolist()


def main():
    """Write the file."""
    free = np.array([0.95, 1.0, 1.05, 1.1, 1.15, 1.2, 1.25])
    frictions = np.array([0.185, 0.195, 0.205, 0.215, 0.225])
    stiffnesses = np.array([452.0, 458.0, 464.0, 470.0, 476.0])
    low, high = np.linspace(88.0, 94.0, 25), np.linspace(100.0, 111.0, 23)
    result = {
        "provenance": __doc__.partition("\n")[0],
        "none": {
            "friction": free.tolist(),
            "peak": [row[0] for row in peaks(free, [0.0], np.linspace(98.0, 100.0, 41))],
        },
        "springs": {
            "friction": frictions.tolist(),
            "stiffness": stiffnesses.tolist(),
            "peak": peaks(frictions, stiffnesses, np.concatenate([low, high])),
        },
    }
    text = json.dumps(result, indent=1) + "\n"
    Path(__file__).with_name("friction_absorber.json").write_text(text, "utf-8")


if __name__ == "__main__":
    main()
