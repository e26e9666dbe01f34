"""Laws of a damper whose coefficient is controlled, and of a force between the masses."""

from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

from agents.control.actuators import GRID, SWITCHINGS, Lead
from agents.control.feedback import Feedback
from agents.control.scene import sphere_springs
from agents.controllers.clipped_optimal import (
    ClippedOptimal,
    SharedForce,
    free_numbers,
    with_free_gains,
)
from agents.controllers.constant import no_control, uncontrolled
from agents.controllers.energy_shaping import EnergyShaping
from agents.controllers.learned import Learned
from agents.controllers.lqr import LQR
from agents.controllers.newton_predictive_control import NewtonPredictiveControl, Steps
from agents.controllers.noise import RandomActions
from agents.controllers.predictive_control import SEARCH, PredictiveControl, predictive_control
from agents.controllers.registry import laws, obstacle
from agents.controllers.semi_active import CORNER, Balance, GroundVelocity, Hook
from agents.controllers.tuned import classical_laws, makers
from agents.evaluation.plans import Effort, Planner
from agents.evolution.search import EvolveSettings, evolve
from agents.gradient.descent import descend
from agents.gradient.settings import GradientSettings
from agents.policies import load_policy
from agents.scoring import evaluate
from agents.training.config import TrainSettings
from agents.training.reinforcement import train
from agents.training.runs import Run
from agents.training.starts import start_of
from mm_gym import DesignError, MovingMassVectorEnv, Scene, compile_scene, load_scene
from mm_gym.analysis import spring_energy
from mm_gym.lanes import layout

LOW, HIGH = 0.05, 2.0
QUAKE = {
    "kind": "kanai_tajimi",
    "rms": 3.0,
    "ground_frequency": 75.0,
    "rise": 0.2,
    "sample_time": 0.005,
}
PUSH = {"kind": "noise", "rms": 0.3, "low_frequency": 40.0, "high_frequency": 80.0}
OF = ("interface", "carriage")


def scene_of(of="interface", excitation=(QUAKE,), **changes):
    scene = Scene(
        carriage={"damping": 0.2},
        sphere={"mass": 0.01},
        interface={"kind": "viscous", "damping": 0.1},
        springs={"kind": "linear", "stiffness": 36.0},
        excitation=list(excitation),
        actuation={"damping": {"of": of, "minimum": LOW, "maximum": HIGH}},
        control={"time_step": 0.005, "steps": 200},
    )
    return scene.replace(**changes)


STILL, SHAKEN = scene_of(excitation=()), scene_of()
STATES = np.random.default_rng(0).normal(size=(500, 4)) * [0.002, 0.01, 0.1, 0.5]


def every_law(scene):
    """Return one of each law that the scene allows."""
    hooks = [
        partial(Hook, scene, what, how, gain=gain)
        for (what, gain), how in product(GAINS.items(), ("on-off", "continuous"))
    ]
    others = [
        maker
        for how in ("on-off", "continuous")
        for maker in (partial(Balance, scene, how), partial(ClippedOptimal, scene, how, 0.03))
    ]
    found = []
    for make in [*hooks, *others]:
        try:
            found.append(make())
        except DesignError:
            assert scene.actuation.damping.of == "carriage"
    return found


DAMPER = "mm_gym/SemiActiveDamper-v0"
HIDDEN = ["carriage_displacement", "sphere_offset"]
GAINS = {"skyhook": 2.0, "groundhook": 5.0, "displacement groundhook": 400.0}


def commanded(law, states=STATES):
    """Return the dampings that a law asks for [N s/m]."""
    actions, _ = law.action(law.begin(len(states)), states, np.full((len(states), 1), 0.3))
    return 0.5 * (HIGH + LOW) + 0.5 * (HIGH - LOW) * actions[:, 0]


FORCES = {
    "skyhook": (0.0, 0.0, 0.0, 2.0),
    "groundhook": (0.0, 0.0, -5.0, 0.0),
    "displacement groundhook": (-400.0, 0.0, 0.0, 0.0),
    "balance": (36.0, -36.0, 0.0, 0.0),
}
"""What each wants of the interface's damper, per x1, x2 [N/m], v1 and v2 [N s/m]."""


@pytest.mark.parametrize("what", FORCES)
@pytest.mark.parametrize("how", ["on-off", "continuous"])
def test_damping_of_the_interface_is_that_of_the_formula(what, how):
    law = Balance(STILL, how) if what == "balance" else Hook(STILL, what, how, gain=GAINS[what])
    for state, damping in zip(STATES, commanded(law), strict=True):
        force, slip = state @ FORCES[what], state[3] - state[2]
        wanted = LOW
        if force * slip > 0.0:
            wanted = HIGH if how == "on-off" else min(max(force / slip, LOW), HIGH)
        assert damping == pytest.approx(wanted, rel=1e-13)


@pytest.mark.parametrize("how", ["on-off", "continuous"])
def test_carriage_damper_balances_its_spring(how):
    for state, damping in zip(STATES, commanded(Balance(scene_of("carriage"), how)), strict=True):
        ratio = -400.0 * state[0] / state[2]
        if how == "on-off":
            assert damping == pytest.approx(HIGH if ratio > 0.0 else LOW, rel=1e-13)
        else:
            assert damping == pytest.approx(min(max(ratio, LOW), HIGH), rel=1e-13)


def test_carriage_damper_is_a_skyhook_only_while_the_ground_moves():
    for scene, what in (
        (scene_of("carriage", ()), "skyhook"),
        (scene_of("carriage"), "groundhook"),
    ):
        with pytest.raises(DesignError, match=r"actuation.damping.of: got 'carriage'; allowed for"):
            Hook(scene, what, "on-off")
    law = Hook(scene_of("carriage"), "skyhook", "continuous", gain=2.0)
    ground = np.random.default_rng(1).normal(size=len(STATES))
    ratio = 2.0 * (STATES[:, 2] + ground) / STATES[:, 2]
    law.ground.observe = lambda memory, *_: {**memory, "velocity": ground}
    applied = np.full((len(STATES), 1), 0.3)
    actions = law.action(law.begin(len(STATES)), STATES, applied)[0][:, 0]
    dampings = 0.5 * (HIGH + LOW) + 0.5 * (HIGH - LOW) * actions
    np.testing.assert_allclose(dampings, np.clip(ratio, LOW, HIGH), rtol=1e-13)


def test_balance_refuses_a_damper_without_springs_beside_it():
    with pytest.raises(DesignError, match=r"springs.kind: got 'none'; allowed for the balance"):
        Balance(STILL.replace(springs={"kind": "none"}), "on-off")


@pytest.mark.parametrize("of", OF)
def test_clipped_optimal_follows_the_force_of_a_regulator(of):
    """The oracle discretises and solves by itself, with the damper taken out."""
    scene, weight = scene_of(of, **{"objective.stroke_weight": 0.1}), 0.02
    m1, m2, k1, k2 = 0.1, 0.01, 400.0, 36.0
    d, c = (0.2, 0.0) if of == "interface" else (0.0, 0.1)
    a = np.zeros((4, 4))
    a[:2, 2:] = np.eye(2)
    a[2] = [-(k1 + k2) / m1, k2 / m1, -(d + c) / m1, c / m1]
    a[3] = [k2 / m2, -k2 / m2, c / m2, -c / m2]
    b = np.array([0.0, 0.0, 1.0 / m1, -1.0 / m2 if of == "interface" else 0.0])
    both = expm(0.005 * np.block([[a, b[:, None]], [np.zeros((1, 5))]]))
    ad, bd = both[:4, :4], both[:4, 4:]
    x, s = 1.0 / 0.01**2, 0.1 / 0.02**2
    q = np.zeros((4, 4))
    q[:2, :2] = [[x + s, -s], [-s, s]]
    r = np.array([[weight / (400.0 * 0.01) ** 2]])
    # A step's cost is that of the state at its end: Q of the next state.
    cost = ad.T @ q @ ad, bd.T @ q @ bd + r, ad.T @ q @ bd
    p = solve_discrete_are(ad, bd, cost[0], cost[1], s=cost[2])
    gain = np.linalg.solve(cost[1] + bd.T @ p @ bd, bd.T @ p @ ad + cost[2].T)[0]
    force = -STATES @ gain  # on the carriage
    velocity = STATES[:, 3] - STATES[:, 2] if of == "interface" else -STATES[:, 2]
    ratio = force / velocity
    found = commanded(ClippedOptimal(scene, "continuous", weight))
    np.testing.assert_allclose(found, np.clip(ratio, LOW, HIGH), rtol=1e-9)
    assert ((ratio > LOW) & (ratio < HIGH)).sum() > 5
    found = commanded(ClippedOptimal(scene, "on-off", weight))
    np.testing.assert_allclose(found, np.where(ratio > 0.0, HIGH, LOW), rtol=1e-13)


@pytest.mark.parametrize("switching", SWITCHINGS)
def test_free_gains_begin_with_those_of_the_regulator(switching):
    first = {name: one.first for name, one in free_numbers(SHAKEN, switching).items()}
    design = ClippedOptimal(SHAKEN, switching, first["weight"]).design
    law = with_free_gains(SHAKEN, first, switching)
    assert np.array_equal(law.design.gain, design.gain)
    assert law.device.on == HIGH
    other = with_free_gains(SHAKEN, first | {"gain_v1": 3.0, "lead": 0.0}, switching)
    np.testing.assert_allclose(other.design.gain / design.gain, [[1.0, 1.0, 3.0, 1.0]])
    assert other.lead.time == 0.0


@pytest.mark.parametrize(
    ("excitation", "bound"), [((QUAKE,), 0.05), ((QUAKE, PUSH), 0.25)], ids=["ground", "both"]
)
def test_velocity_of_the_ground_is_the_integral_of_its_acceleration(excitation, bound):
    channels = ["carriage_displacement", "ground_acceleration"]
    scene = scene_of(excitation=excitation, **{"sensors.channels": channels})
    env = MovingMassVectorEnv(scene, 20, autoreset_mode="Disabled")
    _, info = env.reset(seed=1)
    law, expected, pairs = GroundVelocity(scene), np.zeros(20), []
    memory = law.observe(law.begin(20), info["state"], info["applied"])
    kept = np.exp(-CORNER * np.sqrt(400.0 / 0.1) * 0.005)
    before = env.get_state()["values"][layout.GROUND_ACCELERATION].copy()
    for _ in range(200):
        *_, info = env.step(np.full((20, 1), 0.2))
        memory = law.observe(memory, info["state"], info["applied"])
        after = env.get_state()["values"][layout.GROUND_ACCELERATION].copy()
        expected = kept * expected + 0.005 * 0.5 * (before + after)
        pairs.append((memory["velocity"], expected.copy()))
        before = after
    found, expected = np.moveaxis(np.array(pairs), 1, 0)
    # The law takes both causes for constant over a step. They change in it, which one alone hides
    # better than two that are told apart.
    assert np.sqrt(np.mean((found - expected) ** 2) / np.mean(expected**2)) < bound


@pytest.mark.parametrize("of", OF)
def test_lead_of_a_damper_moves_the_state_as_the_plant_does(of):
    scene = scene_of(of, **{"actuation.damping.lag": 0.004, "actuation.damping.rate_limit": 400.0})
    lead, states = Lead(scene, "damping"), STATES[:GRID]
    dampings = np.linspace(LOW, HIGH, GRID)
    ahead = lead(states, dampings)
    # The lag and half of the time in which it crosses its range.
    time = 0.004 + 0.5 * (HIGH - LOW) / 400.0
    for k in (0, 17, GRID - 1):
        a, _ = compile_scene(
            scene.replace(actuation={"force": {}}, **{f"{of}.damping": dampings[k]})
        ).linear()
        np.testing.assert_allclose(ahead[k], expm(time * a) @ states[k], rtol=1e-11, atol=1e-15)
    assert Lead(scene_of(of), "damping").time == 0.0
    slow = scene_of(of, **{"actuation.damping.rate_limit": 10.0})  # two periods of the carriage
    assert Lead(slow, "damping").time == 0.0


def test_lead_makes_up_for_a_lag():
    scene = scene_of(**{"actuation.damping.lag": 0.01})
    law, late = (Hook(scene, "displacement groundhook", "on-off") for _ in range(2))
    late.lead.time = 0.0
    cost, without = (evaluate(scene, Feedback(scene, one), episodes=60).cost for one in (law, late))
    assert cost < 0.98 * without


def device_power(scene, env):
    """Return the power that the device absorbs [W], by the forces that accelerate the masses.

    And the size of the powers that it is the difference of.
    """
    v = env.get_state()["values"]
    x1, offset = v[layout.X1], v[layout.X2] - v[layout.X1]
    slip, inertia = v[layout.V2] - v[layout.V1], v[layout.M2] * v[layout.SPHERE_ACCELERATION]
    if scene.actuation.damping.of == "interface":
        forces, velocity = (inertia, scene.springs.stiffness * offset), slip
    else:
        carriage = v[layout.M1] * v[layout.CARRIAGE_ACCELERATION]
        forces, velocity = (inertia, carriage, scene.carriage.stiffness * x1), v[layout.V1]
    return -sum(forces) * velocity, sum(map(np.abs, forces)) * np.abs(velocity)


def require_passive(scene, controller, episodes, shown=None):
    """Run a controller, and check that the device absorbs power at every step's end.

    A force that is the difference of n others has their round-off. The controller is shown those
    channels of the same motion, by default the scene's.
    """
    env = seen = MovingMassVectorEnv(scene, episodes, autoreset_mode="Disabled")
    observation, info = env.reset(seed=5)
    if shown is not None:
        own = scene.replace(**{"sensors.channels": shown})
        seen = MovingMassVectorEnv(own, episodes, autoreset_mode="Disabled")
        observation, info = seen.reset(seed=5)
    memory = controller.begin(seen)
    most = 0.0
    for _ in range(scene.control.steps):
        action, memory = controller.act(memory, observation, controller.known(info))
        observation, *_, info = env.step(action)
        if seen is not env:
            observation, *_, info = seen.step(action)
        power, size = device_power(scene, env)
        assert (power >= -1e-14 * size.max()).all(), controller.name
        most = max(most, power.max())
        applied = info["applied"][:, 0]
        assert (applied >= scene.actuation.damping.minimum).all()
        assert (applied <= scene.actuation.damping.maximum).all()
    assert most > 0.0


SHOWN = {
    "sensors.channels": [
        *("carriage_displacement", "sphere_offset", "carriage_velocity", "slip_velocity"),
        *("damping", "carriage_acceleration", "sphere_acceleration"),
    ],
    "sensors.noise": {},
}


def watched(of, steps):
    limited = {"actuation.damping.rate_limit": 300.0, "actuation.damping.lag": 0.004}
    return scene_of(of, **SHOWN, **limited, **{"control.steps": steps})


def started(scene):
    """Return the start of a search, whose hidden units take part by chance."""
    start = start_of(scene, EvolveSettings(law="switching"), np.random.default_rng(0))
    inputs = start.direct.shape[1]
    units = np.random.default_rng(1).normal(size=(4, inputs + 1))
    return Learned(start.policy(units))


@pytest.mark.parametrize("of", OF)
def test_device_only_absorbs_power_under_every_law_and_network(of):
    scene = watched(of, 40)
    found = [Feedback(scene, law) for law in every_law(scene)]
    assert len(found) == {"interface": 10, "carriage": 6}[of]
    for controller in [*found, RandomActions(scene), started(scene)]:
        require_passive(scene, controller, 5)


@pytest.mark.parametrize("of", OF)
def test_device_only_absorbs_power_in_ten_thousand_episodes(of):
    scene = watched(of, 200)
    found = [Feedback(scene, law) for law in every_law(scene)]
    for controller in [*found, RandomActions(scene), started(scene)]:
        require_passive(scene, controller, 10_000)


SMALL = {"candidates": 8, "episodes": 8, "generations": 5, "threads": 1}
TRAININGS = {
    "evolution": (evolve, partial(EvolveSettings, **SMALL)),
    "gradient": (descend, partial(GradientSettings, episodes=8, iterations=5)),
    "ppo": (train, partial(TrainSettings, lanes=64, steps=64_000)),
}


@pytest.mark.parametrize("kind", TRAININGS)
def test_device_only_absorbs_power_under_a_trained_network(tmp_path, kind):
    changes = {**SHOWN, "control.steps": 250}
    shown = SHOWN["sensors.channels"][:-2]  # accelerations have no gradients
    settings = {**changes, "sensors.channels": shown}
    begin, settings_of = TRAININGS[kind]
    run = Run("passive", tmp_path)
    begin(settings_of(task=DAMPER, name="passive", changes=settings, evaluations=1), run, bar=False)
    trained = Learned(load_policy(run.policy))
    require_passive(load_scene(DAMPER).replace(**changes), trained, 10_000, shown)


def test_network_begins_as_clipped_optimal_control():
    """Nearly: on where force and velocity agree, whatever shows the velocities."""
    shown = scene_of(**SHOWN)
    hidden = shown.replace(**{"sensors.channels": HIDDEN, "sensors.history": 2})
    for scene in (shown, hidden):
        start = start_of(scene, EvolveSettings(law="switching"), np.random.default_rng(0))
        still = evaluate(scene, Feedback(scene, no_control(scene)), episodes=30).cost
        # No control holds the damping that an episode begins with: 0.151, and the start 0.138.
        assert evaluate(scene, Learned(start.policy()), episodes=30).cost < 0.95 * still
    blind = shown.replace(**{"sensors.channels": HIDDEN})
    with pytest.raises(DesignError, match="switching needs the velocity of the damper's ends"):
        start_of(blind, EvolveSettings(law="switching"), np.random.default_rng(0))
    with pytest.raises(DesignError, match=r"law: got 'regulator'; allowed where actuation.damping"):
        start_of(shown, EvolveSettings(law="regulator"), np.random.default_rng(0))


@pytest.mark.parametrize("of", OF)
def test_network_begins_as_the_lqg_at_the_best_constant_damping(of):
    def start(scene, law):
        settings = EvolveSettings(scene="mine.toml", law=law)
        return start_of(scene, settings, np.random.default_rng(0))

    changes = {"actuation.force.limit": 1.0, "objective.effort_weight": 0.01, "control.steps": 40}
    scene = scene_of(of, **changes)
    found, constant = start(scene, "auto"), start(scene, "constant")
    assert found.law == "lqg"
    assert found.cost(scene) < 0.8 * constant.cost(scene)
    assert found.direct[1, 0] == constant.direct[1, 0]
    # It is the LQG of a plant that has this damping.
    damping = float(np.interp(found.direct[1, 0], [-1.0, 1.0], [LOW, HIGH]))
    plain = scene.replace(**{"actuation.damping": None, f"{of}.damping": damping})
    alone = start(plain, "lqg")
    np.testing.assert_allclose(found.keep, alone.keep, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.direct[:1], alone.direct, rtol=1e-9, atol=1e-12)


def test_plans_begin_at_the_laws_and_are_not_worse_in_any_episode():
    scene = scene_of(**{"control.steps": 60})
    found = [evaluate(scene, Feedback(scene, law), episodes=4) for law in every_law(scene)]
    effort = Effort(random=1, kept=2, first=5, second=8, rounds=1, steps=4, searches=0, last=5)
    starts = {one.name: one.applied for one in found}
    planned = evaluate(scene, Planner(scene, starts, effort), episodes=4)
    least = np.min([one.penalties for one in found], axis=0)
    assert (planned.penalties <= least * (1.0 + 1e-9)).all()
    assert planned.cost < 0.97 * np.sqrt(least.mean())


def test_predictive_control_plans_for_a_damping_and_for_a_force_between_the_masses():
    force = {"limit": 0.5, "between": "masses"}
    pushed = scene_of(actuation={"force": force}, **{"objective.effort_weight": 0.01})
    steps, short = {"control.steps": 150}, replace(SEARCH, plans=24)
    for scene, law in (
        (SHAKEN, ClippedOptimal(SHAKEN, "on-off", 0.03)),
        (pushed, LQR(pushed)),
    ):
        one = scene.replace(**steps)
        makers = (
            lambda one=one, law=law: PredictiveControl(one, law, short),
            lambda one=one: NewtonPredictiveControl(one, Steps(near=1, fresh=1)),
        )
        still = evaluate(one, Feedback(one, no_control(one)), episodes=4).cost
        for make in makers:
            assert evaluate(one, Feedback(one, make()), episodes=4).cost < 0.9 * still
    chosen = predictive_control(SHAKEN, ClippedOptimal(SHAKEN, "on-off", 0.03)).law
    assert isinstance(chosen, PredictiveControl)


def test_energy_shaping_takes_out_what_its_gain_says():
    finite = {"kind": "finite_stretch", "rest_length": 0.1, "stiffness": 20.0, "stretch": 1.3}
    for springs in ({"kind": "none"}, {"kind": "linear", "stiffness": 36.0}, finite):
        force = {"actuation": {"force": {"limit": 1e3, "between": "masses"}}}
        scene = STILL.replace(springs=springs, **force)
        law, (x1, x2, v1, v2) = EnergyShaping(scene, 25.0, 0.7), STATES.T
        force, e, w = 1e3 * law.action({}, STATES, np.zeros((500, 1)))[0][:, 0], x2 - x1, v2 - v1

        def stored(e, springs=springs):
            if springs["kind"] == "none":
                return 0.0 * e
            if springs["kind"] == "linear":
                return 0.5 * 36.0 * e**2
            return spring_energy(e, 1.3, 20.0, 0.1)

        # The actuator gives u (v1 - v2); what is stored changes by the springs' work.
        step = 1e-6
        replaced = (stored(e + step * w) - stored(e - step * w)) / (2.0 * step)
        rate = force * (v1 - v2) + 25.0 * e * w - replaced
        # Central differences err by 1e-9 of the springs' power, some 1 W.
        np.testing.assert_allclose(rate, -0.7 * w**2, rtol=1e-7, atol=1e-8)


def test_energy_shaping_beats_the_springs_that_it_replaces():
    force = {"actuation": {"force": {"limit": 0.5, "between": "masses"}}}
    scene = SHAKEN.replace(**force, **{"springs.stiffness": 60.0})
    tuned, still = (
        evaluate(scene, Feedback(scene, EnergyShaping(scene, *values)), episodes=50)
        for values in ((32.0, 0.05), (60.0, 0.0))
    )
    assert tuned.cost < 0.9 * still.cost


@pytest.mark.parametrize("field", [{"between": "ground"}, {"command": "rate", "rate_limit": 9.0}])
def test_energy_shaping_needs_a_force_between_the_masses_by_value(field):
    force = {"between": "masses", **field}
    with pytest.raises(DesignError, match=r"actuation.force.\w+: got .* allowed for energy shapi"):
        EnergyShaping(STILL.replace(actuation={"force": force}), 1.0, 1.0)


def test_springs_of_a_controller_are_those_of_the_engine():
    kinds = (
        {"kind": "small_on_large", "stiffness": 20.0, "stretch": 1.4},
        {"kind": "finite_stretch", "stiffness": 20.0, "stretch": 1.4, "rest_length": 0.1},
    )
    offset, step = np.linspace(-0.02, 0.02, 9), 1e-6
    for springs in kinds:
        length = springs.get("rest_length", 0.0)
        ends = [spring_energy(offset + sign * step, 1.4, 20.0, length) for sign in (1.0, -1.0)]
        found = sphere_springs(STILL.replace(springs=springs))(offset)
        np.testing.assert_allclose(found, (ends[0] - ends[1]) / (2.0 * step), atol=1e-9)
    hard = {"kind": "linear", "stiffness": 30.0, "cubic_coefficient": 1e3}
    found = sphere_springs(STILL.replace(springs=hard))(offset)
    np.testing.assert_allclose(found, 30.0 * offset + 3e4 * offset**3, rtol=1e-14)


def test_no_control_holds_the_damping_of_the_beginning_where_none_is_shown():
    begins = 0.8 * LOW + 0.2 * HIGH
    scene = scene_of(**{"interface.damping": begins, "control.steps": 3})
    scene = scene.replace(**{"sensors.channels": HIDDEN})
    held = evaluate(scene, uncontrolled(scene), episodes=2).applied
    np.testing.assert_allclose(held, begins, rtol=1e-12)


def test_damper_and_force_in_parallel_share_the_regulators_force():
    damper = {"minimum": 0.2, "maximum": 8.0}
    ample = {"limit": 100.0, "between": "masses"}
    scene = scene_of(**{"interface.damping": 1.0})
    scene = scene.replace(actuation={"force": ample, "damping": damper})
    law = SharedForce(scene, 0.1)
    state = np.random.default_rng(1).normal(size=(50, 4)) * [5e-3, 5e-3, 0.1, 0.1]
    action, memory = law.action(law.begin(50), state, np.tile([0.0, 1.0], (50, 1)))
    force, damping = 100.0 * action[:, 0], 4.1 + 3.9 * action[:, 1]
    given = force + damping * (state[:, 3] - state[:, 2])
    np.testing.assert_allclose(given, law.force(memory, state), rtol=1e-9, atol=1e-9)
    assert np.mean(np.abs(force) < 1e-9) > 0.1, "the damper alone gives what it can"
    ground = scene.replace(**{"actuation.force.between": "ground"})
    with pytest.raises(DesignError, match="only there do both act in parallel"):
        SharedForce(ground, 0.1)
    assert "clipped-optimal-and-force" in laws(scene)
    assert "clipped-optimal-and-force" not in laws(ground)
    assert "in parallel" in obstacle("clipped-optimal-and-force", ground)


def test_every_law_is_tuned_and_named():
    scene = scene_of(**{"control.steps": 5})
    found = classical_laws(scene)
    assert len(found) == len(makers(scene, "law")) == 12
    assert {"clipped-optimal-on-off", "skyhook-continuous", "balance-on-off"} < set(laws(scene))
    assert "energy-shaping" not in laws(scene)
    force = scene.replace(actuation={"force": {"between": "masses"}})
    assert "energy-shaping" in laws(force)
    ground = scene.replace(actuation={"force": {}})
    assert "between the masses" in obstacle("energy-shaping", ground)
    assert "for other actuators: damping" in obstacle("skyhook-on-off", ground)
