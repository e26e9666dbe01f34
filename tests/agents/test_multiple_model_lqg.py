"""The LQG that finds a harmonic's frequency among those that it was designed for."""

import numpy as np

from agents.controllers.lqg import LQG
from agents.controllers.multiple_model_lqg import MODELS, MultipleModelLQG
from agents.controllers.registry import laws, obstacle
from agents.scoring import evaluate
from agents.training.config import CONFIGS
from mm_gym import MovingMassVectorEnv, load_scene

FREQUENCY = "excitation.0.frequency"
FOOTBRIDGE = load_scene(CONFIGS / "structures" / "footbridge.toml")


def test_it_costs_little_more_than_an_lqg_that_is_told_the_frequency():
    own, unsure = MultipleModelLQG(FOOTBRIDGE), LQG(FOOTBRIDGE)
    for frequency in (10.8, 13.1):
        scene = FOOTBRIDGE.replace(**{FREQUENCY: frequency}, randomization={})
        told = evaluate(scene, LQG(scene), episodes=20).cost
        assert evaluate(scene, own, episodes=20).cost < 1.15 * told
        assert evaluate(scene, unsure, episodes=20).cost > 1.3 * told


def test_the_frequencies_of_an_episode_become_the_most_probable():
    own, env = MultipleModelLQG(FOOTBRIDGE), MovingMassVectorEnv(FOOTBRIDGE, num_envs=16)
    observation, _ = env.reset(seed=0)
    memory = own.begin(env)
    for _ in range(FOOTBRIDGE.control.steps - 1):
        action, memory = own.act(memory, observation, {})
        observation, *_ = env.step(action)
    low, high = FOOTBRIDGE.randomization[FREQUENCY]
    found = own.frequencies[memory["evidence"].argmax(axis=1), 0]
    drawn = env.drawn(FREQUENCY)
    assert np.abs(found - drawn).max() < 2.0 * (high - low) / MODELS


def test_two_frequencies_can_be_unknown():
    second = FOOTBRIDGE.excitation[0].model_copy(update={"frequency": 20.0})
    drawn = {**FOOTBRIDGE.randomization, "excitation.2.frequency": (18.0, 22.0)}
    scene = FOOTBRIDGE.replace(excitation=[*FOOTBRIDGE.excitation, second], randomization=drawn)
    own = MultipleModelLQG(scene)
    assert own.frequencies.shape == (MODELS, 2)
    costs = [evaluate(scene, one, episodes=20).cost for one in (own, LQG(scene))]
    assert costs[0] < 0.95 * costs[1]


def test_it_is_offered_where_a_frequency_is_drawn():
    assert "multiple-model-lqg" in laws(FOOTBRIDGE)
    known = FOOTBRIDGE.replace(randomization={})
    assert "no frequency of the excitation is drawn" in str(obstacle("multiple-model-lqg", known))
