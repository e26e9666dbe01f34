"""Every vector wrapper of Gymnasium works as around its own SyncVectorEnv, or refuses."""

import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import vector
from tasks import HYBRID

from mm_gym import MovingMassEnv, MovingMassVectorEnv, compile_scene
from mm_gym.env.outputs import action_space, observation_space

LANES, STEPS = 3, 30
# Bounded observations, for what rescales them; episodes that end at a limit, and after 9 steps.
SCENE = HYBRID.replace(
    sensors={"channels": ["stretch", "applied_force"], "history": 2},
    **{"objective.displacement_limit": 0.0006, "control.steps": 9},
)
PLANT = compile_scene(SCENE)

ARGUMENTS = {
    "ArrayConversion": {"env_xp": np, "target_xp": np},
    "ClipAction": {},
    "ClipReward": {"min_reward": -0.01, "max_reward": -0.001},
    "DictInfoToList": {},
    "DtypeObservation": {"dtype": np.float64},
    "FilterObservation": {"filter_keys": [0]},
    "FlattenObservation": {},
    "GrayscaleObservation": {},
    "HumanRendering": {},
    "JaxToNumpy": {},
    "JaxToTorch": {},
    "NormalizeObservation": {},
    "NormalizeReward": {},
    "NumpyToTorch": {},
    "RecordEpisodeStatistics": {},
    "RecordVideo": {"video_folder": "videos"},
    "RescaleAction": {"min_action": np.float32(-2), "max_action": np.float32(2)},
    "RescaleObservation": {"min_obs": np.float32(0), "max_obs": np.float32(1)},
    "ReshapeObservation": {"shape": (2, 2)},
    "ResizeObservation": {"shape": (2, 2)},
    "TransformAction": {"func": np.negative},
    "TransformObservation": {"func": np.negative},
    "TransformReward": {"func": np.negative},
    "VectorizeTransformAction": {
        "wrapper": wrappers.TransformAction,
        "func": np.negative,
        "action_space": action_space(PLANT),
    },
    "VectorizeTransformObservation": {
        "wrapper": wrappers.TransformObservation,
        "func": np.negative,
        "observation_space": observation_space(PLANT),
    },
    "VectorizeTransformReward": {"wrapper": wrappers.TransformReward, "func": np.negative},
}


def test_every_wrapper_is_tried():
    assert set(ARGUMENTS) == set(vector.__all__)


def plain(value):
    """Numbers as lists, without the seconds that an episode took."""
    if isinstance(value, dict):
        return {name: plain(entry) for name, entry in value.items() if name != "t"}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, np.ndarray) and value.dtype == object:
        return [plain(entry) for entry in value]
    if value is None or isinstance(value, bool | int | float | str):
        return value
    array = np.asarray(value)
    return (str(array.dtype), array.shape, np.ascontiguousarray(array).tobytes())


def played(env, mode):
    """Yield what the wrapped environment returns, step by step."""
    yield plain(env.reset(seed=5))
    actions = np.random.default_rng(0).uniform(-1.2, 1.2, (STEPS, LANES, 2)).astype(np.float32)
    for action in actions:
        result = env.step(action)
        yield plain(result)
        ended = np.asarray(result[2]) | np.asarray(result[3])
        if mode is AutoresetMode.DISABLED and ended.any():
            yield plain(env.reset(options={"reset_mask": ended})[0])


def outcome(make, mode, wrapper):
    """Return what a wrapped environment did, and the error that ended it."""
    seen, error = [], None
    try:
        seen.extend(played(getattr(vector, wrapper)(make(), **ARGUMENTS[wrapper]), mode))
    except Exception as caught:  # noqa: BLE001 - any, to be compared
        error = caught
    return seen, error


# Wrappers warn of spaces that change, and NumPy of bounds that another type cannot hold.
@pytest.mark.filterwarnings("ignore::UserWarning", "ignore:overflow encountered:RuntimeWarning")
@pytest.mark.parametrize("copy", [True, False])
@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("wrapper", ARGUMENTS)
def test_wrapper_does_what_it_does_around_single_environments(wrapper, mode, copy):
    native, error = outcome(
        lambda: MovingMassVectorEnv(SCENE, LANES, autoreset_mode=mode, copy=copy), mode, wrapper
    )
    sync, expected = outcome(
        lambda: SyncVectorEnv([lambda: MovingMassEnv(SCENE)] * LANES, autoreset_mode=mode),
        mode,
        wrapper,
    )
    if expected is not None:
        assert (type(error), str(error)) == (type(expected), str(expected))
    elif error is not None:  # it writes into observations
        assert not copy
        assert "read-only" in str(error)
    else:
        assert len(native) == len(sync)
        assert (len(sync) > STEPS + 1) is (mode is AutoresetMode.DISABLED)  # episodes end
    if wrapper == "RecordEpisodeStatistics" and mode is AutoresetMode.DISABLED:
        # SyncVectorEnv takes the mask out of the caller's options, and the wrapper then forgets the
        # episodes of all lanes; here it sees the mask.
        native, sync = ([without_statistics(one) for one in seen] for seen in (native, sync))
    assert native == sync[: len(native)]


def without_statistics(result):
    if len(result) != 5:
        return result
    return [*result[:4], {name: part for name, part in result[4].items() if "episode" not in name}]


def test_episodes_of_lanes_that_are_not_reset_go_on_being_recorded():
    native = MovingMassVectorEnv(SCENE, LANES, autoreset_mode=AutoresetMode.DISABLED)
    env = vector.RecordEpisodeStatistics(native)
    env.reset(seed=5)
    age = np.zeros(LANES, np.int64)
    rng = np.random.default_rng(0)
    different = False
    for _ in range(STEPS):
        *_, terminated, truncated, info = env.step(
            rng.uniform(-1.2, 1.2, (LANES, 2)).astype(np.float32)
        )
        age += 1
        ended = terminated | truncated
        if ended.any():
            assert (info["episode"]["l"][ended] == age[ended]).all()
            env.reset(options={"reset_mask": ended})
            age[ended] = 0
            different |= len(set(age.tolist())) > 1
    assert different
