"""Rules across fields hold for every value that can be drawn, and are all reported at once."""

import numpy as np
import pytest

from mm_gym import MovingMassVectorEnv, Scene, SceneError, load_scene

DRY = {
    "kind": "dry_friction",
    "static_coefficient": 0.5,
    "kinetic_coefficient": 0.2,
    "reference_velocity": 0.1,
}
NOISE = {"kind": "noise", "rms": 1.0, "low_frequency": 5.0, "high_frequency": 50.0}

# Joint ranges


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (
            {
                "interface": DRY,
                "randomization": {
                    "interface.static_coefficient": [0.3, 0.5],
                    "interface.kinetic_coefficient": [0.2, 0.4],
                },
            },
            (
                "randomization.interface.kinetic_coefficient: got 0.4; allowed: at most "
                "static_coefficient = 0.3, which is drawn too; draw interface.kinetic_ratio in "
                "place of interface.kinetic_coefficient"
            ),
        ),
        (
            {
                "excitation": [NOISE],
                "randomization": {
                    "excitation.0.high_frequency": [10.0, 50.0],
                    "excitation.0.low_frequency": [1.0, 20.0],
                },
            },
            (
                "randomization.excitation.0.low_frequency: got 20.0; allowed: less than "
                "high_frequency = 10.0, which is drawn too; draw excitation.0.low_ratio in place "
                "of excitation.0.low_frequency"
            ),
        ),
        (
            {"interface": DRY, "randomization": {"interface.kinetic_ratio": [0.5, 1.1]}},
            "randomization.interface.kinetic_ratio: got 1.1; allowed: greater than 0 and at most 1",
        ),
        (
            {"excitation": [NOISE], "randomization": {"excitation.0.low_ratio": [-0.1, 0.5]}},
            "randomization.excitation.0.low_ratio: got -0.1; allowed: at least 0 and below 1",
        ),
        (
            {
                "interface": DRY,
                "randomization": {
                    "interface.kinetic_ratio": [0.5, 1.0],
                    "interface.kinetic_coefficient": [0.2, 0.4],
                },
            },
            (
                "randomization.interface.kinetic_coefficient: has no effect: it follows from a "
                "ratio drawn too"
            ),
        ),
        (
            {"randomization": {"interface.kinetic_ratio": [0.5, 1.0]}},
            (
                "randomization.interface.kinetic_ratio: not a number of this scene that can be "
                "drawn; did you mean 'interface.damping'?"
            ),
        ),
    ],
)
def test_ranges_that_break_a_rule_jointly_are_refused_by_name(data, words):
    with pytest.raises(SceneError) as caught:
        Scene(**data)
    assert str(caught.value) == words


RECORD = {"kind": "record", "file": "ground.txt"}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (
            {"excitation": [NOISE | {"decay": 7.0}]},
            "excitation.0.decay: has no effect without plateau",
        ),
        (
            {"excitation": [NOISE], "randomization": {"excitation.0.decay": [1.0, 2.0]}},
            "randomization.excitation.0.decay: has no effect without plateau",
        ),
        (
            {"excitation": [RECORD | {"scale_to": {"peak": 1.0, "damping": 0.3}}]},
            "excitation.0.scale_to.damping: has no effect without spectral_acceleration",
        ),
    ],
)
def test_settings_without_effect_are_refused(data, words):
    with pytest.raises(SceneError) as caught:
        Scene(**data)
    assert str(caught.value) == words
    assert Scene(excitation=[NOISE | {"decay": 7.0, "plateau": 2.0}]).excitation[0].decay == 7.0


def test_ranges_that_never_meet_are_allowed():
    ranges = {
        "interface.static_coefficient": (0.4, 0.5),
        "interface.kinetic_coefficient": (0.1, 0.4),
    }
    assert Scene(interface=DRY, randomization=ranges).randomization == ranges


RATIOS = {
    "interface": (
        {"interface": DRY},
        {"interface.static_coefficient": [0.3, 0.6], "interface.kinetic_ratio": [0.4, 1.0]},
        "interface.kinetic_coefficient",
    ),
    "noise": (
        {"excitation": [NOISE]},
        {"excitation.0.high_frequency": [20.0, 60.0], "excitation.0.low_ratio": [0.1, 0.9]},
        "excitation.0.low_frequency",
    ),
}


@pytest.mark.parametrize("name", RATIOS)
def test_ratio_that_is_drawn_gives_its_field(name):
    data, ranges, followed = RATIOS[name]
    other, ratio = ranges
    env = MovingMassVectorEnv(Scene(**data, randomization=ranges, actuation={"force": {}}), 500)
    env.reset(seed=0)
    for each in ranges:
        low, high = ranges[each]
        values = env.drawn(each)
        assert len(set(values)) > 490  # of 500 draws of 53 bits
        assert values.min() >= low
        assert values.max() <= high
    assert (env.drawn(followed) == env.drawn(ratio) * env.drawn(other)).all()
    # What is set replaces what is drawn, and the field still follows.
    env.reset(options={other: ranges[other][0], ratio: np.full(500, 0.5)})
    assert (env.drawn(followed) == 0.5 * ranges[other][0]).all()
    with pytest.raises(SceneError, match=f"{followed}: follows from {ratio}; set that"):
        env.reset(options={followed: 0.5 * ranges[other][1]})
    with pytest.raises(SceneError, match=rf"{ratio}: got 1\.5; allowed: "):
        env.reset(options={ratio: 1.5})
    for _ in range(3):
        env.step(env.action_space.sample())


def test_options_may_not_shorten_a_spring_to_nothing():
    scene = Scene(
        springs={"kind": "finite_stretch", "rest_length": 0.05},
        actuation={"stretch": {"minimum": 1.2, "maximum": 3.0}},
        initial={"stretch": 2.0, "sphere_offset": [-0.03, 0.03]},
        randomization={"springs.rest_length": [0.05, 0.1]},
    )
    env = MovingMassVectorEnv(scene, 2)
    env.reset(seed=0, options={"initial.sphere_offset": 0.059})
    env.reset(options={"initial.sphere_offset": -0.1, "springs.rest_length": 0.1})
    for offset in (0.061, [0.0, -0.061]):
        with pytest.raises(SceneError, match=r"initial\.sphere_offset: got .*; allowed: less than"):
            env.reset(options={"initial.sphere_offset": offset})


# Ranges as such


@pytest.mark.parametrize(
    ("data", "name"),
    [
        ({"initial": {"sphere_offset": [-1.7e308, 1.7e308]}}, "initial.sphere_offset"),
        (
            {
                "excitation": [{"kind": "harmonic", "amplitude": 1.0, "frequency": 1.0}],
                "randomization": {"excitation.0.amplitude": [-1.7e308, 1.7e308]},
            },
            "randomization.excitation.0.amplitude",
        ),
        (
            {"excitation": [{"kind": "impulse", "rate": 1.0, "size": [-1e308, 1e308]}]},
            "excitation.0.size",
        ),
    ],
)
def test_range_too_wide_to_draw_from_is_refused_by_name(data, name):
    # Between such ends, low + (high - low) u is infinite for any u.
    with pytest.raises(SceneError) as caught:
        Scene(**data)
    text = str(caught.value)
    assert text.startswith(f"{name}: got [-1")
    assert text.endswith("allowed: high - low of at most 1.8e+308, the largest number")


# Every finding at once

WRONG = """\
[carriage]
mass = -1
[interface]
kind = "dry_friction"
static_coefficient = 0.3
kinetic_coefficient = 0.4
reference_velocity = 0
[[excitation]]
kind = "noise"
rms = "loud"
low_frequency = 20
high_frequency = 10
[initial]
stretch = 2
[sensors]
channels = ["stretch"]
lag = 3
[randomization]
"sphere.mass" = [-1, 1]
"""


def test_rules_are_checked_where_other_fields_are_wrong(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(WRONG)
    with pytest.raises(SceneError) as caught:
        load_scene(file)
    lines = [
        line.removeprefix(f"{file}:").split(": ")[:2] for line in str(caught.value).split("\n")
    ]
    assert sorted((int(line), name) for line, name in lines) == [
        (2, "carriage.mass"),
        (6, "interface.kinetic_coefficient"),
        (7, "interface.reference_velocity"),
        (10, "excitation.0.rms"),
        (11, "excitation.0.low_frequency"),
        (14, "initial.stretch"),
        (16, "sensors.channels"),
        (17, "sensors.lag"),
        (19, "randomization.sphere.mass"),
    ]


@pytest.mark.parametrize(
    "data",
    [
        {"interface": DRY | {"static_coefficient": "x", "kinetic_coefficient": 5.0}},
        {"interface": DRY | {"static_coeficient": 6.0, "kinetic_coefficient": 5.0}},
        {"initial": {"stretch": 2.0}, "actuation": {"stretch": 3}},
        {"initial": {"stretch": 2.0}, "actuatoin": {"stretch": {}}},
        {"sensors": {"channels": ["carriage_displacement", "s"], "noise": {"stretch": 1.0}}},
        {"excitation": [{"kind": "nose"}], "randomization": {"excitation.0.rms": [1.0, 2.0]}},
        {"excitation": [{"kind": "impulse", "size": 1.0, "rat": 1.0}]},
        {
            "interface": DRY,
            "randomization": {
                "interface.static_coefficient": [0.5, 0.2],
                "interface.kinetic_coefficient": [0.2, 0.6],
            },
        },
    ],
)
def test_rules_are_not_checked_on_values_that_are_not_known(data):
    with pytest.raises(SceneError) as caught:
        Scene(**data)
    assert "\n" not in str(caught.value)
