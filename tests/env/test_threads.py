"""Lanes divided among threads: the results are those of one thread, to the last bit."""

import os
import signal
import subprocess
import sys

import numba
import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, TASKS

from mm_gym import ActionError, MovingMassVectorEnv, SimulationError
from mm_gym.lanes import layout

LANES = 3 * layout.BLOCK - 100
"""Two or three ranges of lanes, the last one short and no multiple of a vector."""

SECONDS = 600  # a deadlock lasts for ever; on a loaded machine the kernels compile for minutes

TWO_AT_A_TIME = """
import threading
from hashlib import sha256
import numba
import numpy as np
from mm_gym import MovingMassVectorEnv

TASK = "mm_gym/CarriageForce-v0"
envs = [MovingMassVectorEnv(TASK, 2000, threads=count) for count in (1, 2, 2, 2)]
for env in envs:
    env.reset(seed=0)
action = np.ones((2000, 1), np.float32)

def run(env):
    for _ in range(300):
        env.step(action)

threads = [threading.Thread(target=run, args=(env,)) for env in envs]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(numba.threading_layer(), *{sha256(env.state.tobytes()).hexdigest() for env in envs})
"""


def envs(scene, threads=(1, 2, 3), **options):
    made = [MovingMassVectorEnv(scene, LANES, threads=count, **options) for count in threads]
    for env in made:
        env.reset(seed=3)
    return made


def actions_for(env, steps):
    return np.random.default_rng(0).uniform(-1.2, 1.2, (steps, *env.action_space.shape))


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_the_number_of_threads_changes_nothing_over_resets(ending_scene, mode, assert_same):
    alone, *together = envs(ending_scene, autoreset_mode=mode)
    ends = 0
    for action in actions_for(alone, 60).astype(np.float32):
        expected = alone.step(action)
        ends += np.count_nonzero(expected[2] | expected[3])
        for env in together:
            assert_same(env.step(action), expected)
    assert ends > LANES
    for env in together:
        assert_same(env.get_state(), alone.get_state())


@pytest.mark.parametrize("name", list(TASKS))
@pytest.mark.parametrize("copy", [False, True])
def test_no_task_depends_on_the_number_of_threads(name, copy, assert_same):
    alone, together = envs(TASKS[name], (1, 2), copy=copy)
    for action in actions_for(alone, 3).astype(np.float32):
        assert_same(together.step(action), alone.step(action))


def test_threads_take_actions_of_either_precision(assert_same):
    alone, together = envs(CARRIAGE_FORCE, (1, 2))
    for action in actions_for(alone, 4):
        for kind in (np.float32, np.float64):
            assert_same(together.step(action.astype(kind)), alone.step(action.astype(kind)))


def test_a_wrong_action_in_one_thread_changes_nothing_in_the_others(assert_same):
    for env in envs(CARRIAGE_FORCE, (2, 3)):
        for lane in (0, LANES - 1):
            before, action = env.get_state(), np.zeros((LANES, 1), np.float32)
            action[lane] = np.nan
            with pytest.raises(ActionError, match="finite"):
                env.step(action)
            assert_same(env.get_state(), before)


@pytest.mark.parametrize("lane", [0, LANES - 1])
def test_failure_in_one_thread_is_raised(lane):
    (env,) = envs(CARRIAGE_FORCE, (3,))
    starts = np.zeros(LANES)
    starts[lane] = 1e200  # costs more than the largest double
    env.reset(options={"initial.carriage_displacement": starts})
    with pytest.raises(SimulationError):
        env.step(np.zeros((LANES, 1), np.float32))


def test_numbas_own_number_of_threads_is_left_as_it_was():
    (env,) = envs(CARRIAGE_FORCE, (3,))
    before = numba.get_num_threads()
    try:
        for count in range(1, before + 1):
            numba.set_num_threads(count)
            env.step(np.zeros((LANES, 1), np.float32))
            assert numba.get_num_threads() == count
    finally:
        numba.set_num_threads(before)


def test_the_process_environment_is_left_as_it_was(monkeypatch):
    for given in (None, "7"):
        if given is None:
            monkeypatch.delenv("GOMP_SPINCOUNT", raising=False)
        else:
            monkeypatch.setenv("GOMP_SPINCOUNT", given)
        envs(CARRIAGE_FORCE, (2,))
        assert os.environ.get("GOMP_SPINCOUNT") == given


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_process_continues():
    alone, together = envs(CARRIAGE_FORCE, (1, 2))
    action = np.ones((LANES, 1), np.float32)
    together.step(action)  # numba's threads run now
    child = os.fork()
    if child == 0:
        signal.alarm(SECONDS)
        together.step(action)
        alone.step(action)
        alone.step(action)
        os._exit(0 if np.array_equal(alone.state, together.state) else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


@pytest.mark.parametrize("layer", ["default", "workqueue"])
def test_environments_may_be_stepped_at_the_same_time(layer):
    done = subprocess.run(
        [sys.executable, "-c", TWO_AT_A_TIME],
        env=os.environ | {"NUMBA_THREADING_LAYER": layer, "NUMBA_NUM_THREADS": "2"},
        capture_output=True,
        check=False,
        text=True,
        timeout=SECONDS,
    )
    assert done.returncode == 0, done.stderr
    used, *states = done.stdout.split()
    assert layer in (used, "default")
    assert len(states) == 1


def test_more_threads_than_lanes_do_no_harm(assert_same):
    scene = CARRIAGE_FORCE
    few, many = (MovingMassVectorEnv(scene, 5, threads=count) for count in (1, 64))
    assert_same(many.reset(seed=1), few.reset(seed=1))
    assert_same(many.step(np.ones((5, 1))), few.step(np.ones((5, 1))))
