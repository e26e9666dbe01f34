"""Do torch's gradients of control steps and of whole episodes meet differences?"""

from __future__ import annotations

import re

import numpy as np
import pytest
import torch
from torch.autograd import gradcheck

from mm_gym import ActionError, MovingMassVectorEnv, SceneError, compile_scene, load_scene, rewarded
from mm_gym.lanes import layout
from mm_gym.tasks import ids
from mm_gym.torch import Episodes, step

DRAWN = {
    "randomization.sphere.mass": [0.03, 0.05],
    "randomization.carriage.stiffness": [300.0, 500.0],
}
BOUC_WEN = {
    "interface": {
        "kind": "bouc_wen",
        "stiffness": 20.0,
        "yield_displacement": 0.002,
        "stiffness_ratio": 0.2,
    }
}


def start_of(plant, lanes=3):
    """Return states (lanes, n), with what the actuators apply, and actions (lanes, k), by seed."""
    rng, columns = np.random.default_rng(0), len(plant.actuators)
    motion = [0.001, 0.002, 0.01, -0.01] + [0.1] * (len(plant.support.state_rows) - 4)
    end = plant.jacobian(motion, [0.1] * columns).end
    state = np.tile(end, (lanes, 1))
    state[:, :4] *= rng.uniform(0.7, 1.1, (lanes, 4))
    action = rng.uniform(-0.5, 0.5, (lanes, columns))
    return torch.tensor(state, requires_grad=True), torch.tensor(action, requires_grad=True)


@pytest.mark.parametrize("task", ids())
def test_a_step_of_every_task_has_the_slopes_of_differences(task):
    plant = compile_scene(load_scene(task))
    state, action = start_of(plant)
    # To ends of order one: positions are some 1e-3 m. Differences of 1e-6 of doubles are good to
    # 1e-10 / 1e-6.
    scale = torch.ones(state.shape[1], dtype=torch.float64)
    scale[:4] = torch.tensor([1e3, 1e3, 1e1, 1e1])
    assert gradcheck(lambda *given: step(plant, *given) * scale, (state, action), atol=1e-4)


def test_parameters_of_a_step_have_the_slopes_of_differences():
    scene = load_scene("mm_gym/CarriageForce-v0").replace(**DRAWN)
    plant = compile_scene(scene)
    state, action = start_of(plant)
    names = "sphere.mass", "carriage.stiffness"
    values = [torch.tensor(x, dtype=torch.float64, requires_grad=True) for x in (0.041, 380.0)]

    def ends(*given):
        return 1e3 * step(plant, state, action, parameters=dict(zip(names, given, strict=True)))

    assert gradcheck(ends, values, atol=1e-4)
    with pytest.raises(SceneError, match="at: with parameters"):
        step(plant, state, action, at=np.zeros(3), parameters={names[0]: values[0]})


def test_a_parameter_may_have_any_shape_of_one_number():
    plant = compile_scene(load_scene("mm_gym/CarriageForce-v0").replace(**DRAWN))
    state, action = start_of(plant)
    slopes = []
    for shape in ((), (1,), (1, 1)):
        mass = torch.full(shape, 0.041, dtype=torch.float64, requires_grad=True)
        step(plant, state, action, parameters={"sphere.mass": mass}).sum().backward()
        assert mass.grad.shape == shape
        slopes.append(mass.grad.item())
    assert len(set(slopes)) == 1


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"parameters": {"sphere.mass": torch.ones(3)}}, "parameters.sphere.mass: got shape (3,)"),
        ({"parameters": {"sphere.mass": 0.041}}, "parameters.sphere.mass: got float; allowed: a"),
        ({"state": np.zeros(4)}, "state: got float64; allowed: a tensor"),
        ({"action": torch.zeros(1, dtype=torch.complex64)}, "action: got torch.complex64"),
    ],
)
def test_what_is_no_tensor_of_real_numbers_is_refused(changes, text):
    plant = compile_scene(load_scene("mm_gym/CarriageForce-v0").replace(**DRAWN))
    given = {"state": torch.zeros(4), "action": torch.zeros(1)} | changes
    with pytest.raises(SceneError, match=f"^{re.escape(text)}"):
        step(plant, **given)


def test_steps_go_on_where_the_step_before_has_ended():
    plant = compile_scene(load_scene("mm_gym/PreStretch-v0"))
    env = MovingMassVectorEnv("mm_gym/PreStretch-v0", 1)
    env.reset(seed=0)
    start = env.get_state()
    state = torch.tensor(start["values"][plant.support.state_rows].T)
    action = torch.tensor([[0.3]])
    state = step(plant, state, action, at=start)
    env.step(action.numpy())
    again = step(plant, state, action, at=env.get_state())
    env.step(action.numpy())
    # Jacobians move by series of their own, to round-off of the motion's scale.
    assert np.allclose(again[:, :4].numpy(), env.state, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("task", [task for task in ids() if "ActiveMass" not in task])
def test_episodes_have_the_numbers_of_the_environment(task):
    episodes = Episodes(task, 3)
    env = MovingMassVectorEnv(task, 3)
    observation, _ = env.reset(seed=5)
    assert np.array_equal(episodes.reset(seed=5), observation)
    rng = np.random.default_rng(0)
    for _ in range(4):
        action = rng.uniform(-1.2, 1.2, env.action_space.shape)
        observation, rewards, *_ = env.step(action)
        shown, cost = episodes.step(torch.tensor(action, requires_grad=True))
        assert np.array_equal(shown.detach(), observation)
        assert np.array_equal(cost.detach(), -rewards)


def own_cost(carriage_acceleration, spring_force, sphere_velocity):
    return 1e-4 * carriage_acceleration**2 + spring_force**2 + abs(sphere_velocity) ** 3


SCENES = {
    "PreStretch": load_scene("mm_gym/PreStretch-v0"),
    "Hybrid, late": load_scene("mm_gym/Hybrid-v0").replace(**{"sensors.delay": 2}),
    "Hybrid, late and lost": load_scene("mm_gym/Hybrid-v0").replace(
        randomization={"sensors.delay": [0, 2], "actuation.force.lag": [0.0, 0.02]},
        **{"sensors.dropout": 0.3},
    ),
    "Friction": load_scene("mm_gym/CarriageForceFriction-v0"),
    "accelerations": load_scene("mm_gym/CarriageForceDuffing-v0").replace(
        **{
            "objective.carriage_acceleration_weight": 0.5,
            "sensors.channels": ["carriage_acceleration", "sphere_offset", "applied_force"],
        }
    ),
    "accelerations, a damper of the carriage": load_scene("mm_gym/SemiActiveDamper-v0").replace(
        **{
            "actuation.damping": {"of": "carriage", "minimum": 0.1, "maximum": 20.0, "lag": 0.03},
            "sensors": {"channels": ["carriage_acceleration", "sphere_acceleration"]},
        }
    ),
    "Bouc-Wen": load_scene("mm_gym/CarriageForce-v0").replace(**BOUC_WEN),
    "own cost": rewarded(load_scene("mm_gym/PreStretchNoise-v0"), own_cost),
}


@pytest.mark.parametrize("name", SCENES)
def test_an_episode_has_the_slopes_of_differences(name):
    episodes = Episodes(SCENES[name], 2)
    seen = episodes.reset(seed=0).shape[1]
    columns = episodes.env.single_action_space.shape[0]
    draw = torch.Generator().manual_seed(1)
    first, steps = 0.1 * torch.randn(seen, columns, generator=draw, dtype=torch.float64), 8
    weights = first.requires_grad_()

    def cost(given):
        observation, total = episodes.reset(seed=0), torch.zeros((), dtype=torch.float64)
        for n in range(steps):
            asked = observation.double() @ given + 0.1 * np.cos(2.0 * n)
            observation, costs = episodes.step(asked)
            total = total + costs.mean()
        return total / steps

    (slopes,) = torch.autograd.grad(cost(weights), weights)
    direction = torch.randn(seen, columns, generator=draw, dtype=torch.float64)
    with torch.no_grad():
        apart = cost(first + 1e-3 * direction) - cost(first - 1e-3 * direction)
    # Observations are single: 1e-7 of a number of order one, over a difference of 2e-3, and the
    # curvature over 1e-3.
    assert float((slopes * direction).sum()) == pytest.approx(float(apart) / 2e-3, rel=3e-3)


@pytest.mark.parametrize(("of", "sign"), [("carriage", 0.0), ("interface", 1.0)])
def test_the_shown_acceleration_has_the_slope_of_the_damping_force(of, sign):
    scene = load_scene("mm_gym/SemiActiveDamper-v0").replace(
        **{
            "actuation.damping": {"of": of, "minimum": 0.1, "maximum": 20.0},
            "initial.carriage_velocity": 0.3,
            "sensors": {"channels": ["carriage_acceleration"]},
        }
    )
    episodes = Episodes(scene, 2)
    episodes.reset(seed=0)
    episodes.step(torch.zeros(2, 1))
    (shown,) = episodes.env.plant.observed
    lanes = np.asarray(episodes.env.get_state()["values"])
    v1, v2 = lanes[layout.V1], lanes[layout.V2]
    wanted = shown.factor * (sign * v2 - v1) / scene.carriage.mass
    assert abs(wanted).min() > 0.01
    # Central differences of a linear function: their round-off is some 1e-10 of the acceleration.
    found = episodes._outputs.slopes()[0][0, -1]
    assert found == pytest.approx(wanted, rel=1e-7)


@pytest.mark.parametrize("wrong", [torch.full((2, 1), np.nan), torch.zeros(3, 1), torch.zeros(2)])
def test_a_refused_action_changes_nothing(wrong):
    slopes = []
    for is_asked in (False, True):
        episodes = Episodes("mm_gym/CarriageForce-v0", 2)
        episodes.reset(seed=0)
        if is_asked:
            with pytest.raises(ActionError, match=r"^action: got"):
                episodes.step(wrong)
        action = torch.full((2, 1), 0.1, requires_grad=True)
        _, cost = episodes.step(action)
        slopes += torch.autograd.grad(cost.sum(), action)
    assert torch.equal(*slopes)


def test_a_detached_state_ends_the_way_back():
    episodes = Episodes("mm_gym/PreStretch-v0", 2)
    episodes.reset(seed=0)
    first = torch.zeros(2, 1, requires_grad=True)
    episodes.step(first)
    episodes.detach()
    _, cost = episodes.step(torch.zeros(2, 1, requires_grad=True))
    assert torch.autograd.grad(cost.sum(), first, allow_unused=True) == (None,)


def test_held_slopes_fade_and_are_no_larger_than_asked():
    slopes = {}
    for fade, most in ((1.0, np.inf), (0.5, np.inf), (1.0, 1.0)):
        episodes = Episodes("mm_gym/PreStretch-v0", 3, fade=fade, most=most)
        episodes.reset(seed=0)
        first = torch.zeros(3, 1, requires_grad=True)
        episodes.step(first)
        for _ in range(3):
            _, cost = episodes.step(torch.zeros(3, 1))
        (slopes[fade, most],) = torch.autograd.grad(cost.sum(), first)
    # Three steps back to the first action's end.
    assert torch.allclose(slopes[0.5, np.inf], 0.125 * slopes[1.0, np.inf])
    assert not torch.equal(slopes[1.0, 1.0], slopes[1.0, np.inf])


def test_episodes_that_end_early_are_refused():
    scene = load_scene("mm_gym/CarriageForce-v0").replace(**{"objective.displacement_limit": 0.1})
    for given in (scene, "mm_gym/ActiveMassDamper-v0"):
        with pytest.raises(SceneError, match="do not end early"):
            Episodes(given, 2)
