"""Accelerations and the force between the masses in the reward, recomputed from the motion."""

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, HYBRID, TASKS

from mm_gym import CompileError, MovingMassEnv, MovingMassVectorEnv, compile_scene

WEIGHTS = {
    "objective.carriage_acceleration_weight": 0.7,
    "objective.carriage_acceleration_scale": 20.0,
    "objective.sphere_acceleration_weight": 0.4,
    "objective.sphere_acceleration_scale": 3.0,
    "objective.coupling_force_weight": 0.2,
    "objective.coupling_force_scale": 0.05,
}
LANES = 600


def test_reward_is_the_documented_sum():
    scene = CARRIAGE_FORCE.replace(
        **WEIGHTS, springs={"kind": "small_on_large", "stiffness": 35.0, "stretch": 1.5}
    )
    env = MovingMassVectorEnv(scene, LANES, info="full", autoreset_mode="Disabled")
    env.reset(seed=0)
    rng, o = np.random.default_rng(1), scene.objective
    m1, m2, k1 = scene.carriage.mass, scene.sphere.mass, scene.carriage.stiffness
    d, c = scene.carriage.damping, scene.interface.damping
    k2 = 2.0 * 35.0 * (1.0 + 2.0 * 1.5**-3)
    for _ in range(20):
        action = rng.uniform(-1.2, 1.2, (LANES, 1))
        _, reward, _, _, info = env.step(action)
        x1, x2, v1, v2 = info["state"].T
        u = info["applied"][:, 0]
        between = c * (v2 - v1) + k2 * (x2 - x1)
        a1, a2 = (between + u - k1 * x1 - d * v1) / m1, -between / m2
        terms = {
            "displacement": o.displacement_weight * (x1 / o.displacement_scale) ** 2,
            "velocity": o.velocity_weight * (v1 / o.velocity_scale) ** 2,
            "effort": o.effort_weight * np.clip(action[:, 0], -1.0, 1.0) ** 2,
            "stroke": 0.0 * x1,
            "carriage_acceleration": 0.7 * (a1 / 20.0) ** 2,
            "sphere_acceleration": 0.4 * (a2 / 3.0) ** 2,
            "coupling_force": 0.2 * (between / 0.05) ** 2,
        }
        # Accelerations are differences of forces that may cancel: 2^-52 of the largest of them.
        size = 1e-13 * ((k1 * np.abs(x1) + np.abs(u)) / m1 / 20.0) ** 2
        np.testing.assert_allclose(reward, -sum(terms.values()), rtol=1e-12, atol=size.max())
        for name, term in terms.items():
            np.testing.assert_allclose(info[f"reward_{name}"], -term, rtol=1e-12, atol=size.max())


def rewards_of(scene, threads=1):
    env = MovingMassVectorEnv(scene, LANES, autoreset_mode="SameStep", threads=threads)
    env.reset(seed=5)
    rng = np.random.default_rng(0)
    shape = (LANES, *env.single_action_space.shape)
    actions = (rng.uniform(-1, 1, shape).astype(np.float32) for _ in range(40))
    return np.array([env.step(action)[1] for action in actions])


@pytest.mark.parametrize("task", [CARRIAGE_FORCE, HYBRID])
def test_single_environments_lanes_and_threads_have_the_same_rewards(task):
    scene = task.replace(**WEIGHTS, **{"control.steps": 25})
    one, two = rewards_of(scene), rewards_of(scene, threads=2)
    np.testing.assert_array_equal(one, two)
    rng, lane = np.random.default_rng(0), 11
    env = MovingMassEnv(scene)
    env.reset(seed=5 + lane)
    for row in one:
        shape = (LANES, *env.action_space.shape)
        action = rng.uniform(-1, 1, shape).astype(np.float32)[lane]
        _, reward, terminated, truncated, _ = env.step(action)
        assert reward == row[lane]
        if terminated or truncated:
            env.reset()


def test_accelerations_are_those_that_sensors_show():
    scene = HYBRID.replace(
        sensors={"channels": ["carriage_acceleration", "sphere_acceleration"]},
        objective={"displacement_weight": 0.0, "displacement_scale": 1.0},
    ).replace(**WEIGHTS)
    env = MovingMassVectorEnv(scene, LANES)
    env.reset(seed=1)
    units = [1.0 / channel.factor for channel in env.plant.observed]
    for _ in range(10):
        observation, reward, *_ = env.step(np.full((LANES, 2), 0.3, np.float32))
        a1, a2 = (observation * units).astype(np.float64).T
        want = 0.7 * (a1 / 20.0) ** 2 + 0.4 * (a2 / 3.0) ** 2
        want += 0.2 * (env.drawn("sphere.mass") * a2 / 0.05) ** 2
        # Observations are in single precision, whose errors squares double.
        np.testing.assert_allclose(-reward, want, rtol=8 * 2.0**-24)


@pytest.mark.parametrize("name", TASKS)
def test_tasks_have_no_such_terms(name):
    assert not compile_scene(TASKS[name]).scores_reactions
    _, info = MovingMassEnv(TASKS[name], info="full").reset(seed=0)
    assert not {"reward_carriage_acceleration", "reward_coupling_force"} & set(info)


@pytest.mark.parametrize("name", ["carriage_acceleration_weight", "carriage_acceleration_scale"])
def test_digest_has_what_is_set(name):
    changed = CARRIAGE_FORCE.replace(**{f"objective.{name}": 2.0})
    assert changed.digest != CARRIAGE_FORCE.digest


def test_carriage_without_mass_has_no_acceleration_to_weigh():
    scene = CARRIAGE_FORCE.replace(
        **{"carriage.mass": 0.0, "objective.carriage_acceleration_weight": 1.0}
    )
    with pytest.raises(CompileError, match="objective: a carriage of mass 0 has no finite"):
        compile_scene(scene)


def test_carriage_without_mass_leaves_the_force_between_the_masses_to_weigh():
    light = {"carriage.mass": 0.0, "initial.carriage_velocity": 0.0}
    weights = {"objective.coupling_force_weight": 0.2, "objective.coupling_force_scale": 0.05}
    scene = CARRIAGE_FORCE.replace(**light, **weights)
    env = MovingMassVectorEnv(scene, 3, autoreset_mode="Disabled")
    env.reset(seed=0)
    _, reward, _, _, info = env.step(np.zeros((3, 1)))
    x1, _, v1, v2 = info["state"].T
    between, o = scene.interface.damping * (v2 - v1), scene.objective
    cost = 0.2 * (between / 0.05) ** 2 + o.displacement_weight * (x1 / o.displacement_scale) ** 2
    cost += o.velocity_weight * (v1 / o.velocity_scale) ** 2
    np.testing.assert_allclose(reward, -cost, rtol=1e-10)
    scored = env.plant.scored_reactions(env.get_state()["values"])
    np.testing.assert_allclose((scored**2).sum(axis=0), 0.2 * (between / 0.05) ** 2, rtol=1e-10)
