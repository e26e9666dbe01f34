"""Does Stable-Baselines3 store what happened, and does its page work as it is printed?"""

import pytest
from pages import run_page
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env as make_single_envs
from transitions import CHANGES, ROUNDING, SCENE, check_transitions

from mm_gym.sb3 import make_vec_env

ID = "mm_gym/CarriageForce-v0"
LANES, STEPS = 6, 200

# Actions are stored on the scale of [-1, 1], which is the environment's own: (a + 1) / 2 * 2 - 1.
ACTION_ROUNDING = 4 * ROUNDING


def test_blocks_of_the_page_run(tmp_path):
    assert "return -" in run_page("stable-baselines3", tmp_path)


@pytest.mark.parametrize(
    "make",
    [
        lambda: make_vec_env(ID, LANES, changes=CHANGES),
        lambda: make_single_envs(ID, LANES, env_kwargs={"changes": CHANGES}),
    ],
    ids=["native", "single"],
)
def test_stored_transitions_follow_the_plant_and_end_where_it_ends(make):
    assert make().get_attr("scene", 0) == [SCENE]
    model = SAC(
        "MlpPolicy", make(), buffer_size=STEPS * LANES, learning_starts=STEPS * LANES, seed=1
    )
    model.learn(STEPS * LANES)
    buffer = model.replay_buffer
    truncated = buffer.timeouts.astype(bool)
    terminated = buffer.dones.astype(bool) & ~truncated
    check_transitions(
        buffer.observations,
        buffer.actions,
        buffer.next_observations,
        terminated,
        truncated,
        action_rounding=ACTION_ROUNDING,
    )
