"""Do the laws that are scored for reference do what their sources say?"""

import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled
from scipy.optimize import minimize
from tasks import CARRIAGE_FORCE, PRE_STRETCH

from agents.control.feedback import Feedback, TrueState
from agents.controllers.constant import no_control
from agents.controllers.extremum_seeking import ExtremumSeeking
from agents.controllers.finite_horizon_lqr import FiniteHorizonLQR
from agents.controllers.linear_mpc import PENALTY, LinearMPC
from agents.controllers.lqr import LQR, LaggingLQR, design, lagging, problem_of
from agents.controllers.quadratic_program import Program
from agents.controllers.registry import laws
from agents.controllers.tuned import further_laws
from agents.controllers.velocity_feedback import VelocityFeedback
from agents.scoring import evaluate
from mm_gym import DesignError, MovingMassVectorEnv, compile_scene

UNLIMITED = CARRIAGE_FORCE.replace(
    **{"actuation.force.limit": 1000.0, "objective.effort_weight": 625.0, "control.steps": 40}
)
"""The task without clipping: the same weight of force in newtons, and a limit out of reach."""


@pytest.mark.parametrize("stroke_weight", [0.0, 1.0])
def test_finite_horizon_cost_is_the_riccati_cost_and_the_least(stroke_weight) -> None:
    # With the stroke weighed no LQR exists: the force does not reach where the sphere ends up.
    scene = UNLIMITED.replace(**{"objective.stroke_weight": stroke_weight})
    env = MovingMassVectorEnv(scene, 16)
    law = FiniteHorizonLQR(scene)

    def total(gains):
        _, info = env.reset(seed=3)
        memory = law.begin(16)
        law.gains, start, rewards = gains, info["state"][:, law.states], 0.0
        for _ in range(scene.control.steps):
            action, memory = law.action(memory, info["state"], info["applied"])
            _, reward, *_, info = env.step(action)
            rewards = rewards + reward
        return start, rewards

    best = law.gains
    start, rewards = total(best)
    expected = np.einsum("ni,ij,nj->n", start, law.cost, start)
    # Sums of 40 products of numbers of order one.
    np.testing.assert_allclose(-rewards, expected, rtol=1e-9)
    for factor in (0.9, 1.1):
        assert np.all(total(factor * best)[1] < rewards)


def test_first_gain_of_a_long_episode_is_the_regulators() -> None:
    long = UNLIMITED.replace(**{"control.steps": 2000})
    expected = design(long)
    found = FiniteHorizonLQR(long)
    assert found.states == expected.states
    np.testing.assert_allclose(found.gains[0], expected.gain[0], rtol=1e-9)


def test_velocity_feedback_is_of_the_force_where_its_rate_is_commanded() -> None:
    scene = CARRIAGE_FORCE.replace(
        **{"actuation.force": {"limit": 2.0, "rate_limit": 400.0, "command": "rate"}}
    )
    env = MovingMassVectorEnv(scene, 8)
    _, info = env.reset(seed=0)
    law = VelocityFeedback(scene, 5.0)
    for _ in range(20):
        velocity = info["state"][:, 2]
        action, _ = law.action({}, info["state"], info["applied"])
        *_, info = env.step(action)
        np.testing.assert_allclose(info["applied"][:, 0], np.clip(-5.0 * velocity, -2.0, 2.0))


def test_linear_mpc_without_limits_is_the_regulator() -> None:
    pytest.importorskip("osqp")
    states = np.random.default_rng(1).normal(0.0, 1.0, (10, 4)) * (0.01, 0.02, 0.5, 0.5)
    mpc, applied = LinearMPC(UNLIMITED), np.zeros((10, 1))
    # The solver stops at 1e-6 of a limit of 1000 N.
    found, _ = mpc.action(mpc.begin(10), states, applied)
    expected, _ = LQR(UNLIMITED).action({}, states, applied)
    np.testing.assert_allclose(found, expected, atol=2e-5)


def test_linear_mpc_is_optimal_within_limit_and_rate_limit() -> None:
    pytest.importorskip("osqp")
    scene = CARRIAGE_FORCE.replace(**{"actuation.force": {"limit": 2.0, "rate_limit": 100.0}})
    steps, (a, b) = 8, compile_scene(scene).discrete()
    solution = design(scene)
    a, b = a[np.ix_(solution.states, solution.states)], b[list(solution.states), 0]
    mpc, state = LinearMPC(scene, steps), np.array([0.01, 0.0, 0.3, 0.1])
    weight = scene.objective.effort_weight

    def cost(plan):
        x, total = state[list(solution.states)], weight * plan @ plan
        for action in plan:
            x = a @ x + b * 2.0 * action
            total += x @ solution.weight @ x
        return total + x @ (solution.cost - solution.weight) @ x

    # The force of 2 N moves by at most 1 N in a step.
    moves = [
        {"type": "ineq", "fun": lambda p, s=s: 0.5 + s * np.diff(p, prepend=0.1)} for s in (1, -1)
    ]
    best = minimize(cost, np.zeros(steps), bounds=[(-1, 1)] * steps, constraints=moves, tol=1e-12).x
    found, memory = mpc.action(mpc.begin(1), state[None], np.array([[0.2]]))
    assert found[0, 0] == pytest.approx(best[0], abs=1e-3)
    assert best[0] == pytest.approx(-0.4, abs=1e-6)  # as fast as the rate allows
    assert cost(memory["plan"][0]) == pytest.approx(cost(best), rel=1e-4)


def lagging_program(scene, solution, steps):
    states, a, b, cost = lagging(scene, problem_of(scene))
    assert states == solution.states
    none = np.zeros((0, len(a) + 1))
    share = float(-np.expm1(-scene.control.time_step / scene.actuation.force.lag))
    return Program(
        scene,
        a,
        b,
        cost,
        last=solution.cost,
        rows=none,
        share=share,
        horizon=steps,
        penalty=PENALTY,
    )


def test_plan_of_plant_and_lag_is_that_of_the_regulator_that_knows_it() -> None:
    pytest.importorskip("osqp")
    scene = UNLIMITED.replace(**{"actuation.force.lag": 0.03})
    generator = np.random.default_rng(1)
    states = generator.normal(0.0, 1.0, (10, 4)) * (0.01, 0.02, 0.5, 0.5)
    law, applied = LaggingLQR(scene), generator.normal(0.0, 5.0, (10, 1))
    program = lagging_program(scene, law.design, 30)
    seen = np.hstack([states, applied])[:, law.design.states]
    found, _ = program.first(program.begin(10), seen, applied[:, 0])
    expected, _ = law.action({}, states, applied)
    np.testing.assert_allclose(found, expected, atol=2e-5)


def test_plan_of_plant_and_lag_is_optimal_within_limit_and_rate_limit() -> None:
    pytest.importorskip("osqp")
    force = {"limit": 2.0, "rate_limit": 30.0, "lag": 0.02}
    scene = CARRIAGE_FORCE.replace(**{"actuation.force": force})
    steps, (a, b) = 8, compile_scene(scene).discrete()
    solution, weight = LaggingLQR(scene).design, scene.objective.effort_weight
    rows, share = list(solution.states), -np.expm1(-0.5)
    program, state = lagging_program(scene, solution, steps), np.array([0.01, 0.0, 0.3, 0.1])

    def motion(plan):
        x, force = state, 0.2
        for action in plan:
            force += share * (2.0 * action - force)
            x = a @ x + b[:, 0] * force
            yield np.append(x, force)[rows]

    def cost(plan):
        total = weight * plan @ plan
        for x in motion(plan):
            total += x @ solution.weight @ x
        return total + x @ (solution.cost - solution.weight) @ x

    def moves(plan):  # of the force, by at most 0.3 N in a step
        return np.diff([x[-1] for x in motion(plan)], prepend=0.2)

    within = [{"type": "ineq", "fun": lambda p, s=s: 0.3 + s * moves(p)} for s in (1, -1)]
    best = minimize(cost, np.zeros(steps), bounds=[(-1, 1)] * steps, constraints=within, tol=1e-12)
    begun, seen = np.array([0.2]), np.append(state, 0.2)[None, rows]
    found, memory = program.first(program.begin(1), seen, begun)
    assert found[0, 0] == pytest.approx(best.x[0], abs=1e-3)
    assert np.abs(moves(best.x)).max() == pytest.approx(0.3, abs=1e-6)  # the rate limit acts
    assert cost(memory["plan"][0]) == pytest.approx(cost(best.x), rel=1e-4)


def test_linear_mpc_is_no_worse_than_the_clipped_regulator() -> None:
    pytest.importorskip("osqp")
    mpc, lqr = (
        evaluate(CARRIAGE_FORCE, Feedback(CARRIAGE_FORCE, law), episodes=30)
        for law in (LinearMPC(CARRIAGE_FORCE), LQR(CARRIAGE_FORCE))
    )
    assert mpc.cost <= lqr.cost


def test_missing_osqp_is_told_with_what_to_install(monkeypatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "osqp", None)
    with pytest.raises(DependencyNotInstalled, match="install the extra `mpc`"):
        LinearMPC(CARRIAGE_FORCE)


@pytest.mark.parametrize("law", [FiniteHorizonLQR, LinearMPC])
def test_regulators_need_a_force_with_a_price(law) -> None:
    with pytest.raises(DesignError, match=r"actuation\.force: missing"):
        law(PRE_STRETCH)
    with pytest.raises(DesignError, match="effort_weight: got 0"):
        law(CARRIAGE_FORCE.replace(**{"objective.effort_weight": 0.0}))


def test_extremum_seeking_finds_a_better_stretch_in_time() -> None:
    # Its wobble takes half a second, so it takes tens of seconds.
    scene = PRE_STRETCH.replace(**{"control.steps": 2000})
    costs = []
    for law in (ExtremumSeeking(scene), no_control(scene)):
        result = evaluate(scene, Feedback(scene, law, TrueState()), episodes=27)
        costs.append([np.sqrt(np.mean(part**2)) for part in np.split(result.displacement, 4)])
    seeking, still = costs
    assert seeking[3] < 0.7 * seeking[0]
    assert seeking[3] < 0.6 * still[3]


def test_pages_of_the_tasks_score_them() -> None:
    pytest.importorskip("osqp")
    pytest.importorskip("slycot")
    names = [law.name for law in further_laws(CARRIAGE_FORCE)]
    assert names == [
        "finite-horizon LQR",
        "linear MPC, 30 steps ahead",
        "predictive LQG, effort weight times 1, unmodelled 0.001",
        "H-infinity",
        "H-infinity, effort weight times 0.1, noise 0.3",
    ]
    assert [law.name for law in further_laws(PRE_STRETCH)] == ["extremum seeking, gain 0.03"]


def test_commands_know_them_by_name() -> None:
    named = {
        "finite-horizon-lqr": CARRIAGE_FORCE,
        "linear-mpc": CARRIAGE_FORCE,
        "predictive-lqg": CARRIAGE_FORCE,
        "h-infinity": CARRIAGE_FORCE,
        "detuned-h-infinity": CARRIAGE_FORCE,
        "extremum-seeking": PRE_STRETCH,
    }
    made = {laws(scene)[name](scene).name for name, scene in named.items()}
    scored = [*further_laws(CARRIAGE_FORCE), *further_laws(PRE_STRETCH)]
    assert made == {law.name for law in scored}
    free = CARRIAGE_FORCE.replace(**{"objective.effort_weight": 0.0})
    for name in ("detuned-h-infinity", "predictive-lqg"):  # they bring a weight of their own
        named.pop(name)
    assert not set(named) & set(laws(free))
