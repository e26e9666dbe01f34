"""The JSON schema of scene files, by which editors complete and check them.

A schema cannot express the rules across fields, nor that 10.0 is no integer: `load_scene` checks
these.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import TypeAlias, cast, get_args, get_origin

from mm_gym.scene.excitation import FIXED_FIELDS
from mm_gym.scene.part import Part, parts_of
from mm_gym.scene.scene import DELAY, ERRORS, Scene
from mm_gym.step.channels import CHANNELS
from mm_gym.tasks import ids, robust_ids, short_name

Node: TypeAlias = "Object | list[Node] | str | float | bool | None"
Object: TypeAlias = "dict[str, Node]"

DRAFT = "http://json-schema.org/draft-07/schema#"
"""All editors of TOML read this draft; what is used of it means the same in later ones."""

BEGINS = "task with which the scene begins; the file states what differs"


def scene_schema() -> str:
    """Return the JSON schema of a scene file, generated from the models of `Scene`."""
    schema = cast("Object", Scene.model_json_schema())
    _require_kinds(schema, cast("dict[str, Object]", schema["$defs"]))
    schema = cast("Object", _plain(schema))
    _name_drawn(cast("dict[str, Object]", schema["properties"])["randomization"])
    names = [*ids(), *robust_ids()]
    base: Object = {"description": BEGINS, "enum": [*names, *map(short_name, names)]}
    schema["properties"] = {"base": base, **cast("Object", schema["properties"])}
    schema = {"$schema": DRAFT, "title": "Scene of mm_gym", **schema}
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


NEVER_DRAWN = {"objective", "control", "solver", *FIXED_FIELDS, "initial", "scale_to"}
"""Parts and fields of no number that `randomization` may name; the last two take ranges."""


def _name_drawn(randomization: Object) -> None:
    """Allow only the dotted names of a scene's numbers as keys of the randomisation."""
    drawn = randomization["additionalProperties"]
    errors = (f"sensors.{what}.{channel}" for what in ERRORS for channel in CHANNELS)
    numbers = (name for name in _numbers(Scene) if not NEVER_DRAWN.intersection(name.split(".")))
    names = dict.fromkeys((*numbers, DELAY, *errors), drawn)
    randomization |= {
        "properties": {name: drawn for name in names if INDEX not in name},
        "patternProperties": {
            f"^{re.escape(name).replace(re.escape(INDEX), '[0-9]+')}$": drawn
            for name in names
            if INDEX in name
        },
        "additionalProperties": False,
    }


def _require_kinds(node: Node, parts: dict[str, Object]) -> None:
    """Require the kind of each alternative, for which pydantic states a default."""
    children = node.values() if isinstance(node, dict) else node if isinstance(node, list) else ()
    if isinstance(node, dict) and "discriminator" in node:
        told = cast("dict[str, dict[str, str]]", node.pop("discriminator"))
        for place in told["mapping"].values():
            part = parts[place.rpartition("/")[2]]
            part["required"] = ["kind", *cast("list[Node]", part.get("required", []))]
    for child in children:
        _require_kinds(child, parts)


def _plain(node: Node, *, names: bool = False) -> Node:
    """Return a node without null, which TOML does not have, and without redundant entries."""
    if isinstance(node, list):
        return [_plain(child) for child in node]
    if not isinstance(node, dict):
        return node
    if names:  # the keys are names of fields, not keywords of the schema
        return {name: _plain(child) for name, child in node.items()}
    node = {key: child for key, child in node.items() if key not in {"title", "discriminator"}}
    if node.get("default", 0) is None or isinstance(node.get("default"), dict):
        del node["default"]
    if node.get("type") == "array":  # pydantic writes minLength if a validator precedes the bound
        node = {key.replace("Length", "Items"): child for key, child in node.items()}
    if "prefixItems" in node:  # both ends of a range have the same type
        node["items"] = cast("list[Node]", node.pop("prefixItems"))[0]
    if "anyOf" in node:
        options = [option for option in cast("list[Node]", node.pop("anyOf")) if option != NULL]
        node |= cast("Object", options[0]) if len(options) == 1 else {"anyOf": options}
    return {
        key: _plain(child, names=key in {"properties", "$defs", "patternProperties"})
        for key, child in node.items()
    }


NULL: Node = {"type": "null"}
INDEX = "*"  # placeholder for the index of a list's entry in a dotted name


def _numbers(part: type[Part], prefix: str = "") -> Iterator[str]:
    """Yield the dotted names of all numbers that a part can hold."""
    for name, field in part.model_fields.items():
        annotation, inner = field.annotation, list(parts_of(field.annotation))
        index = f"{INDEX}." if get_origin(annotation) is tuple else ""
        for other in inner:
            yield from _numbers(other, f"{prefix}{name}.{index}")
        if not inner and get_origin(annotation) is not dict and _is_number(annotation):
            yield prefix + name
    yield from (prefix + name for name in part.ratios)


def _is_number(annotation: object) -> bool:
    return annotation is float or any(map(_is_number, get_args(annotation)))
