"""Logs that TensorBoard shows, written without torch."""

import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Self

from tensorboard.compat.proto.event_pb2 import Event
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.record_writer import RecordWriter

FOLDER = "tensorboard"  # of logs, in the folder of a run

VALIDATION = "validation/cost"
"""The name of the cost on the validation episodes, the same for every training."""


class Log:
    """Numbers of a training over its control steps; a continued run adds a file to its folder.

    Use it in a `with` statement, which closes the file. Readers leave out what a kill cut off.
    """

    def __init__(self, folder: Path) -> None:
        (folder / FOLDER).mkdir(exist_ok=True)
        # Readers find files by this beginning, and order them by name.
        name = f"events.out.tfevents.{time.time():.6f}.{os.getpid()}"
        self._file = (folder / FOLDER / name).open("wb")
        self._records = RecordWriter(self._file)
        self._write(Event(wall_time=time.time(), file_version="brain.Event:2"))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def add(self, steps: int, numbers: Mapping[str, float]) -> None:
        """Add numbers, each by its name, after so many control steps."""
        values = [Summary.Value(tag=name, simple_value=value) for name, value in numbers.items()]
        self._write(Event(step=steps, wall_time=time.time(), summary=Summary(value=values)))

    def show(self) -> None:
        """Let readers see what was added so far."""
        self._file.flush()

    def _write(self, event: Event) -> None:
        self._records.write(event.SerializeToString())
