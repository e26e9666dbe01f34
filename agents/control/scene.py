"""What a controller knows of its scene: the plant, the middle of ranges, what must be there."""

from collections.abc import Callable, Iterable
from math import inf

import numpy as np

from mm_gym import DesignError, Plant, Scene, compile_scene
from mm_gym.analysis import spring_force
from mm_gym.arrays import Array
from mm_gym.errors import refuse

STATES = ("x1", "x2", "v1", "v2")

FADED = 1e-6  # of a motion after a control step; less is round-off

ENDLESS = {"objective.displacement_limit": None, "objective.rail_half_length": None}
"""Changes of a scene by which no motion ends an episode."""

USUAL = np.sqrt(400.0 / 0.1)  # natural frequency of the tasks whose springs change [rad/s]

PARTS = "carriage.", "sphere.", "interface.", "springs."
"""What a rig is made of."""

MOST_PLANTS = 32
_PLANTS: dict[str, Plant] = {}


def drawn_but(scene: Scene, *prefixes: str) -> dict[str, tuple[float, float]]:
    """Return what a scene draws, but for names that begin so: "sensors." of other sensors."""
    drawn = scene.randomization.items()
    return {name: ends for name, ends in drawn if not name.startswith(prefixes)}


def nominal(scene: Scene, name: str) -> float:
    """Return a number by dotted name or, if it is drawn, the middle of its range.

    What is not stated is infinite, as a rate limit is.
    """
    stated = scene.value_of(name)
    return float(np.mean(scene.range_of(name, np.inf if stated is None else stated)))


def internal_force(scene: Scene) -> Array:
    """Return what 1 N on the carriage and -1 N on the sphere adds to x1', x2', v1', v2' (4,)."""
    masses = (nominal(scene, f"{body}.mass") for body in ("carriage", "sphere"))
    on_carriage, on_sphere = (1.0 / mass for mass in masses)
    return np.array([0.0, 0.0, on_carriage, -on_sphere])


def natural_frequency(scene: Scene) -> float:
    """Return that of the carriage on its spring [rad/s]."""
    stiffness, mass = (nominal(scene, f"carriage.{one}") for one in ("stiffness", "mass"))
    return float(np.sqrt(stiffness / mass))


def pace(scene: Scene) -> float:
    """Return the natural frequency over that of the tasks whose springs change [-].

    A rate times this number does as much in a period of any carriage as the rate does there.
    """
    return float(natural_frequency(scene) / USUAL)


def beginning(scene: Scene, actuator: str) -> float:
    """Return what an actuator has when an episode begins, the middle of a range."""
    if actuator == "force":
        return 0.0
    if actuator == "stretch":
        start = scene.initial.stretch
        return float(np.mean(scene.springs.stretch if start is None else start))
    return nominal(scene, str(scene.actuation.damped))


def sphere_springs(scene: Scene) -> Callable[[Array], Array]:
    """Return the springs' force [N] on the carriage over relative displacements x2 - x1 [m].

    The sphere feels the opposite. See (5) and (6) of docs/model.md.
    """
    kind = scene.springs.kind
    if kind == "none":
        return np.zeros_like
    stiffness = nominal(scene, "springs.stiffness")
    if kind == "linear":
        cubic = nominal(scene, "springs.cubic_coefficient")
        return lambda offset: stiffness * (1.0 + cubic * offset**2) * offset
    stretch = nominal(scene, "springs.stretch")
    length = nominal(scene, "springs.rest_length") if kind == "finite_stretch" else 0.0
    return lambda offset: spring_force(offset, stretch, stiffness, length)


def plant_of(scene: Scene) -> Plant:
    """Return what a scene compiles to, once for all scenes of one content."""
    key = scene.digest
    if key not in _PLANTS:
        if len(_PLANTS) == MOST_PLANTS:
            _PLANTS.pop(next(iter(_PLANTS)))
        _PLANTS[key] = compile_scene(scene)
    return _PLANTS[key]


def periods(scene: Scene) -> Array:
    """Return the periods (n,) of the modes of the linear plant that turn, in control steps [-].

    Without mass there is no A: those of the sampled plant, which are of two steps or more.
    """
    plant = plant_of(scene)
    if nominal(scene, "carriage.mass") > 0.0:
        angles = np.linalg.eigvals(plant.linear()[0]).imag * scene.control.time_step
    else:
        values = np.linalg.eigvals(plant.discrete()[0])
        angles = np.angle(values[(values.imag != 0.0) & (np.abs(values) > FADED)])
    return 2.0 * np.pi / np.abs(angles[angles != 0.0])


def require_actuator(scene: Scene, name: str) -> None:
    """Raise `DesignError` if the scene lacks an actuator: "force", "stretch" or "damping"."""
    if getattr(scene.actuation, name) is None:
        msg = f"actuation.{name}: missing; the scene must have a {name} actuator"
        raise DesignError(msg)


def require_number(name: str, value: float, low: float = 0.0, high: float = inf) -> None:
    """Raise `DesignError` unless a number is finite, at least `low` and at most `high`."""
    if not (low <= value <= high and abs(value) < inf):
        end = "" if high == inf else f" and at most {high:g}"
        refuse(name, f"{value!r}", f"a finite number of at least {low:g}{end}", DesignError)


def force_weight(scene: Scene, held: Iterable[str] = ()) -> float:
    """Return the cost of the force [1/N^2].

    Raise `DesignError` if there is no force, it is commanded by its rate or costs nothing, or if
    next to it is a damping or voltage whose dotted name is not among those that are held.
    """
    actuator, weight = scene.actuation.force, scene.objective.effort_weight
    if actuator is None:
        msg = (
            "actuation.force: missing; "
            "a regulator needs a force (a stretch or a damping is no input of the linear plant: it "
            "multiplies the state)"
        )
        raise DesignError(msg)
    if scene.actuation.damped not in (None, *held):
        msg = (
            f"actuation.{scene.actuation.names[-1]}: a regulator commands only the force; a "
            "damping multiplies the state, so it is no input of the linear plant"
        )
        raise DesignError(msg)
    if actuator.command == "rate":
        refuse("actuation.force.command", "'rate'", "'position'", DesignError)
    if weight == 0.0:
        msg = (
            "objective.effort_weight: got 0; "
            "allowed: greater than 0 (the Riccati equation needs a weight on the force)"
        )
        raise DesignError(msg)
    return weight / actuator.limit**2
