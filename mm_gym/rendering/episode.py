"""An episode without an agent, drawn into a file: its last picture, or a video."""

from __future__ import annotations

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from mm_gym.errors import refuse
from mm_gym.extras import optional
from mm_gym.files import write_bytes
from mm_gym.lanes import layout
from mm_gym.plant.compile import compile_scene
from mm_gym.rendering.canvas import load_pygame
from mm_gym.rendering.history import History, Past
from mm_gym.rendering.look import SIZE
from mm_gym.rendering.picture import Picture, columns
from mm_gym.rendering.subject import Subject
from mm_gym.scene.scene import Scene
from mm_gym.simulation.lanes import Lanes

KINDS = (".png", ".mp4")


def draw_episode(scene: Scene, path: str, *, seed: int = 0, steps: int | None = None) -> None:
    """Draw an episode in which the actuators stay at action 0, into a ``.png`` or a ``.mp4``.

    The first has the last picture, the other one picture a control step; by default of an episode.
    """
    if Path(path).suffix.lower() not in KINDS:
        refuse("--out", f"{path!r}", f"a file whose name ends in {' or '.join(KINDS)}")
    plant = compile_scene(scene)
    lanes = Lanes(plant, 1)
    lanes.seed(seed)
    subject = Subject(scene, plant)
    history, picture = History(lanes, subject, columns(subject)), Picture(subject)
    pasts = _pasts(lanes, history, plant.steps if steps is None else steps)
    if path.lower().endswith(".png"):
        *_, last = pasts
        content = BytesIO()
        load_pygame().image.save(picture.draw(last), content, "picture.png")
        write_bytes(path, content.getvalue())
        return
    with TemporaryDirectory() as folder:
        draft = Path(folder) / "episode.mp4"
        video = _video(str(draft), subject.frames)
        for past in pasts:
            video.write_frame(picture.pixels(past))
        video.close()
        write_bytes(path, draft.read_bytes())


def _pasts(lanes: Lanes, history: History, steps: int) -> Iterator[Past]:
    """Yield what each picture shows, from the start of an episode to its end."""
    lanes.restart()
    history.note()
    yield history.past(0)
    action = np.zeros(len(lanes.plant.actuators))
    for _ in range(steps):
        status = lanes.advance(action)
        if status > layout.ENDED:
            lanes.raise_for(status)
        history.note()
        yield history.past(0)
        if lanes.terminated[0] or lanes.truncated[0]:
            return


def _video(path: str, frames: int) -> Any:  # noqa: ANN401 - moviepy ships no types
    """Return a writer of videos, as Gymnasium's and Stable-Baselines3's recorders use it."""
    remedy = "videos need moviepy; install it with: pip install moviepy"
    writers = optional("moviepy.video.io.ffmpeg_writer", remedy)
    return writers.FFMPEG_VideoWriter(path, SIZE, frames)
