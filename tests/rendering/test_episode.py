"""The command that draws an episode into a file."""

import sys

import pygame
import pytest

from mm_gym import load_scene
from mm_gym.__main__ import main
from mm_gym.rendering.episode import draw_episode
from mm_gym.rendering.look import SIZE
from mm_gym.rendering.picture import Picture
from mm_gym.scene import Scene

PRE_STRETCH = "mm_gym/PreStretch-v0"


def test_last_picture_is_written_as_png(tmp_path):
    paths = [tmp_path / name for name in ("one.png", "same.png", "later.png")]
    for path, steps in zip(paths, ("3", "3", "4"), strict=True):
        assert main(["render", PRE_STRETCH, "--out", str(path), "--steps", steps]) == 0
    assert pygame.image.load(paths[0]).get_size() == SIZE
    one, same, later = (path.read_bytes() for path in paths)
    assert one == same
    assert one != later
    assert len(one) < 100_000


# The pipe to the encoder is closed by the collector.
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_video_is_written(tmp_path):
    path = tmp_path / "episode.mp4"
    assert main(["render", PRE_STRETCH, "--out", str(path), "--steps", "5"]) == 0
    assert path.stat().st_size > 1000


@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_interrupted_video_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "episode.mp4"
    path.write_bytes(b"old")
    monkeypatch.setattr(Picture, "pixels", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        draw_episode(load_scene(PRE_STRETCH), str(path), steps=2)
    assert path.read_bytes() == b"old"


def test_scene_needs_no_actuator(tmp_path):
    scene = Scene(initial={"carriage_displacement": 0.01}, control={"steps": 3})
    draw_episode(scene, str(tmp_path / "free.png"))
    assert (tmp_path / "free.png").exists()


def test_other_endings_are_refused(tmp_path, capsys):
    path = tmp_path / "episode.gif"
    assert main(["render", PRE_STRETCH, "--out", str(path)]) == 2
    error = capsys.readouterr().err
    assert f"--out: got {str(path)!r}; allowed: a file whose name ends in .png or .mp4" in error
    assert not path.exists()


def test_missing_moviepy_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "moviepy.video.io.ffmpeg_writer", None)
    assert main(["render", PRE_STRETCH, "--out", str(tmp_path / "a.mp4"), "--steps", "1"]) == 2
    assert "pip install moviepy" in capsys.readouterr().err


def test_motion_that_cannot_be_followed_is_an_error(tmp_path, capsys):
    path = tmp_path / "fast.toml"
    path.write_text(
        "[carriage]\ncubic_coefficient = 1e3\n[initial]\ncarriage_velocity = 1e200\n"
        "[solver]\nmethod = 'rk4'\n"
    )
    assert main(["render", str(path), "--out", str(tmp_path / "fast.png")]) == 2
    assert "error: rk4" in capsys.readouterr().err
