"""Does skrl store what happened, and does its page work as it is printed?"""

import gymnasium
import numpy as np
import pytest
import torch
from pages import blocks, run_page
from skrl.agents.torch.sac import SAC
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.trainers.torch import SequentialTrainer
from skrl.utils import set_seed
from skrl.utils.model_instantiators.torch import deterministic_model, gaussian_model
from transitions import CHANGES, check_shuffled, check_transitions

ID = "mm_gym:mm_gym/CarriageForce-v0"
STEPS, LANES = 200, 6


def right_ends():
    """The class that the page prints."""
    ((_, text),) = blocks("skrl")
    names = {"torch": torch, "np": np}
    exec("class RightEnds" + text.partition("class RightEnds")[2].partition("\n\n\n")[0], names)  # noqa: S102
    return names["RightEnds"]


def recorded(*bases, **arguments):
    """What an agent of these classes has in its memory after steps of its first policy."""
    set_seed(1)
    if "num_envs" in arguments:
        env = wrap_env(gymnasium.make_vec(ID, changes=CHANGES, **arguments))
    else:
        env = wrap_env(gymnasium.make(ID, changes=CHANGES))
    memory = RandomMemory(memory_size=STEPS, num_envs=env.num_envs)
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space}
    network = [{"name": "net", "input": "OBSERVATIONS", "layers": [8], "activations": "tanh"}]
    both = [network[0] | {"input": "OBSERVATIONS_ACTIONS"}]
    critics = ("critic_1", "critic_2", "target_critic_1", "target_critic_2")
    models = {name: deterministic_model(**spaces, network=both, output="ONE") for name in critics}
    models["policy"] = gaussian_model(
        **spaces, network=network, output="ACTIONS", clip_actions=True
    )
    agent = type("Agent", (*bases, SAC), {})(
        models=models,
        memory=memory,
        **spaces,
        cfg={
            "learning_starts": STEPS,
            "experiment": {"write_interval": 0, "checkpoint_interval": 0},
        },
    )
    cfg = {
        "timesteps": STEPS,
        "headless": True,
        "disable_progressbar": True,
        "close_environment_at_exit": False,
    }
    SequentialTrainer(env=env, agents=agent, cfg=cfg).train()
    numbers = [
        memory.get_tensor_by_name(name).numpy()
        for name in ("observations", "actions", "next_observations")
    ]
    return *numbers, memory.get_tensor_by_name("terminated").squeeze(-1).numpy().astype(bool)


def horizons(before, terminated):
    """Whether the next transition begins an episode though this one did not terminate.

    skrl's off-policy agents do not store truncations. The last step is left out.
    """
    begins = (before[1:, :, 2:] == 0).all(axis=-1)
    return begins & ~terminated[:-1]


def test_blocks_of_the_page_run(tmp_path):
    run_page("skrl", tmp_path)


def test_stored_transitions_follow_the_plant_and_end_where_it_ends():
    lanes = {"num_envs": LANES, "autoreset_mode": "SameStep"}
    before, actions, after, terminated = (array for array in recorded(right_ends(), **lanes))
    truncated = horizons(before, terminated)
    check_transitions(before[:-1], actions[:-1], after[:-1], terminated[:-1], truncated)


def test_single_environment_is_stored_as_it_is():
    before, actions, after, terminated = recorded()
    truncated = horizons(before, terminated)
    check_transitions(before[:-1], actions[:-1], after[:-1], terminated[:-1], truncated)


def test_without_the_class_of_the_page_the_ends_are_wrong():
    # It says so; when skrl reads final_obs by itself, the page has to change.
    before, actions, after, terminated = recorded(num_envs=LANES, autoreset_mode="SameStep")
    truncated = horizons(before, terminated)
    assert (after[:-1][truncated][:, 2:] == 0).all()  # at rest, as episodes begin
    with pytest.raises(AssertionError):
        check_shuffled(before, actions, after, terminated)
