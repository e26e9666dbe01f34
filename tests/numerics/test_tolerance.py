"""Does the error of every control step stay below the tolerance?"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from mm_gym import CompileError, Scene, SimulationError, compile_scene
from mm_gym.lanes import layout
from mm_gym.lanes.simd import LANES
from mm_gym.simulation.lanes import Lanes
from mm_gym.simulation.recording import Recording, blank, lane_at, run

from .decimal_series import ControlStep

if TYPE_CHECKING:
    from collections.abc import Callable

STEPS = 10
CHECKED = (0, 4, 9)  # control steps of each episode that the reference follows


def _near(rng: np.random.Generator, middle: float, decades: float = 1.0) -> float:
    return float(middle * 10.0 ** rng.uniform(-decades, decades))


def splitting_scene(rng: np.random.Generator) -> Scene | None:
    """Return a random scene for the splitting, with a random tolerance; None if it is refused."""
    scene = random_scene(rng)
    springs = scene.springs.model_dump()
    if springs["kind"] == "finite_stretch":
        springs = {name: springs[name] for name in ("stiffness", "stretch")}
        springs["kind"] = "small_on_large"
    viscous = {"kind": "viscous", "damping": _near(rng, 0.3, 2.0)}
    interface = viscous if scene.interface.kind == "dry_friction" else scene.interface.model_dump()
    scene = scene.replace(
        springs=springs,
        interface=interface,
        excitation=[],
        **{
            "carriage.cubic_coefficient": scene.carriage.cubic_coefficient or _near(rng, 1e4, 3.0),
            "solver.method": "splitting",
            "solver.tolerance": float(10.0 ** rng.uniform(-12.0, -1.0)),
        },
    )
    try:
        compile_scene(scene)
    except CompileError:
        return None
    return scene


def series_scene(rng: np.random.Generator) -> Scene | None:
    """Return a random scene for the truncated series, whose stretch moves; None if refused."""
    scene = random_scene(rng)
    harmonics = [part for part in scene.excitation if part.target == "force"]
    low = float(rng.uniform(1.0, 2.0))
    scene = scene.replace(
        **{
            "carriage.cubic_coefficient": 0.0,
            "solver.method": "series",
            "solver.tolerance": float(10.0 ** rng.uniform(-12.0, -1.0)),
        },
        interface={"kind": "viscous", "damping": _near(rng, 0.3)},
        springs={"kind": "small_on_large", "stiffness": _near(rng, 35.0), "stretch": low},
        excitation=[part.model_dump() for part in harmonics],
        actuation=scene.actuation.model_dump()
        | {"stretch": {"minimum": low, "maximum": low + float(rng.uniform(0.1, 2.0))}},
    )
    try:
        compile_scene(scene)
    except CompileError:
        return None
    return scene


def random_scene(rng: np.random.Generator) -> Scene:
    """Return a random scene for the Taylor series, with a random tolerance.

    Control steps span 0.05 to 10 radians of its fastest oscillation.
    """
    x1, offset = (_near(rng, 0.01) * float(rng.choice([-1.0, 1.0])) for _ in range(2))
    m1, k1 = _near(rng, 0.1), _near(rng, 400.0)
    springs = _springs(rng, offset)
    cubic = springs["kind"] != "finite_stretch" or rng.random() < 0.5
    # From a thousandth to a thousand times the linear spring's force.
    beta = _near(rng, x1**-2, 3.0) if cubic else 0.0
    k2 = 6.0 * springs.get("stiffness", 0.0)
    m2 = _near(rng, 0.04)
    rate = np.sqrt((k1 * (1.0 + 3.0 * beta * x1**2) + k2) / m1 + k2 / m2)
    data: dict[str, Any] = {
        "carriage": {"mass": m1, "stiffness": k1, "cubic_coefficient": beta},
        "sphere": {"mass": m2},
        "springs": springs,
        "interface": _interface(rng),
        "initial": {
            "carriage_displacement": x1,
            "sphere_offset": offset,
            "carriage_velocity": float(rng.choice([0.0, 1.0])) * rate * x1 * rng.uniform(-1.0, 1.0),
        },
        "control": {"time_step": float(10.0 ** rng.uniform(-1.3, 1.0) / rate), "steps": STEPS},
        "solver": {"method": "taylor", "tolerance": float(10.0 ** rng.uniform(-13.0, -3.0))},
        "excitation": [
            {
                "kind": "harmonic",
                "target": target,
                "amplitude": size * abs(x1) * rng.uniform(0.0, 1.0),
                "frequency": _near(rng, rate),
                "phase": float(rng.uniform(0.0, 6.0)),
            }
            for target, size in (("force", k1), ("ground", k1 / m1))
            if rng.random() < 0.3
        ],
    }
    data["carriage"]["damping"] = float(rng.choice([0.0, 1.0])) * _near(rng, 0.1 * m1 * rate)
    if rng.random() < 0.5:
        data["actuation"] = {"force": {"limit": k1 * abs(x1)}}
    return Scene(**data)


def _interface(rng: np.random.Generator) -> dict[str, Any]:
    kind = str(rng.choice(["none", "viscous", "dry_friction", "dry_friction"]))
    if kind != "dry_friction":
        return {"kind": kind} | ({"damping": _near(rng, 0.3)} if kind == "viscous" else {})
    static = _near(rng, 0.5)
    return {
        "kind": kind,
        "static_coefficient": static,
        "kinetic_coefficient": static * float(rng.uniform(0.1, 1.0)),
        "reference_velocity": _near(rng, 0.2),
        "slip_damping": float(rng.choice([0.0, 1.0])) * _near(rng, 0.1),
    }


def _springs(rng: np.random.Generator, offset: float) -> dict[str, Any]:
    kind = str(rng.choice(["none", "small_on_large", "finite_stretch", "finite_stretch"]))
    if kind == "none":
        return {"kind": kind}
    springs = {
        "kind": kind,
        "stiffness": _near(rng, 35.0),
        "stretch": float(rng.uniform(1.0, 3.0)),
    }
    if kind == "finite_stretch":
        springs["rest_length"] = abs(offset) * float(rng.uniform(1.5, 10.0))
    return springs


def excess(seed: int, scene_of: Callable[[np.random.Generator], Scene | None]) -> float:
    """Return the largest error of a random scene's control steps, relative to what is allowed.

    Allowed is the tolerance, plus round-off where that is exceeded: ten times the effect of
    rounding the reference's state to doubles. It matters where a spring is shortened to a
    thousandth of its length: there the stored positions have only some digits of the offset.
    """
    rng = np.random.default_rng(seed)
    scene = scene_of(rng)
    if scene is None:
        return 0.0
    plant = compile_scene(scene)
    limit = plant.task[layout.FORCE_LIMIT] if "force" in plant.actuators else 0.0
    stretches = plant.support.low[layout.STRETCH], plant.support.high[layout.STRETCH]
    lanes, worst = Lanes(plant, 1), 0.0
    lanes.restart()
    recording = blank(plant, lanes.values[:, 0].copy(), STEPS)
    for n in range(STEPS):
        force, stretch = rng.uniform(-limit, limit), lanes.values[layout.STRETCH, 0]
        if "stretch" in plant.actuators:
            stretch = rng.uniform(*stretches)
        run(lanes, np.array([[force, stretch]]), recording, n)
        if n in CHECKED:
            start, applied, end = recording.starts[n], recording.applied[n], recording.states[n + 1]
            step = ControlStep(scene, n * plant.time_step, *(float(x) for x in applied))
            want, scale = step.end(start)
            error, allowed = _largest(end - want, scale), scene.solver.tolerance
            if error > allowed:
                allowed += 10.0 * _largest(replace(step, rounded=True).end(start)[0] - want, scale)
            worst = max(worst, error / allowed)
    _assert_lanes_apart(recording)
    return worst


def _assert_lanes_apart(recording: Recording) -> None:
    """Assert that control steps side by side end as each alone, to the last bit."""
    plant, count = recording.plant, max(STEPS, LANES)
    many, one = Lanes(plant, count), Lanes(plant, 1)
    for i in range(count):
        many.values[:, [i]] = lane_at(recording, i % STEPS)
    many.raise_for(plant.entries.propagate(plant.model, many.values, 0, count))
    for i in range(STEPS):
        one.values[:] = lane_at(recording, i)
        one.raise_for(plant.entries.propagate(plant.model, one.values, 0, 1))
        assert np.array_equal(many.values[:4, i], one.values[:4, 0])


def _largest(difference: np.ndarray, scale: np.ndarray) -> float:
    return float((np.abs(difference) / scale).max())


def _violations(
    seeds: range, scene_of: Callable[[np.random.Generator], Scene | None]
) -> dict[int, float]:
    """Return the seeds whose error exceeds what is allowed, and by how much."""
    found: dict[int, float] = {}
    for seed in seeds:
        try:
            ratio = excess(seed, scene_of)
        except SimulationError:
            continue  # a spring of length 0
        if not ratio <= 1.0:
            found[seed] = ratio
    return found


@pytest.mark.parametrize("scene_of", [random_scene, splitting_scene, series_scene])
def test_error_of_a_control_step_is_below_the_tolerance(scene_of: Callable[..., Any]) -> None:
    assert _violations(range(100), scene_of) == {}


@pytest.mark.parametrize("scene_of", [random_scene, splitting_scene, series_scene])
def test_error_of_a_control_step_is_below_the_tolerance_in_a_thousand_scenes(
    scene_of: Callable[..., Any],
) -> None:
    assert _violations(range(1000), scene_of) == {}
