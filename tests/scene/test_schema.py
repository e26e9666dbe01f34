"""Editors are told what a scene file may hold, and the same as `load_scene` holds them to."""

import json
import tomllib

import jsonschema
import pytest

from mm_gym import Scene, SceneError
from mm_gym.__main__ import main
from mm_gym.scene.schema import scene_schema
from mm_gym.tasks import FOLDER

FILES = sorted(FOLDER.glob("*.toml"))
DRAFTS = [jsonschema.Draft7Validator, jsonschema.Draft202012Validator]
SCHEMA = json.loads(scene_schema())
FILE = FOLDER / "scene.schema.json"


def accepted(data):
    """Whether the schema accepts the data; both drafts must agree."""
    verdicts = {draft(SCHEMA).is_valid(data) for draft in DRAFTS}
    assert len(verdicts) == 1
    return verdicts.pop()


def loads(data):
    try:
        Scene(**data)
    except SceneError:
        return False
    return True


def test_committed_schema_is_up_to_date():
    command = "python -m mm_gym schema > mm_gym/tasks/scene.schema.json"
    assert FILE.read_text("utf-8") == scene_schema(), f"run `{command}`"


def test_command_prints_the_schema(capsys):
    assert main(["schema"]) == 0
    assert capsys.readouterr().out == scene_schema()


@pytest.mark.parametrize("draft", DRAFTS)
def test_schema_is_valid(draft):
    draft.check_schema(SCHEMA)


@pytest.mark.parametrize("file", FILES, ids=[file.stem for file in FILES])
def test_scene_files_name_the_schema_and_fit_it(file):
    text = file.read_text("utf-8")
    first, _, path = text.split("\n", 1)[0].partition(" ")
    assert first == "#:schema"
    assert (file.parent / path).samefile(FILE)
    assert accepted(tomllib.loads(text))


def without_none(data):
    if isinstance(data, dict):
        return {key: without_none(value) for key, value in data.items() if value is not None}
    return [without_none(value) for value in data] if isinstance(data, list) else data


def test_every_default_fits():
    assert accepted({})
    assert accepted(without_none(Scene().model_dump(mode="json")))


DRY = {"kind": "dry_friction", "static_coefficient": 1, "kinetic_coefficient": 1}
HARMONIC = {"kind": "harmonic", "amplitude": 1.0, "frequency": 5.0}


@pytest.mark.parametrize(
    "data",
    [
        {"carriage": {"mass": 1}},
        {"interface": {"kind": "none"}},
        {"interface": DRY | {"reference_velocity": 1, "normal_force": 2.0}},
        {"initial": {"sphere_offset": [-1, 1.5]}},
        {"excitation": [HARMONIC, HARMONIC]},
        {"randomization": {"carriage.mass": [1, 2], "interface.damping": [0, 1]}},
        {"excitation": [HARMONIC], "randomization": {"excitation.0.phase": [0, 1.0]}},
        {"sensors": {"channels": ["carriage_velocity"]}},
        {"objective": {"rail_half_length": 0.1}},
    ],
)
def test_schema_accepts_what_loads(data):
    assert loads(data)
    assert accepted(data)


@pytest.mark.parametrize(
    "data",
    [
        {"carrage": {}},
        {"carriage": {"mas": 1}},
        {"carriage": 1},
        {"carriage": {"mass": "1"}},
        {"carriage": {"mass": True}},
        {"carriage": {"mass": None}},
        {"carriage": {"mass": [1, 2]}},
        {"carriage": {"mass": -1}},
        {"sphere": {"mass": 0}},
        {"interface": {}},
        {"interface": {"damping": 1.0}},
        {"interface": {"kind": "viscos"}},
        {"interface": {"kind": "none", "damping": 1}},
        {"interface": DRY},
        {"springs": {"kind": "small_on_large", "stretch": 0.9}},
        {"excitation": HARMONIC},
        {"excitation": [{"amplitude": 1.0}]},
        {"excitation": [HARMONIC | {"target": "floor"}]},
        {"initial": {"sphere_offset": [0]}},
        {"initial": {"sphere_offset": [0, 1, 2]}},
        {"initial": {"sphere_offset": [0, "1"]}},
        {"sensors": {"channels": []}},
        {"sensors": {"channels": ["speed"]}},
        {"control": {"steps": 1.5}},
        {"solver": {"method": "tailor"}},
        {"solver": {"tolerance": 1}},
        {"randomization": {"carriage.mas": [1, 2]}},
        {"randomization": {"carriage": {"mass": [1, 2]}}},
        {"randomization": {"carriage.mass": 1}},
        {"randomization": {"initial.sphere_offset": [1, 2]}},
        {"randomization": {"objective.effort_weight": [1, 2]}},
        {"randomization": {"control.time_step": [1, 2]}},
        {"randomization": {"solver.tolerance": [0.1, 0.2]}},
        {"actuation": {"force": {}}, "randomization": {"actuation.force.limit": [1, 2]}},
        {"randomization": {"excitation.x.phase": [1, 2]}},
        {"randomization": {"excitation.0.phase.x": [1, 2]}},
    ],
)
def test_schema_refuses_what_does_not_load(data):
    assert not loads(data)
    assert not accepted(data)


def fields(node):
    """Every field that the schema describes."""
    for child in node.values() if isinstance(node, dict) else node:
        if isinstance(child, dict | list):
            yield from fields(child)
    if isinstance(node, dict) and isinstance(node.get("properties"), dict):
        yield from node["properties"].items()


def test_numbers_of_the_scene_are_described():
    described = [name for name, field in fields(SCHEMA["$defs"]) if "description" in field]
    assert {"mass", "stiffness", "tolerance", "rail_half_length"} <= set(described)
    assert "null" not in scene_schema()


@pytest.mark.parametrize("name", ["CarriageForce", "mm_gym/HybridRobust-v0", "HybridRobust"])
def test_every_name_of_a_task_is_a_base(name):
    jsonschema.validate({"base": name}, json.loads(scene_schema()))
