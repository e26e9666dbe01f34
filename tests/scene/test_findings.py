"""A wrong scene fails with field, value, what is allowed, and for a misspelt name the nearest."""

import math

import pytest

from mm_gym import Scene, SceneError
from mm_gym.scene.mechanics import Sphere

NAN, INF = math.nan, math.inf
STRETCHED = {"springs": {"kind": "small_on_large"}, "actuation": {"stretch": {}}}
DRY = {
    "kind": "dry_friction",
    "static_coefficient": 0.5,
    "kinetic_coefficient": 0.4,
    "reference_velocity": 0.1,
}
HARMONIC = {"kind": "harmonic", "amplitude": 1.0, "frequency": 50.0}

# What is written -> every word that the message must contain.
FINDINGS = [
    # misspelt and unknown names
    ({"carrage": {}}, "carrage: unknown key; did you mean 'carriage'?; allowed: carriage, sphere"),
    ({"carriage": {"mas": 1.0}}, "carriage.mas: unknown key; did you mean 'mass'?"),
    (
        {"interface": {"kind": "viscos"}},
        "interface: unknown kind 'viscos'; did you mean 'viscous'?",
    ),
    (
        {"interface": {"kind": "viscous", "dampin": 1}},
        "interface.dampin: unknown key; did you mean",
    ),
    ({"springs": {"kind": "large"}}, "allowed: none, linear, small_on_large, finite_stretch"),
    ({"springs": {"stretch": 2.0}}, "springs: 'kind' is missing"),
    ({"solver": {"method": "tailor"}}, "solver.method: got 'tailor'; did you mean 'taylor'?"),
    (
        {"excitation": [HARMONIC | {"target": "floor"}]},
        "excitation.0.target: got 'floor'; did you mean 'force'?",
    ),
    (
        {"excitation": [HARMONIC, HARMONIC | {"phas": 1}]},
        "excitation.1.phas: unknown key; did you mean",
    ),
    ({"sensors": {"channels": ["slip"]}}, "sensors.channels.0: got 'slip'; allowed: 'carriage_dis"),
    (
        {"randomization": {"sphere.mas": [1, 2]}},
        "randomization.sphere.mas: not a number of this sc",
    ),
    ({"randomization": {"sphere.mas": [1, 2]}}, "did you mean 'sphere.mass'?"),
    (
        {"randomization": {"excitation.0.phase": [0, 1]}},
        "randomization.excitation.0.phase: not a n",
    ),
    ({"randomization": {"initial.stretch": [1, 2]}}, "randomization.initial.stretch: not a number"),
    # missing
    ({"interface": {k: DRY[k] for k in list(DRY)[:-1]}}, "interface.reference_velocity: missing"),
    ({"excitation": [{"kind": "harmonic", "amplitude": 1.0}]}, "excitation.0.frequency: missing"),
    ({"springs": {"kind": "finite_stretch"}}, "springs.rest_length: missing"),
    # wrong types: strict, so that neither "yes" nor True becomes 1
    ({"carriage": {"mass": "0.1"}}, "carriage.mass: got '0.1'; allowed: a number"),
    ({"carriage": {"mass": 10**5000}}, "carriage.mass: got a number of type int; allowed: a numb"),
    ({"carriage": {"mass": True}}, "carriage.mass: got True; allowed: a number"),
    ({"carriage": {"mass": None}}, "carriage.mass: got None; allowed: a number"),
    ({"carriage": {"mass": [0.1, 0.2]}}, "carriage.mass: got [0.1, 0.2]; allowed: a number"),
    ({"carriage": {"mass": 10**400}}, "carriage.mass: got 1000"),
    ({"carriage": 3}, "carriage: got 3; allowed: a dictionary or instance of Carriage"),
    ({"control": {"steps": 10.0}}, "control.steps: got 10.0; allowed: an integer"),
    ({"control": {"steps": True}}, "control.steps: got True; allowed: an integer"),
    ({"excitation": HARMONIC}, "excitation: got {"),
    ({"excitation": "harmonic"}, "excitation: got 'harmonic'; allowed: a list"),
    ({"sensors": {"channels": "stretch"}}, "sensors.channels: got 'stretch'; allowed: a list"),
    ({"sensors": {"channels": []}}, "sensors.channels: got []; allowed: at least 1"),
    (
        {"initial": {"sphere_offset": "a"}},
        "initial.sphere_offset: got 'a'; allowed: a finite number",
    ),
    (
        {"initial": {"sphere_offset": [0, "a"]}},
        "got [0, 'a']; allowed: a finite number or [low, hi",
    ),
    ({"initial": {"sphere_offset": [0, 1, 2]}}, "got [0, 1, 2]; allowed: a finite number or [low"),
    ({"initial": {"sphere_offset": {0.1, 0.2}}}, "initial.sphere_offset: got {"),
    ({"initial": {"sphere_offset": [False, True]}}, "initial.sphere_offset: got [False, True]"),
    ({"randomization": 3}, "randomization: got 3; allowed: a dictionary"),
    (
        {"randomization": {"sphere.mass": 0.1}},
        "randomization.sphere.mass: got 0.1; allowed: a list",
    ),
    ({"randomization": {"sphere.mass": [0.1]}}, "randomization.sphere.mass.1: missing"),
    (
        {"randomization": {"sphere.mass": ["a", 1]}},
        "randomization.sphere.mass.0: got 'a'; allowed:",
    ),
    # not finite
    ({"carriage": {"mass": NAN}}, "carriage.mass: got nan; allowed: "),
    ({"carriage": {"damping": INF}}, "carriage.damping: got inf; allowed: a finite number"),
    ({"excitation": [HARMONIC | {"amplitude": -INF}]}, "excitation.0.amplitude: got -inf"),
    (
        {"initial": {"carriage_velocity": NAN}},
        "initial.carriage_velocity: got nan; allowed: a finite",
    ),
    ({"initial": {"carriage_velocity": [0, INF]}}, "initial.carriage_velocity: got [0, inf]"),
    ({"randomization": {"sphere.mass": [1, INF]}}, "randomization.sphere.mass.1: got inf"),
    # out of range
    ({"sphere": {"mass": 0.0}}, "sphere.mass: got 0.0; allowed: greater than 0"),
    ({"carriage": {"mass": -1e-80}}, "carriage.mass: got -1e-80; allowed: greater than or equal"),
    (
        {"carriage": {"damping": -1e-9}},
        "carriage.damping: got -1e-09; allowed: greater than or equal",
    ),
    (
        {"springs": {"kind": "small_on_large", "stretch": 0.99}},
        "springs.stretch: got 0.99; allowed: g",
    ),
    ({"control": {"steps": 0}}, "control.steps: got 0; allowed: greater than or equal to 1"),
    (
        {"control": {"steps": 10**18}},
        "control.steps: got 1000000000000000000; allowed: less than or",
    ),
    (
        {"objective": {"velocity_scale": 1e-200}},
        "objective.velocity_scale: got 1e-200; allowed: great",
    ),
    ({"solver": {"tolerance": 1.0}}, "solver.tolerance: got 1.0; allowed: less than 1"),
    (
        {"sensors": {"history": 1001}},
        "sensors.history: got 1001; allowed: less than or equal to 1000",
    ),
    (
        {"initial": {"sphere_offset": [0.2, 0.1]}},
        "initial.sphere_offset: got [0.2, 0.1]; allowed: [lo",
    ),
    (
        {"randomization": {"sphere.mass": [2, 1]}},
        "randomization.sphere.mass: got [2.0, 1.0]; allowed",
    ),
    (
        {"randomization": {"sphere.mass": [-1, 1]}},
        "randomization.sphere.mass: got -1.0; allowed: gre",
    ),
    # rules across fields
    (
        {"interface": DRY | {"kinetic_coefficient": 0.6}},
        "interface.kinetic_coefficient: got 0.6; allowed: at most static_coefficient = 0.5",
    ),
    (
        {"interface": DRY, "randomization": {"interface.kinetic_coefficient": [0.3, 0.7]}},
        "randomization.interface.kinetic_coefficient: got 0.7; allowed: at most static_coefficient",
    ),
    ({"actuation": {"stretch": {}}}, "actuation.stretch: there are no springs to stretch"),
    ({"initial": {"stretch": 2.0}}, "initial.stretch: has no effect without actuation.stretch"),
    (
        {"sensors": {"channels": ["stretch"]}},
        "sensors.channels: 'stretch' needs springs",
    ),
    (
        {"sensors": {"channels": ["sphere_offset", "sphere_offset"]}},
        "sensors.channels: 'sphere_offset' is listed more than once",
    ),
    (
        STRETCHED | {"actuation": {"stretch": {"minimum": 2.0, "maximum": 1.5}}},
        "actuation.stretch.minimum: got 2.0; allowed: less than maximum = 1.5",
    ),
    (
        STRETCHED | {"actuation": {"stretch": {"command": "rate"}}},
        "actuation.stretch.rate_limit: missing; command = 'rate' needs it",
    ),
    (
        STRETCHED | {"initial": {"stretch": [0.5, 2.0]}},
        "initial.stretch: got (0.5, 2.0); allowed: within actuation.stretch, 1.0 to 3.0",
    ),
    (
        STRETCHED | {"springs": {"kind": "small_on_large", "stretch": 4.0}},
        "springs.stretch: got 4.0; allowed: within actuation.stretch, 1.0 to 3.0",
    ),
    (
        STRETCHED | {"randomization": {"springs.stretch": [1.0, 2.0]}},
        "randomization.springs.stretch: has no effect with actuation.stretch; set initial.stretch",
    ),
]


@pytest.mark.parametrize(("data", "words"), FINDINGS, ids=[words for _, words in FINDINGS])
def test_wrong_scene_is_refused_in_words(data, words):
    with pytest.raises(SceneError) as caught:
        Scene(**data)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value), "one mistake is one finding"


def test_all_findings_are_reported_at_once():
    with pytest.raises(SceneError) as caught:
        Scene(
            carriage={"mass": -1, "stifness": 3, "damping": "yes"},
            spher={},
            springs={"kind": "small_on_large", "stretch": 0.5},
            excitation=[HARMONIC | {"frequency": NAN}],
        )
    fields = [line.split(":")[0] for line in str(caught.value).splitlines()]
    assert sorted(fields) == [
        "carriage.damping",
        "carriage.mass",
        "carriage.stifness",
        "excitation.0.frequency",
        "spher",
        "springs.stretch",
    ]


def test_rules_across_fields_are_reported_together_and_once():
    with pytest.raises(SceneError) as caught:
        Scene(
            **STRETCHED,
            initial={"stretch": [0.5, 5.0], "sphere_offset": [1, 0]},
            randomization={"springs.stiffness": [-1.0, 2.0], "sphere.mass": [0.1, 0.2]},
        )
    fields = [line.split(":")[0] for line in str(caught.value).splitlines()]
    assert fields == ["initial.sphere_offset", "initial.stretch", "randomization.springs.stiffness"]


def test_either_end_of_a_drawn_range_is_checked():
    with pytest.raises(SceneError) as caught:
        Scene(interface=DRY, randomization={"interface.static_coefficient": [-1.0, 0.2]})
    lines = str(caught.value).splitlines()
    assert len(lines) == 2
    assert "got -1.0; allowed: greater than 0" in lines[0]
    assert "interface.kinetic_coefficient: got 0.4; allowed: at most" in lines[1]


def test_a_part_is_checked_when_it_is_made():
    with pytest.raises(SceneError, match=r"^mass: got -1\.0; allowed: greater than 0$"):
        Sphere(mass=-1.0)
