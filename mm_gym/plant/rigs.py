"""A scene over a distribution of rigs: what a laboratory's differ in from the scene, and by day."""

from __future__ import annotations

from collections.abc import Iterator

from mm_gym.plant.compile import compile_scene
from mm_gym.scene.mechanics import GRAVITY
from mm_gym.scene.scene import DELAY, Scene, bounds, require_scene

UNSURE = {
    "carriage": ("mass", "stiffness", "damping"),
    "sphere": ("mass",),
    "interface": ("stiffness", "damping", "static_coefficient", "kinetic_coefficient"),
    "springs": ("stiffness",),
}
"""Part -> its fields that rigs differ in."""

REPORTED = ("stretch", "damping", "voltage", "applied_force")
"""Channels that an actuator reports itself, without noise."""


def over_rigs(
    scene: Scene, *, spread: float = 0.2, delay: int = 2, noise: float = 0.01, lag: float = 1.0
) -> Scene:
    """Return a scene whose episodes are on rigs that differ in what is not known of a rig.

    Parameters
    ----------
    scene
        The scene. What it states stays the middle of masses, stiffnesses, damping and friction; a
        range that it draws from becomes wider.
    spread
        Largest relative deviation of each of these [-], independent of the others.
    delay
        Largest delay of the sensors in control steps, added to the delay that the scene states.
    noise
        Largest standard deviation of each measured channel over its scale [-], added to the noise
        that the scene states.
    lag
        Largest lag of each actuator in control steps, added to the lag that the scene states.

    Raises
    ------
    SceneError
        If the scene does not allow one of the ranges: the field, and why.
    CompileError
        If no plant covers the scene.
    """
    require_scene(scene)
    ranges: dict[str, tuple[float, float]] = {}
    for name, (low, high) in _unsure(scene):
        ranges[name] = _short(low * (1.0 - spread)), _short(high * (1.0 + spread))
    least, most = bounds(scene.range_of(DELAY, float(scene.sensors.delay)))
    ranges[DELAY] = least, most + delay
    for channel in compile_scene(scene).observed:
        if channel.name not in REPORTED and noise > 0.0:
            field = f"sensors.noise.{channel.name}"
            own = scene.sensors.noise.get(channel.name, 0.0)
            low, high = bounds(scene.range_of(field, own))
            ranges[field] = low, _short(high + noise / channel.factor)
    for name, actuator in scene.actuation:
        if actuator is not None and lag > 0.0:
            low, high = bounds(scene.range_of(f"actuation.{name}.lag", actuator.lag))
            ranges[f"actuation.{name}.lag"] = low, _short(high + lag * scene.control.time_step)
    of_rig = ("sensors.", "actuation.")
    stated: dict[str, float] = {
        name: _short(0.5 * (low + high))
        for name, (low, high) in ranges.items()
        if name.startswith(of_rig)
    }
    stated[DELAY] = int(stated[DELAY] + 0.5)
    if getattr(scene.interface, "normal_force", 0.0) is None:  # it would follow from the mass
        stated["interface.normal_force"] = _short(scene.sphere.mass * GRAVITY)
    return scene.replace(**stated, randomization={**scene.randomization, **ranges})


def _unsure(scene: Scene) -> Iterator[tuple[str, tuple[float, float]]]:
    """Yield the dotted name and the range of each positive number that rigs differ in.

    A number that follows from a ratio differs with the other number.
    """
    follow = [field for field, _ in scene.drawn_ratios.values()]
    for part, fields in UNSURE.items():
        for field in fields:
            name, value = f"{part}.{field}", scene.value_of(f"{part}.{field}")
            if value and name not in follow:
                yield name, bounds(scene.range_of(name, value))


def _short(value: float) -> float:
    """Return a number with six digits, for a reader."""
    return float(f"{value:.6g}")
