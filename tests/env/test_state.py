"""The state of an episode is saved and restored exactly; a foreign one changes nothing."""

import copy
import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from rollouts import LANES, random_actions, rollout
from tasks import CARRIAGE_FORCE, PRE_STRETCH

from mm_gym import MovingMassEnv, MovingMassVectorEnv, Scene, SceneError, SimulationError
from mm_gym.lanes import layout

MOTION = Path(__file__).parents[1] / "data" / "motion.csv"


def test_state_restores_an_episode_and_its_future_exactly(make, ending_scene, assert_same):
    env = make(ending_scene)
    env.reset(seed=3)
    rollout(env, random_actions(env, 13, seed=1))
    saved = env.get_state()
    actions = random_actions(env, 80)
    first = rollout(env, actions)
    env.set_state(saved)
    assert_same(saved, env.get_state())
    assert_same(rollout(env, actions), first)
    # Another environment continues as well, even one that never was reset.
    other = make(ending_scene)
    other.set_state(saved)
    assert_same(rollout(other, actions), first)


def test_saved_state_is_a_copy(make, scene):
    env = make(scene)
    env.reset(seed=0)
    saved = env.get_state()
    kept = {name: np.copy(value) for name, value in saved.items()}
    rollout(env, random_actions(env, 3))
    assert all(np.array_equal(kept[name], saved[name]) for name in kept)
    env.set_state(saved)
    rollout(env, random_actions(env, 3))
    assert all(np.array_equal(kept[name], saved[name]) for name in kept)


def test_state_from_before_the_first_episode_is_restored_as_such(make, scene):
    env = make(scene)
    env.set_state(make(scene).get_state())
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(env.action_space.shape, np.float32))
    starts = [make(scene) for _ in range(2)]
    for one in starts:
        one.set_state(one.get_state())
        one.reset()
    streams = [one.get_state()["streams"] for one in starts]
    assert not np.array_equal(*streams)


def test_failed_step_ends_the_episode(make):
    scene = CARRIAGE_FORCE.replace(
        **{"carriage.cubic_coefficient": 1e15, "solver": {"method": "rk4", "substeps": 1}}
    )
    env = make(scene)
    env.reset(seed=0)
    action = np.ones(env.action_space.shape, np.float32)
    where = "" if isinstance(env, MovingMassEnv) else ", lane [0-3](, [1-3])*"
    with pytest.raises(SimulationError, match=rf"^rk4{where}: "):
        rollout(env, [action] * 100)
    if isinstance(env, MovingMassEnv):
        with pytest.raises(ResetNeeded):
            env.step(action)
        env.reset()
    _, reward, *_ = env.step(0.0 * action)  # all lanes are reset
    assert np.isfinite(reward).all()


def pickled(env):
    return pickle.loads(pickle.dumps(env))  # noqa: S301 - our own


def received(env):
    """As from another process, whose arrays arrive in read-only memory."""
    buffers = []
    data = pickle.dumps(env, protocol=5, buffer_callback=buffers.append)
    return pickle.loads(data, buffers=[bytes(one.raw()) for one in buffers])  # noqa: S301 - our own


COPIED = [copy.deepcopy, copy.copy, pickled, received]


@pytest.mark.parametrize("copied", COPIED)
def test_a_copy_continues_independently_as_the_original_would(
    make, ending_scene, copied, assert_same
):
    env = make(ending_scene)
    env.reset(seed=3)
    rollout(env, random_actions(env, 13, seed=1))
    env.action_space.seed(5)
    saved, twin = env.get_state(), copied(env)
    actions = random_actions(env, 80)
    expected = rollout(env, actions)
    after = env.get_state()
    assert_same(twin.get_state(), saved)
    assert_same(rollout(twin, actions), expected)
    assert_same(env.get_state(), after)
    assert_same(twin.action_space.sample(), env.action_space.sample())


def test_a_carriage_without_mass_is_copied_though_its_acceleration_is_not_finite(make, assert_same):
    channels = ["carriage_displacement", "sphere_acceleration"]
    light = {"carriage.mass": 0.0, "initial.carriage_velocity": 0.0, "sensors.channels": channels}
    env = make(CARRIAGE_FORCE.replace(**light))
    env.reset(seed=1)
    actions = random_actions(env, 5)
    rollout(env, actions)
    assert not np.isfinite(env.get_state()["values"][layout.CARRIAGE_ACCELERATION]).any()
    assert_same(rollout(pickled(env), actions), rollout(env, actions))


@pytest.mark.parametrize("copied", COPIED)
def test_a_copy_of_what_was_never_reset_needs_a_reset(make, scene, copied, assert_same):
    env = make(scene)
    twin = copied(env)
    with pytest.raises(ResetNeeded):
        twin.step(np.zeros(env.action_space.shape, np.float32))
    assert_same(twin.reset(seed=2), env.reset(seed=2))


def spoilt(saved):
    """States that belong to something else."""
    values = saved["values"]
    yield None, "state: got NoneType"
    yield {}, "running|finished"
    yield {name: value for name, value in saved.items() if name != "streams"}, "streams"
    yield saved | {"scene": "0123456789abcdef"}, "scene"
    yield saved | {"values": values.tolist()}, "values"
    yield saved | {"values": values[:, :0]}, "values"
    yield saved | {"values": values.astype(np.float32)}, "values"
    yield saved | {"frames": saved["frames"][:-1]}, "frames"
    yield saved | {"streams": saved["streams"].astype(np.int64)}, "streams"
    if "running" in saved:
        yield saved | {"running": 1.0}, "running"
    else:
        yield saved | {"finished": np.full(LANES, 0.5)}, "finished"


def test_foreign_state_is_refused_and_changes_nothing(make, scene, assert_same):
    env = make(scene)
    env.reset(seed=0)
    rollout(env, random_actions(env, 3))
    saved = env.get_state()
    for state, words in spoilt(saved):
        with pytest.raises(SceneError, match=words):
            env.set_state(state)
        assert_same(saved, env.get_state())


def test_state_of_another_scene_or_lane_count_is_refused(make):
    env, other = make(CARRIAGE_FORCE), make(PRE_STRETCH)
    env.reset(seed=0)
    other.reset(seed=0)
    with pytest.raises(SceneError, match="belongs to scene"):
        env.set_state(other.get_state())
    more = MovingMassVectorEnv(CARRIAGE_FORCE, LANES + 1)
    more.reset(seed=0)
    with pytest.raises(SceneError):
        env.set_state(more.get_state())


def picked(state, columns):
    """The state of some lanes of a state, in any order and number."""
    return {
        name: value[..., columns] if isinstance(value, np.ndarray) else value
        for name, value in state.items()
    }


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_lanes_of_a_state_may_be_repeated_and_permuted(ending_scene, mode):
    few = MovingMassVectorEnv(ending_scene, 7, autoreset_mode=mode)
    few.reset(seed=3)
    rollout(few, random_actions(few, 17))
    few.reset(seed=4, options={"reset_mask": np.arange(7) % 3 == 0})  # lanes of several ages
    rollout(few, random_actions(few, 5))
    state = few.get_state()
    columns = np.concatenate(
        [np.repeat(np.arange(7), 200), np.random.default_rng(0).integers(7, size=600)]
    )
    many = MovingMassVectorEnv(ending_scene, len(columns), autoreset_mode=mode)
    many.set_state(picked(state, columns))
    for action in random_actions(few, 70):  # some episodes more
        one, other = few.step(action), many.step(action[columns])
        for short, long in zip(one[:4], other[:4], strict=True):
            assert np.ascontiguousarray(short[columns]).tobytes() == long.tobytes("C")
    again = MovingMassVectorEnv(ending_scene, 7, autoreset_mode=mode)
    again.set_state(picked(many.get_state(), np.arange(7) * 200))
    for short, long in zip(few.step(action)[:4], again.step(action)[:4], strict=True):
        assert short.tobytes() == long.tobytes()


FUZZ = """
import sys
from pathlib import Path
sys.path[:0] = {paths}
import numpy as np
from conftest import ENDING
from tasks import TASKS
from mm_gym import MovingMassEnv, Scene, SceneError, SimulationError
switched = Scene(
    interface={{
        "kind": "dry_friction",
        "static_coefficient": 0.5,
        "kinetic_coefficient": 0.4,
        "reference_velocity": 0.01,
    }},
    springs={{"kind": "finite_stretch", "rest_length": 0.1}},
    actuation={{"force": {{}}, "stretch": {{}}}},
    randomization={{"interface.kinetic_ratio": [0.5, 1.0]}},
)
refused = lost = moved = 0
for scene in [*TASKS.values(), ENDING["everything"], switched]:
    env = MovingMassEnv(scene)
    env.reset(seed=0)
    action = np.full(env.action_space.shape, 0.5, np.float32)
    for _ in range(3):
        env.step(action)
    saved = env.get_state()
    for row in range(len(saved["values"])):
        for value in [np.nan, np.inf, -np.inf, 1.7e308, -1.7e308, -1e7, 1e7, 0.5, 5e-324]:
            spoilt = saved | {{"values": saved["values"].copy()}}
            spoilt["values"][row] = value
            try:
                env.set_state(spoilt)
                for _ in range(2):
                    observation, reward, terminated, truncated, info = env.step(action)
                    assert np.isfinite(observation).all(), (row, value)
                    assert np.isfinite(reward), (row, value)
                    assert np.isfinite(info["state"]).all(), (row, value)
                    if terminated or truncated:
                        env.reset()
            except SceneError:
                refused += 1
            except SimulationError:
                lost += 1
            else:
                moved += 1
print("end", refused, lost, moved)
"""


def test_no_value_of_a_state_crashes_or_hangs_the_kernels():
    here = Path(__file__).parent
    code = FUZZ.format(paths=[str(here), str(here.parent)])
    # In a process of its own, which a read outside the memory would end.
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=1800, check=False
    )
    assert done.returncode == 0, done.stderr
    refused, lost, moved = map(int, re.findall(r"\d+", done.stdout))
    assert refused > lost + moved  # of parameters, all are checked
    assert moved > 0


def test_state_of_a_record_that_starts_before_it_is_refused(assert_same):
    scene = Scene(
        excitation=[{"kind": "record", "file": str(MOTION)}],
        randomization={"excitation.0.start": [0.0, 0.2]},
        actuation={"force": {}},
    )
    env = MovingMassVectorEnv(scene, 2)
    env.reset(seed=0)
    saved = env.get_state()
    row = env.plant.support.names["excitation.0.start"]
    spoilt = saved | {"values": saved["values"].copy()}
    spoilt["values"][row, 1] = -1e7
    with pytest.raises(SceneError) as caught:
        env.set_state(spoilt)
    assert str(caught.value) == (
        f"state.values: row {row} (excitation.0.start) of lane 1: got -1e+07; allowed: 0 to 0.2"
    )
    assert_same(saved, env.get_state())


@pytest.mark.parametrize("copied", COPIED)
def test_a_copy_of_a_lost_episode_is_made_and_may_be_reset(make, copied):
    scene = CARRIAGE_FORCE.replace(
        **{"carriage.cubic_coefficient": 1e15, "solver": {"method": "rk4", "substeps": 1}}
    )
    env = make(scene)
    env.reset(seed=0)
    with pytest.raises(SimulationError):
        rollout(env, [np.ones(env.action_space.shape, np.float32)] * 100)
    twin = copied(env)
    observation, _ = twin.reset(seed=1)
    assert np.isfinite(observation).all()


def test_a_fresh_environment_draws_on_from_the_state_that_is_set(make, scene):
    first, second = make(scene), make(scene)
    first.reset(seed=3)
    second.set_state(first.get_state())
    for env in (first, second):
        env.reset()
    np.testing.assert_equal(second.get_state()["values"], first.get_state()["values"])


def test_terms_of_a_reward_do_not_outlive_a_state_that_is_set():
    env = MovingMassVectorEnv(CARRIAGE_FORCE, 2, info="full", autoreset_mode="Disabled")
    env.reset(seed=0)
    saved = env.get_state()
    env.step(np.ones((2, 1), np.float32))
    env.set_state(saved)
    _, info = env.reset(options={"reset_mask": np.array([True, False])})
    assert not info["reward_displacement"].any()
