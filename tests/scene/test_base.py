"""Does a scene file with a base say just what differs from the task, and refuse what is none?"""

import json

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mm_gym import SceneError, load_scene
from mm_gym.__main__ import main
from mm_gym.files import read_toml
from mm_gym.scene.schema import scene_schema
from mm_gym.tasks import ids, path_of, short_name

HARMONIC, QUAKE = "mm_gym/PreStretch-v0", "mm_gym/Hybrid-v0"


@pytest.fixture
def load(tmp_path):
    def load(text):
        (tmp_path / "own.toml").write_text(text, "utf-8")
        return load_scene(tmp_path / "own.toml")

    return load


@pytest.mark.parametrize("task", ids())
@pytest.mark.parametrize("name", [str, short_name])
def test_base_alone_is_the_task_and_has_its_digest(load, task, name):
    found = load(f'base = "{name(task)}"\n')
    assert found == load_scene(task)
    assert found.digest == load_scene(task).digest


@given(mass=st.floats(0.01, 10.0), steps=st.integers(1, 1000))
def test_stated_fields_go_over_those_of_the_task(tmp_path_factory, mass, steps):
    file = tmp_path_factory.mktemp("scene") / "own.toml"
    file.write_text(
        f'base = "CarriageForce"\n[carriage]\nmass = {mass}\n[control]\nsteps={steps}\n'
    )
    task = load_scene("mm_gym/CarriageForce-v0")
    assert load_scene(file) == task.replace(**{"carriage.mass": mass, "control.steps": steps})


def test_part_of_another_kind_begins_with_the_defaults_of_that_kind(load):
    found = load(f'base = "{QUAKE}"\n[interface]\nkind = "none"\n')
    assert found == load_scene(QUAKE).replace(**{"interface.kind": "none"})
    same = load(f'base = "{QUAKE}"\n[springs]\nkind = "small_on_large"\n')
    assert same == load_scene(QUAKE)


def test_list_is_stated_whole_and_what_was_drawn_of_it_is_drawn_no_longer(load):
    text = '[[excitation]]\nkind = "harmonic"\namplitude = 2.0\nfrequency = 50.0\n'
    found = load(f'base = "{QUAKE}"\n{text}')
    assert len(found.excitation) == 1
    assert load_scene(QUAKE).randomization
    assert not found.randomization


def test_what_the_file_draws_is_drawn_next_to_what_the_task_draws(load):
    heavy = '\n[randomization]\n"carriage.mass" = [0.1, 0.3]\n'
    found = load(f'base = "{HARMONIC}"{heavy}')
    task = load_scene(HARMONIC)
    assert set(found.randomization) == {*task.randomization, "carriage.mass"}
    narrow = '\n[randomization]\n"excitation.0.frequency" = [60.0, 61.0]\n'
    assert load(f'base = "{HARMONIC}"{narrow}').randomization["excitation.0.frequency"] == (60, 61)


DRAWS = """
[interface]
kind = "dry_friction"
static_coefficient = 0.5
kinetic_coefficient = 0.3
reference_velocity = 0.1

[randomization]
"carriage.mass" = [0.1, 0.3]
"sphere.mass" = [0.01, 0.02]
"interface.kinetic_ratio" = [0.4, 0.8]
"""


@pytest.mark.parametrize(
    ("text", "gone"),
    [
        ("[carriage]\nmass = 0.2\n", {"carriage.mass"}),
        ("[interface]\nkinetic_coefficient = 0.2\n", {"interface.kinetic_ratio"}),
        ('[interface]\nkind = "none"\n', {"interface.kinetic_ratio"}),
        ("[interface]\nstatic_coefficient = 0.6\n", set()),
    ],
)
def test_what_the_file_fixes_is_drawn_no_longer(load, text, gone, tmp_path, monkeypatch):
    (tmp_path / "draws.toml").write_text(DRAWS)
    monkeypatch.setattr("mm_gym.tasks.FOLDER", tmp_path)
    drawn = load_scene("mm_gym/Draws-v0").randomization
    assert set(load(f'base = "Draws"\n{text}').randomization) == set(drawn) - gone


def test_empty_table_adds_a_part_that_the_task_does_not_have_and_keeps_others(load):
    found = load('base = "PreStretchRobust"\n[actuation.force]\n[sensors.noise]\n[springs]\n')
    task = load_scene("mm_gym/PreStretchRobust-v0")
    assert found == task.replace(**{"actuation.force": {}})
    assert found.actuation.names == ("force", "stretch")


def test_channels_that_are_no_longer_observed_have_no_errors(load):
    channels = 'channels = ["sphere_velocity", "carriage_displacement"]'
    errors = "[sensors.bias]\nsphere_velocity = 0.1\n"
    found = load(f'base = "PreStretchRobust"\n[sensors]\n{channels}\n{errors}')
    task = load_scene("mm_gym/PreStretchRobust-v0")
    for kept in found.sensors.channels:
        field = f"sensors.noise.{kept}"
        assert found.sensors.noise.get(kept) == task.sensors.noise.get(kept)
        assert found.randomization.get(field) == task.randomization.get(field)
    assert set(found.sensors.noise) <= set(found.sensors.channels)
    with pytest.raises(SceneError, match=r"sensors\.bias\.sphere_offset: has no effect"):
        load(f'base = "PreStretchRobust"\n[sensors]\n{channels}\n{errors}sphere_offset = 0.1\n')


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            'base = "CarriageForse"',
            "own.toml:1: base: got 'CarriageForse'; did you mean 'CarriageForce'",
        ),
        ('\nbase = "other.toml"', "own.toml:2: base: got 'other.toml'"),
        ("base = 3", "own.toml:1: base: got 3; allowed: the name of a task, in quotes"),
        (
            'base = "Hybrid"\n[carriage]\nmas = 1',
            "own.toml:3: carriage.mas: unknown key; did you mean 'mass'",
        ),
        (
            'base = "Hybrid"\n[carriage]\nmass = -1',
            "own.toml:3: carriage.mass: got -1; allowed: greater",
        ),
        (
            'base = "Hybrid"\n[excitation]\nkind = "noise"',
            "own.toml:3: excitation.kind: there is no entry",
        ),
        ('bass = "Hybrid"', "own.toml:1: bass: unknown key; did you mean 'base'"),
        ('carriage = 3\nbase = "Hybrid"', "own.toml:1: carriage: got 3"),
        ('base = "Hybrid"\n[carrriage]\n', "own.toml:2: carrriage: unknown key"),
        ('base = "Hybrid"\n[excitation]\n', "own.toml:2: excitation: got {}"),
        (
            'base = "Hybrid"\n[randomization]\ncarriage.mass = [0.1, 0.2]',
            "own.toml:3: randomization.carriage: got {'mass': [0.1, 0.2]}",
        ),
        ('base = "Hybrid"\n"" = 1', "own.toml:2: '': unknown key"),
    ],
)
def test_findings_have_line_field_and_nearest_name(load, text, message):
    with pytest.raises(SceneError) as caught:
        load(text)
    assert message in str(caught.value)


def test_task_has_no_base_so_there_is_no_cycle(tmp_path, monkeypatch):
    assert not any("base" in read_toml(path_of(task)) for task in ids())
    monkeypatch.setattr("mm_gym.tasks.FOLDER", tmp_path)
    (tmp_path / "round.toml").write_text('base = "Round"\n')
    (tmp_path / "own.toml").write_text('base = "Round"\n')
    with pytest.raises(SceneError, match="base: unknown key"):
        load_scene("mm_gym/Round-v0")
    with pytest.raises(SceneError, match="base: unknown key"):
        load_scene(tmp_path / "own.toml")


def test_schema_completes_the_tasks():
    schema = json.loads(scene_schema())
    jsonschema.validate({"base": QUAKE, "carriage": {"mass": 0.2}}, schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({"base": "mm_gym/None-v0"}, schema)
    assert schema["properties"]["base"]["enum"][: len(ids())] == ids()


def test_commands_take_such_a_file(load, tmp_path, capsys):
    load('base = "CarriageForce"\n[carriage]\nmass = 0.2\n')
    assert main(["validate", str(tmp_path / "own.toml")]) == 0
    assert main(["explain", str(tmp_path / "own.toml")]) == 0
    assert "valid" in capsys.readouterr().out
