"""Rewards by a cost of the caller's own: the same in every environment, and refused when made."""

import copy
import json
import os
import pickle
from functools import partial

import gymnasium
import numba
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from tasks import CARRIAGE_FORCE, HYBRID

from mm_gym import (
    CompileError,
    MovingMassEnv,
    MovingMassVectorEnv,
    OwnReward,
    SceneError,
    SimulationError,
    rewarded,
)
from mm_gym.sb3 import make_vec_env
from mm_gym.user_code import load

NAME = "mm_gym/CarriageForce-v0"
LANES = 600  # more than a block of lanes, so that two threads have work

FREE = CARRIAGE_FORCE.replace(
    **{"objective.displacement_limit": None, "objective.rail_half_length": None}
)

TEXT = """
def cost(carriage_displacement, carriage_velocity, applied_force):
    x, v, a = carriage_displacement / 0.01, carriage_velocity / 0.5, applied_force / 4.0
    return x**2 + 0.1 * v**2 + 0.01 * a**2
"""


def same_as_task(carriage_displacement, carriage_velocity, applied_force):
    x, v, a = carriage_displacement / 0.01, carriage_velocity / 0.5, applied_force / 4.0
    return x**2 + 0.1 * v**2 + 0.01 * a**2


def comfort(carriage_acceleration, spring_force, ground_acceleration, stretch):
    return carriage_acceleration**2 + abs(spring_force) + ground_acceleration**2 + stretch


TASK = OwnReward(same_as_task)
COMFORT = OwnReward(comfort)


def rewards_of(env, steps):
    """Rewards (steps, lanes) under the same random actions."""
    env.reset(seed=5)
    rng = np.random.default_rng(0)
    shape = (LANES, *env.single_action_space.shape)
    return np.array(
        [env.step(rng.uniform(-1, 1, shape).astype(np.float32))[1] for _ in range(steps)]
    )


def test_cost_that_is_the_task_s_gives_its_rewards():
    made = (MovingMassVectorEnv(NAME, LANES, reward=reward) for reward in (None, TASK))
    want, got = (rewards_of(env, CARRIAGE_FORCE.control.steps + 20) for env in made)
    # Three squares, rounded where the kernel's fused products are not: some 2^-52 each.
    np.testing.assert_allclose(got, want, rtol=8 * 2.0**-52)
    assert got.min() < -1.0


def test_changed_file_runs_as_changed_and_leaves_no_other_file(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.dont_write_bytecode", False)
    file, text = tmp_path / "cost.py", "def cost(carriage_displacement):\n    return {}.0\n"
    for number in (1, 2):
        file.write_text(text.format(number))
        os.utime(file, (1e9, 1e9))  # both in one second
        assert load(f"{file}:cost", "reward")(0.0) == number
    assert list(tmp_path.iterdir()) == [file]


def test_file_that_ends_the_program_is_refused(tmp_path):
    file = tmp_path / "cost.py"
    file.write_text("def cost(carriage_velocity):\n    return 0.0\nraise SystemExit(0)\n")
    with pytest.raises(SceneError, match=r"reward: .*cost\.py, line 3: SystemExit: 0"):
        MovingMassEnv(NAME, reward=f"{file}:cost")


def test_only_scenes_are_rewarded():
    with pytest.raises(SceneError, match="scene: got 'mm_gym/CarriageForce-v0'; allowed: a Scene"):
        rewarded(NAME, TASK)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("scene", [CARRIAGE_FORCE, HYBRID])
def test_single_environments_lanes_and_threads_have_the_same_rewards(scene, mode):
    own = TASK if scene is CARRIAGE_FORCE else COMFORT
    scene = scene.replace(**{"control.steps": 30})
    made = [
        MovingMassVectorEnv(scene, LANES, reward=own, autoreset_mode=mode, threads=threads)
        for threads in (1, 2)
    ]
    one, two = (rewards_of(env, 40) for env in made)
    np.testing.assert_array_equal(one, two)
    rng, lane = np.random.default_rng(0), 7
    env = MovingMassEnv(scene, reward=own)
    env.reset(seed=5 + lane)
    shape = (LANES, *env.action_space.shape)
    ended, single = False, []
    for _ in range(40):
        action = rng.uniform(-1, 1, shape).astype(np.float32)[lane]
        if ended and mode == "NextStep":
            env.reset()
            single.append(0.0)
            ended = False
            continue
        if ended:
            env.reset()
        _, reward, terminated, truncated, _ = env.step(action)
        single.append(reward)
        ended = terminated or truncated
    np.testing.assert_array_equal(one[:, lane], single)


def test_accelerations_and_forces_are_those_that_sensors_would_show():
    seen = ["carriage_acceleration", "spring_force", "ground_acceleration", "stretch"]
    scene = HYBRID.replace(**{"sensors": {"channels": seen}, "objective.displacement_limit": None})
    env = MovingMassVectorEnv(scene, LANES, reward=COMFORT)
    env.reset(seed=5)
    units = [1.0 / channel.factor for channel in env.plant.observed]
    zeros = [channel.zero for channel in env.plant.observed]
    for _ in range(20):
        observation, reward, *_ = env.step(np.ones((LANES, 2), np.float32))
        values = (observation.astype(np.float64) * units + zeros).T
        # The observation is rounded to single precision; squares double the error.
        np.testing.assert_allclose(-reward, comfort(*values), rtol=4 * 2.0**-24)
    # Another frame does not change what the reward reads.
    blind = MovingMassVectorEnv(
        scene.replace(sensors={"channels": ["carriage_displacement"], "delay": 2}),
        LANES,
        reward=COMFORT,
    )
    np.testing.assert_array_equal(rewards_of(blind, 20), rewards_of(env, 20))


@numba.njit
def push(observed, actions):
    for i in range(actions.shape[1]):
        actions[0, i] = -1.0 if observed[0, i] > 0.0 else 1.0


@pytest.mark.parametrize("changes", [{}, {"objective.displacement_limit": 0.02}])
def test_whole_episodes_have_the_sums_of_their_rewards(changes):
    scene = CARRIAGE_FORCE.replace(**changes)
    env = MovingMassVectorEnv(scene, 50, reward=TASK, autoreset_mode="Disabled")
    env.reset(seed=5)
    found = env.closed_loop(push)()
    observation, _ = env.reset(seed=5)
    total, alive = np.zeros(50), np.ones(50, bool)
    least = np.zeros(50)
    while alive.any():
        action = np.where(observation[:, :1] > 0.0, -1.0, 1.0).astype(np.float32)
        observation, reward, terminated, truncated, _ = env.step(action)
        total += np.where(alive, reward, 0.0)
        least = np.minimum(least, np.where(alive, reward, 0.0))
        ended = terminated | truncated
        alive &= ~ended
        if ended.any():
            observation, _ = env.reset(options={"reset_mask": ended})
    np.testing.assert_array_equal(found.returns, total)
    np.testing.assert_array_equal(found.least, least)


def test_gymnasium_and_stable_baselines_take_the_reward():
    single = gymnasium.make(NAME, reward=TASK)
    vector = gymnasium.make_vec(NAME, 3, reward=TASK, vectorization_mode="vector_entry_point")
    adapter = make_vec_env(NAME, 3, seed=4, reward=TASK)
    single.reset(seed=4)
    vector.reset(seed=4)
    adapter.reset()
    action = np.full((3, 1), 0.5, np.float32)
    reward = single.step(action[0])[1]
    rewards = vector.step(action)[1]
    assert reward == rewards[0]
    np.testing.assert_array_equal(adapter.step(action)[1], rewards.astype(np.float32))


def test_reward_of_a_file_is_in_the_specification(tmp_path):
    (tmp_path / "own.py").write_text(TEXT)
    env = gymnasium.make(NAME, reward=f"{tmp_path}/own.py:cost")
    spec = env.spec.to_json()
    assert json.loads(spec)["kwargs"]["reward"] == f"{tmp_path}/own.py:cost"
    again = gymnasium.make(EnvSpec.from_json(spec))
    of_scene = gymnasium.make(NAME, scene=rewarded(CARRIAGE_FORCE, TASK))
    action, rewards = np.ones(1, np.float32), []
    for made in (env, again, of_scene):
        made.reset(seed=3)
        rewards.append(made.step(action)[1])
    assert rewards[0] == rewards[1] == rewards[2]
    assert gymnasium.make(of_scene.spec).unwrapped.scene.own_reward is not None


def test_copies_and_pickles_keep_the_reward(tmp_path):
    (tmp_path / "own.py").write_text(TEXT)
    env = MovingMassEnv(NAME, reward=f"{tmp_path}/own.py:cost")
    env.reset(seed=1)
    action = np.ones(1, np.float32)
    others = copy.deepcopy(env), pickle.loads(pickle.dumps(env))  # noqa: S301 - our own
    want = env.step(action)[1]
    assert [other.step(action)[1] for other in others] == [want, want]
    # A copy has the function that is compiled, whatever has become of its file.
    (tmp_path / "own.py").unlink()
    assert copy.deepcopy(env).step(action)[1] == env.step(action)[1]


def test_changes_of_a_scene_keep_its_reward():
    scene = rewarded(CARRIAGE_FORCE, TASK).replace(**{"carriage.mass": 0.2})
    assert scene.own_reward is TASK
    assert CARRIAGE_FORCE.own_reward is None
    assert rewarded(CARRIAGE_FORCE, TASK).digest == CARRIAGE_FORCE.digest


def test_information_has_one_term():
    env = MovingMassVectorEnv(NAME, 3, reward=TASK, info="full")
    _, info = env.reset(seed=0)
    assert info["reward_own"].tolist() == [0.0] * 3
    _, reward, _, _, info = env.step(np.ones((3, 1), np.float32))
    np.testing.assert_array_equal(info["reward_own"], reward)
    assert "reward_displacement" not in info
    single = MovingMassEnv(NAME, reward=TASK, info="full")
    single.reset(seed=0)
    _, reward, _, _, info = single.step(np.ones(1, np.float32))
    assert info["reward_own"] == reward


def raises(slip_velocity):
    raise ValueError(slip_velocity)


def divides(slip_velocity):
    return 1.0 / slip_velocity


def raises_near_the_scale(slip_velocity):
    if slip_velocity > 0.1:
        raise ValueError(slip_velocity)
    return 0.0


def pair(slip_velocity):
    return slip_velocity, slip_velocity


def array(slip_velocity):
    return np.full(2, slip_velocity)


def imports(slip_velocity):
    import math  # noqa: PLC0415 - what numba does not compile

    return math.sin(slip_velocity)


def misspelt(slip_velocty):
    return slip_velocty


def stretches(stretch):
    return stretch


def nothing():
    return 0.0


def complex_number(slip_velocity):
    return 1j * slip_velocity


def takes_any(**slip_velocity):
    return slip_velocity["slip_velocity"]


def takes_several(*slip_velocity):
    return slip_velocity[0]


class Bound:
    def cost(self, slip_velocity):
        return slip_velocity


def beyond_the_limit(carriage_displacement):
    return np.sqrt(0.02**2 - carriage_displacement**2)


@pytest.mark.parametrize(
    ("reward", "words"),
    [
        (raises, "reward: raises returns none; allowed: a number"),
        (raises_near_the_scale, "raised ValueError: .* for slip_velocity = "),
        (divides, r"divides (returned inf|raised ZeroDivision.*) for slip_velocity = 0; allowed"),
        (pair, "pair returns UniTuple"),
        (array, "array returns array"),
        (imports, "imports cannot be compiled by numba: Use of unsupported opcode"),
        (misspelt, "got the argument 'slip_velocty'; did you mean 'slip_velocity'"),
        (stretches, "the argument 'stretch' needs springs with a stretch; springs.kind: got"),
        (nothing, "got the argument ''; allowed: carriage_displacement"),
        (complex_number, "returns complex128"),
        (takes_any, r"got the argument '\*\*slip_velocity'; did you mean 'slip_velocity'"),
        (takes_several, r"got the argument '\*slip_velocity'; did you mean 'slip_velocity'"),
        (Bound().cost, "reward: cost cannot be compiled by numba: The decorated object is not a"),
        (partial(nothing), "got the argument ''; allowed: carriage_displacement"),
        (partial(divides), "cannot be compiled by numba: The decorated object is not a function"),
        (3, "reward: got 3; allowed: a function of channels, or FILE.py:NAME of one"),
        ("own.py", "reward: got 'own.py'; allowed: FILE.py:NAME"),
        ("absent.py:cost", "reward: absent.py: no such file"),
        # The step that ends an episode goes beyond its limit.
        (beyond_the_limit, "beyond_the_limit returned nan for carriage_displacement"),
    ],
)
@pytest.mark.parametrize("make", [MovingMassEnv, MovingMassVectorEnv])
def test_wrong_reward_is_named_when_the_environment_is_made(make, reward, words):
    with pytest.raises(SceneError, match=words):
        make(NAME, reward=reward, changes={"objective.displacement_limit": 0.02})


def test_springs_need_no_stretch():
    springs = {"springs": {"kind": "linear", "stiffness": 100.0}}
    env = MovingMassEnv(NAME, reward=TASK, changes=springs)
    env.reset(seed=0)
    assert env.step(np.zeros(1, np.float32))[1] < 0.0
    with pytest.raises(SceneError, match="'stretch' needs springs with a stretch"):
        MovingMassEnv(NAME, reward=stretches, changes=springs)


def abs_acceleration(carriage_acceleration):
    return abs(carriage_acceleration)


def test_carriage_without_mass_has_no_acceleration():
    with pytest.raises(CompileError, match="reward: a carriage of mass 0 has no finite"):
        MovingMassEnv(NAME, reward=abs_acceleration, changes={"carriage.mass": 0.0})


def far(carriage_displacement):
    if carriage_displacement > 0.5:
        raise ValueError(carriage_displacement)
    return np.sqrt(0.25 - carriage_displacement**2)


@pytest.mark.parametrize(("start", "words"), [(0.9, "raised ValueError"), (-0.9, "nan")])
def test_cost_that_fails_far_away_ends_the_episode_with_its_name(start, words):
    own = OwnReward(far)
    single = MovingMassEnv(FREE, reward=own)
    where = {"initial.carriage_displacement": start}
    single.reset(seed=0, options=where)
    with pytest.raises(SimulationError, match=f"reward: far .*{words}"):
        single.step(np.zeros(1, np.float32))
    vector = MovingMassVectorEnv(FREE, 3, reward=own)
    vector.reset(seed=0, options={"initial.carriage_displacement": [0.0, start, start]})
    with pytest.raises(SimulationError, match=f"lane 1: reward: far .*{words}"):
        vector.step(np.zeros((3, 1), np.float32))
    vector.reset(seed=0, options={"initial.carriage_displacement": [0.0, start, start]})
    with pytest.raises(SimulationError, match=f"lane 1: reward: far .*{words}"):
        vector.closed_loop(push)()
