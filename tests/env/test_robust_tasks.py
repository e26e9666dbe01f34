"""The variants of the tasks are the tasks over one published distribution of rigs."""

import gymnasium
import numpy as np
import pytest

from mm_gym import (
    MovingMassVectorEnv,
    Scene,
    SceneError,
    __main__,
    compile_scene,
    load_scene,
    over_rigs,
)
from mm_gym.tasks import ids, path_of, robust_ids, short_name, task_called, task_or_scene


@pytest.mark.parametrize("task", ids())
def test_every_task_has_a_variant_that_the_command_prints(task, capsys):
    variant = f"{task.removesuffix('-v0')}Robust-v0"
    assert variant in robust_ids()
    assert variant not in ids()
    assert __main__.main(["rigs", task]) == 0
    schema, first, second, text = path_of(variant).read_text("utf-8").split("\n", 3)
    assert schema == "#:schema ../scene.schema.json"
    assert first.startswith(f"# {variant}: {short_name(task)} on rigs that differ")
    assert second.startswith(f"# Printed by `python -m mm_gym rigs {short_name(task)}`")
    assert text == capsys.readouterr().out
    assert load_scene(variant) == over_rigs(load_scene(task))


@pytest.mark.parametrize("task", robust_ids())
def test_variants_are_stepped_as_other_tasks(task):
    assert task_called(short_name(task)) == task_or_scene(short_name(task)) == task
    single, env = gymnasium.make(task), gymnasium.make_vec(task, 8)
    observation, _ = env.reset(seed=4)
    seen, _ = single.reset(seed=4)
    for _ in range(4):
        assert np.array_equal(observation[0], seen)
        action = 0.5 * np.ones(env.action_space.shape, np.float32)
        observation, *_ = env.step(action)
        seen, *_ = single.step(action[0])
    scene = env.unwrapped.scene
    for name, (low, high) in scene.randomization.items():
        drawn = env.unwrapped.drawn(name)
        assert (low <= drawn).all()
        assert (drawn <= high).all()
        assert len(np.unique(drawn)) > 1, name


def test_what_a_scene_states_is_the_middle_of_the_rigs():
    for task in robust_ids():
        scene = load_scene(task)
        for name, ends in scene.randomization.items():
            if not name.startswith("excitation."):
                stated = scene.sensors.noise.get(name.removeprefix("sensors.noise."))
                stated = scene.value_of(name) if stated is None else stated
                assert stated == pytest.approx(np.mean(ends), rel=1e-5), (task, name)
        assert compile_scene(scene).delay == scene.sensors.delay == 1


def test_ranges_that_a_scene_draws_from_become_wider():
    scene = load_scene("mm_gym/CarriageForce-v0")
    drawn = {"sensors.delay": (0.0, 4.0), "actuation.force.lag": (0.0, 0.02)}
    drawn["sensors.noise.carriage_velocity"] = (0.0, 0.1)
    scene = scene.replace(**{"actuation.force.lag": 0.01, "randomization": drawn})
    found = over_rigs(scene).randomization
    assert found["sensors.delay"] == (0.0, 6.0)
    assert found["actuation.force.lag"] == (0.0, 0.02 + scene.control.time_step)
    assert found["sensors.noise.carriage_velocity"][1] > 0.1


@pytest.mark.parametrize(
    ("changes", "delays", "stated"),
    [
        ({"sensors.delay": 5}, (5.0, 7.0), 6),
        ({"randomization": {"sensors.delay": (3.0, 6.0)}}, (3.0, 8.0), 6),
    ],
)
def test_delay_goes_from_that_of_the_scene_up(changes, delays, stated):
    found = over_rigs(load_scene("mm_gym/CarriageForce-v0").replace(**changes))
    assert found.randomization["sensors.delay"] == delays
    assert found.sensors.delay == stated


RATIO = "interface.kinetic_ratio"
FRICTION = {"static_coefficient": 0.5, "kinetic_coefficient": 0.25, "reference_velocity": 0.05}


@pytest.mark.parametrize("kind", ["dry_friction", "stribeck"])
def test_friction_that_follows_from_a_mass_or_a_ratio_compiles(kind):
    more = {} if kind == "dry_friction" else {"stribeck_velocity": 0.1}
    scene = Scene(interface={"kind": kind, **FRICTION, **more}, actuation={"force": {}})
    found = over_rigs(scene)
    compile_scene(found)
    assert found.interface.normal_force == pytest.approx(scene.sphere.mass * 9.81)
    ratio = over_rigs(scene.replace(randomization={RATIO: (0.4, 0.6)})).randomization
    assert ratio[RATIO] == (0.4, 0.6)
    assert ratio["interface.static_coefficient"] == (0.4, 0.6)
    assert "interface.kinetic_coefficient" not in ratio


def test_the_distribution_can_be_another():
    scene = load_scene("mm_gym/CarriageForce-v0")
    narrow = over_rigs(scene, spread=0.0, delay=0, noise=0.0, lag=0.0)
    same, env = MovingMassVectorEnv(scene, 3), MovingMassVectorEnv(narrow, 3)
    for one in (same, env):
        one.reset(seed=1)
    action = np.ones((3, 1), np.float32)
    assert np.array_equal(same.step(action)[0], env.step(action)[0])
    wide = over_rigs(scene, spread=0.5, delay=5)
    assert wide.randomization["carriage.mass"] == (0.05, 0.15)
    assert wide.randomization["sensors.delay"] == (0.0, 5.0)
    with pytest.raises(SceneError, match=r"randomization\.carriage\.mass: got -0\.1"):
        over_rigs(scene, spread=2.0)
