"""Does a search of one number leave out what cannot be designed, or followed?"""

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE

from agents.controllers import searched as module
from agents.controllers.searched import cheapest, searched, searched_pair
from agents.controllers.velocity_feedback import VelocityFeedback
from mm_gym import DesignError, SimulationError

SCENE = CARRIAGE_FORCE.replace(**{"control.steps": 5})


def damped_below(least: float, error: type[Exception]):
    """Return what makes velocity feedback, but raises an error for a gain beyond a least one."""

    class Raising(VelocityFeedback):
        def action(self, memory, state, applied):
            if self.gain > least:
                raise error(self.gain)
            return super().action(memory, state, applied)

    return lambda gain: Raising(SCENE, gain)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("error", [DesignError, SimulationError])
def test_search_leaves_out_what_has_no_cost(error) -> None:
    found = searched(SCENE, damped_below(3.0, error), np.linspace(0.0, 9.0, 10))
    assert 2.0 < found.law.gain <= 3.0
    with pytest.raises(error):
        searched(SCENE, damped_below(-1.0, error), np.linspace(0.0, 9.0, 3)).law.action(
            {}, np.zeros((1, 4)), np.zeros((1, 1))
        )


def test_search_of_two_numbers_leaves_out_what_has_no_cost() -> None:
    make = damped_below(3.0, DesignError)
    found = searched_pair(SCENE, lambda base, ratio: make(base * ratio), np.ones(1))
    assert 1.0 < found.law.gain <= 3.0


def test_search_tells_large_costs_apart(monkeypatch) -> None:
    monkeypatch.setattr(module, "validation_cost", lambda _, value, **__: 1e9 + 1e8 * value**2)
    found = cheapest(SCENE, lambda value: value - 4.0, np.linspace(0.0, 9.0, 10))
    assert found == pytest.approx(0.0, abs=1e-2)
