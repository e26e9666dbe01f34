"""Random scenes, each parameter log-uniform over ten decades."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mm_gym import CompileError, Scene, SceneError, SimulationError, compile_scene, simulate

if TYPE_CHECKING:
    from mm_gym.simulation.trajectory import Trajectory

STEPS = 20


def _between(rng: np.random.Generator, middle: float) -> float:
    """Return a value within five decades of the middle."""
    return float(middle * 10.0 ** rng.uniform(-5.0, 5.0))


def random_scene(rng: np.random.Generator) -> Scene:
    """Return a scene of random kinds and values; raise `SceneError` if they contradict."""
    data: dict[str, Any] = {
        "carriage": {
            "mass": _between(rng, 0.1),
            "stiffness": _between(rng, 400.0),
            "damping": float(rng.choice([0.0, 1.0])) * _between(rng, 1.0),
            "cubic_coefficient": float(rng.random() < 0.3) * _between(rng, 2e6),
        },
        "sphere": {"mass": _between(rng, 0.04)},
        "interface": _interface(rng),
        "springs": _springs(rng),
        "initial": {
            "carriage_displacement": _between(rng, 0.01) * float(rng.choice([-1.0, 1.0])),
            "sphere_offset": _between(rng, 0.01) * float(rng.choice([-1.0, 1.0])),
            "carriage_velocity": _between(rng, 0.1) * float(rng.choice([-1.0, 0.0, 1.0])),
            "sphere_velocity": _between(rng, 0.1) * float(rng.choice([-1.0, 0.0, 1.0])),
        },
        "control": {"time_step": _between(rng, 0.01), "steps": STEPS},
    }
    if rng.random() < 0.3:
        target = str(rng.choice(["force", "ground"]))
        data["excitation"] = [
            {
                "kind": "harmonic",
                "target": target,
                "amplitude": _between(rng, 1.0),
                "frequency": _between(rng, 60.0),
            }
        ]
    if rng.random() < 0.3:
        data["actuation"] = {"force": {"limit": _between(rng, 4.0)}}
    if rng.random() < 0.1:
        stiffness = data["carriage"]["stiffness"]
        data["randomization"] = {"carriage.stiffness": (stiffness, stiffness * (1.0 + 1e-15))}
    return Scene(**data)


def _interface(rng: np.random.Generator) -> dict[str, Any]:
    kind = str(rng.choice(["none", "viscous", "dry_friction", "dry_friction"]))
    if kind == "viscous":
        return {"kind": kind, "damping": _between(rng, 1.0)}
    if kind == "none":
        return {"kind": kind}
    static = _between(rng, 0.5)
    return {
        "kind": kind,
        "static_coefficient": static,
        "kinetic_coefficient": static * float(rng.uniform(0.01, 1.0)),
        "reference_velocity": _between(rng, 0.1),
        "slip_damping": float(rng.choice([0.0, 1.0])) * _between(rng, 0.1),
    }


def _springs(rng: np.random.Generator) -> dict[str, Any]:
    kind = str(rng.choice(["none", "none", "small_on_large", "finite_stretch"]))
    if kind == "none":
        return {"kind": kind}
    springs: dict[str, Any] = {
        "kind": kind,
        "stiffness": _between(rng, 35.0),
        "stretch": float(rng.uniform(1.0, 3.0)),
    }
    return springs | ({"rest_length": _between(rng, 0.03)} if kind == "finite_stretch" else {})


def forces_of(scene: Scene, seed: int) -> np.ndarray | None:
    """Return a random force for each control step, if the scene is actuated."""
    if scene.actuation.force is None:
        return None
    limit = scene.actuation.force.limit
    return np.random.default_rng(seed).uniform(-limit, limit, STEPS)


def attempt(scene: Scene, seed: int) -> tuple[str, Trajectory | None]:
    """Simulate; return "ok" and the trajectory, or the error's text and None."""
    try:
        plant = compile_scene(scene)
    except CompileError as error:
        return f"CompileError: {error}", None
    try:
        return "ok", simulate(plant, action=forces_of(scene, seed))
    except (SceneError, SimulationError) as error:
        return f"{type(error).__name__}: {error}", None
