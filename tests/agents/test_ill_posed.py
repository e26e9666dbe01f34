"""Is a design that is not possible refused with an error that names the reason?"""

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, CARRIAGE_FORCE_FRICTION, HYBRID, PRE_STRETCH

from agents.control.actuators import Lead
from agents.control.observed_state import ObservedState
from agents.controllers.clipped_lqr import ClippedLQR
from agents.controllers.constant import Held
from agents.controllers.extremum_seeking import ExtremumSeeking
from agents.controllers.feedforward_lqr import FeedforwardLQR
from agents.controllers.finite_horizon_lqr import FiniteHorizonLQR
from agents.controllers.frequency_tracking import MatchingStretch
from agents.controllers.h_infinity import HInfinity
from agents.controllers.linear_mpc import LinearMPC
from agents.controllers.lqg import LQG
from agents.controllers.lqr import LQR, regulator
from agents.controllers.on_off_stiffness import OnOffStiffness
from agents.controllers.phase_law import PhaseLaw
from agents.controllers.registry import laws
from agents.controllers.resetting_stiffness import ResettingStiffness
from agents.controllers.tuned import baselines
from agents.controllers.velocity_feedback import VelocityFeedback
from mm_gym import CompileError, DesignError, SceneError

NAMED = (DesignError, SceneError, CompileError)

RATE = CARRIAGE_FORCE.replace(**{"actuation.force": {"rate_limit": 10.0, "command": "rate"}})
FREE = CARRIAGE_FORCE.replace(**{"objective.effort_weight": 0.0})
NOTHING = CARRIAGE_FORCE.replace(
    **{"objective.displacement_weight": 0.0, "objective.velocity_weight": 0.0}
)
DRIFTING = CARRIAGE_FORCE.replace(**{"objective.stroke_weight": 1.0})
MASSLESS = CARRIAGE_FORCE.replace(**{"carriage.mass": 0.0})
BLIND = CARRIAGE_FORCE.replace(**{"sensors.channels": ["carriage_velocity"]})
BLIND_TO_STROKE = BLIND.replace(
    **{"objective.stroke_weight": 1.0, "actuation.force.between": "masses"}
)
UNSEEN = PRE_STRETCH.replace(**{"sensors.channels": ["stretch"], "sensors.history": 1})
OFFSET = CARRIAGE_FORCE.replace(**{"sensors.channels": ["sphere_offset"]})
CUBIC = PRE_STRETCH.replace(
    **{"carriage.linear_coefficient": 0.0, "carriage.cubic_coefficient": 1e4}
)
LONG = CARRIAGE_FORCE.replace(**{"control.steps": 10**9})
REGULATORS = (LQR, LQG, FiniteHorizonLQR, LinearMPC, HInfinity, FeedforwardLQR)
STRETCHING = (
    lambda scene: ClippedLQR(scene, 2.0, 1.0),
    lambda scene: OnOffStiffness(scene, 2.0),
    lambda scene: ResettingStiffness(scene, passive=True),
    PhaseLaw,
    ExtremumSeeking,
    MatchingStretch,
    Lead,
    lambda scene: Held(scene, "stretch"),
)

CASES = [
    *[(law, PRE_STRETCH, (), r"actuation\.force: missing") for law in REGULATORS],
    *[(law, RATE, (), r"command: got 'rate'") for law in REGULATORS],
    *[(law, FREE, (), r"effort_weight: got 0") for law in REGULATORS],
    *[(law, NOTHING, (), r"velocity_weight and stroke_weight are 0") for law in REGULATORS[:-1]],
    *[(law, MASSLESS, (), r"carriage\.mass") for law in (LQG, HInfinity)],
    *[(law, CARRIAGE_FORCE, (), r"actuation\.stretch: missing") for law in STRETCHING],
    (VelocityFeedback, PRE_STRETCH, (5.0,), r"actuation\.force: missing"),
    (Held, PRE_STRETCH, ("force", 0.0), r"actuation\.force: missing"),
    (LQR, DRIFTING, (), "not stabilisable"),
    (LQG, DRIFTING, (), "no stabilising solution"),
    (LQG, CARRIAGE_FORCE_FRICTION, (), "no stabilising solution"),
    (LQG, BLIND_TO_STROKE, (), "not detectable"),
    (HInfinity, OFFSET, (), r"sensors\.channels: .* of the carriage"),
    (ObservedState, UNSEEN, (), r"sensors\.channels: the state cannot be estimated"),
    (ObservedState, BLIND, (), r"sensors\.channels: the state cannot be estimated"),
    (FeedforwardLQR, CARRIAGE_FORCE, (), "no noise"),
    (FiniteHorizonLQR, LONG, (), r"control\.steps: got 1000000000; .* at most 100000"),
    *[(LinearMPC, CARRIAGE_FORCE, (n,), "horizon: got") for n in (0, -3, 1.5, np.nan, 10**9)],
    *[
        (law, HYBRID, (stretch,), r"stretch: got")
        for law in (LQR, FeedforwardLQR)
        for stretch in (np.nan, 0.5, -1.0, np.inf)
    ],
    *[(ClippedLQR, PRE_STRETCH, (2.0, p), "weight: got") for p in (np.nan, -1.0, 0.0, np.inf)],
    *[(ClippedLQR, PRE_STRETCH, (s, 1.0), "stretch: got") for s in (np.nan, 0.5)],
    (ClippedLQR, CUBIC, (2.0, 1.0), "the Riccati equation has no stabilising solution"),
    *[(OnOffStiffness, PRE_STRETCH, (s,), "stretch: got") for s in (np.nan, 0.2)],
    *[(Held, PRE_STRETCH, ("stretch", s), "stretch: got .* at most 3") for s in (np.nan, 9.0)],
    *[(Held, CARRIAGE_FORCE, ("force", f), "force: got .* at most 4") for f in (np.nan, 9.0)],
    *[(LQG, CARRIAGE_FORCE, (1.0, u), "unmodelled: got") for u in (np.nan, -1.0, np.inf)],
    *[(VelocityFeedback, CARRIAGE_FORCE, (g,), "gain: got") for g in (np.nan, -5.0)],
    (PhaseLaw, PRE_STRETCH, (np.nan,), "gain: got"),
]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("make", "scene", "arguments", "message"), CASES)
def test_impossible_design_is_refused_with_the_reason(make, scene, arguments, message):
    if make is LinearMPC:
        pytest.importorskip("osqp")
    if make is HInfinity:
        pytest.importorskip("slycot")
    with pytest.raises(NAMED, match=message):
        make(scene, *arguments)


def test_scene_without_a_regulator_is_evaluated_without_it():
    for scene in (RATE, NOTHING):
        with pytest.raises(DesignError):
            regulator(scene)
        assert "LQR" in baselines(scene).not_scored
    assert "lqr" not in laws(RATE)


def test_carriage_without_mass_has_no_frequency_to_shape_and_no_critical_damping() -> None:
    scene = MASSLESS.replace(**{"actuation.force.between": "masses", "control.steps": 5})
    assert "energy shaping" not in baselines(scene).not_scored
    for name in ("energy-shaping", "velocity-feedback"):
        assert name not in laws(scene)
        assert name in laws(scene.replace(**{"carriage.mass": 0.1}))
