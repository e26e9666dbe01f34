"""Does linear predictive control keep limits of the motion, as well as any plan could?"""

import numpy as np
import pytest
from scipy.optimize import minimize
from tasks import ACTIVE_MASS_DAMPER, CARRIAGE_FORCE

from agents.control.feedback import Feedback, TrueState
from agents.controllers.linear_mpc import KEPT, Limits, LinearMPC
from agents.controllers.lqr import design, problem_of
from agents.controllers.registry import laws, obstacle
from agents.scoring import evaluate
from mm_gym import DesignError, MovingMassVectorEnv, compile_scene

pytest.importorskip("osqp")

QUIET = ACTIVE_MASS_DAMPER.replace(
    excitation=[],
    sensors={},
    randomization={},
    initial={"carriage_velocity": [-0.12, 0.12]},
    **{
        "actuation.force.lag": 0.0,
        "control.steps": 100,
        "objective.effort_weight": 3.0,
        "objective.rail_half_length": None,
    },
)
"""The task without what its model does not know: plans come true."""

LIMITS = {"displacement": 0.0055, "stroke": 0.02, "coupling_force": 0.5}
KEEPING = 1000.0  # more than any limit is worth: plans go beyond none that they can keep


def limited(scene, state, force):
    """Return what can be limited, (3, lanes), at a step's end."""
    a, b = compile_scene(scene).linear()
    coupling = scene.sphere.mass * (state @ a[3] + b[3, 0] * force)
    return np.array([state[:, 0], state[:, 1] - state[:, 0], coupling])


def largest(scene, law, lanes=16):
    """Return the largest value of what can be limited, (3, lanes), over an episode."""
    env, memory = MovingMassVectorEnv(scene, lanes), law.begin(lanes)
    _, info = env.reset(seed=5)
    found = np.zeros((3, lanes))
    for _ in range(scene.control.steps):
        action, memory = law.action(memory, info["state"], info["applied"])
        *_, info = env.step(action)
        found = np.maximum(found, np.abs(limited(scene, info["state"], info["applied"][:, 0])))
    return found


def test_constrained_plan_is_that_of_another_solver() -> None:
    steps, penalty, force = 8, 3.0, QUIET.actuation.force.limit
    bounds = np.array([0.006, 0.05, 1.5])
    state = np.array([0.004, 0.045, 0.1, 0.3])
    _, a, b, cost = problem_of(QUIET)
    found = design(QUIET)

    def motion(plan):
        """Return states and forces of a plan."""
        states, x = [], state
        for action in plan:
            x = a @ x + b[:, 0] * force * action
            states.append(x)
        return np.array(states), force * plan

    def total(plan, beyond):
        x, forces = motion(plan)
        value = np.einsum("ki,ij,kj->", x, cost.state, x) + cost.force.item() * forces @ forces
        value += x[-1] @ (found.cost - found.weight) @ x[-1]
        return value + penalty * (beyond + beyond**2).sum()

    def within(plan, beyond, sign):
        values = limited(QUIET, *motion(plan)) / bounds[:, None]
        return 1.0 + beyond - sign * values.ravel()

    parts = slice(None, steps), slice(steps, None)
    best = minimize(
        lambda z: total(*(z[part] for part in parts)),
        np.concatenate([np.zeros(steps), np.ones(3 * steps)]),
        bounds=[(-1, 1)] * steps + [(0, None)] * 3 * steps,
        constraints=[
            {"type": "ineq", "fun": lambda z, s=s: within(*(z[part] for part in parts), s)}
            for s in (1, -1)
        ],
        method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 500},
    )
    assert best.success
    assert (best.x[steps:] > 0.1).any()  # no plan keeps all of the limits
    names = dict(zip(LIMITS, bounds, strict=True))
    law = LinearMPC(QUIET, steps, Limits(**names, penalty=penalty))
    action, memory = law.action(law.begin(1), state[None], np.zeros((1, 1)))
    # Both solvers stop at residuals of 1e-6 of numbers of order ten.
    np.testing.assert_allclose(memory["plan"][0], best.x, atol=1e-4)
    assert action[0, 0] == memory["plan"][0, 0]
    free = LinearMPC(QUIET, steps)
    assert abs(free.action(free.begin(1), state[None], np.zeros((1, 1)))[0] - action) > 0.1


@pytest.mark.parametrize("name", LIMITS)
def test_limit_is_kept_where_the_unlimited_plan_breaks_it(name) -> None:
    row = list(LIMITS).index(name)
    limits = Limits(penalty=KEEPING, **{name: LIMITS[name]})
    free, kept = (largest(QUIET, LinearMPC(QUIET, limits=one))[row] for one in (None, limits))
    assert np.count_nonzero(free > LIMITS[name]) >= 2
    # The solver stops at 1e-6, of numbers that without force are up to ten limits.
    assert kept.max() <= LIMITS[name] * (1.0 + 1e-5)


def test_far_beyond_a_limit_there_still_is_a_plan() -> None:
    law = LinearMPC(QUIET, limits=Limits(stroke=0.01))
    state = np.array([[0.0, 0.2, 0.0, 5.0], [0.0, -0.2, 0.0, -5.0]])  # no force keeps 1 cm
    action, memory = law.action(law.begin(2), state, np.zeros((2, 1)))
    assert np.isfinite(memory["plan"]).all()
    # Positive is on the carriage, and draws the sphere back. The solver stops at 1e-6.
    np.testing.assert_allclose(action, [[1.0], [-1.0]], atol=1e-4)


def test_limits_are_of_the_scene_unless_stated() -> None:
    scene = ACTIVE_MASS_DAMPER.replace(**{"objective.displacement_limit": 0.02})
    rail = scene.objective.rail_half_length
    assert Limits.of(scene) == Limits(displacement=KEPT * 0.02, stroke=KEPT * rail)
    found = laws(scene)["constrained-mpc"](scene)
    assert found.law.program.free.shape[0] == 2 * 30
    assert LinearMPC(scene, limits=Limits(coupling_force=2.0)).program.free.shape[0] == 30
    assert found.name == "linear MPC, 30 steps ahead, within limits"


def test_no_episode_ends_early_within_limits() -> None:
    # Wind and ground are unknown to the plan, and strong here: what it leaves of the rail is for
    # them.
    strong = {"excitation.0.rms": [1.0, 1.2], "excitation.1.rms": [0.4, 0.5]}
    scene = ACTIVE_MASS_DAMPER.replace(randomization=strong)
    free, kept = (
        evaluate(scene, Feedback(scene, law, TrueState()), episodes=20)
        for law in (LinearMPC(scene), LinearMPC(scene, limits=Limits.of(scene)))
    )
    # After an early end the displacement keeps its last value.
    ended = [(one.displacement[-1] == one.displacement[-2]).sum() for one in (free, kept)]
    assert ended[0] > ended[1] == 0
    assert kept.cost < free.cost


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf, "1", True, [1.0]])
@pytest.mark.parametrize("name", [*LIMITS, "penalty"])
def test_impossible_limit_is_refused_by_name(name, value) -> None:
    with pytest.raises(DesignError, match=f"^{name}: got .*allowed: a finite number"):
        Limits(**{name: value})


def test_scene_without_limits_is_refused_by_name() -> None:
    with pytest.raises(DesignError, match="penalty: got None"):
        Limits(penalty=None)
    for kept in (-1.0, 1.5, np.nan):
        with pytest.raises(DesignError, match="kept: got"):
            Limits.of(ACTIVE_MASS_DAMPER, kept)
    assert "rail_half_length: missing" in str(obstacle("constrained-mpc", CARRIAGE_FORCE))
    assert "constrained-mpc" in laws(ACTIVE_MASS_DAMPER)
    assert "constrained-mpc" not in laws(CARRIAGE_FORCE)
