"""What the tests of agents share."""

import signal

import pytest

from agents.controllers.registry import laws
from agents.scoring import validation_cost
from agents.training.parts import Best


@pytest.fixture
def ctrl_c():
    """Let Ctrl-C interrupt, even where a shell that runs the tests in the background ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def untuned(monkeypatch):
    """Compare searches with no control: to tune all controllers takes longest in a short run."""

    def without_control(scene, **_):
        return Best("no-control", validation_cost(scene, laws(scene)["no-control"](scene)))

    for module in ("search", "own_scene"):
        monkeypatch.setattr(f"agents.training.{module}.best_controller", without_control)
