"""What a scene is: frozen, complete, identified by its content, changed only by making another."""

import json

import pytest
from tasks import TASKS

from mm_gym import Scene, SceneError
from mm_gym.scene.actuators import ForceActuator
from mm_gym.scene.excitation import Harmonic
from mm_gym.scene.mechanics import SmallOnLarge

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
        ("carriage.mas", r"carriage\.mas: there is no 'mas'; did you mean 'mass'\?"),
        ("carrige.mass", r"carrige\.mass: there is no 'carrige'; did you mean 'carriage'\?"),
        ("excitation.0.phase", r"excitation\.0\.phase: there is no '0'"),
        ("actuation.force.limit", r"actuation\.force\.limit: there is no 'limit'"),
        ("carriage.mass.value", r"carriage\.mass\.value: there is no 'value'"),
        ("", "there is no ''"),
    ],
)
def test_replace_names_what_is_not_there(name, words):
    with pytest.raises(SceneError, match=words):
        Scene().replace(**{name: 1.0})


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
