"""The paper's linear systems against golden values of which every digit is right."""

import json
from pathlib import Path

import numpy as np
import pytest
from oracle import error, scale_of

from mm_gym import Scene, simulate

CASES = json.loads((Path(__file__).parents[1] / "golden" / "linear.json").read_text("utf-8"))[
    "cases"
]

# The bound of docs/numerics.md; round-off of 2,000 steps stays well below it.
BOUND = 1e-12


def scene_of(case, time_step):
    p = {name: float(value) for name, value in case["params"].items()}
    x1, x2, v1, v2 = (float(value) for value in case["ic"])
    data = {
        "carriage": {"mass": p["m1"], "stiffness": p["k1"], "damping": p["d"]},
        "sphere": {"mass": p["m2"]},
        "interface": {"kind": "viscous", "damping": p["c"]},
        "initial": {
            "carriage_displacement": x1,
            "sphere_offset": x2 - x1,
            "carriage_velocity": v1,
            "sphere_velocity": v2,
        },
        "control": {"time_step": time_step},
    }
    if "k0" in p:
        data["springs"] = {"kind": "small_on_large", "stiffness": p["k0"], "stretch": p["lam"]}
    return Scene(**data)


@pytest.mark.parametrize("time_step", [0.001, 0.02, 0.03, 0.7, 10.0])
@pytest.mark.parametrize("name", CASES)
def test_linear_systems_of_the_paper_are_right_to_round_off(name, time_step):
    # The times are multiples of 0.001 and 0.02 s; with the other control steps they lie within one.
    case = CASES[name]
    times = [float(t) for t in case["states"]]
    expected = np.array([[float(v) for v in row] for row in case["states"].values()])
    start = [float(v) for v in case["ic"]]
    state = simulate(scene_of(case, time_step), times=times).state
    assert error(state, expected, scale_of(expected, start)) <= BOUND


@pytest.mark.parametrize("name", [n for n, case in CASES.items() if "dx_inf" in case])
def test_offset_reaches_the_asymptote_of_the_paper(name):
    # The slowest decay, d/(2 m1) = 0.2 1/s of fig. 5, leaves exp(-42) = 1e-18 after 200 s.
    case = CASES[name]
    x1, x2 = simulate(scene_of(case, 10.0), duration=200.0).state[-1, :2]
    scale = max(abs(float(v)) for v in case["ic"])
    assert abs(x2 - x1 - float(case["dx_inf"])) <= BOUND * scale
