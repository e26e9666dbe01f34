"""Scenes in words and tables, as Markdown: observation, action, reward, parts and plant."""

from __future__ import annotations

import re

from agents.report.pages import render
from mm_gym import Scene, compile_scene
from mm_gym.scene import Part

TARGETS = ("force", "ground")  # in the order in which docstrings give the units of an amplitude


def describe(scene: Scene) -> str:
    """Return observation, action, reward, disturbance, start and plant of a scene as Markdown."""
    objective = scene.objective
    limits = {"x1": objective.displacement_limit, "x2 - x1": objective.rail_half_length}
    drawn = {f"initial.{name}": value for name, value in scene.initial}
    drawn |= {str(name): ends for name, ends in scene.randomization.items()}
    return render(
        "scene",
        sensors=scene.sensors,
        actuation=scene.actuation,
        control=scene.control,
        plant=compile_scene(scene),
        reward=_reward(scene),
        parts=_parts(scene),
        drawn=[
            [name, f"{value[0]:.6g}", f"{value[1]:.6g}"]
            for name, value in drawn.items()
            if isinstance(value, tuple)
        ],
        ends=[f"|{what}| exceeds {most:g} m" for what, most in limits.items() if most is not None],
    ).rstrip("\n")


def _reward(scene: Scene) -> str:
    objective = scene.objective
    terms = [
        (objective.displacement_weight, f"(x1 / {objective.displacement_scale:g} m)^2"),
        (objective.velocity_weight, f"(v1 / {objective.velocity_scale:g} m/s)^2"),
        (objective.stroke_weight, f"((x2 - x1) / {objective.stroke_scale:g} m)^2"),
        (objective.effort_weight, "(sum of squared actions)"),
        (
            objective.carriage_acceleration_weight,
            f"(a1 / {objective.carriage_acceleration_scale:g} m/s^2)^2",
        ),
        (
            objective.sphere_acceleration_weight,
            f"(a2 / {objective.sphere_acceleration_scale:g} m/s^2)^2",
        ),
        (
            objective.coupling_force_weight,
            f"(force between the masses / {objective.coupling_force_scale:g} N)^2",
        ),
    ]
    return " + ".join(
        text if weight == 1.0 else f"{weight:g} {text}" for weight, text in terms if weight
    )


def _parts(scene: Scene) -> list[list[str]]:
    parts: list[tuple[str, Part]] = [
        ("carriage", scene.carriage),
        ("sphere", scene.sphere),
        ("interface", scene.interface),
        ("springs", scene.springs),
    ]
    parts += [(f"excitation.{i}", part) for i, part in enumerate(scene.excitation)]
    rows = [[name, _fields(part)] for name, part in parts]
    if not scene.excitation:
        rows.append(["excitation", "none"])
    return rows


def _fields(part: Part) -> str:
    words: list[str] = []
    for name, value in part:
        if name == "kind":
            words.insert(0, str(value).replace("_", " "))
        elif value is not None:
            words.append(f"{name.replace('_', ' ')} {_number(value)}{_unit(part, name)}")
    return ", ".join(words)


def _unit(part: Part, name: str) -> str:
    """Return the unit from the field's docstring; of two, the second is that of ground motion."""
    units = re.findall(r"\[([^\]]+)\]", type(part).model_fields[name].description or "")
    second = len(units) == len(TARGETS) and getattr(part, "target", None) == "ground"
    unit = units[second] if units else "-"
    return "" if unit == "-" else f" {unit}"


def _number(value: object) -> str:
    if isinstance(value, tuple):
        return f"{value[0]:g} to {value[1]:g}"
    return f"{value:g}" if isinstance(value, float) else str(value).replace("_", " ")
