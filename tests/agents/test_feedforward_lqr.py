"""Does the LQR with feed-forward gain what the excitation's spectrum tells in advance?"""

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, HYBRID, PRE_STRETCH

from agents.control.feedback import Both, Feedback
from agents.controllers.clipped_lqr import ClippedLQR
from agents.controllers.feedforward_lqr import FeedforwardLQR
from agents.controllers.lqg import LQG
from agents.controllers.lqr import LQR
from agents.controllers.registry import laws
from agents.scoring import evaluate
from mm_gym import DesignError, Scene

SHAKEN = Scene(
    springs={"kind": "small_on_large", "stiffness": 35.0, "stretch": 2.0},
    interface={"kind": "viscous", "damping": 0.3},
    excitation=[{"kind": "noise", "rms": 1.0, "low_frequency": 30.0, "high_frequency": 90.0}],
    actuation={"force": {"limit": 400.0, "lag": 0.01}},
    objective={"effort_weight": 100.0, "velocity_weight": 0.1},
    sensors={
        "channels": [
            *("carriage_displacement", "sphere_offset", "carriage_velocity", "slip_velocity")
        ]
    },
    control={"time_step": 0.01, "steps": 500},
)


def test_cost_is_that_of_the_optimal_output_feedback_and_below_a_plain_regulators():
    # Every state is observed, so the LQG knows what this law does; the force is never clipped.
    best, ours, plain = (
        evaluate(SHAKEN, controller, episodes=100).cost
        for controller in (
            LQG(SHAKEN),
            Feedback(SHAKEN, FeedforwardLQR(SHAKEN)),
            Feedback(SHAKEN, LQR(SHAKEN)),
        )
    )
    assert ours == pytest.approx(best, rel=1e-3)
    assert ours < 0.9 * plain


def test_hybrid_costs_a_twentieth_less_with_feed_forward_from_the_observation():
    with_it, without = (
        evaluate(HYBRID, Feedback(HYBRID, Both(force, ClippedLQR(HYBRID, 1.25, 1.1))), episodes=100)
        for force in (FeedforwardLQR(HYBRID, 1.25), LQR(HYBRID, 1.25))
    )
    assert with_it.reads == "observation"
    assert with_it.cost <= 0.955 * without.cost  # 0.277 and 0.292
    assert np.mean(with_it.penalties < without.penalties) >= 0.8


def test_commands_know_its_name_where_there_is_noise():
    still = HYBRID.replace(excitation=[], randomization={})
    assert set(laws(HYBRID)) - set(laws(still)) == {"feedforward-lqr-and-clipped-lqr"}
    law = laws(HYBRID)["feedforward-lqr-and-clipped-lqr"](HYBRID)
    assert law.name.startswith("LQR with feed-forward + clipped LQR")


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (CARRIAGE_FORCE, "excitation: contains no noise"),
        (PRE_STRETCH, r"actuation\.force: missing"),
    ],
)
def test_what_it_cannot_do_is_refused_with_the_reason(scene, message):
    with pytest.raises(DesignError, match=message):
        FeedforwardLQR(scene)
