"""Is the H-infinity bound the least that there is, kept, and attained?"""

import control
import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled
from scipy.linalg import LinAlgError, solve_continuous_are
from tasks import CARRIAGE_FORCE, CARRIAGE_FORCE_FRICTION, HYBRID, PRE_STRETCH

from agents.control.feedback import Feedback
from agents.controllers.constant import no_control
from agents.controllers.h_infinity import (
    ABOVE,
    HInfinity,
    Matrices,
    best_detuned_h_infinity,
    bilinear,
    correction,
    design_h_infinity,
)
from agents.controllers.registry import laws
from agents.scoring import evaluate, validation_cost
from agents.training.config import CONFIGS
from mm_gym import DesignError, load_scene

LATE = CARRIAGE_FORCE.replace(**{"sensors.delay": 1, "actuation.force.lag": 0.01})
SPRUNG = CARRIAGE_FORCE.replace(
    springs={"kind": "small_on_large", "stiffness": 35.0, "stretch": 2.0},
    **{"sensors.noise": {"carriage_displacement": 2e-4}, "objective.stroke_weight": 0.1},
)
SHAKEN = SPRUNG.replace(excitation=HYBRID.excitation)
SCENES = {"free sphere": CARRIAGE_FORCE, "late": LATE, "springs": SPRUNG, "ground": SHAKEN}


def riccati_exists(plant: Matrices, measured: int, bound: float) -> bool:
    """Tell whether a controller of one input keeps the amplification below a bound.

    Glover and Doyle, State-space formulae for all stabilizing controllers that satisfy an
    H-infinity norm bound, Syst. Control Lett. 11 (1988), conditions (a) to (d): both Riccati
    equations have stabilising solutions, positive semidefinite, whose product has eigenvalues below
    bound^2. The case without direct paths is that of Doyle, Glover, Khargonekar and Francis (1989).
    """
    a, b, c, d = plant
    costs, disturbances = len(c) - measured, b.shape[1] - 1
    d1, d2 = d[:costs], d[:, :disturbances]
    r = d1.T @ d1
    r[:disturbances, :disturbances] -= bound**2 * np.eye(disturbances)
    other = d2 @ d2.T
    other[:costs, :costs] -= bound**2 * np.eye(costs)
    b1, c1 = b[:, :disturbances], c[:costs]
    try:
        x = solve_continuous_are(a, b, c1.T @ c1, r, s=c1.T @ d1)
        y = solve_continuous_are(a.T, c.T, b1 @ b1.T, other, s=b1 @ d2.T)
    except LinAlgError:
        return False
    least = min(np.linalg.eigvalsh(p).min() / np.abs(p).max() for p in (x, y))
    # The direct path from disturbance to cost, but for what the force can undo, here its last row.
    direct = np.linalg.norm(d[: costs - 1, :disturbances], 2)
    return least > -1e-9 and direct < bound and np.abs(np.linalg.eigvals(x @ y)).max() < bound**2


@pytest.fixture(scope="module")
def designs():
    pytest.importorskip("slycot")
    return {name: design_h_infinity(scene) for name, scene in SCENES.items()}


@pytest.mark.parametrize("name", SCENES)
def test_bound_is_the_least_for_which_the_riccati_equations_have_solutions(name, designs):
    design = designs[name]
    plant, measured = bilinear(design.generalised), len(design.system.outputs) - 4
    least = design.bound / (1.0 + ABOVE)
    assert riccati_exists(plant, measured, 1.001 * least)
    assert not riccati_exists(plant, measured, 0.999 * least)


@pytest.mark.parametrize("name", SCENES)
def test_bound_is_kept_at_a_thousand_frequencies_and_attained(name, designs):
    a, b, c, d = designs[name].closed
    assert np.abs(np.linalg.eigvals(a)).max() < 1.0
    largest = max(
        np.linalg.norm(c @ np.linalg.solve(np.exp(1j * w) * np.eye(len(a)) - a, b) + d, 2)
        for w in np.linspace(0.0, np.pi, 1001)
    )
    assert 0.99 * designs[name].bound <= largest <= designs[name].bound


@pytest.mark.parametrize("name", SCENES)
def test_closed_loop_is_plant_and_controller(name, designs):
    plant, k, closed = designs[name].generalised, designs[name].controller, designs[name].closed
    size, seen = len(plant.A), len(designs[name].system.outputs) - 4
    z = np.exp(0.3j)

    def response(system):
        return system.C @ np.linalg.solve(z * np.eye(len(system.A)) - system.A, system.B) + system.D

    p, g = response(plant), response(k)
    inner = np.linalg.solve(np.eye(1) - g @ p[-seen:, -1:], g @ p[-seen:, :-1])
    assert size == len(k.A)
    np.testing.assert_allclose(p[:-seen, :-1] + p[:-seen, -1:] @ inner, response(closed), atol=1e-7)


def test_map_to_continuous_time_and_back_is_none():
    values = np.random.default_rng(0).normal(size=(5, 5))
    step = Matrices(values[:3, :3], values[:3, 3:], values[3:, :3], values[3:, 3:])
    for back, given in zip(bilinear(bilinear(step), -1.0), step, strict=True):
        np.testing.assert_allclose(back, given, atol=1e-12)


def test_it_stills_the_carriage_from_the_observation():
    pytest.importorskip("slycot")
    for scene in (CARRIAGE_FORCE, LATE):
        found = evaluate(scene, HInfinity(scene), episodes=50)
        nothing = evaluate(scene, Feedback(scene, no_control(scene)), episodes=50)
        assert found.reads == "observation"
        assert found.cost < 0.6 * nothing.cost


def test_clipped_output_of_an_unstable_controller_decays_and_a_stable_one_is_left_alone():
    generator = np.random.default_rng(0)
    for poles in ([0.9, 0.5, -0.3], [1.4, 0.5, -0.3], [1.4, -1.1, 0.3]):
        axes = generator.normal(size=(3, 3))
        a = axes @ np.diag(poles) @ np.linalg.inv(axes)
        k = Matrices(a, np.zeros((3, 2)), generator.normal(size=(1, 3)), np.zeros((1, 2)))
        gain = correction(k)
        # The least output mirrors what grows in the unit circle, and moves nothing else.
        mirrored = [pole if abs(pole) < 1.0 else 1.0 / pole for pole in poles]
        found = np.linalg.eigvals(k.A - gain @ k.C)
        np.testing.assert_allclose(np.sort(found.real), np.sort(mirrored), atol=1e-9)
        assert gain.any() == (max(np.abs(poles)) > 1.0)


def test_clipped_force_does_not_drive_an_unstable_controller_off():
    pytest.importorskip("slycot")
    late = {"sensors.delay": 2, "sensors.noise": {"carriage_displacement": 1e-4}}
    scene = CARRIAGE_FORCE.replace(**late)
    found = HInfinity(scene)
    assert np.abs(np.linalg.eigvals(found.design.controller.A)).max() > 1.0
    still = evaluate(scene, Feedback(scene, no_control(scene)), episodes=50)
    assert evaluate(scene, found, episodes=50).cost < 0.6 * still.cost  # 2.9 without correction


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (PRE_STRETCH, r"actuation\.force: missing"),
        (CARRIAGE_FORCE.replace(**{"objective.effort_weight": 0.0}), "effort_weight: got 0"),
        (
            CARRIAGE_FORCE.replace(**{"sensors.channels": ["sphere_offset"]}),
            r"sensors\.channels: got sphere_offset; allowed .* of the carriage",
        ),
        (
            CARRIAGE_FORCE_FRICTION.replace(
                **{"carriage.linear_coefficient": 0.0, "sensors.channels": ["carriage_velocity"]}
            ),
            "not detectable",
        ),
    ],
)
def test_ill_posed_designs_are_refused_with_the_reason(scene, message):
    with pytest.raises(DesignError, match=message):
        design_h_infinity(scene)


def test_a_sphere_that_nothing_couples_to_the_carriage_is_left_out():
    pytest.importorskip("slycot")
    scene = load_scene(CONFIGS / "structures" / "frame.toml")  # on ground that shakes
    still = evaluate(scene, Feedback(scene, no_control(scene)), episodes=20).cost
    assert evaluate(scene, HInfinity(scene), episodes=20).cost < 0.2 * still


def test_other_weights_lower_the_cost():
    pytest.importorskip("slycot")
    frame = load_scene(CONFIGS / "structures" / "frame.toml").replace(**{"control.steps": 125})
    found, stated = (
        validation_cost(frame, one(frame)) for one in (best_detuned_h_infinity, HInfinity)
    )
    assert found < 0.65 * stated  # 0.56


def test_weights_are_found_also_where_the_force_costs_nothing():
    pytest.importorskip("slycot")
    free = CARRIAGE_FORCE.replace(**{"objective.effort_weight": 0.0, "control.steps": 100})
    still = validation_cost(free, Feedback(free, no_control(free)))
    assert "h-infinity" not in laws(free)
    assert validation_cost(free, laws(free)["detuned-h-infinity"](free)) < 0.5 * still


def test_missing_slycot_is_told_with_what_to_install(monkeypatch):
    def missing(*_):
        raise control.ControlSlycot

    monkeypatch.setattr("control.hinfsyn", missing)
    with pytest.raises(DependencyNotInstalled, match="extra `robust`"):
        design_h_infinity(CARRIAGE_FORCE)


def test_what_the_routine_refuses_is_told(monkeypatch):
    def refuses(*_):
        raise ArithmeticError(*["\nThe controller is not admissible"])

    monkeypatch.setattr("control.hinfsyn", refuses)
    with pytest.raises(DesignError, match="no H-infinity controller exists: The controller"):
        design_h_infinity(CARRIAGE_FORCE)
