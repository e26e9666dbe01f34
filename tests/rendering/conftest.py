"""What the tests of the rendering share: no screen, and pictures of states that they set."""

import numpy as np
import pytest
from tasks import TASKS

from mm_gym.plant.compile import compile_scene
from mm_gym.rendering.history import History
from mm_gym.rendering.mechanism import view_of
from mm_gym.rendering.picture import Picture, columns
from mm_gym.rendering.subject import Subject
from mm_gym.scene import Scene
from mm_gym.simulation.lanes import Lanes


@pytest.fixture(autouse=True)
def no_screen(monkeypatch):
    """Let windows open on machines without a screen, and not on those with one."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


class Studio:
    """A scene whose lane can be put into any state, and its pictures."""

    def __init__(self, scene):
        self.scene = Scene.model_validate(scene) if isinstance(scene, dict) else scene
        self.plant = compile_scene(self.scene)
        self.lanes = Lanes(self.plant, 1)
        self.lanes.seed(0)
        self.lanes.restart()
        self.subject = Subject(self.scene, self.plant)
        self.history = History(self.lanes, self.subject, columns(self.subject))
        self.picture = Picture(self.subject)

    def put(self, **values):
        """Put rows of `mm_gym.lanes.layout` to values, and take note of them."""
        from mm_gym.lanes import layout  # noqa: PLC0415 - names of rows

        for name, value in values.items():
            self.lanes.values[getattr(layout, name.upper())] = value
        self.history.note()
        return self

    def step(self, *action):
        """Make a control step, and take note of it."""
        self.lanes.advance(np.array(action))
        self.history.note()
        return self

    @property
    def past(self):
        return self.history.past(0)

    @property
    def view(self):
        return view_of(self.subject, self.past)

    @property
    def pixels(self):
        return self.picture.pixels(self.past)


@pytest.fixture
def studio():
    """Return a `Studio` of a task by its short name, or of a scene."""

    def make(scene, **changes):
        if isinstance(scene, str):
            scene = TASKS[f"mm_gym/{scene}-v0"]
        return Studio(scene.replace(**changes) if changes else scene)

    return make
