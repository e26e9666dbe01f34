"""The page with every field of a scene, from the schema that editors use."""

from __future__ import annotations

import json
import re

from mm_gym.scene.schema import scene_schema

HEADER = """# Scene fields

Made from the schema that `python -m mm_gym schema` prints. A field without a default must be
stated. [Scene files](../scenes.md) tells how files are written and checked.
"""
HEAD = ["| field | meaning | allowed | default |", "|---|---|---|---|"]
BOUNDS = {
    "exclusiveMinimum": "above {}",
    "minimum": "at least {}",
    "exclusiveMaximum": "below {}",
    "maximum": "at most {}",
    "minItems": "at least {}",
    "maxItems": "at most {} entries",
}

DIGITS = 8
"""Most digits and signs of a number that is printed as it is."""

Node = dict[str, object]


def scene_fields() -> str:
    """Return the page: a section for each table of a scene file, one for each of its kinds."""
    schema = json.loads(scene_schema())
    parts = [HEADER]
    for name, field in schema["properties"].items():
        models = [schema["$defs"][one] for one in _references(field)]
        parts.append(f"## {name}\n\n{_sentence(field.get('description', ''))}\n")
        for model in models:
            kind = model["properties"].get("kind", {}).get("const")
            if kind:
                parts.append(f'### `{name}.kind = "{kind}"`\n')
            parts.append(
                f"{_paragraphs(model.get('description', ''))}\n\n{_table(model, schema)}\n"
            )
    return "\n".join(parts)


def _table(model: Node, schema: Node) -> str:
    """Return a row for each field; those of a part within it have dotted names."""
    rows = [f"| {' | '.join(row)} |" for row in _rows(model, schema, "")]
    return "\n".join(HEAD + rows if rows else [])


def _rows(model: Node, schema: Node, prefix: str) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for name, field in model["properties"].items():
        if "const" in field:
            continue
        parts = _references(field)
        if parts:
            for part in parts:
                rows += _rows(schema["$defs"][part], schema, f"{prefix}{name}.")
            continue
        required = name in model.get("required", ())
        default = "" if required else f"`{_value(field.get('default'))}`"
        rows.append(
            (
                f"`{prefix}{name}`",
                _cell(field.get("description", "")),
                _allowed(field),
                default,
            )
        )
    return rows


def _references(node: object) -> list[str]:
    """Return the names of the models that a field refers to, in order."""
    if isinstance(node, dict):
        own = [node["$ref"].rpartition("/")[2]] if "$ref" in node else []
        nested = [node[key] for key in ("anyOf", "oneOf", "allOf", "items") if key in node]
        return own + [name for one in nested for name in _references(one)]
    if isinstance(node, list):
        return [name for one in node for name in _references(one)]
    return []


def _allowed(field: Node) -> str:
    """Return the range, the values, or the type of a field."""
    choices = [_allowed(one) for one in field.get("anyOf", ()) if one.get("type") != "null"]
    if choices:
        return " or ".join(dict.fromkeys(choices))
    if "enum" in field:
        return ", ".join(f"`{one}`" for one in field["enum"])
    if field.get("minItems") == field.get("maxItems") == 2:  # noqa: PLR2004 - the ends of a range
        return "[low, high]"
    bounds = [text.format(_value(field[key])) for key, text in BOUNDS.items() if key in field]
    kind = {"array": "list", "object": "table"}.get(field.get("type", ""), field.get("type", ""))
    inner = field.get("items", {})
    if kind == "list" and isinstance(inner, dict) and inner:
        kind = f"list of {_allowed(inner)}"
    return ", ".join([kind, *bounds]) if kind != "number" or not bounds else ", ".join(bounds)


def _value(value: object) -> str:
    """Return a value as a scene file writes it, numbers with at most six digits."""
    if isinstance(value, float | int) and not isinstance(value, bool) and len(f"{value}") > DIGITS:
        return f"{value:.6g}"
    return (
        {True: "true", False: "false", None: "none"}.get(value, value)
        if isinstance(value, bool | None)
        else f"{value}"
    )


def _sentence(text: str) -> str:
    """Return a field's description as a sentence."""
    text = _cell(text)
    return f"{text[:1].upper()}{text[1:]}." if text and not text.endswith(".") else text


def _paragraphs(text: str) -> str:
    """Return a description with its paragraphs; a formula is set as one."""
    parts = text.split("\n\n")
    return "\n\n".join(
        f"```none\n{one}\n```" if re.match(r"\w+ = ", one) else _cell(one) for one in parts
    )


def _cell(text: str) -> str:
    """Return text that fits into one cell of a table; names of pages become links."""
    text = " ".join(text.split()).replace("|", "\\|").replace("*", "\\*")
    return re.sub(r"`?docs/([\w-]+)\.md`?", r"[\1](../\1.md)", text)
