"""Is a base told of each lane's own episode, wherever in time it began?"""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from tasks import CARRIAGE_FORCE

from agents.control.feedback import Feedback
from agents.controllers.lqr import LQR
from agents.controllers.newton_predictive_control import NewtonPredictiveControl, Steps
from agents.controllers.predictive_control import SEARCH, PredictiveControl
from agents.controllers.registry import laws
from agents.training.lanes import ResidualLanes
from agents.training.parts import base_controller
from mm_gym import SceneError, load_scene

SHORT = CARRIAGE_FORCE.replace(
    **{
        "control.steps": 30,
        "objective.displacement_limit": 0.003,
        "sensors.channels": ["carriage_displacement", "sphere_offset"],
        "sensors.noise": {"carriage_displacement": 1e-4, "sphere_offset": 1e-4},
        "sensors.delay": 2,
    }
)


def lanes(count, base, seed):
    env = gymnasium.make_vec(
        "mm_gym/CarriageForce-v0",
        num_envs=count,
        vectorization_mode="vector_entry_point",
        scene=SHORT,
        autoreset_mode=AutoresetMode.SAME_STEP,
    )
    residual = ResidualLanes(env, base, 0.5)
    return residual, residual.reset(seed=seed)[0]


FEW = Steps(horizon=5, rounds=1, near=1, fresh=1)

BASES = {
    name: (lambda name=name: base_controller(SHORT, name))
    for name in ("lqg", "lqr", "finite-horizon-lqr", "random")
} | {
    "linear-mpc": lambda: base_controller(
        SHORT.replace(**{"actuation.force.limit": 0.5}), "linear-mpc"
    ),
    "newton": lambda: Feedback(
        SHORT, NewtonPredictiveControl(SHORT, Steps(horizon=5, rounds=1, near=1, fresh=1))
    ),
    "cross-entropy": lambda: Feedback(
        SHORT, PredictiveControl(SHORT, LQR(SHORT), replace(SEARCH, horizon=4, plans=8))
    ),
}
"""Bases with a memory of their own, next to that of the state's estimate."""

ALONE = ("lqg", "lqr", "finite-horizon-lqr")
"""Those that draw no random numbers, which lanes that began together draw together."""


@pytest.mark.parametrize("name", ALONE)
def test_base_of_each_lane_acts_as_in_a_lane_alone(name):
    base, generator = BASES[name](), np.random.default_rng(1)
    many, observation = lanes(5, base, 7)
    alone = [lanes(1, base, 7 + i) for i in range(5)]
    begun = set()
    for step, action in enumerate(generator.uniform(-1.0, 1.0, (90, 5, 1))):
        np.testing.assert_allclose(
            observation, np.concatenate([seen for _, seen in alone]), rtol=0.0, atol=1e-6
        )
        observation, _, terminated, _, info = many.step(action)
        singles = [env.step(action[i : i + 1]) for i, (env, _) in enumerate(alone)]
        for i in np.flatnonzero(info.get("_final_obs", [])):
            last = singles[i][4]["final_obs"][0]
            np.testing.assert_allclose(info["final_obs"][i], last, rtol=0.0, atol=1e-6)
        alone = [(env, made[0]) for (env, _), made in zip(alone, singles, strict=True)]
        begun |= {(step, i) for i in np.flatnonzero(terminated)}
    assert len({step for step, _ in begun}) > 2  # lanes ended apart


@pytest.mark.parametrize("name", BASES)
def test_lanes_that_are_killed_ten_times_go_on_to_the_last_bit_without_replay(name):
    if name == "linear-mpc":
        pytest.importorskip("osqp")
    actions = np.random.default_rng(1).uniform(-1.0, 1.0, (60, 3, 1))
    unbroken, _ = lanes(3, BASES[name](), 7)
    expected = [unbroken.step(action)[0] for action in actions]
    broken, _ = lanes(3, BASES[name](), 7)
    for step, action in enumerate(actions):
        if step % 6 == 5:
            saved = broken.env.unwrapped.get_state(), broken.get_state()
            broken, _ = lanes(3, BASES[name](), 0)
            broken.env.unwrapped.set_state(saved[0])
            broken.base.act = broken.base.propose = None  # nothing is asked of the base
            broken.set_state(saved[1])
            del broken.base.act, broken.base.propose
        np.testing.assert_array_equal(broken.step(action)[0], expected[step])


def test_agent_and_base_add_up_within_the_range_of_the_action():
    env, observation = lanes(5, base_controller(SHORT, "lqr"), 3)
    law = env.proposed.copy()
    np.testing.assert_array_equal(observation[:, -1:], law.astype(np.float32))
    _, _, ended, _, info = env.step(np.full((5, 1), 1.0))
    applied = SHORT.actuation.force.limit * np.clip(law + 0.5, -1.0, 1.0)
    np.testing.assert_allclose(info["applied"][~ended], applied[~ended], rtol=1e-6)


def test_unknown_base_is_named_with_the_nearest():
    with pytest.raises(SceneError, match="base: got 'lqrr'; did you mean 'lqr'") as caught:
        base_controller(SHORT, "lqrr")
    assert all(name in str(caught.value) for name in laws(SHORT))


def test_base_that_does_not_suit_the_scene_says_why():
    with pytest.raises(SceneError, match="base: got 'phase-law', which is for other actuators"):
        base_controller(SHORT, "phase-law")


REASONS = [
    ({"objective.effort_weight": 0.0}, "lqr", "effort_weight: got 0; allowed: greater than 0"),
    (
        {"actuation.force": {"limit": 4.0, "rate_limit": 9.0, "command": "rate"}},
        "lqg",
        "actuation.force.command: got 'rate'; allowed: 'position'",
    ),
    ({}, "clipped-lqr", "which is for other actuators: stretch"),
    ({}, "lqr-and-clipped-lqr", "which is for other actuators: force and stretch"),
]


@pytest.mark.parametrize(("changes", "name", "reason"), REASONS)
def test_law_that_a_scene_refuses_is_told_why(changes, name, reason):
    scene = SHORT.replace(**changes)
    with pytest.raises(SceneError) as caught:
        base_controller(scene, name)
    assert f"base: got '{name}', " in str(caught.value)
    assert reason in str(caught.value)


def test_law_of_another_excitation_is_told_why():
    scene = load_scene("mm_gym/PreStretchShock-v0")
    for name, reason in (
        ("frequency-locked-loop", "harmonic"),
        ("matching-stretch", "randomization does not draw it"),
    ):
        with pytest.raises(SceneError, match=rf"got '{name}', which .*{reason}"):
            base_controller(scene, name)
    hybrid = load_scene("mm_gym/Hybrid-v0").replace(excitation=[], randomization={})
    with pytest.raises(SceneError, match="which expects the next values of noise"):
        base_controller(hybrid, "feedforward-lqr-and-clipped-lqr")
