"""The state of an episode is saved and restored exactly; a refused argument changes nothing."""

import copy
import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from tasks import CARRIAGE_FORCE, PRE_STRETCH

from mm_gym import (
    ActionError,
    MovingMassEnv,
    MovingMassVectorEnv,
    Scene,
    SceneError,
    SimulationError,
)

LANES = 4
MOTION = Path(__file__).parents[1] / "data" / "motion.csv"


@pytest.fixture(params=["single", "vector"])
def make(request):
    if request.param == "single":
        return MovingMassEnv
    return lambda scene: MovingMassVectorEnv(scene, LANES)


def random_actions(env, steps, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, (steps, *env.action_space.shape)).astype(np.float32)


def rollout(env, actions):
    """Step, and reset where an episode ends; return all results."""
    seen = []
    for action in actions:
        result = env.step(action)
        seen.append(result)
        if isinstance(env, MovingMassEnv) and (result[2] or result[3]):
            seen.append(env.reset())
    return seen


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
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=False
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


class Stubborn:
    """Refuses to become an array, as a tensor does that needs its gradient."""

    def __array__(self, dtype=None, copy=None):
        raise RuntimeError


BAD_ACTIONS = {
    "nan": lambda shape: np.full(shape, np.nan, np.float32),
    "nan, double": lambda shape: np.full(shape, np.nan),
    "inf": lambda shape: np.full(shape, np.inf, np.float32),
    "-inf, double": lambda shape: np.full(shape, -np.inf),
    "nan in the last place": lambda shape: np.where(
        np.arange(np.prod(shape)).reshape(shape) == np.prod(shape) - 1, np.nan, 0.0
    ),
    "a column too many": lambda shape: np.zeros((*shape[:-1], shape[-1] + 1), np.float32),
    "an axis too many": lambda shape: np.zeros((1, *shape), np.float32),
    "a number": lambda _: 0.5,
    "nothing": lambda _: None,
    "empty": lambda _: [],
    "a word": lambda _: "left",
    "words": lambda shape: np.full(shape, "0.5"),
    "objects": lambda shape: np.full(shape, object()),
    "complex": lambda shape: np.zeros(shape, np.complex128),
    "booleans": lambda shape: np.zeros(shape, np.bool_),
    "masked": np.ma.masked_all,
    "what refuses to be one": lambda _: Stubborn(),
    "ragged": lambda _: [[0.0], [0.0, 1.0]],
    "a dictionary": lambda _: {"force": 0.0},
}


@pytest.mark.parametrize("name", BAD_ACTIONS)
def test_bad_action_is_refused_and_changes_nothing(make, scene, name, assert_same):
    env = make(scene)
    env.reset(seed=0)
    rollout(env, random_actions(env, 3))
    before = env.get_state()
    with pytest.raises(ActionError, match="action"):
        env.step(BAD_ACTIONS[name](env.action_space.shape))
    assert_same(before, env.get_state())
    # It continues as if the action had not been given.
    twin = make(scene)
    twin.set_state(before)
    actions = random_actions(env, 3)
    assert_same(rollout(env, actions), rollout(twin, actions))


@pytest.mark.parametrize("beyond", [1.5, 100.0, 3e38])
def test_finite_actions_outside_the_space_are_clipped(make, scene, beyond, assert_same):
    env, twin = make(scene), make(scene)
    env.reset(seed=0)
    twin.reset(seed=0)
    for sign in (1.0, -1.0, 1.0):
        action = np.full(env.action_space.shape, sign, np.float32)
        assert_same(env.step(np.float32(beyond) * action), twin.step(action))


def test_type_of_the_action_does_not_matter(make, scene, assert_same):
    env = make(scene)
    env.reset(seed=0)
    saved = env.get_state()
    half = np.full(env.action_space.shape, 0.5, np.float32)
    expected = env.step(half)
    for same in (half.astype(np.float64), half.astype(np.float16), half.tolist(), half[..., ::-1]):
        env.set_state(saved)
        assert_same(env.step(same), expected)
    env.set_state(saved)
    ones = np.ones(env.action_space.shape)
    expected = env.step(ones)
    env.set_state(saved)
    assert_same(env.step(ones.astype(int)), expected)


def test_step_needs_a_running_episode(ending_scene):
    env = MovingMassEnv(ending_scene)
    action = np.zeros(env.action_space.shape, np.float32)
    with pytest.raises(ResetNeeded):
        env.step(action)
    env.reset(seed=0)
    ended = False
    while not ended:
        _, _, terminated, truncated, _ = env.step(action)
        ended = terminated or truncated
    before = env.get_state()
    with pytest.raises(ResetNeeded, match="reset"):
        env.step(action)
    # The end of an episode is part of its state.
    env.reset()
    env.set_state(before)
    with pytest.raises(ResetNeeded):
        env.step(action)


@pytest.mark.parametrize("name", ["initial.stretch", "initial.sphere_offset"])
def test_what_a_step_changes_is_not_called_drawn(make, name):
    with pytest.raises(SceneError, match=rf"{name}: changes in every step"):
        make(PRE_STRETCH).drawn(name)


def test_options_fix_what_would_be_drawn(make):
    env = make(PRE_STRETCH)
    options = {
        "excitation.0.frequency": 50.0,
        "initial.stretch": 2.0,
        "initial.carriage_displacement": 0.003,
        "initial.sphere_offset": -0.001,
        "initial.sphere_velocity": 0.2,
    }
    _, info = env.reset(seed=0, options=options)
    assert np.all(info["applied"] == 2.0)
    assert np.all(env.drawn("excitation.0.frequency") == 50.0)
    expected = np.array([0.003, 0.003 - 0.001, 0.0, 0.2])
    assert (np.atleast_2d(env.state) == expected).all()


def test_options_do_not_disturb_the_stream(make, assert_same):
    env, twin = make(PRE_STRETCH), make(PRE_STRETCH)
    env.reset(seed=0, options={"excitation.0.frequency": 50.0})
    twin.reset(seed=0)
    assert np.all(env.drawn("excitation.0.phase") == twin.drawn("excitation.0.phase"))
    assert_same(env.reset(), twin.reset())


def test_options_of_the_vector_may_differ_by_lane():
    env = MovingMassVectorEnv(PRE_STRETCH, 3)
    frequencies = np.array([45.0, 55.0, 65.0])
    env.reset(seed=0, options={"excitation.0.frequency": frequencies})
    assert (env.drawn("excitation.0.frequency") == frequencies).all()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"excitation.0.frequncy": 50.0}, "did you mean 'excitation.0.frequency'"),
        ({"excitation.0.frequency": 100.0}, "excitation.0.frequency: got 100.0; allowed: 44 to 71"),
        ({"excitation.0.frequency": np.nan}, "excitation.0.frequency: got nan"),
        ({"excitation.0.frequency": "50"}, "excitation.0.frequency: got"),
        ({"excitation.0.frequency": 1j}, "excitation.0.frequency: got"),
        ({"excitation.0.frequency": None}, "excitation.0.frequency: got"),
        ({"excitation.0.frequency": [50.0] * 7}, "excitation.0.frequency: got"),
        ({"initial.carriage_displacement": np.inf}, "initial.carriage_displacement: got inf"),
        ({"initial.stretch": 3.5}, "initial.stretch: got 3.5; allowed: 1 to 3"),
        ({"carriage.mass": 0.2}, "carriage.mass: got 0.2; allowed: 0.1 to 0.1"),
        ({"initial.stretch": [1, [2]]}, "initial.stretch: got [1, [2]]"),
        ({"seed": 3}, "seed: not a field"),
        ({3: 3.0}, "3: not a field"),
        ([], "options: got []; allowed: a dictionary"),
        (3, "options: got 3; allowed: a dictionary"),
    ],
    ids=str,
)
def test_bad_options_are_refused_and_change_nothing(make, options, words, assert_same):
    env = make(PRE_STRETCH)
    env.reset(seed=0)
    rollout(env, random_actions(env, 2))
    before = env.get_state()
    with pytest.raises(SceneError) as caught:
        env.reset(seed=5, options=options)
    assert words in str(caught.value)
    assert_same(before, env.get_state())


@pytest.mark.parametrize("seed", [-1, 0.5, "1"])
def test_bad_seed_is_refused_and_changes_nothing(make, scene, seed, assert_same):
    env = make(scene)
    env.reset(seed=0)
    before = env.get_state()
    with pytest.raises(Exception, match=r"[Ss]eed|integer"):  # Gymnasium's own errors, and ours
        env.reset(seed=seed)
    assert_same(before, env.get_state())


def test_scene_is_needed_and_needs_an_actuator(make, tmp_path):
    with pytest.raises(SceneError, match="needs an actuator"):
        make(Scene())
    with pytest.raises(SceneError, match="scene: got dict"):
        make({"carriage": {}})
    with pytest.raises(SceneError, match="no such file"):
        make(tmp_path / "scene.toml")


def test_scene_may_be_a_file(make, tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text("[actuation.force]\nlimit = 2.0\n", "utf-8")
    for path in (file, str(file)):
        assert make(path).scene.actuation.force.limit == 2.0
