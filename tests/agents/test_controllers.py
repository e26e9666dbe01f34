"""Do the classical laws do what their sources say?"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.linalg import expm
from tasks import (
    CARRIAGE_FORCE,
    CARRIAGE_FORCE_FRICTION,
    PRE_STRETCH,
    PRE_STRETCH_SHOCK,
    TASKS,
)

from agents.control.actuators import GRID, Command, Lead
from agents.control.controller import part
from agents.control.feedback import Feedback, TrueState
from agents.control.model import ForceObserver
from agents.controllers.clipped_lqr import ClippedLQR
from agents.controllers.constant import Held, best_constant, no_control
from agents.controllers.forecast import Forecast
from agents.controllers.frequency_tracking import (
    FrequencyLockedLoop,
    FrequencyTracking,
    LinearPrediction,
    MatchingStretch,
    ShortTimeFourier,
    reachable_band,
)
from agents.controllers.lqr import regulator
from agents.controllers.noise import RandomActions
from agents.controllers.phase_law import PhaseLaw, best_phase_law
from agents.controllers.predictive_control import SEARCH, PredictiveControl
from agents.controllers.resetting_stiffness import ResettingStiffness
from agents.controllers.tuned import baselines, best_law, classical_laws, further_laws, makers
from agents.scoring import evaluate
from mm_gym import DesignError, MovingMassVectorEnv, compile_scene

if TYPE_CHECKING:
    from agents.control.controller import Controller
    from mm_gym import Scene

RATE = PRE_STRETCH.replace(**{"actuation.stretch.command": "rate"})


@pytest.mark.parametrize("scene", [PRE_STRETCH, RATE], ids=["position", "rate"])
def test_constant_stretch_reaches_and_holds_it_at_the_rate_limit(scene) -> None:
    result = evaluate(scene, Feedback(scene, Held(scene, "stretch", 2.5)), episodes=20)
    assert np.all(np.abs(np.diff(result.applied[:, :, 0], axis=0)) <= 0.04 + 1e-12)
    # 1 to 3 takes 50 steps at 0.04 a step; then it stays, up to the single precision in
    # which the first stretch was observed.
    np.testing.assert_allclose(result.applied[51:, :, 0], 2.5, rtol=2e-7)


@pytest.mark.parametrize("scene", [PRE_STRETCH, RATE], ids=["position", "rate"])
def test_no_control_holds_the_initial_stretch(scene) -> None:
    env = MovingMassVectorEnv(scene, 8)
    observation, info = env.reset(seed=1)
    controller, start = Feedback(scene, no_control(scene)), info["applied"].copy()
    memory = controller.begin(env)
    for _ in range(5):
        action, memory = controller.act(memory, observation, info)
        observation, *_, info = env.step(action)
    # It is observed in single precision.
    np.testing.assert_allclose(info["applied"], start, rtol=2e-7)


def test_faster_rig_is_controlled_as_a_slower_one_in_as_many_periods() -> None:
    """Of a hundredth of all times, frequencies and rates are a hundred times as large."""
    slow = PRE_STRETCH.replace(**{"control.steps": 20, "actuation.stretch.rate_limit": 4.0})
    fast = slow.replace(
        **{
            "carriage.stiffness": 1e4 * 400.0,
            "carriage.damping": 1e2 * slow.carriage.damping,
            "springs.stiffness": 1e4 * slow.springs.stiffness,
            "interface.damping": 1e2 * slow.interface.damping,
            "actuation.stretch.rate_limit": 400.0,
            "control.time_step": 1e-2 * slow.control.time_step,
            "objective.velocity_scale": 1e2 * slow.objective.velocity_scale,
            "excitation.0.amplitude": 1e4 * slow.excitation[0].amplitude,
            "excitation.0.frequency": 5750.0,
            "randomization": slow.randomization | {"excitation.0.frequency": (4400.0, 7100.0)},
        }
    )
    times = [scene.control.time_step for scene in (slow, fast)]
    loops = [FrequencyLockedLoop(scene, 1.0) for scene in (slow, fast)]
    np.testing.assert_allclose(*(loop.gain * h for loop, h in zip(loops, times, strict=True)))
    lengths = [ShortTimeFourier(one, reachable_band(one)).length for one in (slow, fast)]
    assert lengths[0] == lengths[1] == round(5.0 * 2.0 * np.pi / np.sqrt(4000.0) / 0.01)
    found = [best_phase_law(scene) for scene in (slow, fast)]
    gains = [own.law.gain * h for own, h in zip(found, times, strict=True)]
    np.testing.assert_allclose(*gains, rtol=1e-2)


def test_matching_stretch_inverts_the_spring_law() -> None:
    scene = PRE_STRETCH.replace(randomization={"excitation.0.frequency": (45.0, 70.0)})
    env = MovingMassVectorEnv(scene, 16)
    env.reset(seed=0)
    controller = MatchingStretch(scene)
    k2 = 2 * 35.0 * (1 + 2 / controller.begin(env)["stretch"] ** 3)
    np.testing.assert_allclose(np.sqrt(k2 / 0.04), env.drawn("excitation.0.frequency"), rtol=1e-12)


def test_phase_law_stretches_while_displacement_and_offset_agree() -> None:
    law = PhaseLaw(PRE_STRETCH)
    state = np.array([[0.001, 0.003, 0, 0], [0.001, -0.003, 0, 0]])
    action, _ = law.action({}, state, np.full((2, 1), 2.0))
    assert action[0, 0] > 0.0 > action[1, 0]


@cache
def constant_of_pre_stretch() -> Controller:
    return best_constant(PRE_STRETCH)


def test_classical_laws_rank_as_theory_says() -> None:
    controllers = (
        constant_of_pre_stretch(),
        Feedback(PRE_STRETCH, no_control(PRE_STRETCH)),
        best_phase_law(PRE_STRETCH),
        MatchingStretch(PRE_STRETCH),
    )
    constant, nothing, phase_law, matching = (
        evaluate(PRE_STRETCH, controller, episodes=60).cost for controller in controllers
    )
    assert matching < phase_law < constant < nothing
    # As in docs/tasks.md, from more episodes; 60 scatter by a few per cent.
    assert constant == pytest.approx(1.01, abs=0.05)
    assert phase_law == pytest.approx(0.43, abs=0.03)
    assert matching == pytest.approx(0.31, abs=0.03)


def test_best_constant_stretch_is_not_beaten_by_a_finer_grid() -> None:
    best = constant_of_pre_stretch()
    cost = evaluate(PRE_STRETCH, best, episodes=100).cost
    others = [
        evaluate(
            PRE_STRETCH, Feedback(PRE_STRETCH, Held(PRE_STRETCH, "stretch", s)), episodes=100
        ).cost
        for s in np.linspace(1, 3, 41)
    ]
    # Tuned on other episodes than these, which can move the optimum a little.
    assert cost <= min(others) * 1.01


EACH_TASK = pytest.mark.parametrize("name", TASKS)


def test_regulator_beats_no_control_on_the_yardstick() -> None:
    zero, lqr, damper, lqg, detuned = (
        evaluate(CARRIAGE_FORCE, c, episodes=50) for c in baselines(CARRIAGE_FORCE).controllers
    )
    assert np.all(lqr.returns > zero.returns)
    assert lqr.cost < damper.cost < zero.cost
    # The first frame shows the whole state: nothing is lost in estimating it.
    assert lqg.cost == pytest.approx(lqr.cost, rel=1e-3)
    assert detuned.cost == pytest.approx(lqr.cost, rel=2e-3)


@cache
def short_baselines(name: str) -> tuple[Scene, list[Controller]]:
    for extra in ("osqp", "slycot"):
        pytest.importorskip(extra)
    scene = TASKS[name].replace(**{"control.steps": 10})
    return scene, [*baselines(scene).controllers, *further_laws(scene)]


@EACH_TASK
def test_every_task_has_baselines_that_act_on_its_actuators(name) -> None:
    scene, found = short_baselines(name)
    width = len(scene.actuation.names)
    assert len(found) >= 3
    for controller in found:
        assert evaluate(scene, controller, episodes=3).applied.shape[2] == width


@EACH_TASK
def test_hidden_state_does_not_change_what_claims_the_observation(name) -> None:
    scene, found = short_baselines(name)
    env = MovingMassVectorEnv(scene, 3)
    for controller in found:
        if controller.reads != "observation":
            continue
        actions = []
        for scrambled in (False, True):
            observation, info = env.reset(seed=5)
            memory = controller.begin(env)
            for _ in range(8):
                if scrambled:
                    info = {key: np.full_like(info[key], np.nan) for key in info}
                action, memory = controller.act(memory, observation, info)
                actions.append(action)
                observation, *_, info = env.step(action)
        np.testing.assert_array_equal(actions[:8], actions[8:], err_msg=controller.name)


def test_clipped_regulator_takes_energy_out_of_switched_springs() -> None:
    # The best constant stretch costs 0.48 here, the law 0.34; 60 episodes scatter by 5 %.
    scene = PRE_STRETCH_SHOCK
    law = evaluate(scene, Feedback(scene, ClippedLQR(scene, 2.12, 2.4)), episodes=60)
    constant = evaluate(scene, Feedback(scene, Held(scene, "stretch", 1.43)), episodes=60)
    assert law.cost < 0.8 * constant.cost


def test_clipped_regulator_asks_for_the_force_of_its_regulator() -> None:
    law = ClippedLQR(PRE_STRETCH_SHOCK, 2.0, 1.0)
    state, applied = np.random.default_rng(0).normal(0.0, 1e-3, (200, 4)), np.full((200, 1), 2.0)
    action = law.action({}, state, applied)[0][:, 0]
    state = law.lead(state, applied[:, 0])
    inside = np.abs(action) < 1.0
    assert inside.any()
    stretch, offset = 2.0 + action, state[:, 1] - state[:, 0]
    got = 2 * 35.0 * (1 + 2 / stretch**3) * offset
    wanted = 2 * 35.0 * (1 + 2 / 2.0**3) * offset - state @ law.gain
    np.testing.assert_allclose(got[inside], wanted[inside], rtol=1e-9)


def test_regulator_that_cannot_price_the_stroke_is_told_not_to() -> None:
    controller = regulator(CARRIAGE_FORCE_FRICTION)
    assert controller.name == "LQR, blind to the stroke"


def test_random_actions_repeat_themselves() -> None:
    first, second = (
        evaluate(CARRIAGE_FORCE, RandomActions(CARRIAGE_FORCE), episodes=4) for _ in range(2)
    )
    np.testing.assert_array_equal(first.returns, second.returns)


def test_command_refuses_a_scene_without_its_actuator() -> None:
    with pytest.raises(ValueError, match="stretch actuator"):
        Command(CARRIAGE_FORCE, "stretch")


DRAWN = dict(PRE_STRETCH.randomization) | {"carriage.linear_coefficient": (-0.5, 1.0)}


@pytest.mark.parametrize(
    "changes", [{"carriage.linear_coefficient": -1.0}, {"randomization": DRAWN}]
)
def test_laws_that_tune_springs_refuse_an_unstable_middle_by_name(
    changes: dict[str, object],
) -> None:
    short = {"control.steps": 10}
    scene = PRE_STRETCH.replace(**changes, **short, **{"carriage.cubic_coefficient": 1e4})
    for law in (MatchingStretch, PhaseLaw, lambda scene: ClippedLQR(scene, 2.0, 0.1)):
        with pytest.raises(DesignError, match=r"linear_coefficient: got .* at least 0"):
            law(scene)
    assert classical_laws(scene) == []
    not_scored = baselines(scene).not_scored
    assert {*makers(scene, "law", "informed")} == set(not_scored)
    assert all("linear_coefficient: got" in reason for reason in not_scored.values())


def test_lead_moves_the_state_as_the_plant_does() -> None:
    lead, plant = Lead(PRE_STRETCH_SHOCK), compile_scene(PRE_STRETCH_SHOCK)
    state = np.random.default_rng(7).normal(size=(GRID, 4))
    stretches = np.linspace(1.0, 3.0, GRID)
    ahead = lead(state, stretches)
    # Half of the 2 that the springs cross, at 100 a second.
    for k in (0, 11, GRID - 1):
        a, _ = plant.linear(float(stretches[k]))
        np.testing.assert_allclose(ahead[k], expm(0.01 * a) @ state[k], rtol=1e-11)


@pytest.mark.parametrize(
    ("estimator", "cost"),
    [
        (LinearPrediction, 0.33),
        (lambda s: FrequencyLockedLoop(s, 57.5), 0.33),
        (lambda s: ShortTimeFourier(s, reachable_band(s)), 0.47),
    ],
)
def test_frequency_tracking_finds_the_frequency(estimator, cost) -> None:
    law = FrequencyTracking(PRE_STRETCH, estimator(PRE_STRETCH))
    # The stretch that knows the frequency costs 0.31 to 0.32.
    assert evaluate(PRE_STRETCH, Feedback(PRE_STRETCH, law), episodes=50).cost < cost


def test_passive_springs_never_give_more_energy_than_they_took() -> None:
    scene = PRE_STRETCH_SHOCK.replace(**{"control.steps": 150})
    passive, other = (
        [
            evaluate(scene, Feedback(scene, ResettingStiffness(scene, passive=p), s), episodes=30)
            for s in (TrueState(), None)
        ]
        for p in (True, False)
    )
    # Round-off of sums of energies of 1e-3 J, and of an observation in single precision.
    assert passive[0].injected.max() <= 1e-15
    assert passive[1].injected.max() <= 1e-9
    assert min(result.injected.max() for result in other) > 1e-6


def test_predictive_control_is_better_than_its_law_without_knowing_the_disturbance() -> None:
    scene = PRE_STRETCH_SHOCK.replace(**{"control.steps": 120})
    law = ClippedLQR(scene, 1.25, 1.0)
    alone = evaluate(scene, Feedback(scene, law), episodes=40)
    search = replace(SEARCH, horizon=20, plans=24)
    planned = evaluate(scene, Feedback(scene, PredictiveControl(scene, law, search)), episodes=40)
    assert planned.reads == "observation"
    assert planned.cost < 0.98 * alone.cost


def test_plans_begin_as_the_best_law_and_leave_alone_what_it_remembers() -> None:
    tracking = FrequencyTracking(PRE_STRETCH, LinearPrediction(PRE_STRETCH))
    phase = PhaseLaw(PRE_STRETCH, 4.8)
    law = best_law(PRE_STRETCH, [Feedback(PRE_STRETCH, one) for one in (phase, tracking)])
    assert law is tracking
    planned = PredictiveControl(PRE_STRETCH, law, replace(SEARCH, horizon=8, plans=8))
    env = MovingMassVectorEnv(PRE_STRETCH, 3)
    _, info = env.reset(seed=3)
    memory, alone = planned.begin(3), law.begin(3)
    for _ in range(40):
        seen = info["state"], info["applied"]
        (action, memory), (_, alone) = planned.action(memory, *seen), law.action(alone, *seen)
        *_, info = env.step(action)
        own = part(memory, "law")
        assert own.keys() == alone.keys()
        assert all(np.array_equal(own[name], alone[name], equal_nan=True) for name in own)


def test_predicted_force_of_a_harmonic_is_the_force() -> None:
    env = MovingMassVectorEnv(PRE_STRETCH, 5)
    _, info = env.reset(seed=3)
    forecast, observer = Forecast(PRE_STRETCH), ForceObserver(PRE_STRETCH)
    of_forecast, of_observer = forecast.begin(5), observer.begin(5)
    action = np.full((5, 1), 0.3)
    predicted, found = [], []
    for _ in range(70):
        seen = info["state"], info["applied"]
        ahead, of_forecast = forecast.ahead(of_forecast, *seen, 10)
        force, _, of_observer = observer.force(of_observer, *seen)
        predicted.append(ahead)
        found.append(force)
        *_, info = env.step(action)
    # The stretch has settled after 50 steps; the springs' motion between samples is not modelled.
    np.testing.assert_allclose(predicted[55], found[56:66], atol=1e-3)
