"""Does predictive control by Gauss-Newton steps find the plans that a search by chance misses?"""

from copy import copy

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, CARRIAGE_FORCE_FRICTION, HYBRID, TASKS

from agents.control.feedback import Feedback, TrueState
from agents.control.model import Model
from agents.controllers.forecast import ExcitationFilter, PushForecast
from agents.controllers.lqr import LQR
from agents.controllers.newton_predictive_control import TOLERANCE, NewtonPredictiveControl, Steps
from agents.controllers.predictive_control import PredictiveControl, predictive_control
from agents.controllers.velocity_feedback import VelocityFeedback
from agents.evaluation.rigs import late
from agents.scoring import evaluate
from mm_gym import DesignError, MovingMassVectorEnv, compile_scene

SHAKEN = CARRIAGE_FORCE.replace(
    **{
        "excitation": [{"kind": "harmonic", "amplitude": 1.0, "frequency": 50.0}],
        "actuation.force.limit": 400.0,
        "objective.effort_weight": 100.0,
        "initial": {},
    }
)


def test_linear_plant_costs_what_the_riccati_equation_says():
    planned = evaluate(
        CARRIAGE_FORCE,
        Feedback(CARRIAGE_FORCE, NewtonPredictiveControl(CARRIAGE_FORCE)),
        episodes=10,
    )
    optimal = evaluate(CARRIAGE_FORCE, Feedback(CARRIAGE_FORCE, LQR(CARRIAGE_FORCE)), episodes=10)
    # The LQR is optimal but for the limit of the force, which the plans know.
    assert planned.cost <= optimal.cost * (1.0 + 1e-4)
    assert planned.cost >= 0.99 * optimal.cost


def test_friction_costs_a_third_of_the_best_constant_from_the_observation():
    law = NewtonPredictiveControl(CARRIAGE_FORCE_FRICTION)
    planned = evaluate(CARRIAGE_FORCE_FRICTION, Feedback(CARRIAGE_FORCE_FRICTION, law), episodes=8)
    assert planned.reads == "observation"
    still = evaluate(
        CARRIAGE_FORCE_FRICTION,
        Feedback(CARRIAGE_FORCE_FRICTION, VelocityFeedback(CARRIAGE_FORCE_FRICTION, 0.0)),
        episodes=8,
    )
    assert planned.cost < 0.36 * still.cost


def test_hybrid_uses_what_the_filter_of_the_soil_tells_in_advance():
    scene = HYBRID.replace(**{"control.steps": 120})
    law, blind = NewtonPredictiveControl(scene), NewtonPredictiveControl(scene)
    blind.forecast.ahead = lambda memory, *_: (None, memory)
    with_it, without = (evaluate(scene, Feedback(scene, it), episodes=16) for it in (law, blind))
    assert with_it.cost < 0.97 * without.cost


def test_plans_by_chance_stay_on_the_rail():
    scene = TASKS["mm_gym/ActiveMassDamper-v0"].replace(
        **{"excitation": [], "randomization": {}, "actuation.force.limit": 30.0}
    )
    still = VelocityFeedback(scene, 0.0)
    state = np.array([[0.0, 0.05, 0.0, 0.6]])  # 20 mm before the rail's end, 0.6 m/s towards it
    controlled = PredictiveControl(scene, still)
    longer = PredictiveControl(scene.replace(**{"objective.rail_half_length": 1.0}), still)
    strokes = []
    for law in (controlled, longer):
        model, now, memory, furthest = Model(scene), state, law.begin(1), 0.0
        model.begin(state)
        applied = np.zeros((1, 1))
        for _ in range(10):
            action, memory = law.action(memory, now, applied)
            applied, _ = law.actuators.reached(action, applied, applied)
            now = model.advance(applied)[0].copy()
            furthest = max(furthest, float(now[0, 1] - now[0, 0]))
        strokes.append(furthest)
    assert strokes[0] < scene.objective.rail_half_length < strokes[1]


def test_errors_of_late_estimates_are_not_taken_for_excitation():
    scene = late(TASKS["mm_gym/ActiveMassDamper-v0"].replace(**{"control.steps": 150}))
    law, blind = NewtonPredictiveControl(scene), NewtonPredictiveControl(scene)
    blind.forecast.ahead = lambda memory, *_: (None, memory)
    with_it, without = (evaluate(scene, Feedback(scene, it), episodes=4) for it in (law, blind))
    # It costs 6 % more if the filter takes all that the model missed for excitation.
    assert with_it.cost < 1.05 * without.cost


def test_forecast_of_a_filter_is_the_conditional_mean_of_the_sampled_plant():
    system = compile_scene(HYBRID).state_space([], ("x1", "x2", "v1", "v2"), sampled=True)
    found = ExcitationFilter(HYBRID, system)
    starts = np.array([[1.0, -2.0], [0.5, 0.3]])
    ahead = found.ahead({**found.begin(2), "state": starts}, 7)
    for lane, start in enumerate(starts):
        state = np.concatenate([np.zeros(4), start])
        for step in ahead:
            state[:4] = 0.0  # what a step adds to the motion, not what the motion makes of it
            state = system.A @ state
            np.testing.assert_allclose(step[lane], state[:4], rtol=1e-12, atol=1e-18)


def test_push_of_a_harmonic_force_is_what_the_plant_does():
    forecast = PushForecast(SHAKEN)
    env = MovingMassVectorEnv(SHAKEN, 2)
    _, info = env.reset(seed=3)
    memory = forecast.begin(2)
    undisturbed = compile_scene(SHAKEN).discrete()[0]
    for _ in range(12):
        pushes, memory = forecast.ahead(memory, info["state"], info["applied"], 3)
        before = info["state"].copy()
        *_, info = env.step(np.zeros((2, 1)))
    missed = info["state"] - before @ undisturbed.T
    # A held force differs from one that turns by 0.5 rad in the step by 0.5**2 / 24, 1 %.
    np.testing.assert_allclose(pushes[0][2], missed[:, 2], rtol=0.03)


def test_plans_of_a_silent_scene_do_not_depend_on_the_lanes_beside():
    # Two lanes of one state differ by the random plans alone, and both are improved.
    law = NewtonPredictiveControl(CARRIAGE_FORCE, Steps(near=0, fresh=0, rounds=8))
    state = np.tile([0.004, 0.01, 0.1, -0.1], (2, 1))
    (first, second), _ = law.action(law.begin(2), state, np.zeros((2, 1)))
    assert first == second


def test_it_is_taken_where_a_force_acts_and_time_allows():
    damper = VelocityFeedback(CARRIAGE_FORCE, 5.0)
    limited = {"rate_limit": 9.0, "command": "rate", "lag": 0.02}
    slow = {f"actuation.force.{name}": value for name, value in limited.items()}
    lagging = CARRIAGE_FORCE.replace(**slow)
    laws = [
        predictive_control(scene, damper).law
        for scene in (CARRIAGE_FORCE, HYBRID, TASKS["mm_gym/CarriageForceDuffing-v0"], lagging)
    ]
    assert [isinstance(law, NewtonPredictiveControl) for law in laws] == [True, True, False, False]
    assert isinstance(laws[-1], PredictiveControl)
    with pytest.raises(DesignError, match="no lag of an actuator that is commanded by its rate"):
        NewtonPredictiveControl(lagging)
    assert Feedback(CARRIAGE_FORCE, laws[0], TrueState()).reads == "full state"


def test_state_of_the_interface_is_what_the_model_makes_of_it():
    hysteresis = {"kind": "bouc_wen", "stiffness": 50.0, "yield_displacement": 0.005}
    scene = CARRIAGE_FORCE.replace(interface=hysteresis)
    law = NewtonPredictiveControl(scene, Steps(horizon=5, near=1, fresh=1))
    env = MovingMassVectorEnv(scene, 2, autoreset_mode="Disabled")
    _, info = env.reset(seed=0)
    memory = law.begin(2)
    for _ in range(8):
        actions, memory = law.action(memory, info["state"], np.zeros((2, 1)))
        *_, info = env.step(actions)
        (own,) = env.get_state()["values"][env.plant.support.own_rows]
        # Nothing disturbs the motion: both are within their tolerances of it.
        np.testing.assert_allclose(memory["own"][:, 0], own, atol=TOLERANCE)
    assert np.all(np.abs(own) > 0.01)


def test_plans_follow_an_interface_within_their_own_tolerance():
    hysteresis = {"kind": "bouc_wen", "stiffness": 50.0, "yield_displacement": 0.005}
    law = NewtonPredictiveControl(CARRIAGE_FORCE.replace(interface=hysteresis), Steps(horizon=5))
    plans, lanes = law._problem(2), np.arange(2)
    plans.start[0][2] = 0.3  # v1 [m/s]
    exact = copy(plans)
    exact._tolerance = 1e-12
    controls = np.full((5, 1, 2), 0.5)
    found, known = plans.follow(lanes, controls), exact.follow(lanes, controls)
    # Exact derivatives of an episode of ten seconds took minutes.
    assert np.any(found.motion != known.motion)
    scale = np.abs(known.motion).max(axis=(0, 3), keepdims=True)
    assert np.max(np.abs(found.motion - known.motion) / (scale + 1e-12)) < 10 * TOLERANCE
