"""Is predictive control on the LQG's state the LQG, and better where limits matter?"""

import numpy as np
import pytest

from agents.control.feedback import Feedback
from agents.controllers import quadratic_program
from agents.controllers.linear_mpc import LinearMPC
from agents.controllers.lqg import LQG
from agents.controllers.lqr import LaggingLQR
from agents.controllers.predictive_lqg import PredictiveLQG
from agents.controllers.registry import laws
from agents.scoring import evaluate, validation_cost
from mm_gym import DesignError, load_scene

pytest.importorskip("osqp")

UNMODELLED = 1e-3
QUARTER_CAR, TOWER = (
    load_scene(f"configs/structures/{name}.toml") for name in ("quarter_car", "tower")
)
CARRIAGE_FORCE, DAMPER = (
    load_scene(f"mm_gym/{name}-v0") for name in ("CarriageForce", "ActiveMassDamper")
)
FREE = QUARTER_CAR.replace(
    **{"actuation.force.limit": 1e3 * QUARTER_CAR.actuation.force.limit},
    **{"objective.effort_weight": 1e6 * QUARTER_CAR.objective.effort_weight},
)
LAGGING = CARRIAGE_FORCE.replace(**{"actuation.force.lag": 0.03})


def test_it_is_the_lqg_while_no_limit_matters() -> None:
    predictive, lqg = (
        evaluate(FREE, one, episodes=5).cost
        for one in (PredictiveLQG(FREE, 1.0, UNMODELLED), LQG(FREE, 1.0, UNMODELLED))
    )
    assert predictive == pytest.approx(lqg, rel=1e-3)  # the program is solved to 1e-6 of a force


def test_it_knows_the_lag_and_the_limit() -> None:
    knows = evaluate(LAGGING, PredictiveLQG(LAGGING, 1.0, UNMODELLED), episodes=30).cost
    unlimited, prompt = (
        evaluate(LAGGING, Feedback(LAGGING, law(LAGGING)), episodes=30).cost
        for law in (LaggingLQR, LinearMPC)
    )
    assert knows < 0.97 * unlimited < 0.7 * prompt


@pytest.mark.parametrize("scene", [QUARTER_CAR, TOWER], ids=["quarter car", "tower"])
def test_plans_within_limits_cost_less_than_the_clipped_lqg(scene) -> None:
    predictive, clipped = (
        evaluate(scene, kind(scene, 1.0, UNMODELLED), episodes=20).cost
        for kind in (PredictiveLQG, LQG)
    )
    assert predictive < 0.99 * clipped


@pytest.mark.parametrize("scene", [TOWER, DAMPER], ids=["rate limit", "rail"])
def test_plans_of_all_lanes_are_those_of_another_solver(scene) -> None:
    program = PredictiveLQG(scene, 0.1, UNMODELLED).program
    generator = np.random.default_rng(3)
    # As far from equilibrium as limits matter in most lanes.
    near = generator.standard_normal((60, program.slope.shape[1]))
    asked = np.abs(near @ program.slope.T @ program.inverse).max(axis=1)
    states = near * (generator.uniform(0.2, 5.0, 60) / asked)[:, None]
    applied = program.limit * generator.uniform(-1.0, 1.0, 60)
    found, memory = program.first(program.begin(60), states, applied)
    assert np.count_nonzero(memory["sides"].any(axis=1)) > 30
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(quadratic_program, "ROUNDS", 0)
        expected, by_osqp = program.first(program.begin(60), states, applied)
    # OSQP stops at residuals of 1e-6, of numbers of order ten.
    np.testing.assert_allclose(found, expected, atol=1e-4)
    np.testing.assert_allclose(memory["plan"], by_osqp["plan"], atol=1e-3)
    again, same = program.first({**memory, "sides": shifted_back(memory, 30)}, states, applied)
    np.testing.assert_allclose(again, found, atol=1e-12)  # begun at its own sides
    assert (same["sides"] == memory["sides"]).all()


def shifted_back(memory, steps):
    """Return sides that are those of a memory once they are a step older."""
    sides = memory["sides"].reshape(len(memory["sides"]), -1, steps)
    return np.roll(sides, 1, axis=2).reshape(memory["sides"].shape)


def test_it_keeps_off_the_rail_and_is_searched_by_name() -> None:
    scene = DAMPER.replace(**{"control.steps": 250})
    found, detuned = (laws(scene)[name](scene) for name in ("predictive-lqg", "detuned-lqg"))
    assert isinstance(found, PredictiveLQG)
    assert found.program.slacks > 0
    assert validation_cost(scene, found) < 0.95 * validation_cost(scene, detuned)


def test_force_that_is_commanded_by_its_rate_is_refused() -> None:
    rated = TOWER.replace(**{"actuation.force.command": "rate"})
    with pytest.raises(DesignError, match=r"actuation\.force\.command: got 'rate'"):
        PredictiveLQG(rated, 1.0, UNMODELLED)
    assert "predictive-lqg" not in laws(rated)
