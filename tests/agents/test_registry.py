"""Is a controller that is added in one file known to all: commands, bases and rankings?"""

import re
from pathlib import Path

import pytest
from tasks import CARRIAGE_FORCE, PRE_STRETCH

import agents.controllers
from agents.controllers.registry import every_entry, laws, obstacle
from agents.controllers.tuned import classical_laws
from agents.training.parts import base_controller
from mm_gym import OwnReward, SceneError, rewarded

PAGE = (Path(__file__).parents[2] / "docs" / "controllers.md").read_text("utf-8")
(ADDED,) = re.findall(r"^```py\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)  # the file of the page


@pytest.fixture
def added(tmp_path, monkeypatch):
    (tmp_path / "cubic_damper.py").write_text(ADDED)
    every_entry.cache_clear()
    monkeypatch.setattr(
        agents.controllers, "__path__", [*agents.controllers.__path__, str(tmp_path)]
    )
    yield
    every_entry.cache_clear()


@pytest.mark.usefixtures("added")
def test_controller_of_one_file_is_a_law_a_base_and_a_row() -> None:
    scene = CARRIAGE_FORCE.replace(**{"control.steps": 20})
    assert "cubic-damper" in laws(scene)
    assert base_controller(scene, "cubic-damper").name == "cubic damper"
    assert "cubic damper" in [law.name for law in classical_laws(scene)]
    assert obstacle("cubic-damper", PRE_STRETCH) == "which is for other actuators: force"
    with pytest.raises(SceneError, match=r"got 'cubic-dampr'; did you mean 'cubic-damper'"):
        base_controller(scene, "cubic-dampr")


def test_names_are_unique_for_the_actuators() -> None:
    names = [(entry.name, entry.actuators) for entry in every_entry()]
    assert len(names) == len(set(names)) == 55


def test_controller_of_a_scene_is_designed_once() -> None:
    scene = CARRIAGE_FORCE.replace(**{"control.steps": 20})
    first, again = (laws(scene)["velocity-feedback"](scene) for _ in range(2))
    same = scene.replace(**{"control.steps": 20})
    assert first.law is again.law is laws(same)["velocity-feedback"](same).law
    other = scene.replace(**{"objective.effort_weight": 3.0})
    assert laws(other)["velocity-feedback"](other).law is not first.law
    own = rewarded(scene, OwnReward(lambda carriage_displacement: carriage_displacement**2))
    assert laws(own)["velocity-feedback"](own).law is not first.law
