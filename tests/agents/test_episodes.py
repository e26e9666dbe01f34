"""Are all controllers scored on the same episodes, by what the task asks for?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, PRE_STRETCH, TASKS

from agents.control.controller import Controller
from agents.control.feedback import Feedback
from agents.controllers.constant import Held, no_control
from agents.controllers.lqr import LQR
from agents.controllers.noise import RandomActions
from agents.scoring import HELD_OUT_SEED, evaluate, limit_penalty, validation_cost
from mm_gym import MovingMassVectorEnv, simulate
from mm_gym.analysis import spring_energy

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from agents.control.controller import Memory
    from mm_gym import Scene

LIMITED = CARRIAGE_FORCE.replace(**{"objective.displacement_limit": 0.004})


def test_cost_is_the_rms_where_only_displacement_is_rewarded() -> None:
    result = evaluate(
        PRE_STRETCH, Feedback(PRE_STRETCH, Held(PRE_STRETCH, "stretch", 1.5)), episodes=10
    )
    assert result.cost == pytest.approx(result.rms, rel=1e-12)
    np.testing.assert_allclose(result.episode_costs, result.episode_rms, rtol=1e-12)


def test_cost_is_the_root_of_the_mean_of_minus_reward() -> None:
    result = evaluate(CARRIAGE_FORCE, Feedback(CARRIAGE_FORCE, LQR(CARRIAGE_FORCE)), episodes=10)
    mean = -result.returns.mean() / CARRIAGE_FORCE.control.steps
    assert result.cost == pytest.approx(np.sqrt(mean), rel=1e-12)
    assert result.cost > 1.1 * result.rms  # velocity and force cost too


class Counted(RandomActions):
    """Random actions, and how often they were asked for."""

    steps = 0

    def propose(self, memory: Memory, observation: Any, info: Any) -> Any:
        self.steps += 1
        return super().propose(memory, observation, info)


@pytest.mark.parametrize("scene", [CARRIAGE_FORCE, LIMITED], ids=["lasts", "ends early"])
@pytest.mark.parametrize("worst", [1.0, 0.2])
def test_episodes_that_cost_more_than_is_asked_for_are_ended(scene: Scene, worst: float) -> None:
    def cost(most: float) -> tuple[float, int]:
        acting = Counted(scene)
        return validation_cost(scene, acting, worst, 10, most=most), acting.steps

    whole, steps = cost(np.inf)
    for share in (1.0, 1.0 + 1e-6, 2.0):  # what is not above the limit is found to the last bit
        assert cost(share * whole) == (whole, steps)
    told, done = cost(0.5 * whole)
    assert 0.5 * whole < told <= whole
    assert done < steps


def test_every_controller_sees_the_same_held_out_episodes() -> None:
    first, second = (
        evaluate(PRE_STRETCH, Feedback(PRE_STRETCH, Held(PRE_STRETCH, "stretch", s)), episodes=10)
        for s in (1.2, 2.4)
    )
    np.testing.assert_array_equal(first.frequency, second.frequency)
    # The first step cannot differ by more than one rate-limited step of the stretch.
    np.testing.assert_allclose(first.applied[0], second.applied[0], atol=2 * 0.04 + 1e-12)


def test_frequency_is_known_only_where_it_is_randomised() -> None:
    scene = TASKS["mm_gym/PreStretchNoise-v0"]
    assert evaluate(scene, Feedback(scene, no_control(scene)), episodes=3).frequency is None
    assert (
        evaluate(PRE_STRETCH, Feedback(PRE_STRETCH, no_control(PRE_STRETCH)), episodes=3).frequency
        is not None
    )


def test_ending_an_episode_early_does_not_lower_its_cost() -> None:
    limited, free = (
        evaluate(scene, Feedback(scene, no_control(scene)), episodes=40)
        for scene in (LIMITED, CARRIAGE_FORCE)
    )
    ended = np.abs(limited.displacement[-1]) * 0.01 > 0.004
    assert ended.any()
    assert not ended.all()
    # An ended episode gets no more rewards; the free one decays.
    assert np.all(limited.returns[ended] > free.returns[ended])
    assert np.all(limited.penalties[ended] > free.penalties[ended])
    np.testing.assert_array_equal(limited.penalties[~ended], free.penalties[~ended])


class LateCrash(Controller):
    """A good regulator that pushes with full force from some step on."""

    def __init__(self, scene: Scene, step: int) -> None:
        self.name, self.step = f"crash from step {step}", step
        self.law = Feedback(scene, LQR(scene))

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        return {**self.law.begin(env), "count": np.zeros(env.num_envs, np.int64)}

    def propose(
        self, memory: Memory, observation: NDArray[np.float32], info: dict[str, Any]
    ) -> tuple[NDArray[np.float64], Memory]:
        count = memory["count"] + 1
        action, own = self.law.act(memory, observation, info)
        late = np.ones_like(action)
        return np.where(count[:, None] <= self.step, action, late), {**own, "count": count}


CRASHES = (20, 40, 60, 80, 95)
"""From rest 4 N over 400 N/m overshoot 12 mm within four steps of 0.01 s."""


def test_no_early_end_is_better_than_an_episode_within_the_limits() -> None:
    scene = CARRIAGE_FORCE.replace(**{"objective.displacement_limit": 0.012})
    # 2.8 N: 7 mm for good, which costs much more than to regulate and to crash at last.
    pushes = [Held(scene, "force", force) for force in (2.8, 2.0)]
    laws = [no_control(scene), LQR(scene), *pushes]
    results = [
        evaluate(scene, controller, episodes=40)
        for controller in [
            *(Feedback(scene, law) for law in laws),
            *(LateCrash(scene, step) for step in CRASHES),
        ]
    ]
    crashed = [np.abs(result.displacement[-1]) * 0.01 > 0.012 for result in results]
    assert all(ended.all() for ended in crashed[len(laws) :])
    pairs = list(zip(results, crashed, strict=True))
    worst = max(one.penalties[~ended].max() for one, ended in pairs if not ended.all())
    assert worst > 0.3  # some survive in a poor way
    assert min(one.penalties[ended].min() for one, ended in pairs if ended.any()) > worst


def test_the_later_an_end_the_better() -> None:
    scene = CARRIAGE_FORCE.replace(**{"objective.displacement_limit": 0.012})
    costs = [evaluate(scene, LateCrash(scene, step), episodes=40).cost for step in CRASHES]
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] < 0.8 * costs[0]


def test_leaving_the_rail_costs_as_much_as_the_limits_allow() -> None:
    scene = CARRIAGE_FORCE.replace(
        **{"objective.rail_half_length": 0.02, "objective.stroke_weight": 0.0}
    )
    # Without a weight of the stroke the last step before the sphere leaves the rail costs nearly
    # nothing. A unit of displacement and 0.1 units of velocity at their scales, 0.01 of the action:
    assert limit_penalty(scene) == pytest.approx(1.11, rel=1e-15)
    result = evaluate(scene, Feedback(scene, Held(scene, "force", 0.4)), episodes=100)
    ended = result.returns > -scene.control.steps * result.penalties + 1e-9
    assert ended.any()
    assert result.penalties[ended].min() > limit_penalty(scene)


def test_the_penalty_of_an_early_end_is_that_of_its_definition() -> None:
    law = Feedback(LIMITED, Held(LIMITED, "force", 4.0))
    result = evaluate(LIMITED, law, episodes=3)
    limit = (0.004 / 0.01) ** 2 + 0.1 + 0.01
    for lane in range(3):
        env = MovingMassVectorEnv(LIMITED, 3)
        env.reset(seed=HELD_OUT_SEED)
        paid, terminated = [], np.zeros(3, np.bool_)
        while not terminated[lane]:
            _, reward, terminated, _, _ = env.step(np.ones((3, 1)))
            paid.append(-reward[lane])
        worst, steps = max(limit, *paid), LIMITED.control.steps
        penalty = (sum(paid) + (steps - len(paid)) * worst) / steps + worst
        # Sums of a hundred numbers in two orders.
        assert result.penalties[lane] == pytest.approx(penalty, rel=1e-13)
        assert result.returns[lane] == pytest.approx(-sum(paid), rel=1e-13)


FINITE = {"kind": "finite_stretch", "stiffness": 35.0, "stretch": 1.5, "rest_length": 0.05}


@pytest.mark.parametrize("springs", [None, FINITE], ids=["small on large", "finite stretch"])
def test_injected_energy_is_the_work_of_the_trajectory(springs) -> None:
    changes = {"control.steps": 60, "springs": springs or PRE_STRETCH.springs}
    scene = PRE_STRETCH.replace(**changes, **{"springs.stiffness": 30.0})
    scene = scene.replace(randomization={}, initial={"stretch": 2.0, "sphere_offset": 0.01})
    result = evaluate(scene, RandomActions(scene), seed=5, episodes=3)
    for lane in range(3):
        first, *_ = stretches = result.applied[:, lane, 0]
        motion = simulate(scene, action=stretches[:, None], seed=5 + lane)
        # The trajectory begins with the first stretch already applied.
        start = spring_energy(0.01, first, 30.0, 0.05 if springs else 0.0)
        start -= spring_energy(0.01, 2.0, 30.0, 0.05 if springs else 0.0)
        expected = max(0.0, start + motion.work.stretch[:-1].max())
        assert result.injected[lane] == pytest.approx(expected, rel=1e-9)
    assert result.injected.max() > 0.0
