"""Scenes in words and tables, as Markdown: observation, action, reward, parts and plant."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from agents.report.tables import markdown
from mm_gym import compile_scene

if TYPE_CHECKING:
    from mm_gym import Scene
    from mm_gym.scene import Actuator, Part

TARGETS = ("force", "ground")
"""In the order in which docstrings give the units of an amplitude."""


def describe(scene: Scene) -> str:
    """Return observation, action, reward, disturbance, start and plant of a scene as Markdown."""
    sections = [
        ("Observation", _observation(scene)),
        ("Action", _action(scene)),
        ("Reward", _reward(scene)),
        ("Scene", _parts(scene)),
        ("Drawn for each episode", _drawn(scene)),
        ("Episode", _episode(scene)),
        (
            "Plant",
            f"The simplest sufficient model:\n\n```text\n{compile_scene(scene).explain()}\n```",
        ),
    ]
    return "\n\n".join(f"**{title}.** {text}" for title, text in sections)


def _observation(scene: Scene) -> str:
    sensors = scene.sensors
    size = sensors.history * len(sensors.channels)
    frames = (
        "the present frame"
        if sensors.history == 1
        else f"the last {sensors.history} frames, oldest first"
    )
    late = f", {sensors.delay} control steps late" if sensors.delay else ""
    rows = [
        [channel.name, channel.unit, f"{channel.zero:g}", f"{channel.one:g}", f"{channel.noise:g}"]
        for channel in compile_scene(scene).observed
    ]
    header = ["channel", "unit", "shown as 0", "shown as 1", "standard deviation of the noise"]
    return f"{size} numbers: {frames}{late}.\n\n{markdown(header, rows)}"


def _action(scene: Scene) -> str:
    force, stretch = scene.actuation.force, scene.actuation.stretch
    rows: list[list[str]] = []
    if force is not None:
        where = "between the masses" if force.between == "masses" else "on the carriage"
        rows.append([f"force {where}", "N", f"{-force.limit:g}", f"{force.limit:g}"])
        rows[-1] += _motion(force)
    if stretch is not None:
        rows.append(["stretch of the springs", "-", f"{stretch.minimum:g}", f"{stretch.maximum:g}"])
        rows[-1] += _motion(stretch)
    if (damping := scene.actuation.damping) is not None:
        ends = f"{damping.minimum:g}", f"{damping.maximum:g}"
        rows.append([f"damping of the {damping.of}", "N s/m", *ends, *_motion(damping)])
    if (voltage := scene.actuation.voltage) is not None:
        ends = f"{voltage.minimum:g}", f"{voltage.maximum:g}"
        rows.append(["voltage of the interface", "V", *ends, *_motion(voltage)])
    header = ["column", "unit", "least", "most", "an action of 1 means", "rate limit", "lag"]
    count = "1 number" if len(rows) == 1 else f"{len(rows)} numbers"
    return f"{count} in [-1, 1].\n\n{markdown(header, rows)}"


def _motion(actuator: Actuator) -> list[str]:
    rate = "none" if actuator.rate_limit is None else f"{actuator.rate_limit:g} per s"
    meaning = "the most" if actuator.command == "position" else "the rate limit"
    return [meaning, rate, f"{actuator.lag:g} s" if actuator.lag else "none"]


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
    weighted = " + ".join(
        text if weight == 1.0 else f"{weight:g} {text}" for weight, text in terms if weight
    )
    return f"-({weighted}), from the state at the step's end and the clipped action."


def _parts(scene: Scene) -> str:
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
    return f"All values, defaults included.\n\n{markdown(['part', 'values'], rows)}"


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


def _drawn(scene: Scene) -> str:
    drawn = {f"initial.{name}": value for name, value in scene.initial}
    drawn |= {str(name): ends for name, ends in scene.randomization.items()}
    rows = [
        [name, f"{value[0]:.6g}", f"{value[1]:.6g}"]
        for name, value in drawn.items()
        if isinstance(value, tuple)
    ]
    if not rows:
        return "Nothing."
    return f"Uniformly and independently.\n\n{markdown(['field', 'from', 'to'], rows)}"


def _episode(scene: Scene) -> str:
    control, objective = scene.control, scene.objective
    ends = [
        f"|{symbol}| exceeds {limit:g} m"
        for symbol, limit in (
            ("x1", objective.displacement_limit),
            ("x2 - x1", objective.rail_half_length),
        )
        if limit is not None
    ]
    early = f"Terminates when {' or '.join(ends)}." if ends else "Never terminates early."
    return f"{control.steps} control steps of {control.time_step:g} s, then truncated. {early}"


def _number(value: object) -> str:
    if isinstance(value, tuple):
        return f"{value[0]:g} to {value[1]:g}"
    return f"{value:g}" if isinstance(value, float) else str(value).replace("_", " ")
