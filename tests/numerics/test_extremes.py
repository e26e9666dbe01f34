"""Does every extreme scene give the right numbers or a named error?"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np
import pytest
from oracle import error

from mm_gym import (
    ActionError,
    CompileError,
    Scene,
    SceneError,
    SimulationError,
    compile_scene,
    simulate,
)
from mm_gym.env.single import MovingMassEnv
from mm_gym.lanes import layout
from mm_gym.precision.oracle import Oracle
from mm_gym.scene.actuators import ForceActuator
from mm_gym.scene.mechanics import Carriage, DryFriction
from mm_gym.scene.scene import Control, Initial, Solver

from .sweep import attempt, forces_of, random_scene

if TYPE_CHECKING:
    from mm_gym.simulation.trajectory import Trajectory

START = Initial(carriage_displacement=0.01, sphere_offset=0.02)
BASE = Scene(initial=START, control=Control(time_step=1e-2))
SCALE = np.array([0.03, 0.03, 1.0, 1.0])


def _friction(reference_velocity: float, time_step: float) -> Scene:
    interface = DryFriction(
        static_coefficient=0.51,
        kinetic_coefficient=0.255,
        reference_velocity=reference_velocity,
        slip_damping=0.1,
    )
    return Scene(interface=interface, initial=START, control=Control(time_step=time_step))


@pytest.mark.parametrize("time_step", [1e-5, 1e-3, 1e-2, 0.25])
def test_reference_velocity_of_a_micrometre_per_second(time_step: float) -> None:
    scene = _friction(1e-6, time_step)
    state = simulate(scene, duration=0.25).state[-1]
    # Two independent references: other control steps, and SciPy on the stiff equations.
    assert error(state, simulate(_friction(1e-6, 1e-4), duration=0.25).state[-1], SCALE) <= 1e-12
    # Radau follows the stick of 7e6 1/s; its events are good to some 1e-10.
    assert (
        error(state, Oracle(scene, "Radau", rtol=1e-11, max_step=1e-3).solve([0.25]), SCALE) <= 1e-8
    )


@pytest.mark.parametrize("cubic_coefficient", [2e6, 2e8, 2e10, 2e12])
def test_cubic_spring_of_any_strength_keeps_its_tolerance(cubic_coefficient: float) -> None:
    scene = Scene(
        carriage=Carriage(cubic_coefficient=cubic_coefficient),
        initial=START,
        control=Control(time_step=1e-3),
    )
    rate = np.sqrt(3.0 * 400.0 * cubic_coefficient * 1e-4 / 0.1)
    velocity = 0.01 * rate
    scale = np.array([0.03, 0.03, velocity, velocity])
    duration = 100.0 / rate
    want = Oracle(scene).solve([duration])
    for tolerance, bound in ((1e-9, 1e-8), (1e-14, 1e-10)):
        # Over a hundred radians, a relative error of the frequency causes an error of the phase a
        # hundred times as large; SciPy's own error is some 1e-11.
        got = simulate(scene.replace(**{"solver.tolerance": tolerance}), times=[duration]).state
        assert error(got, want, scale) <= bound


@pytest.mark.parametrize("ratio", [1e-6, 1e-3, 1e3, 1e6])
@pytest.mark.parametrize("time_step", [1e-6, 1e-2, 10.0])
def test_any_mass_ratio_and_control_step_keeps_the_bound(ratio: float, time_step: float) -> None:
    scene = BASE.replace(**{"sphere.mass": 0.1 * ratio, "control.time_step": time_step})
    duration = 20 * time_step
    got = simulate(scene, duration=duration).state[-1]
    half = simulate(
        scene.replace(**{"control.time_step": 0.5 * time_step}), duration=duration
    ).state[-1]
    assert error(got, half, SCALE) <= 1e-12
    # The first integral m2 v2 + c offset.
    assert 0.1 * ratio * got[3] + got[1] - got[0] == pytest.approx(0.02, rel=1e-12)


def test_thousand_seconds_keep_the_bound() -> None:
    undamped = BASE.replace(**{"carriage.damping": 0.0, "interface.damping": 0.0})
    for scene, longest in ((undamped, 1000.0), (_friction(0.2, 1e-2), 10.0)):
        many = simulate(scene, duration=1000.0).state[-1]
        few = simulate(scene.replace(**{"control.time_step": longest}), duration=1000.0).state[-1]
        # The matrix of a step is rounded once, by 1e-16, and 1e5 steps repeat it.
        assert error(many, few, SCALE) <= 1e-11


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"carriage.mass": -1.0}, "carriage.mass"),
        ({"carriage.mass": float("nan")}, "carriage.mass"),
        ({"carriage.stiffness": float("inf")}, "carriage.stiffness"),
        (
            {"springs": {"kind": "small_on_large", "stiffness": 35.0, "stretch": 0.9}},
            "springs.stretch",
        ),
        (
            {
                "interface": {
                    "kind": "dry_friction",
                    "static_coefficient": 0.5,
                    "kinetic_coefficient": 0.6,
                    "reference_velocity": 0.1,
                }
            },
            "kinetic_coefficient",
        ),
        (
            {"interface": {"kind": "dry_friction", "static_coefficient": 0.5}},
            "kinetic_coefficient: missing",
        ),
        ({"sphere": {"mas": 1.0}}, "did you mean 'mass'"),
    ],
)  # fmt: skip
def test_impossible_scene_is_refused_by_name(changes: dict[str, object], field: str) -> None:
    with pytest.raises(SceneError, match=field):
        BASE.replace(**changes)


@pytest.mark.parametrize("kind", ["viscous", "dry friction", "cubic"])
def test_action_that_is_not_finite_changes_nothing(kind: str) -> None:
    scene = {
        "viscous": BASE,
        "dry friction": _friction(0.2, 1e-2),
        "cubic": BASE.replace(**{"carriage.cubic_coefficient": 2e6}),
    }[kind]
    env = MovingMassEnv(scene.replace(actuation={"force": ForceActuator().model_dump()}))
    env.reset(seed=0)
    before = env.state
    for bad in (np.nan, np.inf):
        with pytest.raises(ActionError):
            env.step(np.array([bad], np.float32))
        assert np.array_equal(env.state, before)


@pytest.mark.parametrize(
    "scene",
    [
        _friction(0.2, 1e4),
        _friction(1e-12, 1.0),
        BASE.replace(**{"carriage.cubic_coefficient": 1.0, "control.time_step": 1e6}),
        BASE.replace(randomization={"carriage.mass": (1e-9, 1.0)}, **{"control.time_step": 1.0}),
        _friction(0.2, 1e-2).replace(**{"carriage.mass": 1e-80}),
        BASE.replace(**{"carriage.mass": 1e-80, "carriage.cubic_coefficient": 1.0}),
    ],
)
def test_too_long_control_step_is_refused_with_what_is_allowed(scene: Scene) -> None:
    with pytest.raises(CompileError, match=r"control.time_step: .* allow"):
        compile_scene(scene)


def _deviation(scene: Scene, trajectory: Trajectory, seed: int) -> float:
    """Return the error against the oracle, or 0 if SciPy would take more than some seconds."""
    p, x1 = trajectory.parameters, np.abs(trajectory.state[:, 0]).max()
    stick = (
        p[layout.MU1] * p[layout.FN] / p[layout.VR] + p[layout.CHI]
        if p[layout.VR] > 0.0
        else p[layout.C]
    )
    k2 = 6.0 * p[layout.K0]
    k1 = p[layout.K1] * (1.0 + 3.0 * p[layout.BETA] * x1**2)
    oscillation = np.sqrt((k1 + k2) / p[layout.M1] + k2 / p[layout.M2])
    rate = oscillation + (stick + p[layout.D]) / p[layout.M1] + stick / p[layout.M2]
    rate = max(
        rate, p[layout.HARMONICS + layout.FREQUENCY :: layout.HARMONIC_ROWS].max(initial=0.0)
    )
    if scene.springs.kind == "finite_stretch" or rate * trajectory.time[-1] > 100.0:
        return 0.0
    longest = 2.0 / rate if p[layout.VR] > 0.0 else np.inf
    oracle = Oracle(scene, max_step=longest, most_evaluations=100_000)
    try:
        want = oracle.solve(trajectory.time, forces=forces_of(scene, seed))
    except SimulationError:
        return 0.0
    positions, velocities = np.abs(want[:, :2]).max(), np.abs(want[:, 2:]).max()
    # SciPy's error of a position causes an error of a velocity, larger by the oscillation's rate.
    velocities = max(velocities, oscillation * positions)
    return error(trajectory.state, want, np.array([positions, positions, velocities, velocities]))


def _timed(scene: Scene, seed: int) -> tuple[float, Trajectory | None]:
    """Return the processor time that a scene takes [s], and its trajectory unless refused."""
    began = time.process_time()
    _, trajectory = attempt(scene, seed)
    return time.process_time() - began, trajectory


def _sweep(seeds: range) -> list[str]:
    """Return what is wrong with the scenes of these seeds.

    Wrong is a hang, a number that is not finite, an error, or a gain of energy.
    """
    wrong: list[str] = []
    for seed in seeds:
        scene = random_scene(np.random.default_rng(seed))
        elapsed, trajectory = _timed(scene, seed)
        if elapsed > 1.0:
            elapsed, _ = _timed(scene, seed)  # the first scene of a kind compiles kernels
        if elapsed > 1.0:
            wrong.append(f"{seed}: {elapsed:.1f} s")
        if trajectory is None:
            continue
        if not np.isfinite(trajectory.state).all():
            wrong.append(f"{seed}: not finite")
        deviation = _deviation(scene, trajectory, seed)
        # The tolerance holds for each of the 20 steps; for exact plants only SciPy's error is left.
        if deviation > (1e-7 if compile_scene(scene).method.name == "taylor" else 1e-10):
            wrong.append(f"{seed}: {deviation:.1e} from the oracle")
        isolated = (
            not scene.excitation
            and scene.actuation.force is None
            and scene.springs.kind != "finite_stretch"
        )
        energy = trajectory.energy
        tolerance = (
            1e-12
            if scene.carriage.cubic_coefficient == 0.0
            else scene.control.steps * Solver().tolerance
        )
        if isolated and energy.max() > energy[0] * (1.0 + 4.0 * tolerance):
            wrong.append(f"{seed}: energy grows by {energy.max() / energy[0] - 1.0:.1e}")
    return wrong


def test_random_scenes_over_ten_decades_are_right_or_refused() -> None:
    assert _sweep(range(200)) == []


def test_ten_thousand_random_scenes_are_right_or_refused() -> None:
    assert _sweep(range(10_000)) == []
