"""Do the nonlinear plants and the massless limit agree with independent golden values?"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from oracle import error

from mm_gym import Scene, simulate
from mm_gym.scene.mechanics import Carriage, DryFriction, Sphere, Viscous
from mm_gym.scene.scene import Control, Initial, Solver

from .conftest import golden, numbers

FRICTION, DUFFING, MASSLESS = golden("friction"), golden("duffing"), golden("massless")
DUFFING_NAMES = [name for name in DUFFING if name != "provenance"]
MASSLESS_NAMES = [name for name in MASSLESS if name != "provenance"]

ROUND_OFF = 1e-12  # the bound that the exact plants declare


def _start(ic: list[str]) -> Initial:
    x1, x2, v1, v2 = numbers(ic)
    return Initial(
        carriage_displacement=x1, sphere_offset=x2 - x1, carriage_velocity=v1, sphere_velocity=v2
    )


def _friction(case: dict[str, Any], time_step: float, initial: Initial) -> Scene:
    mu1, ratio = float(case["mu1"]), float(case.get("mu2_over_mu1", case.get("ratio")))
    interface = DryFriction(
        static_coefficient=mu1,
        kinetic_coefficient=mu1 * ratio,
        reference_velocity=float(case["vr"]),
        slip_damping=float(case["chi"]),
    )
    return Scene(interface=interface, initial=initial, control=Control(time_step=time_step))


def _errors(scene: Scene, states: dict[str, list[str]]) -> float:
    """Return the largest error at the golden instants, relative to the scale of the trajectory."""
    times = sorted(states, key=float)
    want = np.array([numbers(states[time]) for time in times])
    return error(simulate(scene, times=[float(time) for time in times]).state, want)


@pytest.mark.parametrize("time_step", [1e-3, 1e-2, 1.0])
@pytest.mark.parametrize(
    "case", FRICTION["asymptotes"], ids=lambda case: f"vr{case['vr']}-chi{case['chi']}"
)
@pytest.mark.parametrize(("method", "bound"), [("auto", ROUND_OFF), ("taylor", ROUND_OFF)])
def test_asymptotic_offset_of_dry_friction(
    case: dict[str, Any], time_step: float, method: str, bound: float
) -> None:
    scene = _friction(case, time_step, Initial(carriage_displacement=0.01, sphere_offset=0.02))
    # At this tolerance only round-off is left.
    scene = scene.replace(
        **{"solver.method": method} | ({"solver.tolerance": 1e-14} if method == "taylor" else {})
    )
    x1, x2, _, v2 = simulate(scene, duration=3.0).state[-1]
    stick = float(case["mu1"]) * 0.04 * 9.81 / float(case["vr"])
    assert x2 - x1 + 0.04 * v2 / stick == pytest.approx(float(case["dx_inf"]), rel=bound)


@pytest.mark.parametrize(
    "case", FRICTION["asymptotes"], ids=lambda case: f"vr{case['vr']}-chi{case['chi']}"
)
def test_slip_velocity_meets_the_boundary_at_every_golden_event(case: dict[str, Any]) -> None:
    scene = _friction(case, 1e-3, Initial(carriage_displacement=0.01, sphere_offset=0.02))
    events = case["events"]
    state = simulate(scene, times=[float(event["t"]) for event in events]).state
    vr = float(case["vr"])
    want = [vr * (event["to"] or event["from"]) for event in events]
    # The instants are rounded to doubles; the slip acceleration is at most 60 m/s^2, velocities are
    # below 1 m/s.
    assert np.abs(state[:, 3] - state[:, 2] - want).max() <= ROUND_OFF


@pytest.mark.parametrize("time_step", [1e-3, 0.02, 2.0])
@pytest.mark.parametrize("name", list(FRICTION["states"]))
def test_states_of_dry_friction(name: str, time_step: float) -> None:
    case = FRICTION["states"][name]
    scene = _friction(case["params"], time_step, _start(case["ic"]))
    assert _errors(scene, case["states"]) <= ROUND_OFF


@pytest.mark.parametrize("time_step", [5e-3, 0.1, 2.0])
@pytest.mark.parametrize("name", DUFFING_NAMES)
@pytest.mark.parametrize(("tolerance", "bound"), [(1e-9, 1e-9), (1e-14, 1e-12)])
def test_states_of_a_cubic_spring(
    name: str, time_step: float, tolerance: float, bound: float
) -> None:
    case = DUFFING[name]
    parameters = case["params"]
    scene = Scene(
        carriage=Carriage(cubic_coefficient=float(parameters["beta"])),
        interface=Viscous(damping=float(parameters["c"])),
        initial=_start(case["ic"]),
        control=Control(time_step=time_step),
        solver=Solver(tolerance=tolerance),
    )
    assert _errors(scene, case["states"]) <= bound


@pytest.mark.parametrize("mass", [0.0, 1e-80])
@pytest.mark.parametrize("time_step", [0.02, 2.0])
@pytest.mark.parametrize("name", MASSLESS_NAMES)
def test_states_of_a_carriage_without_mass(name: str, time_step: float, mass: float) -> None:
    case = MASSLESS[name]
    parameters = case["params"]
    scene = Scene(
        carriage=Carriage(mass=mass, damping=float(parameters["d"])),
        sphere=Sphere(mass=float(parameters["m2"])),
        interface=Viscous(damping=float(parameters["c"])),
        initial=_start(case["ic"]),
        control=Control(time_step=time_step),
    )
    assert _errors(scene, case["states"]) <= ROUND_OFF
