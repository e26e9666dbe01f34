"""Draws from ranges: each lies in its range, and no rule across fields is broken by any."""

import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mm_gym import CompileError, Scene, SceneError, compile_scene
from mm_gym.lanes import layout
from mm_gym.simulation.lanes import Lanes

NOISE = {"kind": "noise", "rms": 1.0, "low_frequency": 5.0, "high_frequency": 50.0}
LANES = 32


def pairs(low, high):
    """Ordered pairs of numbers, often equal ones and ends."""
    numbers = st.sampled_from([low, high]) | st.floats(low, high)
    return st.tuples(numbers, numbers).map(sorted)


POSITIVE = pairs(0.05, 2.0)
COEFFICIENTS = pairs(0.1, 1.0)
STRETCHES = pairs(1.0, 3.0)
FREQUENCIES = pairs(1.0, 60.0)

FRICTIONS = st.fixed_dictionaries(
    {
        "kind": st.just("dry_friction"),
        "static_coefficient": st.just(0.8),
        "kinetic_coefficient": st.just(0.3),
        "reference_velocity": st.just(0.1),
        "normal_force": st.just(0.4),
    }
)
INTERFACES = st.just({"kind": "none"}) | st.just({"kind": "viscous"}) | FRICTIONS
SPRINGS = (
    st.just({"kind": "none"})
    | st.just({"kind": "small_on_large"})
    | st.just({"kind": "finite_stretch", "rest_length": 0.05})
)
SOURCES = st.sampled_from(
    [
        NOISE,
        NOISE | {"low_frequency": 0.0},
        {"kind": "kanai_tajimi", "rms": 1.0, "ground_frequency": 50.0},
        {"kind": "impulse", "size": [-0.1, 0.1], "rate": 2.0},
        {"kind": "harmonic", "amplitude": 1.0, "frequency": 50.0},
    ]
)
RANGES = {
    "carriage.mass": POSITIVE,
    "sphere.mass": POSITIVE,
    "interface.damping": POSITIVE,
    "interface.static_coefficient": COEFFICIENTS,
    "interface.kinetic_coefficient": COEFFICIENTS,
    "interface.kinetic_ratio": pairs(0.01, 1.0),
    "interface.reference_velocity": POSITIVE,
    "springs.stiffness": POSITIVE,
    "springs.stretch": STRETCHES,
    "springs.rest_length": pairs(0.02, 0.1),
    "excitation.0.low_frequency": FREQUENCIES,
    "excitation.0.high_frequency": FREQUENCIES,
    "excitation.0.low_ratio": pairs(0.0, 0.999),
    "excitation.0.rate": pairs(0.0, 5.0),
    "excitation.0.amplitude": pairs(-1.0, 1.0),
}


def belongs(name, data):
    """Whether a scene has a number or ratio of this name."""
    part, _, field = name.rpartition(".")
    if part == "excitation.0":
        fields = dict.fromkeys(data["excitation"][0] if data["excitation"] else ())
        return field in fields or (field == "low_ratio" and "low_frequency" in fields)
    if part == "interface":
        friction = data["interface"]["kind"] == "dry_friction"
        return (field == "damping") != friction and data["interface"]["kind"] != "none"
    if part == "springs":
        return data["springs"]["kind"] == "finite_stretch" or (
            data["springs"]["kind"] != "none" and field != "rest_length"
        )
    return True


@st.composite
def scenes_with_ranges(draw):
    data = {
        "interface": draw(INTERFACES),
        "springs": draw(SPRINGS),
        "excitation": draw(st.lists(SOURCES, max_size=1)),
        "initial": {"sphere_offset": draw(pairs(-0.2, 0.2) | pairs(-0.01, 0.01))},
        "actuation": {"force": {}},
    }
    if data["springs"]["kind"] != "none" and draw(st.booleans()):
        minimum, maximum = draw(STRETCHES)
        data["actuation"]["stretch"] = {"minimum": minimum, "maximum": maximum}
        data["initial"]["stretch"] = draw(STRETCHES)
    names = [name for name in RANGES if belongs(name, data)]
    chosen = draw(st.lists(st.sampled_from(names), unique=True, max_size=5))
    data["randomization"] = {name: draw(RANGES[name]) for name in chosen}
    return data


def lanes_of(plant, seed=0):
    lanes = Lanes(plant, LANES)
    lanes.seed(seed)
    lanes.restart()
    return lanes


def check_lanes(lanes, data):
    """Assert each rule across fields, in its own words, and that all draws lie in their ranges."""
    names = lanes.plant.support.names
    drawn = {name: lanes.values[row] for name, row in names.items()}
    assert all(np.isfinite(values).all() for values in drawn.values())
    if "interface.static_coefficient" in drawn and lanes.plant.support.slips:
        assert (drawn["interface.kinetic_coefficient"] > 0.0).all()
        assert (
            drawn["interface.kinetic_coefficient"] <= drawn["interface.static_coefficient"]
        ).all()
    if "excitation.0.high_frequency" in drawn:
        assert (drawn["excitation.0.low_frequency"] < drawn["excitation.0.high_frequency"]).all()
    if "stretch" in data["actuation"]:
        limits = data["actuation"]["stretch"]
        assert (drawn["initial.stretch"] >= limits["minimum"]).all()
        assert (drawn["initial.stretch"] <= limits["maximum"]).all()
    if "springs.rest_length" in drawn:
        stretch = drawn.get("initial.stretch", drawn.get("springs.stretch"))
        offset = lanes.values[1] - lanes.values[0]
        assert (abs(offset) < stretch * drawn["springs.rest_length"]).all()
    for name, (low, high) in data["randomization"].items():
        assert (drawn[name] >= low).all()
        assert (drawn[name] <= high).all()


def check_scene(data):
    """Draw from a scene with ranges, or refuse it by name; return whether it was drawn from."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            plant = compile_scene(Scene(**data))
    except (SceneError, CompileError):
        return False
    check_lanes(lanes_of(plant), data)
    return True


@pytest.mark.parametrize("count", [300, 10_000])
def test_no_lane_draws_what_the_rules_forbid(count):
    drawn = []

    @settings(max_examples=count, deadline=None, suppress_health_check=list(HealthCheck))
    @given(data=scenes_with_ranges())
    def check(data):
        drawn.append(check_scene(data))

    check()
    assert sum(drawn) > 0.3 * count  # otherwise too little is drawn


def test_widest_range_is_drawn_from_within():
    scene = Scene(initial={"sphere_offset": [-8e307, 8e307]})
    offsets = lanes_of(compile_scene(scene)).values[1]
    assert len(set(offsets)) == LANES


def test_friction_that_follows_from_a_ratio_is_the_one_that_acts():
    scene = Scene(
        interface={
            "kind": "dry_friction",
            "static_coefficient": 0.5,
            "kinetic_coefficient": 0.25,
            "reference_velocity": 0.01,
        },
        actuation={"force": {}},
        randomization={"interface.kinetic_ratio": (0.2, 0.8)},
    )
    lanes = Lanes(compile_scene(scene), 50)
    lanes.seed(0)
    lanes.restart()
    mu2, normal = lanes.values[layout.MU2], lanes.values[layout.FN]
    assert np.unique(mu2).size == 50
    assert np.array_equal(lanes.values[layout.KINETIC_FORCE], mu2 * normal)
