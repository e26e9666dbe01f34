"""Is the linear-quadratic regulator optimal, and does it refuse what it cannot do?"""

import mpmath
import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, PRE_STRETCH

from agents.controllers.lqr import LQR, LaggingLQR, design
from agents.controllers.registry import laws, obstacle
from agents.scoring import validation_cost
from mm_gym import DesignError, MovingMassVectorEnv, Scene, compile_scene

LONG = CARRIAGE_FORCE.replace(
    **{"control.steps": 3000, "actuation.force.limit": 1000.0, "objective.effort_weight": 625.0}
)
"""The task without clipping: the same weight of force in newtons, a limit out of reach, and time
to settle."""

LANES = 32


def roll_out(
    scene: Scene, gain: np.ndarray, states: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return each lane's initial state and sum of rewards, and the largest action of all.

    The control is u = -gain @ state.
    """
    assert scene.actuation.force is not None
    env = MovingMassVectorEnv(scene, LANES, autoreset_mode="Disabled")
    _, info = env.reset(seed=7)
    start, total, largest = info["state"].copy(), np.zeros(LANES), 0.0
    for _ in range(scene.control.steps):
        action = info["state"][:, states] @ (-gain.T / scene.actuation.force.limit)
        largest = max(largest, float(np.abs(action).max()))
        _, reward, *_, info = env.step(action)
        total += reward
    return start, total, largest


SPRINGS = {"kind": "small_on_large", "stiffness": 35.0, "stretch": 1.5}


@pytest.mark.parametrize(
    ("springs", "stroke_weight"), [({"kind": "none"}, 0.0), (SPRINGS, 0.0), (SPRINGS, 0.3)]
)
def test_rolled_out_cost_equals_the_riccati_cost(springs: dict, stroke_weight: float) -> None:
    scene = LONG.replace(**{"springs": springs, "objective.stroke_weight": stroke_weight})
    solution = design(scene)
    start, total, largest = roll_out(scene, solution.gain, solution.states)
    assert largest < 1.0, "clipping would break the identity"
    x = start[:, solution.states]
    expected = np.einsum("ni,ij,nj->n", x, solution.cost - solution.weight, x)
    # The Riccati solver keeps about 1e-12; what is left after 30 s of the slowest mode is far
    # below.
    np.testing.assert_allclose(-total, expected, rtol=1e-9)


HEAVY = Scene(
    carriage={"mass": 1e6, "stiffness": 1.6e11, "damping": 4e7},
    sphere={"mass": 1e5},
    springs={"kind": "linear", "stiffness": 1.6e9},
    interface={"kind": "viscous", "damping": 4e6},
    actuation={"force": {"limit": 1.6e7}},
    control={"time_step": 5e-5},
    objective={"displacement_scale": 1e-3, "effort_weight": 1e-3},
)
"""In SI units its Riccati equation has a residual of 1e-8."""


def test_heavy_and_fast_masses_have_the_regulator_of_the_equation() -> None:
    a, b = (mpmath.matrix(one.tolist()) for one in compile_scene(HEAVY).discrete())
    with mpmath.workdps(60):
        weight, one = mpmath.mpf(1e-3) / mpmath.mpf(1.6e7) ** 2, mpmath.eye(4)
        cost = mpmath.diag([mpmath.mpf(1e-3) ** -2, 0, 0, 0])
        turn, reach, p = a, b * b.T / weight, cost
        for _ in range(40):  # doubling: 2^40 steps
            through = (one + reach * p) ** -1
            p, reach, turn = (
                p + turn.T * p * through * turn,
                reach + turn * through * reach * turn.T,
                turn * through * turn,
            )
        exact = (b.T * p * a) / (weight + (b.T * p * b)[0])
    np.testing.assert_allclose(design(HEAVY).gain[0], np.array(exact.tolist()[0], float), rtol=1e-6)


def test_no_perturbed_gain_beats_the_regulator() -> None:
    scene = LONG.replace(**{"control.steps": 600})
    solution = design(scene)
    _, best, _ = roll_out(scene, solution.gain, solution.states)
    generator = np.random.default_rng(0)
    for _ in range(200):
        factor = 1.0 + generator.uniform(0.01, 0.5) * generator.standard_normal(solution.gain.shape)
        _, other, _ = roll_out(scene, solution.gain * factor, solution.states)
        # The regulator minimises the cost from every start, so from each lane's.
        assert np.all(other <= best * (1.0 - 1e-12))


REWARDED = {"objective.sphere_acceleration_weight": 0.3, "objective.sphere_acceleration_scale": 5.0}


@pytest.mark.parametrize("weights", [{}, REWARDED], ids=["motion", "acceleration"])
def test_a_regulator_that_knows_the_lag_has_the_riccati_cost_and_the_least(weights) -> None:
    scene = LONG.replace(**{"springs": SPRINGS, "actuation.force.lag": 0.015, **weights})
    law, totals = LaggingLQR(scene), []
    for one in (law, LQR(scene)):
        env = MovingMassVectorEnv(scene, LANES, autoreset_mode="Disabled")
        _, info = env.reset(seed=7)
        start, total = info["state"].copy(), np.zeros(LANES)
        for _ in range(scene.control.steps):
            action, _ = one.action({}, info["state"], info["applied"])
            assert np.abs(action).max() < 1.0, "clipping would break the identity"
            _, reward, *_, info = env.step(action)
            total += reward
        totals.append(-total)
    weight = law.design.cost - law.design.weight
    expected = np.einsum("ni,ij,nj->n", start, weight[:4, :4], start)  # no force at the start
    np.testing.assert_allclose(totals[0], expected, rtol=1e-9)  # as above
    assert (totals[1] > 1.01 * totals[0]).all()


def test_it_is_offered_where_the_force_lags() -> None:
    assert "lagging-lqr" in laws(LONG.replace(**{"actuation.force.lag": 0.01}))
    assert "lagging-lqr" in laws(LONG.replace(randomization={"actuation.force.lag": (0.0, 0.01)}))
    assert "actuation.force.lag: got 0" in str(obstacle("lagging-lqr", LONG))


def test_free_sphere_is_left_out_of_the_regulated_states() -> None:
    assert design(CARRIAGE_FORCE).states == (0, 2, 3)
    assert design(CARRIAGE_FORCE.replace(interface={"kind": "none"})).states == (0, 2)


def test_sprung_sphere_is_regulated_in_all_states() -> None:
    scene = CARRIAGE_FORCE.replace(springs={"kind": "small_on_large"})
    assert design(scene).states == (0, 1, 2, 3)


def test_closed_loop_is_stable_and_faster_than_the_open_one() -> None:
    a, b = compile_scene(LONG).discrete()
    solution = design(LONG)
    a, b = a[np.ix_(solution.states, solution.states)], b[list(solution.states)]
    closed, opened = (np.abs(np.linalg.eigvals(m)).max() for m in (a - b @ solution.gain, a))
    assert closed < opened < 1.0


def test_missing_force_is_refused() -> None:
    with pytest.raises(DesignError, match=r"actuation\.force: missing"):
        LQR(PRE_STRETCH)


def test_free_force_is_refused() -> None:
    with pytest.raises(DesignError, match=r"objective\.effort_weight: got 0"):
        LQR(CARRIAGE_FORCE.replace(**{"objective.effort_weight": 0.0}))


@pytest.mark.parametrize("kind", ["none", "viscous"])
def test_paid_drift_of_a_free_sphere_is_refused(kind: str) -> None:
    # The stroke is paid for, but m2 v2 + c (x2 - x1) is constant whatever the force: nothing can
    # bring it to rest.
    scene = CARRIAGE_FORCE.replace(**{"interface": {"kind": kind}, "objective.stroke_weight": 1.0})
    with pytest.raises(DesignError, match="not stabilisable"):
        LQR(scene)


def test_the_regulator_holds_a_bistable_carriage_on_its_hill() -> None:
    bistable = {"linear_coefficient": -1.0, "cubic_coefficient": 1e4}
    scene = CARRIAGE_FORCE.replace(**{f"carriage.{k}": v for k, v in bistable.items()})
    scene = scene.replace(**{"initial.carriage_displacement": 0.002, "actuation.force.limit": 20.0})
    env = MovingMassVectorEnv(scene, 1)
    law = LQR(scene)
    _, info = env.reset(seed=0)
    for _ in range(200):
        *_, info = env.step(law.action({}, info["state"], info["applied"])[0])
    # Alone the carriage would be in its well, at 10 mm.
    assert np.abs(info["state"][0, [0, 2]]).max() < 1e-5


@pytest.mark.parametrize("of", ["interface", "carriage"])
def test_it_holds_the_best_damping_where_there_is_a_damper_too(of: str) -> None:
    scene = CARRIAGE_FORCE.replace(
        springs={"kind": "linear", "stiffness": 100.0},
        actuation={"force": {"limit": 1.0}, "damping": {"of": of, "minimum": 0.1}},
        **{"control.steps": 100},
    )
    made = laws(scene)
    found, constant = (
        validation_cost(scene, made[name](scene)) for name in ("lqr", "best-constant")
    )
    assert found < 0.9 * constant
    # Held at one damping it is the regulator of a plant that has this damping.
    force, damper = made["lqr"](scene).law.laws
    plain = CARRIAGE_FORCE.replace(
        springs=scene.springs,
        actuation={"force": {"limit": 1.0}},
        **{f"{of}.damping": damper.value, "control.steps": 100},
    )
    np.testing.assert_allclose(force.design.gain, design(plain).gain, rtol=1e-12)
    free = scene.replace(**{"objective.effort_weight": 0.0})
    assert "effort_weight: got 0" in str(obstacle("lqr", free))
