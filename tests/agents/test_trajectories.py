"""Do plans that descend follow the slope of the cost, and reach what is known?"""

import numpy as np
import pytest

from agents.control.trajectories import Trajectories
from mm_gym import MovingMassVectorEnv, load_scene

LANES = 3
SCENES = {
    "linear": ("CarriageForce", {}),
    "friction": ("CarriageForceFriction", {}),
    "rate limit": ("PreStretch", {}),
    "a lag in each episode": ("CarriageForceRobust", {}),
    "such a lag and a rate limit": ("PreStretchRobust", {}),
    "both": ("Hybrid", {}),
    "ends": ("ActiveMassDamper", {}),
}


def problem(task, changes, steps=None):
    """Return the task's episodes at their start as trajectories."""
    scene = load_scene(f"mm_gym/{task}-v0").replace(**changes)
    env = MovingMassVectorEnv(scene, LANES, autoreset_mode="Disabled")
    env.reset(seed=5)
    return Trajectories(scene, env.plant, env.get_state(), steps)


@pytest.mark.parametrize(("task", "changes"), SCENES.values(), ids=SCENES)
def test_slope_is_that_of_central_differences(task, changes):
    plans, rng = problem(task, changes, 12), np.random.default_rng(2)
    controls = rng.uniform(-0.6, 0.6, (12, len(plans.actuators), LANES))
    lanes = np.arange(LANES)
    found = plans.follow(lanes, controls)
    slope = plans._slope(found)
    h = 1e-5
    for step, actuator in ((0, 0), (5, -1), (11, 0)):
        apart = np.zeros_like(controls)
        apart[step, actuator] = h
        asked = [found.controls + side * apart for side in (1.0, -1.0)]
        above, below = (plans.follow(lanes, one) for one in asked)
        differences = (above.cost - below.cost) / (2.0 * h)
        # Elsewhere a limit of what is applied takes a part of the difference.
        free = [
            (end.controls == one).all(axis=(0, 1))
            for end, one in zip((above, below), asked, strict=True)
        ]
        free = free[0] & free[1]
        assert free.any()
        # Differences of costs lose half of their digits, and kinks of friction a few more.
        scale = np.abs(slope).max(axis=(0, 1))
        error = (slope[step, actuator] - differences) / scale
        np.testing.assert_allclose(error[free], 0.0, atol=1e-6)


def test_descent_ends_at_the_optimum_of_a_quadratic_problem():
    plans, lanes = problem("CarriageForce", {}), np.arange(LANES)
    still = np.zeros((plans.steps, 1, LANES))
    best = plans.improve(lanes, still, 30).cost
    found = plans.descend(lanes, still, 200)
    assert (found.cost <= plans.follow(lanes, still).cost).all()
    np.testing.assert_allclose(found.cost, best, rtol=1e-3)
    np.testing.assert_array_equal(plans.follow(lanes, found.controls).cost, found.cost)
