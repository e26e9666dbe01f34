"""Can controllers do with accelerometers alone, as most rigs have?"""

import numpy as np
import pytest

from agents.control import kalman_state
from agents.control.kalman_filter import design_filter, excited_system
from agents.control.kalman_state import KalmanState
from agents.control.observed_state import observed_state
from agents.controllers.constant import uncontrolled
from agents.controllers.registry import laws
from agents.controllers.smith_predictor import SmithPredictor
from agents.scoring import evaluate
from mm_gym import DesignError, MovingMassVectorEnv, load_scene

FRAME, SPRINGS = (
    load_scene(f"configs/structures/{name}.toml") for name in ("frame", "pre_stretch")
)
# Of an earthquake that neither rises nor decays.
STEADY = {"kind": "kanai_tajimi", "rms": 1.0, "ground_frequency": 15.0, "sample_time": 0.02}
LANES, EPISODES = 200, 20
HARDLY = 1e-5  # what is unmodelled: there is nothing


def with_accelerometers(scene, *others, delay=1):
    channels = ["carriage_acceleration", "sphere_acceleration", *others]
    shown = scene.sensors.noise.items()
    noise = {name: value for name, value in shown if name in channels}
    return scene.replace(sensors={"channels": channels, "noise": noise, "delay": delay})


@pytest.mark.parametrize("delay", [0, 2])
def test_error_of_the_estimate_is_the_one_that_the_filter_states(delay, monkeypatch) -> None:
    monkeypatch.setattr(kalman_state, "UNMODELLED", HARDLY)
    scene = with_accelerometers(FRAME, delay=delay).replace(excitation=[STEADY])
    source, env = observed_state(scene), MovingMassVectorEnv(scene, LANES)
    assert isinstance(source, KalmanState)
    observation, info = env.reset(seed=1)
    memory, generator = source.begin(LANES), np.random.default_rng(2)
    squares = np.zeros(2)
    steps, settled = scene.control.steps, scene.control.steps // 4
    for step in range(steps):
        state, _, memory = source.read(memory, observation, {})
        if step >= settled:
            squares += np.mean((state - info["state"])[:, [0, 2]] ** 2, axis=0) / (steps - settled)
        action = generator.uniform(-1.0, 1.0, (LANES, 1))
        memory = source.note(memory, action)
        observation, *_, info = env.step(action)
    system = excited_system(scene, ["force"])
    stated = design_filter(scene, system, HARDLY).error[[0, 2], [0, 2]]
    np.testing.assert_allclose(squares, stated, rtol=0.1)  # 200 episodes tell it to some 3 %


def test_springs_are_tuned_by_accelerometers_alone() -> None:
    scene = with_accelerometers(SPRINGS, "stretch").replace(**{"control.steps": 166})
    without = evaluate(scene, uncontrolled(scene), episodes=EPISODES).cost
    for name in ("clipped-lqr", "on-off-stiffness"):
        assert evaluate(scene, laws(scene)[name](scene), episodes=EPISODES).cost < 0.85 * without


def test_force_is_what_acts_and_not_what_is_commanded() -> None:
    slow = with_accelerometers(FRAME).replace(**{"actuation.force.rate_limit": 40.0})
    source, env = observed_state(slow), MovingMassVectorEnv(slow, LANES)
    observation, info = env.reset(seed=3)
    memory, errors = source.begin(LANES), []
    for _ in range(100):
        state, applied, memory = source.read(memory, observation, {})
        np.testing.assert_allclose(applied, info["applied"], atol=1e-9)
        errors.append((state - info["state"])[:, 0])
        memory = source.note(memory, np.ones((LANES, 1)))
        observation, *_, info = env.step(np.ones((LANES, 1)))
    assert np.std(errors[50:]) < 0.3 * np.std(info["state"][:, 0])


def test_what_shows_no_motion_is_refused_still() -> None:
    blind = SPRINGS.replace(sensors={"channels": ["stretch"]})
    with pytest.raises(DesignError, match=r"sensors\.channels: stretch show nothing of the motion"):
        observed_state(blind)
    # A Smith predictor on a Kalman filter would be an LQG.
    with pytest.raises(DesignError, match=r"sensors\.channels: the state cannot be estimated"):
        observed_state(with_accelerometers(FRAME), SmithPredictor)
