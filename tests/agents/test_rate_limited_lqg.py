"""Does the LQG of a force whose rate is limited know that force, and cost less for it?"""

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE

from agents.controllers import rate_limited_lqg
from agents.controllers.lqg import LQG
from agents.controllers.rate_limited_lqg import RateLimitedLQG
from agents.controllers.registry import laws, obstacle
from agents.exports.controllers import controller_policy
from agents.scoring import validation_cost
from agents.training.config import CONFIGS
from mm_gym import MovingMassVectorEnv, SimulationError, load_scene

TOWER = load_scene(CONFIGS / "structures" / "tower.toml")
PLATFORM = load_scene(CONFIGS / "structures" / "platform.toml")  # its force lags, too
RATED = CARRIAGE_FORCE.replace(
    **{"actuation.force": {"limit": 4.0, "rate_limit": 200.0, "command": "rate"}}
)


@pytest.mark.parametrize("scene", [TOWER, PLATFORM, RATED])
def test_the_force_that_it_takes_to_be_applied_is_that_of_the_plant(scene):
    law, env = RateLimitedLQG(scene, 1.0, 0.1, 1e-3), MovingMassVectorEnv(scene, 4)
    names = [state.name for state in law.design.system.states]
    observation, info = env.reset(seed=0)
    memory = law.begin(env)
    for _ in range(100):
        action, memory = law.act(memory, observation, info)
        observation, *_, info = env.step(action)
        unit = law.limit * 1e-9
        np.testing.assert_allclose(memory["applied"], info["applied"], atol=unit)
        if "force" in names:
            estimate = memory["estimate"][:, [names.index("force")]]
            np.testing.assert_allclose(estimate, info["applied"], atol=unit)


@pytest.mark.parametrize("scene", [TOWER, PLATFORM])
def test_without_a_weight_of_the_rate_its_gains_are_those_of_the_lqg(scene):
    law, expected = RateLimitedLQG(scene, 1.0, 1e-12, 1e-3), LQG(scene).design
    names = [state.name for state in expected.system.states]
    gain, of_force = law.of_state.copy(), law.of_force
    if scene is PLATFORM:  # the force is among the states, and the input is the command less it
        gain[names.index("force")] -= 1.0
        of_force = 1.0
    np.testing.assert_allclose(
        gain, expected.regulator.gain, atol=1e-8 * np.abs(expected.regulator.gain).max()
    )
    assert of_force == pytest.approx(1.0, abs=1e-8)


def test_a_weight_of_the_rate_costs_less_than_any_other_weight_of_the_force():
    # The detuned LQG has the weights that its search finds.
    found = validation_cost(TOWER, RateLimitedLQG(TOWER, 0.6, 0.7, 0.01))
    assert found < 0.96 * validation_cost(TOWER, LQG(TOWER, 9.3))


def test_designs_whose_motion_cannot_be_computed_are_not_chosen(monkeypatch):
    propose = RateLimitedLQG.propose

    def stops(law, *arguments):
        if law.effort < 1.0:
            msg = "the motion grows beyond all numbers"
            raise SimulationError(msg)
        return propose(law, *arguments)

    monkeypatch.setattr(RateLimitedLQG, "propose", stops)
    monkeypatch.setattr(rate_limited_lqg, "DISTURBANCES", (1e-3,))
    short = RATED.replace(**{"control.steps": 5})
    assert rate_limited_lqg.best_rate_limited_lqg(short).effort >= 1.0


def test_a_force_that_is_commanded_by_its_rate_is_regulated():
    regulated, damped = (
        validation_cost(RATED, laws(RATED)[name](RATED))
        for name in ("rate-limited-lqg", "velocity-feedback")
    )
    assert regulated < 0.95 * damped


def test_without_a_rate_limit_it_is_refused():
    assert "rate_limit: missing" in str(obstacle("rate-limited-lqg", CARRIAGE_FORCE))


def test_export_knows_the_rate_limit():
    law = RateLimitedLQG(TOWER, 1.0, 1.0, 1e-3)
    policy = controller_policy(law, TOWER.replace(**{"control.steps": 10}), law.name)
    assert policy.remembers == len(law.design.start) + 2  # what is applied, and the step
