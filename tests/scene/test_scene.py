"""What a scene is: frozen, complete, identified by its content, changed only by making another."""

import json
import re

import numpy as np
import pytest
from tasks import TASKS

from mm_gym import Scene, SceneError, compile_scene, over_rigs, simulate, work_precision
from mm_gym.analysis import asymptotic_offset, bifurcation, critical_reference_velocity, modes
from mm_gym.metrics import passive_scene
from mm_gym.scene.actuators import ForceActuator
from mm_gym.scene.excitation import Harmonic
from mm_gym.scene.mechanics import SmallOnLarge
from mm_gym.tuning import duffing_absorber, evaluate, friction_absorber, stretch_for, tune

SCENES = {"the default": Scene(), **TASKS}


@pytest.mark.parametrize("name", SCENES)
def test_scene_survives_a_round_trip_through_plain_data(name):
    scene = SCENES[name]
    assert Scene(**scene.model_dump()) == scene
    assert Scene(**json.loads(scene.model_dump_json())) == scene


@pytest.mark.parametrize("name", SCENES)
def test_scene_holds_only_numbers_words_and_parts(name):
    # What JSON can carry, TOML can: nothing in a scene needs a type of its own.
    assert json.loads(SCENES[name].model_dump_json())


def test_integers_stand_for_floats():
    scene = Scene(carriage={"mass": 2, "stiffness": 300}, initial={"sphere_offset": [0, 1]})
    assert scene.carriage.mass == 2.0
    assert type(scene.carriage.mass) is float
    assert scene.initial.sphere_offset == (0.0, 1.0)


def test_scene_is_frozen():
    scene = Scene()
    with pytest.raises(ValueError, match="frozen"):
        scene.carriage.mass = 1.0
    with pytest.raises(ValueError, match="frozen"):
        scene.carriage = scene.carriage


def test_digest_depends_on_content_alone():
    assert Scene(carriage={"mass": 1}).digest == Scene().replace(**{"carriage.mass": 1.0}).digest
    assert Scene(carriage={"mass": 0.1}).digest == Scene().digest
    # Fixed here, because files that name a digest must stay readable.
    assert len(Scene().digest) == 16
    assert int(Scene().digest, 16) >= 0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("carriage.mass", 0.1 + 2e-17),
        ("carriage.cubic_coefficient", 1.0),
        ("interface.damping", 0.0),
        ("initial.sphere_offset", (0.0, 1.0)),
        ("randomization.sphere.mass", (0.1, 0.2)),
        ("sensors.history", 2),
        ("objective.rail_half_length", 1.0),
        ("solver.method", "exact"),
        ("excitation", [Harmonic(amplitude=1.0, frequency=50.0)]),
        ("actuation.force", ForceActuator()),
    ],
)
def test_digest_changes_with_any_field(name, value):
    assert Scene().replace(**{name: value}).digest != Scene().digest


def test_replace_leaves_the_original_as_it_was():
    scene = Scene()
    before = scene.model_dump()
    assert scene.replace(**{"carriage.mass": 0.3}).carriage.mass == 0.3
    assert scene.model_dump() == before


def test_replace_reaches_lists_dictionaries_and_parts_just_set():
    scene = Scene(excitation=[{"kind": "harmonic", "amplitude": 1.0, "frequency": 50.0}]).replace(
        **{
            "excitation.0.phase": 0.5,
            "randomization.sphere.mass": (0.1, 0.2),
            "springs": SmallOnLarge(),
            "springs.stretch": 2.5,
        }
    )
    assert scene.excitation[0].phase == 0.5
    assert scene.randomization == {"sphere.mass": (0.1, 0.2)}
    assert scene.springs == SmallOnLarge(stretch=2.5)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("carriage.mas", r"carriage\.mas: unknown key; did you mean 'mass'\?; allowed: mass, sti"),
        ("carrige.mass", r"carrige: unknown key; did you mean 'carriage'\?; allowed: carriage, "),
        (
            "excitation.0.phase",
            r"excitation\.0\.phase: there is no entry '0'; allowed: none, the l",
        ),
        ("carriage.mass.value", r"carriage\.mass: got \{'value': 1\.0\}; allowed: a number"),
        ("initial.stretch.low", r"initial\.stretch: got \{'low': 1\.0\}; allowed: a finite number"),
        ("", "'': unknown key; allowed: carriage, sphere"),
    ],
)
def test_replace_names_what_is_not_there(name, words):
    with pytest.raises(SceneError, match=words):
        Scene().replace(**{name: 1.0})


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("excitation.0.noise", {"excitation": [{"kind": "noise", "noise": {"v1": 2.0}}]}),
        ("springs.linear", {"springs": {"kind": "linear", "linear": 1.0}}),
    ],
)
def test_key_that_is_named_as_the_kind_is_unknown(field, value):
    with pytest.raises(SceneError, match=rf"{field}: unknown key; "):
        Scene(**value)


def test_replace_makes_a_part_that_was_not_there():
    scene = Scene().replace(**{"actuation.force.limit": 2.5})
    assert scene.actuation.force == ForceActuator(limit=2.5)


def test_replace_reports_all_findings_as_a_file_would():
    changes = {"control.stepz": 3, "sphere.mass": "heavy", "initial.sphere_offset": [2.0, 1.0]}
    with pytest.raises(SceneError) as caught:
        Scene().replace(**changes)
    lines = sorted(str(caught.value).splitlines())
    assert [line.partition(":")[0] for line in lines] == [
        "control.stepz",
        "initial.sphere_offset",
        "sphere.mass",
    ]
    assert (
        lines[0] == "control.stepz: unknown key; did you mean 'steps'?; allowed: time_step, steps"
    )


def test_another_kind_begins_with_its_defaults_in_any_order():
    scene = Scene(springs={"kind": "small_on_large", "stiffness": 9.0})
    changes = {"springs.rest_length": 0.05, "springs.kind": "finite_stretch"}
    assert scene.replace(**changes) == scene.replace(
        springs={"kind": "finite_stretch", "rest_length": 0.05}
    )
    same = scene.replace(**{"springs.kind": "small_on_large", "springs.stretch": 2.0})
    assert (same.springs.stiffness, same.springs.stretch) == (9.0, 2.0)


def test_replace_takes_the_values_of_a_json_file_and_of_numpy():
    scene = Scene().replace(
        **{
            "initial.carriage_displacement": [-0.01, 0.01],
            "control.steps": np.int64(7),
            "carriage.mass": np.float32(0.25),
            "initial.sphere_offset": np.array([0.0, 0.5]),
        }
    )
    assert scene.initial.carriage_displacement == (-0.01, 0.01)
    assert (scene.control.steps, scene.carriage.mass) == (7, 0.25)
    assert scene.initial.sphere_offset == (0.0, 0.5)


def test_replace_refuses_an_array_as_a_kind():
    with pytest.raises(SceneError, match="springs: unknown kind"):
        Scene().replace(**{"springs.kind": np.array([1.0, 2.0])})


def test_replace_validates_anew():
    with pytest.raises(SceneError, match=r"sphere\.mass: got -1\.0; allowed: greater than 0"):
        Scene().replace(**{"sphere.mass": -1.0})


def test_randomization_takes_any_number_of_the_scene():
    scene = Scene(
        springs={"kind": "small_on_large"},
        excitation=[{"kind": "harmonic", "amplitude": 1.0, "frequency": 50.0}],
    )
    names = [
        "carriage.mass",
        "carriage.damping",
        "sphere.mass",
        "interface.damping",
        "springs.stiffness",
        "springs.stretch",
        "excitation.0.amplitude",
        "excitation.0.frequency",
        "excitation.0.phase",
    ]
    for name in names:
        assert scene.replace(**{f"randomization.{name}": (1.0, 2.0)}).randomization == {
            name: (1.0, 2.0)
        }


TAKE_A_SCENE = [
    *(compile_scene, simulate, over_rigs, work_precision),
    *(modes, asymptotic_offset, critical_reference_velocity),
    *(tune, evaluate, duffing_absorber, friction_absorber, passive_scene),
    lambda scene: simulate(scene, duration=1.0, ground=[[0.0, 0.0], [1.0, 1.0]]),
    lambda scene: stretch_for(scene, 100.0),
    lambda scene: bifurcation(scene, "initial.sphere_offset", [0.1]),
]


@pytest.mark.parametrize("function", TAKE_A_SCENE)
@pytest.mark.parametrize("wrong", ["mm_gym/PreStretch-v0", {"carriage": {"mass": 0.2}}, None])
def test_what_is_no_scene_is_named_by_every_function_that_takes_one(function, wrong):
    text = f"scene: got {wrong!r}; allowed: a Scene, as load_scene returns it"
    with pytest.raises(SceneError, match=f"^{re.escape(text)}"):
        function(wrong)


@pytest.mark.parametrize("wrong", [None, [], "carriage"])
def test_fields_that_are_no_dictionary_are_refused(wrong):
    text = f"Scene: got {wrong!r}; allowed: a dictionary of its fields"
    with pytest.raises(SceneError, match=f"^{re.escape(text)}"):
        Scene.of(wrong)
