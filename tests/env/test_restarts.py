"""Many lanes that begin anew together begin as each would by itself, to the last bit."""

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, CARRIAGE_FORCE_FRICTION, PRE_STRETCH

from mm_gym import compile_scene
from mm_gym.lanes.layout import BLOCK
from mm_gym.simulation.lanes import SEVERAL, Lanes

COUNT = 2 * BLOCK + 76  # in three blocks
DRAWN_FRICTION = {
    "interface.static_coefficient": [0.4, 0.5],
    "interface.kinetic_coefficient": [0.1, 0.2],
}
KINDS = {
    "force that is a rate": CARRIAGE_FORCE.replace(
        **{"actuation.force.command": "rate", "actuation.force.rate_limit": 50.0}
    ),
    "noise": PRE_STRETCH.replace(**{"sensors.noise": {"carriage_velocity": 0.1, "stretch": 0.2}}),
    "rate and delay": PRE_STRETCH.replace(
        **{"actuation.stretch.command": "rate", "sensors.delay": 2, "randomization": {}}
    ),
    "friction": CARRIAGE_FORCE_FRICTION,
    "friction that is drawn": CARRIAGE_FORCE_FRICTION.replace(randomization=DRAWN_FRICTION),
}


@pytest.mark.parametrize("paused", [True, False])
@pytest.mark.parametrize("kind", KINDS)
def test_lanes_begin_alike_together_and_in_turn(kind, paused, assert_same):
    plant = compile_scene(KINDS[kind])
    together, in_turn = (Lanes(plant, COUNT) for _ in range(2))
    which = np.flatnonzero(np.random.default_rng(0).random(COUNT) < 0.1)
    assert len(which) >= SEVERAL
    for lanes in (together, in_turn):
        lanes.seed(7)
        lanes.restart()
        lanes.advance(np.ones(COUNT * len(plant.actuators), np.float32))
        lanes.terminated[:] = lanes.truncated[:] = True
    before = together.snapshot()["values"]
    together.restart(which, paused=paused)
    for lane in which:
        in_turn.restart(np.array([lane]), paused=paused)
    assert_same(together.snapshot(), in_turn.snapshot())
    assert_same(together.rewards, in_turn.rewards)
    after, others = together.snapshot()["values"], np.setdiff1d(np.arange(COUNT), which)
    assert_same(before[:, others], after[:, others])
    assert (before[0, which] != after[0, which]).all()
    assert together.terminated[which].any() != paused
    assert together.rewards[which].any() != paused
