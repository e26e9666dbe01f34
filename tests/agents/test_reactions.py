"""Accelerations and the force between the masses in the objective: in rewards and in designs."""

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are
from tasks import CARRIAGE_FORCE, HYBRID, PRE_STRETCH, PRE_STRETCH_SHOCK

from agents.control.model import Model
from agents.control.trajectories import Trajectories
from agents.controllers.clipped_lqr import ClippedLQR
from agents.controllers.finite_horizon_lqr import FiniteHorizonLQR
from agents.controllers.h_infinity import design_h_infinity
from agents.controllers.linear_mpc import LinearMPC
from agents.controllers.lqg import design_lqg
from agents.controllers.lqr import LQR, design
from agents.controllers.newton_predictive_control import NewtonPredictiveControl
from agents.controllers.on_off_stiffness import OnOffStiffness
from agents.controllers.predictive_control import PredictiveControl
from agents.value_iteration.iteration import problem_of
from mm_gym import DesignError, MovingMassVectorEnv, compile_scene

WEIGHTS = {
    "objective.carriage_acceleration_weight": 2.0,
    "objective.sphere_acceleration_weight": 0.5,
    "objective.coupling_force_weight": 0.3,
    "objective.coupling_force_scale": 0.2,
}
SPRINGS = {"springs": {"kind": "small_on_large", "stiffness": 35.0, "stretch": 1.5}}

WIDE = {
    "control.steps": 3000,
    "actuation.force.limit": 1000.0,
    "objective.effort_weight": 625.0,
    "objective.displacement_limit": None,
    "objective.rail_half_length": None,
}
"""The same weight of the force in newtons, no limit in reach, and time to settle."""

FREE = CARRIAGE_FORCE.replace(**WIDE, **WEIGHTS)
BOUND = FREE.replace(**SPRINGS)
SCENES = [FREE, BOUND, BOUND.replace(**{"actuation.force.between": "masses"})]


def equations(scene):
    """A (4, 4) and B (4, 1), written out by hand."""
    m1, m2 = scene.carriage.mass, scene.sphere.mass
    k1, d, c = scene.carriage.stiffness, scene.carriage.damping, scene.interface.damping
    k2 = 0.0
    if scene.springs.kind != "none":
        k2 = 2.0 * scene.springs.stiffness * (1.0 + 2.0 * scene.springs.stretch**-3)
    a = np.zeros((4, 4))
    a[0, 2] = a[1, 3] = 1.0
    a[2] = np.array([-k1 - k2, k2, -c - d, c]) / m1
    a[3] = np.array([k2, -k2, c, -c]) / m2
    on_sphere = -1.0 / m2 if scene.actuation.force.between == "masses" else 0.0
    return a, np.array([[0.0], [0.0], [1.0 / m1], [on_sphere]])


def optimum(scene):
    """States, gain, and P of the sum of costs, from SciPy's routines on the equations by hand."""
    a, b = equations(scene)
    block = np.zeros((5, 5))
    block[:4, :4], block[:4, 4:] = a, b
    moved = expm(block * scene.control.time_step)
    ad, bd = moved[:4, :4], moved[:4, 4:]
    o = scene.objective
    w = np.zeros((5, 5))
    w[0, 0] = o.displacement_weight / o.displacement_scale**2
    w[2, 2] = o.velocity_weight / o.velocity_scale**2
    w[4, 4] = o.effort_weight / scene.actuation.force.limit**2
    on_sphere = o.sphere_acceleration_weight / o.sphere_acceleration_scale**2
    on_sphere += o.coupling_force_weight * scene.sphere.mass**2 / o.coupling_force_scale**2
    on_carriage = o.carriage_acceleration_weight / o.carriage_acceleration_scale**2
    for row, weight in ((2, on_carriage), (3, on_sphere)):
        both = np.append(a[row], b[row])
        w += weight * np.outer(both, both)
    # Of (state after, force) to (state before, force).
    through = np.block([[ad, bd], [np.zeros((1, 4)), np.ones((1, 1))]])
    stage = through.T @ w @ through
    states = [0, 1, 2, 3] if scene.springs.kind != "none" else [0, 2, 3]
    ad, bd, rows = ad[np.ix_(states, states)], bd[states], [*states, 4]
    stage = stage[np.ix_(rows, rows)]
    q, s, r = stage[:-1, :-1], stage[:-1, -1:], stage[-1:, -1:]
    p = solve_discrete_are(ad, bd, q, r, s=s)
    return states, np.linalg.solve(r + bd.T @ p @ bd, bd.T @ p @ ad + s.T), p


def roll_out(scene, act, lanes=16):
    """Initial states and sums of rewards."""
    env = MovingMassVectorEnv(scene, lanes, autoreset_mode="Disabled")
    _, info = env.reset(seed=7)
    start, total = info["state"].copy(), np.zeros(lanes)
    for _ in range(scene.control.steps):
        action = act(info["state"])
        assert np.abs(action).max() < 1.0, "clipping would break the identity"
        _, reward, *_, info = env.step(action)
        total += reward
    return start, total


@pytest.mark.parametrize("scene", SCENES)
def test_regulator_is_that_of_an_own_discretisation_and_its_cost_that_of_a_roll_out(scene):
    states, gain, p = optimum(scene)
    solution = design(scene)
    assert list(solution.states) == states
    # Both equations are solved to some 1e-12 of the gain.
    np.testing.assert_allclose(solution.gain, gain, rtol=0, atol=1e-9 * np.abs(gain).max())
    limit = scene.actuation.force.limit
    start, total = roll_out(scene, lambda state: -state[:, states] @ gain.T / limit)
    x = start[:, states]
    # As in test_lqr.py; what is left after 30 s of the slowest mode is far below.
    np.testing.assert_allclose(-total, np.einsum("ni,ij,nj->n", x, p, x), rtol=1e-9)
    given = solution.cost - solution.weight
    np.testing.assert_allclose(given, p, rtol=0, atol=1e-9 * np.abs(p).max())


PLAIN = SCENES[2].replace(**dict.fromkeys(list(WEIGHTS)[:3], 0.0))
"""A force between the masses that is paid for with displacement and velocity alone."""


@pytest.mark.parametrize("scene", [*SCENES[1:], PLAIN])
def test_no_other_gain_costs_less(scene):
    states, gain, p = optimum(scene)
    np.testing.assert_allclose(design(scene).gain, gain, rtol=0, atol=1e-9 * np.abs(gain).max())
    # A lane each; the first has the regulator's own.
    lanes, generator = 64, np.random.default_rng(4)
    factor = 1.0 + 0.002 * generator.standard_normal((lanes, len(states)))
    factor[0] = 1.0
    gains = factor * gain / scene.actuation.force.limit
    act = lambda state: -np.sum(gains * state[:, states], axis=1, keepdims=True)  # noqa: E731
    start, total = roll_out(scene, act, lanes)
    least = np.einsum("ni,ij,nj->n", start[:, states], p, start[:, states])
    assert -total[0] == pytest.approx(least[0], rel=1e-9)
    # The excess is of second order in a five hundredth, and both costs are known to 1e-9.
    assert (-total[1:] > least[1:] * (1.0 + 1e-8)).all()


@pytest.mark.parametrize("scene", SCENES)
def test_regulator_with_the_weights_costs_less_than_without(scene):
    without = scene.replace(**dict.fromkeys(list(WEIGHTS)[:3], 0.0))
    costs = []
    for designed in (scene, without):
        law = LQR(designed)
        costs.append(-roll_out(scene, lambda state, law=law: law.action({}, state, state)[0])[1])
    assert (costs[0] < costs[1]).all()
    assert costs[0].sum() < 0.97 * costs[1].sum()


@pytest.mark.parametrize("scene", SCENES)
def test_other_designs_have_the_same_optimum(scene):
    states, gain, p = optimum(scene)
    finite = FiniteHorizonLQR(scene)
    np.testing.assert_allclose(finite.gains[0], gain[0], rtol=0, atol=1e-9 * np.abs(gain).max())
    np.testing.assert_allclose(finite.cost, p, rtol=0, atol=1e-9 * np.abs(p).max())
    # The filter apart, an LQG feeds the same states back.
    found = design_lqg(scene)
    np.testing.assert_allclose(
        found.regulator.gain[states], gain[0], rtol=0, atol=1e-9 * np.abs(gain).max()
    )
    state = np.array([[0.002, 0.001, 0.1, -0.1], [-0.001, 0.002, 0.0, 0.2]])
    mpc = LinearMPC(scene, horizon=5)
    wanted = -state[:, states] @ gain.T / scene.actuation.force.limit
    # OSQP stops at 1e-6 of the actions' range.
    found, _ = mpc.action(mpc.begin(2), state, np.zeros((2, 1)))
    np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_force_with_a_lag_is_weighed_as_it_then_is():
    lagging = SCENES[1].replace(**{"actuation.force.lag": 0.02})
    assert "force" in [signal.name for signal in design_lqg(lagging).system.states]
    slow = design_lqg(lagging.replace(**{"actuation.force.lag": 1e-4}))
    gain = optimum(SCENES[1])[1]
    # A lag of a hundredth of a step leaves exp(-100) of the force before.
    np.testing.assert_allclose(
        slow.regulator.gain[:4], gain[0], rtol=0, atol=1e-9 * np.abs(gain).max()
    )


CLAIRVOYANT = CARRIAGE_FORCE.replace(
    **WEIGHTS,
    **SPRINGS,
    **{
        "control.steps": 40,
        "objective.displacement_limit": None,
        "objective.rail_half_length": None,
        "actuation.force.limit": 100.0,
        "objective.effort_weight": 6.25,
    },
)


def planner(scene, lanes):
    env = MovingMassVectorEnv(scene, lanes, autoreset_mode="Disabled")
    _, info = env.reset(seed=3)
    return env, Trajectories(scene, env.plant, env.get_state()), info["state"]


HYSTERESIS = CLAIRVOYANT.replace(
    interface={"kind": "bouc_wen", "stiffness": 50.0, "yield_displacement": 0.005},
    **{"actuation.force.limit": 2.0, "objective.effort_weight": 0.01},
)
PLANNED = [CLAIRVOYANT, HYBRID.replace(**WEIGHTS, **{"control.steps": 30}), HYSTERESIS]


@pytest.mark.parametrize("scene", PLANNED)
def test_cost_of_a_plan_is_that_of_the_environment(scene):
    scene = scene.replace(**{"objective.displacement_limit": None})
    env, plans, _ = planner(scene, 3)
    rng = np.random.default_rng(0)
    controls = rng.uniform(-0.3, 0.3, (scene.control.steps, len(env.plant.actuators), 3))
    found = plans.follow(np.arange(3), controls)
    total = np.zeros(3)
    for action in found.actions:
        total += env.step(action.T.copy())[1]
    # The same motion, with sums in another order.
    np.testing.assert_allclose(found.cost, -total, rtol=1e-11)


def test_plan_through_a_state_of_the_interface_is_stationary():
    scene = HYSTERESIS.replace(**{"control.steps": 15})
    _, plans, _ = planner(scene, 1)
    best = plans.improve(np.arange(1), np.zeros((15, 1, 1)), 60)
    none = plans.follow(np.arange(1), np.zeros((15, 1, 1)))
    assert best.cost < 0.9 * none.cost
    # No change of a control by 1e-3, whose effect is some 1e-6 of the cost, betters the plan by
    # more than the search's 1e-9 and its stiffness leave.
    changed = np.tile(best.controls, 30)
    for k in range(15):
        changed[k, 0, 2 * k] += 1e-3
        changed[k, 0, 2 * k + 1] -= 1e-3
    found = plans.follow(np.zeros(30, np.intp), changed)
    assert np.all(found.cost > (1.0 - 1e-8) * best.cost)


def test_clairvoyant_plan_of_a_linear_plant_is_the_finite_horizon_optimum():
    _, plans, start = planner(CLAIRVOYANT, 3)
    zero = np.zeros((CLAIRVOYANT.control.steps, 1, 3))
    found = plans.improve(np.arange(3), zero, 30)
    p = FiniteHorizonLQR(CLAIRVOYANT).cost
    # Quadratic: Gauss-Newton ends at the optimum but for its stiffness and differences of 1e-10.
    np.testing.assert_allclose(found.cost, np.einsum("ni,ij,nj->n", start, p, start), rtol=1e-8)


@pytest.mark.parametrize("name", list(WEIGHTS)[:3])
def test_designs_that_cannot_weigh_them_refuse_them_by_name(name):
    weight = {name: 1.0}
    words = "carriage_acceleration_weight, sphere_acceleration_weight and coupling_force_weight"
    with pytest.raises(DesignError, match=words):
        design_h_infinity(CARRIAGE_FORCE.replace(**weight))
    with pytest.raises(DesignError, match=words):
        ClippedLQR(PRE_STRETCH.replace(**weight), 1.5, 1.0)
    with pytest.raises(DesignError, match=words):
        OnOffStiffness(PRE_STRETCH.replace(**weight), 1.5)
    with pytest.raises(DesignError, match=words):
        problem_of(PRE_STRETCH_SHOCK.replace(**weight), 5, 3)


def test_models_without_the_disturbance_refuse_what_it_changes_at_once():
    ground = HYBRID.replace(**{"objective.carriage_acceleration_weight": 1.0})
    with pytest.raises(DesignError, match="carriage_acceleration_weight: allowed for predictive"):
        PredictiveControl(ground, LQR(CARRIAGE_FORCE))
    with pytest.raises(DesignError, match="carriage_acceleration_weight: allowed for plans"):
        NewtonPredictiveControl(ground)
    sphere = HYBRID.replace(**{"objective.sphere_acceleration_weight": 1.0})
    assert Model(sphere).effort_weight == HYBRID.objective.effort_weight
    assert compile_scene(sphere).scores_reactions
