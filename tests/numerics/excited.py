"""A scene to excite, friction and noises, for tests that begin from them."""

from mm_gym import Scene

BASE = Scene(initial={"carriage_displacement": 0.01}, control={"time_step": 0.01, "steps": 60})
FRICTION = {
    "kind": "dry_friction",
    "static_coefficient": 0.51,
    "kinetic_coefficient": 0.4,
    "reference_velocity": 0.01,
}
NOISE = {"kind": "noise", "rms": 1.0, "low_frequency": 40.0, "high_frequency": 80.0}
SOIL = {"kind": "kanai_tajimi", "rms": 2.0, "ground_frequency": 60.0, "ground_damping": 0.5}
HIGH_PASSED = SOIL | {"kind": "clough_penzien", "filter_frequency": 10.0, "filter_damping": 0.7}
