"""Does tianshou store what happened, and does its page work as it is printed?"""

import gymnasium
import numpy as np
from pages import run_page
from tianshou.algorithm.algorithm_base import Policy
from tianshou.data import Batch, Collector, VectorReplayBuffer
from tianshou.env import DummyVectorEnv
from transitions import CHANGES, check_transitions

LANES, STEPS = 6, 200


class Uniform(Policy):
    """Actions drawn from the action space."""

    def forward(self, batch, state=None):
        return Batch(act=np.array([self.action_space.sample() for _ in batch.obs]), state=state)


def test_blocks_of_the_page_run(tmp_path):
    assert "return -" in run_page("tianshou", tmp_path)


def test_stored_transitions_follow_the_plant_and_end_where_it_ends():
    make = lambda: gymnasium.make("mm_gym:mm_gym/CarriageForce-v0", changes=CHANGES)  # noqa: E731
    envs = DummyVectorEnv([make] * LANES)
    envs.seed(1)
    buffer = VectorReplayBuffer(STEPS * LANES, LANES)
    space = envs.action_space[0]
    space.seed(1)
    collector = Collector(Uniform(action_space=space), envs, buffer)
    collector.collect(n_step=STEPS * LANES, reset_before_collect=True)
    parts = [buffer.buffers[lane] for lane in range(LANES)]
    columns = (
        np.stack([np.asarray(getattr(part, name)) for part in parts], axis=1)
        for name in ("obs", "act", "obs_next", "terminated", "truncated")
    )
    check_transitions(*columns)
