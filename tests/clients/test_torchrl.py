"""Does TorchRL store what happened, and does its page work as it is printed?"""

import gymnasium
import pytest
from pages import run_page
from tensordict import TensorDict
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer
from torchrl.envs import GymEnv, GymWrapper
from transitions import CHANGES, check_shuffled, check_transitions

ID = "mm_gym:mm_gym/CarriageForce-v0"


def columns(batch: TensorDict):
    """Numbers of transitions as `transitions` takes them."""
    following = batch["next"]
    flags = (following[name].squeeze(-1).numpy() for name in ("terminated", "truncated"))
    return [
        batch["observation"].numpy(),
        batch["action"].numpy(),
        following["observation"].numpy(),
    ], list(flags)


@pytest.fixture(params=["Disabled", "SameStep"])
def env(request):
    lanes = gymnasium.make_vec(ID, 6, autoreset_mode=request.param, changes=CHANGES)
    return GymWrapper(lanes)


def test_blocks_of_the_page_run(tmp_path):
    assert "return -" in run_page("torchrl", tmp_path)


def test_collected_transitions_follow_the_plant_and_end_where_it_ends(env):
    env.set_seed(1)
    (batch,) = Collector(env, None, frames_per_batch=1200, total_frames=1200)
    numbers, flags = columns(batch)
    check_transitions(*(array.swapaxes(0, 1) for array in (*numbers, *flags)))


def test_replayed_samples_follow_the_plant(env):
    env.set_seed(1)
    buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(1200), batch_size=400)
    (batch,) = Collector(env, None, frames_per_batch=1200, total_frames=1200)
    buffer.extend(batch.reshape(-1))
    numbers, flags = columns(buffer.sample())
    check_shuffled(*numbers, flags[0])


def test_single_environment_is_stored_as_it_is():
    env = GymEnv(ID, changes=CHANGES)
    env.set_seed(1)
    (batch,) = Collector(env, None, frames_per_batch=400, total_frames=400)
    numbers, flags = columns(batch)
    check_transitions(*(array[:, None] for array in (*numbers, *flags)))


def test_mode_that_torchrl_cannot_follow_is_refused():
    with pytest.raises(RuntimeError, match="SAME_STEP or DISABLED"):
        GymWrapper(gymnasium.make_vec(ID, 6, changes=CHANGES))
