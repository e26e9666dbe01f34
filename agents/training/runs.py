"""The folder of a run: everything needed to repeat it."""

from __future__ import annotations

import json
import platform
import shutil
import sys
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from mm_gym.files import write_text

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

    from agents.training.config import TrainSettings

PACKAGES = (
    "mm-gym",
    "gymnasium",
    "numpy",
    "scipy",
    "numba",
    "pydantic",
    "control",
    "stable-baselines3",
    "torch",
)


class RunError(RuntimeError):
    """A run's folder does not hold what is needed."""


class Run:
    """The folder ``runs/NAME``.

    ``run.json`` holds settings, scene, versions, seed and command; ``checkpoint.zip`` the state
    from which a killed run continues; ``model.zip`` the best model, written when training is over.
    """

    def __init__(self, name: str, root: str | Path = "runs") -> None:
        self.folder = Path(root) / name
        self.record = self.folder / "run.json"
        self.checkpoint = self.folder / "checkpoint.zip"
        self.best = self.folder / "best.zip"
        self.model = self.folder / "model.zip"

    @property
    def finished(self) -> bool:
        """Whether training is over."""
        return self.model.exists()

    def clear(self) -> None:
        """Delete the files of an earlier run of this name."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def open(self, settings: TrainSettings) -> None:
        """Begin the run, or continue a killed one of the same settings.

        Raise `RunError` if the folder holds a run of other settings or another scene.
        """
        scene = settings.load_scene()
        contents = {
            "settings": json.loads(settings.model_dump_json()),
            "scene": json.loads(scene.model_dump_json()),
            "scene_digest": scene.digest,
            "versions": {name: version(name) for name in PACKAGES},
            "python": platform.python_version(),
            "machine": platform.machine(),
            "command": " ".join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        }
        if self.record.exists():
            earlier = json.loads(self.record.read_text(encoding="utf-8"))
            if any(earlier[key] != contents[key] for key in ("settings", "scene_digest")):
                msg = (
                    f"{self.folder}: holds a run with other settings; "
                    "choose another name or delete it"
                )
                raise RunError(msg)
            return
        write_text(self.record, json.dumps(contents, indent=2) + "\n")

    def read(self) -> dict[str, object]:
        """Return the record; raise `RunError` if there is none."""
        if not self.record.exists():
            msg = f"{self.folder}: no run.json here; train first: python -m agents.train"
            raise RunError(msg)
        return json.loads(self.record.read_text(encoding="utf-8"))


def save_whole(model: BaseAlgorithm, path: Path) -> None:
    """Save a model beside its path, then rename: a kill leaves the old file or the new one."""
    temporary = path.with_name(f".{path.stem}.partial.zip")
    model.save(temporary)
    temporary.replace(path)
