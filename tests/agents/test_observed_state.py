"""Do controllers that claim the observation use nothing else, and is the estimate good?"""

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, CARRIAGE_FORCE_FRICTION, HYBRID, PRE_STRETCH, TASKS

from agents.control.actuators import Actuators
from agents.control.feedback import Feedback, TrueState
from agents.control.model import Innovation, LinearModel, Model, model_of
from agents.control.observed_state import ObservedDelay, ObservedState, observed_state
from agents.controllers.constant import no_control
from agents.controllers.lqr import LQR
from agents.controllers.predictive_control import PredictiveControl, Search
from agents.controllers.registry import laws
from agents.scoring import evaluate
from mm_gym import DesignError, MovingMassVectorEnv, Scene, load_scene

LAGGING = HYBRID.replace(
    **{
        "actuation.force.lag": 0.02,
        "actuation.force.rate_limit": 5.0,
        "actuation.stretch.lag": 0.01,
    }
)


@pytest.mark.parametrize("stated", [0.8, 1.0, 1.2])
def test_of_what_is_drawn_a_controller_knows_the_middle_whatever_is_stated(stated) -> None:
    stiffness, mass = 1.2 * CARRIAGE_FORCE.carriage.stiffness, 1.1 * CARRIAGE_FORCE.carriage.mass
    drawn = {"carriage.stiffness": (0.8 * stiffness, 1.2 * stiffness)}
    drawn |= {"carriage.mass": (0.8 * mass, 1.2 * mass)}
    cubic = {"carriage.cubic_coefficient": 1e3, "sensors.noise": {"carriage_displacement": 1e-4}}
    scene = CARRIAGE_FORCE.replace(randomization=drawn, **cubic)
    other = scene.replace(
        **{"carriage.stiffness": stated * stiffness, "carriage.mass": stated * mass}
    )
    middle = scene.replace(**{"carriage.stiffness": stiffness, "carriage.mass": mass})
    for name in ("feedback-linearisation", "gain-scheduled-lqr"):
        found, expected = (
            evaluate(one, laws(middle)[name](one), episodes=5).cost for one in (other, middle)
        )
        assert found == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("scene", [*TASKS.values(), LAGGING], ids=[*TASKS, "lagging"])
def test_model_of_the_actuators_is_the_environments(scene) -> None:
    env = MovingMassVectorEnv(scene, 20)
    _, info = env.reset(seed=1)
    actuators = Actuators(scene)
    reached = asked = info["applied"]
    generator = np.random.default_rng(1)
    for _ in range(12):
        action = generator.uniform(-1.5, 1.5, env.action_space.shape)
        *_, info = env.step(action)
        reached, asked = actuators.reached(action, reached, asked)
        # Fused multiplication in the kernel: the last bits may differ.
        np.testing.assert_allclose(reached, info["applied"], rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize(
    "scene", [CARRIAGE_FORCE, CARRIAGE_FORCE_FRICTION], ids=["linear", "friction"]
)
def test_model_moves_as_the_environment_without_disturbance(scene) -> None:
    env = MovingMassVectorEnv(scene, 20)
    _, info = env.reset(seed=2)
    model = Model(scene)
    model.begin(info["state"])
    for _ in range(10):
        action = np.random.default_rng(3).uniform(-1, 1, env.action_space.shape)
        *_, info = env.step(action)
        state, _ = model.advance(action * 4.0)
        # x2 enters as an offset, which rounds; the force passes through another unit.
        np.testing.assert_allclose(state, info["state"], rtol=1e-11, atol=1e-14)


@pytest.mark.parametrize(
    "changes",
    [
        {"sensors.dropout": 0.5},
        {"sensors.bias": {"carriage_displacement": 0.002}},
        {"randomization": {"sensors.dropout": (0.0, 0.9)}},
        {"randomization": {"sensors.bias.carriage_displacement": (0.0, 0.004)}},
    ],
)
def test_frames_that_are_old_or_biased_are_not_read_off(changes) -> None:
    scene = CARRIAGE_FORCE.replace(**changes)
    law = Feedback(scene, LQR(CARRIAGE_FORCE))
    assert not law.source.exact
    # The law costs 0.052 with exact frames, and 0.13 to 0.54 if these are taken for exact ones.
    assert evaluate(scene, law, episodes=20).cost < 0.06


HYSTERESIS = CARRIAGE_FORCE.replace(
    interface={"kind": "bouc_wen", "stiffness": 50.0, "yield_displacement": 0.005},
    **{"initial.carriage_displacement": 0.01},
)
BETWEEN = HYSTERESIS.replace(**{"actuation.force.between": "masses"})
VOLTAGE = Scene.of(
    {
        "interface": {"kind": "magnetorheological"},
        "initial": {"carriage_displacement": 0.01, "sphere_offset": 0.006},
        "actuation": {"voltage": {"lag": 0.0}},
        "control": {"time_step": 0.005},
    }
)


def motion(scene, steps=8):
    """Yield state, own states, what was applied before and the action at each step."""
    scene = scene.replace(excitation=[], randomization={})
    env = MovingMassVectorEnv(scene, 3, autoreset_mode="Disabled")
    _, info = env.reset(seed=2)
    generator = np.random.default_rng(3)
    for _ in range(steps):
        action = generator.uniform(-1, 1, env.action_space.shape)
        own = env.get_state()["values"][env.plant.support.own_rows]
        yield info["state"], own, info["applied"], action
        *_, info = env.step(action)


OWN = pytest.mark.parametrize(
    "scene", [HYSTERESIS, BETWEEN, VOLTAGE], ids=["hysteresis", "between", "voltage"]
)


@OWN
def test_model_that_begins_anew_at_each_step_follows_the_own_states(scene) -> None:
    innovation, begun = Innovation(scene), False
    memory = innovation.begin(3)
    for state, own, applied, _ in motion(scene):
        missed, _, memory = innovation.missed(memory, state, applied)
        if begun:
            # Both are within the solver's tolerance of the motion, in units of order 1 to 100.
            near = {"rtol": 100 * scene.solver.tolerance, "atol": 100 * scene.solver.tolerance}
            np.testing.assert_allclose(state - missed, state, **near)
            np.testing.assert_allclose(memory["own"].T, own, **near)
        begun = True
    assert np.all(np.abs(own) > 1e-4)  # far above that tolerance: a model that forgot them fails


@OWN
def test_predictive_control_follows_the_own_states_through_its_plans(scene) -> None:
    search = Search(horizon=3, plans=6, elite=2, rounds=1, spread=0.5)
    control = PredictiveControl(scene.replace(excitation=[]), no_control(scene), search)
    memory = control.begin(3)
    for state, own, applied, _ in motion(scene, 5):
        _, memory = control.action(memory, state, applied)
        tolerance = 100 * scene.solver.tolerance
        np.testing.assert_allclose(memory["own"].T, own, rtol=tolerance, atol=tolerance)
    assert np.all(np.abs(own) > 1e-4)


def test_late_state_is_exact_with_hysteresis() -> None:
    scene = HYSTERESIS.replace(**{"sensors.delay": 2, "excitation": [], "randomization": {}})
    env = MovingMassVectorEnv(scene, 3)
    observation, info = env.reset(seed=4)
    source = ObservedState(scene)
    memory = source.begin(3)
    scale = scene.objective.displacement_scale
    for _ in range(10):
        state, _, memory = source.read(memory, observation, {})
        # Observations are in single precision.
        np.testing.assert_allclose(state[:, :2], info["state"][:, :2], atol=3e-6 * scale)
        memory = source.note(memory, -np.ones((3, 1)))  # +1 would hold the carriage where it begins
        observation, *_, info = env.step(-np.ones((3, 1)))


@pytest.mark.parametrize("delay", [0, 2])
@pytest.mark.parametrize("scene", [CARRIAGE_FORCE, CARRIAGE_FORCE_FRICTION, PRE_STRETCH])
def test_estimate_is_the_state_where_nothing_disturbs(scene, delay) -> None:
    scene = scene.replace(**{"sensors.delay": delay, "excitation": [], "randomization": {}})
    scene = scene.replace(**{"initial.carriage_displacement": 0.004})
    env = MovingMassVectorEnv(scene, 10)
    observation, info = env.reset(seed=4)
    source = ObservedState(scene)
    memory = source.begin(10)
    generator = np.random.default_rng(5)
    scale = scene.objective.displacement_scale
    for _ in range(20):
        state, applied, memory = source.read(memory, observation, {})
        # Observations are in single precision.
        np.testing.assert_allclose(state[:, :2], info["state"][:, :2], atol=3e-6 * scale)
        np.testing.assert_allclose(applied, info["applied"], rtol=1e-5)
        action = generator.uniform(-1, 1, env.action_space.shape)
        memory = source.note(memory, action)
        observation, *_, info = env.step(action)


def test_estimate_is_better_than_the_noisy_observation() -> None:
    noise = {"carriage_displacement": 1e-3, "carriage_velocity": 0.05}
    scene = CARRIAGE_FORCE.replace(**{"sensors.noise": noise})
    env = MovingMassVectorEnv(scene, 200)
    observation, info = env.reset(seed=6)
    source = ObservedState(scene)
    memory = source.begin(200)
    errors = []
    for _ in range(60):
        state, _, memory = source.read(memory, observation, {})
        errors.append((state - info["state"])[:, [0, 2]])
        memory = source.note(memory, np.zeros((200, 1)))
        observation, *_, info = env.step(np.zeros((200, 1)))
    late = np.sqrt(np.mean(np.square(errors[30:]), axis=(0, 1)))
    # Nothing disturbs the motion, so the filter averages over some thirty frames.
    assert np.all(late < (0.3e-3, 0.015))


def test_hidden_position_is_refused_by_name() -> None:
    scene = PRE_STRETCH.replace(**{"sensors.channels": ["stretch"], "sensors.history": 1})
    with pytest.raises(DesignError, match=r"sensors\.channels: .* stretch"):
        ObservedState(scene)


def test_late_and_noisy_observation_costs_something() -> None:
    noise = {"carriage_displacement": 1e-3, "carriage_velocity": 0.1}
    scene = CARRIAGE_FORCE.replace(**{"sensors.delay": 2, "sensors.noise": noise})
    costs = [
        evaluate(scene, Feedback(scene, LQR(scene), source), episodes=50).cost
        for source in (TrueState(), None)
    ]
    nothing = evaluate(scene, Feedback(scene, no_control(scene)), episodes=50).cost
    assert costs[0] < costs[1] < nothing


DRAWN = load_scene("mm_gym/CarriageForceFrictionRobust-v0")


def test_drawn_delay_is_found_from_the_frames() -> None:
    lanes, steps = 120, 12
    env = MovingMassVectorEnv(DRAWN, lanes)
    observation, _ = env.reset(seed=3)
    drawn = env.unwrapped.get_state()["values"][env.unwrapped.plant.support.names["sensors.delay"]]
    source = observed_state(DRAWN)
    memory = source.begin(lanes)
    generator = np.random.default_rng(4)
    for _ in range(steps):
        action = generator.uniform(-1, 1, env.action_space.shape)
        memory = source.note(source.read(memory, observation, {})[2], action)
        observation, *_ = env.step(action)
    likeliest = np.argmin(memory["unlikely"], axis=1)
    # A rig's own mass and lag make another delay likelier in a few episodes.
    assert set(drawn) == {0.0, 1.0, 2.0}
    assert np.mean(likeliest == drawn) > 0.95


def test_estimates_of_a_drawn_delay_are_those_of_each_delay() -> None:
    lanes, sources = 6, []
    for delay in range(3):
        known = {k: v for k, v in DRAWN.randomization.items() if k != "sensors.delay"}
        scene = DRAWN.replace(randomization=known, **{"sensors.delay": delay})
        sources.append(ObservedState(scene, range(delay, delay + 1)))
    drawn = observed_state(DRAWN)
    env = MovingMassVectorEnv(DRAWN, lanes)
    observation, _ = env.reset(seed=5)
    memories, memory = [source.begin(lanes) for source in sources], drawn.begin(lanes)
    for action in np.random.default_rng(6).uniform(-1, 1, (8, *env.action_space.shape)):
        _, _, memory = drawn.read(memory, observation, {})
        memory = drawn.note(memory, action)
        for k, source in enumerate(sources):
            _, _, own = source.read(memories[k], observation, {})
            memories[k] = source.note(own, action)
            for name in ("estimate", "unlikely", "applied"):
                np.testing.assert_array_equal(memory[name][:, k], memories[k][name])
        observation, *_ = env.step(action)


def test_finding_the_delay_is_better_than_its_middle() -> None:
    scene = load_scene("mm_gym/CarriageForceRobust-v0")
    law = LQR(scene)
    middle, found = (
        evaluate(scene, Feedback(scene, law, source), seed=0, episodes=60).cost
        for source in (ObservedState(scene), observed_state(scene))
    )
    assert isinstance(observed_state(scene), ObservedDelay)
    assert found < 0.9 * middle


WIDE = {"minimum": 1.0, "maximum": 4.0}


@pytest.mark.parametrize(
    "scene",
    [
        PRE_STRETCH,
        HYBRID,
        PRE_STRETCH.replace(**{"actuation.stretch": WIDE, "control.time_step": 0.02}),
        load_scene("mm_gym/SemiActiveDamper-v0"),
        load_scene("mm_gym/ActiveMassDamper-v0"),  # a force between the masses
        CARRIAGE_FORCE.replace(randomization={"carriage.mass": (0.1, 0.2)}),
        CARRIAGE_FORCE,
    ],
)
def test_arithmetic_of_a_linear_model_moves_as_the_engine(scene):
    generator, lanes, actuators = np.random.default_rng(0), 50, Actuators(scene)
    span = actuators.high - actuators.low
    state = generator.standard_normal((lanes, 4)) * [0.01, 0.01, 0.3, 0.3]
    linear, engine = LinearModel(scene), Model(scene)
    linear.begin(state, linear.at_rest(lanes))
    engine.begin(state)
    for _ in range(5):
        applied = actuators.low + span * generator.uniform(size=(lanes, len(span)))
        moved, wanted = linear.advance(applied)[0], engine.advance(applied)[0]
        # Round-off of the sums, over the size of the motion.
        bound = 1e-13 * np.abs(wanted).max(axis=0)
        assert (np.abs(moved - wanted) < bound).all()


@pytest.mark.parametrize(
    "scene",
    [
        CARRIAGE_FORCE_FRICTION,
        CARRIAGE_FORCE.replace(**{"carriage.cubic_coefficient": 1e3}),
        HYBRID.replace(**{"actuation.damping": {"minimum": 0.1, "maximum": 1.0}}),
    ],
)
def test_other_plants_are_left_to_the_engine(scene):
    assert isinstance(model_of(scene), Model)
