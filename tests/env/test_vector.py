"""Lane i of the vector environment is the single environment seeded seed + i, to the last bit."""

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import TransformObservation
from gymnasium.wrappers.vector import VectorizeTransformObservation
from tasks import CARRIAGE_FORCE

from mm_gym import (
    MovingMassEnv,
    MovingMassVectorEnv,
    SceneError,
    SimulationError,
    compile_scene,
    load_scene,
)
from mm_gym.lanes.layout import BLOCK
from mm_gym.simulation.lanes import Lanes
from mm_gym.step import episodes

LANES, STEPS, SEED = 5, 160, 11
MODES = list(AutoresetMode)


def twins(scene, mode, lanes=LANES):
    native = MovingMassVectorEnv(scene, lanes, autoreset_mode=mode)
    return native, SyncVectorEnv(
        [lambda: MovingMassEnv(scene)] * lanes, autoreset_mode=mode, copy=True
    )


def actions_for(envs, steps=STEPS):
    shape = (steps, *envs.action_space.shape)
    return np.random.default_rng(0).uniform(-1.3, 1.3, shape).astype(np.float32)


def without_layout(result):
    """Views are Fortran-ordered, copies and Gymnasium's own C-ordered; the values count."""
    return tuple(np.ascontiguousarray(x) if isinstance(x, np.ndarray) else x for x in result)


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_lanes_equal_single_environments_over_resets(ending_scene, mode, assert_same):
    native, sync = twins(ending_scene, mode)
    assert_same(without_layout(native.reset(seed=SEED)), without_layout(sync.reset(seed=SEED)))
    terminations = truncations = 0
    for action in actions_for(native):
        got, expected = native.step(action), sync.step(action)
        assert_same(without_layout(got), without_layout(expected))
        terminations += got[2].sum()
        truncations += (got[3] & ~got[2]).sum()
    assert terminations >= 3
    assert truncations >= 3


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_lanes_are_restored_and_partly_reset_after_any_end(ending_scene, mode, assert_same):
    env = MovingMassVectorEnv(ending_scene, LANES, autoreset_mode=mode)
    other = MovingMassVectorEnv(ending_scene, LANES, autoreset_mode=mode)
    env.reset(seed=SEED)
    mask = np.arange(LANES) == 1
    for step, action in enumerate(actions_for(env)):
        env.step(action)
        if step % 5 == 0:
            env.reset(options={"reset_mask": mask})
        other.set_state(env.get_state())
        assert_same(other.get_state(), env.get_state())
        other.step(action)


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_motion_of_a_finished_lane_does_not_make_a_step_fail(mode, assert_same):
    """A finished lane would overflow if it made one more step."""
    scene = CARRIAGE_FORCE.replace(
        **{
            "carriage.cubic_coefficient": 2e9,
            "objective.displacement_limit": 0.02,
            "solver": {"method": "rk4", "substeps": 1},
        }
    )
    single = MovingMassEnv(scene)
    single.reset(seed=SEED)
    action = np.ones(1, np.float32)
    while not single.step(action)[2]:
        pass
    single._running = True
    with pytest.raises(SimulationError):
        single.step(action)
    native, sync = twins(scene, mode)
    native.reset(seed=SEED)
    sync.reset(seed=SEED)
    for actions in actions_for(native):
        got, expected = native.step(actions), sync.step(actions)
        assert_same(without_layout(got), without_layout(expected))


def test_lanes_without_autoreset_equal_single_environments(ending_scene, assert_same):
    native, sync = twins(ending_scene, AutoresetMode.DISABLED)
    assert_same(without_layout(native.reset(seed=SEED)), without_layout(sync.reset(seed=SEED)))
    resets = 0
    for action in actions_for(native):
        got, expected = native.step(action), sync.step(action)
        assert_same(without_layout(got), without_layout(expected))
        mask = got[2] | got[3]
        if mask.any():
            resets += 1
            options = {"reset_mask": mask}
            obs, info = native.reset(options=dict(options))
            expected_obs, expected_info = sync.reset(options=dict(options))
            assert_same(np.ascontiguousarray(obs), np.ascontiguousarray(expected_obs))
            for name in expected_info:
                assert_same(info[name][mask], expected_info[name][mask])
    assert resets >= 5


@pytest.mark.parametrize("lanes", [1, 255, 257, 600])
def test_number_of_lanes_does_not_matter(ending_scene, lanes):
    # Blocks and their remainders, and vector units with theirs.
    native = MovingMassVectorEnv(ending_scene, lanes)
    singles = {i: MovingMassEnv(ending_scene) for i in {0, lanes // 2, lanes - 1}}
    observations, _ = native.reset(seed=SEED)
    for i, env in singles.items():
        assert env.reset(seed=SEED + i)[0].tobytes() == observations[i].tobytes()
    for action in actions_for(native, 6):
        observations, rewards, terminated, truncated, info = native.step(action)
        for i, env in list(singles.items()):
            obs, reward, ended, _, single_info = env.step(action[i])
            assert obs.tobytes() == observations[i].tobytes()
            assert (reward, ended) == (rewards[i], terminated[i])
            assert single_info["state"].tobytes() == info["state"][i].tobytes()
            if ended:
                del singles[i]
        assert not truncated.any()


def test_list_of_seeds_gives_each_lane_its_own(scene):
    native = MovingMassVectorEnv(scene, 3)
    observations, _ = native.reset(seed=[5, 99, 5])
    assert observations[0].tobytes() == observations[2].tobytes()
    for i, seed in enumerate([5, 99, 5]):
        assert MovingMassEnv(scene).reset(seed=seed)[0].tobytes() == observations[i].tobytes()


def test_lane_without_a_seed_goes_on_with_its_stream(scene):
    native, other = (MovingMassVectorEnv(scene, 3) for _ in range(2))
    native.reset(seed=4)
    other.reset(seed=4)
    expected, _ = other.reset()
    observations, _ = native.reset(seed=[None, 8, None])
    assert observations[0].tobytes() == expected[0].tobytes()
    assert observations[1].tobytes() != expected[1].tobytes()
    assert observations[2].tobytes() == expected[2].tobytes()


def test_reset_mask_leaves_other_lanes_alone(scene, assert_same):
    native = MovingMassVectorEnv(scene, 4, autoreset_mode="Disabled")
    native.reset(seed=0)
    native.step(np.ones(native.action_space.shape, np.float32))
    before = native.get_state()
    mask = np.array([False, True, False, True])
    observations, _ = native.reset(options={"reset_mask": mask})
    after = native.get_state()
    for name in ("values", "streams", "frames"):
        assert_same(before[name][:, ~mask], after[name][:, ~mask])
        assert (before[name][:, mask] != after[name][:, mask]).any()
    assert observations.T[:, ~mask].tobytes() == after["frames"][:, ~mask].tobytes()


def test_lanes_begin_alike_all_at_once_and_one_by_one(assert_same):
    scene = load_scene("mm_gym/PreStretch-v0").replace(
        **{"sensors.noise": {"carriage_velocity": 0.1}}
    )
    count = 2 * BLOCK + 76  # in three blocks
    together, apart = (Lanes(compile_scene(scene), count) for _ in range(2))
    for lanes in (together, apart):
        lanes.seed(SEED)
    together.restart()
    for first in range(3):
        apart.restart(np.arange(first, count, 3))
    assert_same(together.snapshot(), apart.snapshot())
    assert len(np.unique(together.observed[-1])) > 0.99 * count


def test_any_mask_restarts_lanes_by_the_same_compiled_kernel(scene):
    native = MovingMassVectorEnv(scene, LANES)
    native.reset(seed=1)
    mask = np.zeros(2 * LANES, np.bool_)[::2]  # neither contiguous
    mask.flags.writeable = False  # nor writable
    before = list(episodes.start.signatures)
    native.reset(options={"reset_mask": mask})
    assert episodes.start.signatures == before


@pytest.mark.parametrize(
    "mask", [[True], [[True], [True, False]], [1, 0, 1], "abc", np.ones((3, 1), bool)]
)
def test_reset_mask_that_does_not_fit_is_refused(scene, mask, assert_same):
    native = MovingMassVectorEnv(scene, 3)
    native.reset(seed=0)
    before = native.get_state()
    with pytest.raises(SceneError, match="reset_mask"):
        native.reset(seed=1, options={"reset_mask": mask})
    assert_same(before, native.get_state())


def test_copies_are_returned_by_default_and_views_on_request(scene):
    for copy in (True, False):
        native = MovingMassVectorEnv(scene, 3, copy=copy)
        first, _ = native.reset(seed=0)
        action = np.zeros(native.action_space.shape, np.float32)
        second, rewards, *_, info = native.step(action)
        _, more_rewards, *_, more_info = native.step(action)
        assert np.shares_memory(first, second) is not copy
        assert np.shares_memory(info["state"], more_info["state"]) is not copy
        assert not np.shares_memory(rewards, more_rewards)
        # as programs store them, or as the kernels write them
        assert second.flags.c_contiguous if copy else second.flags.f_contiguous


@pytest.mark.parametrize("mode", MODES)
def test_views_are_read_only_and_what_is_no_observation_is_the_callers_own(mode, assert_same):
    limits = {"objective.displacement_limit": 0.007, "control.steps": 12}
    scene = CARRIAGE_FORCE.replace(**limits)
    copied, viewed = (
        MovingMassVectorEnv(scene, 3, copy=copy, autoreset_mode=mode) for copy in (True, False)
    )
    for env in (copied, viewed):
        env.reset(seed=1)
    for action in actions_for(copied, 30):
        expected, got = copied.step(action), viewed.step(action)
        observations, *owned, info = got
        for view in (observations, info["state"], info["applied"]):
            with pytest.raises(ValueError, match="read-only"):
                view[...] = 0.0
        assert_same(without_layout(expected), without_layout(got))
        for array in owned:
            array[...] = 1  # neither the motion nor the ends of episodes notice
        ended = expected[2] | expected[3]
        if mode is AutoresetMode.DISABLED and ended.any():
            for env in (copied, viewed):
                env.reset(options={"reset_mask": ended.copy()})


@pytest.mark.parametrize("copy", [True, False])
def test_ends_are_the_callers_own_with_copies_and_overwritten_with_views(copy):
    limits = {"objective.displacement_limit": 0.007, "control.steps": 12}
    env = MovingMassVectorEnv(
        CARRIAGE_FORCE.replace(**limits), 8, copy=copy, autoreset_mode=AutoresetMode.SAME_STEP
    )
    env.reset(seed=1)
    given, kept = [], []
    for action in actions_for(env, 30):
        info = env.step(action)[-1]
        if "final_obs" not in info:
            continue
        ended = info["_final_obs"]
        assert [row is not None for row in info["final_obs"]] == ended.tolist()
        assert not info["final_info"]["state"][~ended].any()
        rows = [
            *info["final_obs"][ended],
            info["final_info"]["state"],
            info["final_info"]["applied"],
        ]
        assert all(row.flags.writeable is copy for row in rows)
        given += rows
        kept += [row.copy() for row in rows]
    assert len(given) > 10
    same = [np.array_equal(one, other) for one, other in zip(given, kept, strict=True)]
    assert all(same) is copy


def test_wrapper_that_writes_into_views_fails_instead_of_changing_the_physics():
    for copy in (True, False):
        native = MovingMassVectorEnv(CARRIAGE_FORCE, 2, copy=copy)
        env = VectorizeTransformObservation(
            native,
            TransformObservation,
            func=np.negative,
            observation_space=native.single_observation_space,
        )
        if copy:
            assert (env.reset(seed=0)[0] == -native._lanes.observed.T).all()
        else:
            with pytest.raises(ValueError, match="read-only"):
                env.reset(seed=0)


def test_views_and_copies_hold_the_same_values(scene, assert_same):
    copied, viewed = (MovingMassVectorEnv(scene, 3, copy=copy) for copy in (True, False))
    copied.reset(seed=1)
    viewed.reset(seed=1)
    for action in actions_for(copied, 20):
        assert_same(without_layout(copied.step(action)), without_layout(viewed.step(action)))


@pytest.mark.parametrize("mode", MODES)
def test_stepping_before_the_first_reset_is_refused(scene, mode):
    native = MovingMassVectorEnv(scene, 2, autoreset_mode=mode)
    with pytest.raises(ResetNeeded):
        native.step(np.zeros(native.action_space.shape, np.float32))


def test_stepping_a_finished_lane_without_autoreset_is_refused(ending_scene):
    native = MovingMassVectorEnv(ending_scene, 2, autoreset_mode="Disabled")
    native.reset(seed=0)
    action = np.zeros(native.action_space.shape, np.float32)
    while not (native.step(action)[2:4] != np.zeros((2, 2), np.bool_)).any():
        pass
    with pytest.raises(ResetNeeded, match="lanes need reset"):
        native.step(action)


@pytest.mark.parametrize("count", [0, -1, 2.0, True, None])
def test_number_of_lanes_is_checked(scene, count):
    with pytest.raises(SceneError, match="num_envs"):
        MovingMassVectorEnv(scene, count)


@pytest.mark.parametrize(
    "seed", [[-1, 0, 1], [True, 0, 1], [0, 1], "abc", 1.0, np.arange(4), np.ones(3), {0, 1, 2}]
)
def test_seeds_are_checked(scene, seed):
    env = MovingMassVectorEnv(scene, 3)
    with pytest.raises(SceneError, match="seed: got"):
        env.reset(seed=seed)


@pytest.mark.parametrize("mode", ["nextstep", None, 1])
def test_unknown_autoreset_mode_is_refused(scene, mode):
    with pytest.raises(SceneError, match=r"autoreset_mode: got .*allowed: NextStep"):
        MovingMassVectorEnv(scene, 2, autoreset_mode=mode)
