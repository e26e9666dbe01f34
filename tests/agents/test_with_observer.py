"""Agents that an observer shows what prompt and quiet sensors would show."""

import numpy as np
import pytest

from agents.control.feedback import Feedback
from agents.controllers.learned import Learned
from agents.controllers.lqr import LQR
from agents.controllers.with_observer import WithObserver
from agents.evaluation.rigs import task_of
from agents.policies import load_policy
from agents.report.published import FOLDER
from agents.scoring import evaluate
from mm_gym import DesignError, MovingMassVectorEnv, load_scene

NOISE = "PreStretchNoise"


def scenes(name):
    variant = f"mm_gym/{name}Robust-v0"
    return load_scene(variant), load_scene(task_of(variant))


def specialist(name, algorithm="evolution"):
    return Learned(load_policy(FOLDER / f"{name}-{algorithm}.safetensors"))


class Shown(Learned):
    """A policy that keeps what it observed."""

    def propose(self, memory, observation, info):
        self.observation = observation
        return super().propose(memory, observation, info)


def test_prompt_sensors_show_what_they_show_without_observer() -> None:
    _, task = scenes(NOISE)
    alone, shown = specialist(NOISE), Shown(specialist(NOISE).policy)
    observer = WithObserver(task, shown)
    env = MovingMassVectorEnv(task, 5)
    observation, _ = env.reset(seed=1)
    memory, own = observer.begin(env), alone.begin(env)
    for _ in range(12):
        action, memory = observer.propose(memory, observation, {})
        want, own = alone.propose(own, observation, {})
        # An observation is in single precision; a switch turns at a rounding.
        np.testing.assert_allclose(shown.observation, observation, atol=3e-6)
        np.testing.assert_allclose(action, want, atol=1e-3)
        observation, *_ = env.step(want)
        memory, own = observer.note(memory, want), alone.note(own, want)


@pytest.mark.parametrize("name", [NOISE, "PreStretchShock", "CarriageForce"])
def test_specialist_costs_little_more_on_the_task_and_much_less_on_rigs(name) -> None:
    rigs, task = scenes(name)
    alone = specialist(name)
    observer = WithObserver(rigs, alone)
    costs = {
        key: evaluate(scene, agent, seed=0, episodes=40).cost
        for key, scene, agent in (
            ("alone", task, alone),
            ("observer", task, observer),
            ("alone, rigs", rigs, alone),
            ("observer, rigs", rigs, observer),
        )
    }
    assert costs["observer"] < 1.02 * costs["alone"]
    assert costs["observer, rigs"] < min(1.3 * costs["alone"], 0.9 * costs["alone, rigs"])


def test_lqr_with_an_observer_is_the_lqr_that_is_fed_its_estimate() -> None:
    rigs, task = scenes("CarriageForce")
    observer = WithObserver(rigs, Feedback(task, LQR(task)))
    env = MovingMassVectorEnv(rigs, 8)
    observation, _ = env.reset(seed=2)
    other = Feedback(rigs, LQR(task))
    memory, own = observer.begin(env), other.begin(env)
    for _ in range(10):
        action, memory = observer.act(memory, observation, {})
        want, own = other.act(own, observation, {})
        np.testing.assert_allclose(action, want, atol=1e-5)
        observation, *_ = env.step(action)


def test_sensors_that_do_not_show_the_state_are_refused() -> None:
    rigs, _ = scenes(NOISE)
    hidden = rigs.replace(
        randomization={}, **{"sensors.channels": ["stretch"], "sensors.noise": {}}
    )
    with pytest.raises(DesignError, match=r"sensors\.channels: stretch"):
        WithObserver(hidden, specialist(NOISE))
