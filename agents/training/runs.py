"""The folder of a run: everything needed to repeat it."""

import itertools
import json
import os
import platform
import reprlib
import shlex
import subprocess
import sys
from collections.abc import Container, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from shutil import which
from typing import Annotated, Any, TypeVar, cast

from filelock import lock_descriptor
from llvmlite.binding import get_host_cpu_name
from pydantic import BaseModel, Field, JsonValue, TypeAdapter, ValidationError

from agents.training.config import RunSettings
from mm_gym import Scene, SceneError
from mm_gym.arrays import Array
from mm_gym.errors import refuse
from mm_gym.files import delete_partial, open_lock, read_columns, read_json, read_text, write_text
from mm_gym.scene import with_absolute_records, with_relative_records

Settings = TypeVar("Settings", bound="RunSettings")
Contents = TypeVar("Contents")

PACKAGES = (
    "mm-gym",
    "gymnasium",
    "numpy",
    "scipy",
    "numba",
    "pydantic",
    "control",
    "stable-baselines3",
    "sb3-contrib",
    "torch",
    "cma",
)

INTERRUPTED = 130  # exit status of a program that Ctrl-C ended: 128 + the number of the signal
NONE = "none"  # what is told of a setting that a run has not

WORDS = {"scene_digest": "the scene is another", "code": "your own files have changed"}
"""What is told of the parts of a run's record."""

MOST_TOLD = 5  # differences in a message

METRICS, TIMES = ("steps [-]", "cost [-]"), ("steps [-]", "time [s]")
"""Headers of the files of validations."""

HOLDER = "process "  # what a lock begins with that some process has held
MOST_BYTES = 2**24  # largest record of a run; the texts of the user's files are in it


class RunError(RuntimeError):
    """A run's folder does not hold what is needed, or another process is using it."""


class DivergedError(RunError):
    """A training came to numbers that are not finite, so that it has no agent."""


class RecordedSettings(BaseModel, extra="allow", strict=True, allow_inf_nan=False):
    """Settings in a run's record that are read by others than the training that wrote them."""

    task: str
    base: str | None = None
    reward: str | None = None
    authority: Annotated[float, Field(gt=0, le=2)] = 0.5
    schedules: bool = False


class Record(BaseModel, extra="allow", strict=True, allow_inf_nan=False):
    """What ``run.json`` holds, with what describes the machine."""

    settings: RecordedSettings
    scene: dict[str, JsonValue] | None = None
    scene_digest: str
    code: dict[str, str] = {}
    numbers: list[float] | None = None  # those that the base's searches chose
    command: str = ""
    earlier: list[dict[str, JsonValue]] = []


class Run:
    """The folder ``runs/NAME``.

    ``run.json`` holds settings, scene, versions, seed and command; ``checkpoint.npz`` the state
    from which an interrupted run continues; ``metrics.csv`` the validations and ``times.csv`` when
    they were made; ``policy.safetensors`` the best policy, written when training is over, after
    ``end.json``, which tells how it ended. Each is written whole, and none is ever deleted.
    """

    def __init__(self, name: str, root: str | Path = "runs") -> None:
        self.folder = Path(root) / name
        self.record = self.folder / "run.json"
        self.checkpoint = self.folder / "checkpoint.npz"
        self.metrics = self.folder / "metrics.csv"
        self.times = self.folder / "times.csv"
        self.ending = self.folder / "end.json"

    @property
    def policy(self) -> Path:
        """The policy's file; that of an earlier version where there is one."""
        old = self.folder / "policy.npz"
        return old if old.exists() else self.folder / "policy.safetensors"

    @property
    def finished(self) -> bool:
        """Whether training is over."""
        return self.policy.exists()

    @property
    def scoring(self) -> str:
        """The command that scores the run, as a shell takes it; it allows the run's own code."""
        trust = " --trust" if self.record.exists() and self.read().get("code") else ""
        return f"python -m agents evaluate {shlex.quote(str(self.folder))}{trust}"

    def require_finished(self) -> None:
        """Raise `RunError` unless training is over."""
        if not self.finished:
            msg = (
                f"{self.folder}: training is not finished, or {self.policy.name} is missing; the "
                "command that began it continues it"
            )
            raise RunError(msg)

    def validations(self) -> tuple[Array, Array, Array]:
        """Return the control steps, cost and time [s] of each validation, (validations,).

        The cost of a policy that asked for no number is infinite.
        Raise `RunError` if their files are missing, damaged, or of different lengths.
        """
        try:
            steps, costs = read_columns(self.metrics, METRICS, infinite=True)
            also, seconds = read_columns(self.times, TIMES)
        except SceneError as error:
            raise RunError(str(error)) from None
        if steps.tolist() != also.tolist():
            refuse(f"{self.times}", f"other steps than {self.metrics.name}", "the same", RunError)
        return steps, costs, seconds

    @contextmanager
    def advised(self) -> Iterator[None]:
        """Say of Ctrl-C and of a full disk what to do then, and how far the run came if known."""
        try:
            yield
        except KeyboardInterrupt as interrupt:
            advice = "give the same command again to continue"
            if self.finished:
                advice = f"trained; score it: {self.scoring}"
            done = str(interrupt)
            raise KeyboardInterrupt(done, f"{self.folder}: {advice}") from None
        except OSError as error:  # a full disk, a folder that cannot be written to
            again = "give the same command again when files can be written"
            kept = f"its last checkpoint is whole: {again}"
            if self.finished:
                kept = f"trained; score it when files can be written: {self.scoring}"
            msg = f"{error}\n{self.folder}: {kept}"
            raise OSError(msg) from error

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other processes from training in this folder, which is made if need be.

        The lock ends with the process, however it ends. Raise `RunError` if another process holds
        the lock, the folder cannot be written to, or something else is in the lock's place.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            descriptor = open_lock(self._lock)
            stream = os.fdopen(descriptor, "r+", encoding="utf-8", errors="replace")
        except (OSError, SceneError) as error:
            msg = f"{self.folder}: cannot be the folder of a run: {error}"
            raise RunError(msg) from error
        with stream:
            try:
                held = lock_descriptor(descriptor, blocking=False)
            except OSError as error:
                msg = f"{self.folder}: cannot be locked: {error}"
                raise RunError(msg) from None
            if not held:
                holder = "another process"
                with suppress(SceneError):  # who holds it is told where it can be read
                    holder = read_text(self._lock) or holder
                msg = (
                    f"{self.folder}: {holder} is training this run; "
                    "wait for its end, or choose another name with --name"
                )
                raise RunError(msg)
            if stream.read(len(HOLDER)) not in {"", HOLDER}:
                msg = f"{self._lock}: cannot be a lock: another file is in its place; move it away"
                raise RunError(msg)
            stream.seek(0)
            stream.truncate()
            stream.write(f"{HOLDER}{os.getpid()} on {platform.node()}")
            stream.flush()
            files = self.record, self.checkpoint, self.metrics, self.times, self.ending, self.policy
            for file in files:  # temporary ones, of a process that was killed while it wrote
                delete_partial(file)
            yield

    @property
    def _lock(self) -> Path:
        return self.folder / ".lock"

    def open(self, settings: RunSettings, numbers: Sequence[float] = ()) -> None:
        """Begin the run, or continue one of the same settings.

        The numbers are those that the searches of its base chose.
        A run that is given more steps, generations or time goes on: its policy so far is kept
        too, under a free name with the steps or generations. Raise `RunError` if the folder holds
        a run of other settings or another scene.
        """
        other = self._differences(settings)
        if other:
            msg = (
                f"{self.folder}: holds a run with other settings ({few(other)}); "
                "choose another name with --name"
            )
            raise RunError(msg)
        earlier: list[object] = []
        if os.path.lexists(self.record):
            record = self.read()
            if record["settings"] == _identity(settings)["settings"]:
                return
            stage = {name: record["settings"][name] for name in settings.growing}
            earlier = [*record.get("earlier", []), {**stage, "command": record.get("command", "")}]
            if self.policy.exists():
                size = record["settings"][settings.growing[0]]
                self.policy.rename(self._free(f"policy-{size}", self.policy.suffix))
        contents = {
            **_identity(settings),
            **({"numbers": list(numbers)} if numbers else {}),
            **({"earlier": earlier} if earlier else {}),
            "scene": with_relative_records(
                json.loads(settings.load_scene().model_dump_json()), self.folder
            ),
            "versions": versions(),
            "commit": commit(),
            "python": platform.python_version(),
            "machine": f"{platform.machine()} ({get_host_cpu_name()})",
            "command": " ".join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        }
        write_text(self.record, json.dumps(contents, indent=2) + "\n")

    def _free(self, stem: str, suffix: str) -> Path:
        """Return a path that nothing has: time may be added, and the steps remain the same."""
        stems = itertools.chain([stem], (f"{stem}-{number}" for number in itertools.count(2)))
        paths = (self.folder / f"{one}{suffix}" for one in stems)
        return next(path for path in paths if not os.path.lexists(path))

    def _differences(self, settings: RunSettings) -> list[str]:
        """Return what keeps the run that is here, if there is one, from going on with settings."""
        if not os.path.lexists(self.record):
            return []
        record, identity = self.read(), _identity(settings)
        before, now = record.get("settings", {}), identity.pop("settings")
        more = {name for name in settings.growing if _has_grown(before.get(name), now[name])}
        found = differences(by_dotted_name(before), by_dotted_name(now), more)
        return found + [WORDS[key] for key in identity if record.get(key) != identity[key]]

    def takes(self, settings: RunSettings) -> bool:
        """Tell whether training with these settings can begin or continue in the folder."""
        return not self.finished and not self._differences(settings)

    def numbers(self, settings: RunSettings) -> list[float] | None:
        """Return the recorded numbers of the base, if training with settings continues the run."""
        if not os.path.lexists(self.record) or self._differences(settings):
            return None
        return self.read().get("numbers")

    def read(self) -> dict[str, Any]:
        """Return the record, as `Record` says.

        Raise `RunError` if there is none, or it is damaged.
        """
        if not os.path.lexists(self.record):
            msg = f"{self.folder}: no run.json here; train first: python -m agents train"
            raise RunError(msg)
        return read_as(Record, self.record, "a run's record").model_dump(exclude_unset=True)

    def scene(self) -> Scene:
        """Return the scene of the run; raise `RunError` if its record has none that is valid."""
        scene = self.read().get("scene")
        if scene is None:
            msg = f"{self.record}: not a run's record: scene: missing"
            raise RunError(msg)
        try:
            return Scene.of(with_absolute_records(scene, self.folder))
        except SceneError as error:
            told = "; ".join(str(error).splitlines())
            msg = f"{self.record}: scene: {told}"
            raise RunError(msg) from None


def read_as(kind: type[Contents], file: Path, what: str) -> Contents:
    """Return what a JSON file of a run's folder holds.

    Raise `RunError` if the file cannot be read, or does not hold what is wanted.
    """
    try:
        return read_checked(kind, file, what, MOST_BYTES)
    except SceneError as error:
        raise RunError(str(error)) from None


def read_checked(kind: type[Contents], file: Path, what: str, most: int) -> Contents:
    """Return what a JSON file of at most so many bytes holds; raise `SceneError` as `read_as`."""
    return checked(kind, read_json(file, most=most), file, what)


def checked(kind: type[Contents], data: object, file: Path, what: str) -> Contents:
    """Return the data of a file as what is wanted; raise `SceneError` with the first finding."""
    try:
        return TypeAdapter(kind).validate_python(data)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "its content"
        got = "" if first["type"] == "missing" else f"got {reprlib.repr(first['input'])}; "
        msg = f"{file}: not {what}: {where}: {got}{first['msg']}"
        raise SceneError(msg) from None


def _has_grown(before: object, now: float | None) -> bool:
    """Tell whether a setting of a run is at least what it was; None is a time without end."""
    if before is None or now is None:
        return now is None
    return isinstance(before, int | float) and before <= now


def versions() -> dict[str, str]:
    """Return the versions of the packages that are installed."""
    found: dict[str, str] = {}
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def commit() -> str:
    """Return the commit of this checkout, "-dirty" behind it where code or configurations differ.

    Pages may differ: `python -m agents results` writes them between two trainings.
    """
    git, root = which("git"), Path(__file__).parents[2]
    if git is None or not (root / ".git").exists():
        return "unknown: not a checkout"

    def told(*words: str) -> str:
        command = [git, "-C", str(root), *words]
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - no user's text
        return done.stdout.strip()

    changed = told("diff", "--name-only", "HEAD", "--", "agents", "mm_gym", "configs")
    return (told("rev-parse", "HEAD") or "unknown") + ("-dirty" if changed else "")


def by_dotted_name(table: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return the settings of tables in tables by dotted name."""
    found: dict[str, Any] = {}
    for name, value in table.items():
        own = {name: value}
        if isinstance(value, dict):
            own = by_dotted_name(cast("dict[str, Any]", value), f"{name}.")
        found |= {f"{prefix}{key}": one for key, one in own.items()}
    return found


def differences(before: dict[str, Any], now: dict[str, Any], apart: Container[str]) -> list[str]:
    """Return what differs of settings by dotted name, in words, but for names or tables apart."""
    return [
        f"{name} {before.get(name, NONE)}, now {now.get(name, NONE)}"
        for name in dict.fromkeys((*now, *before))
        if before.get(name) != now.get(name) and name.partition(".")[0] not in apart
    ]


def few(found: list[str]) -> str:
    """Return the first of several findings, and how many more there are."""
    more = [f"{len(found) - MOST_TOLD} more"] if len(found) > MOST_TOLD else []
    return "; ".join(found[:MOST_TOLD] + more)


def _identity(settings: RunSettings) -> dict[str, Any]:
    """Return what two runs must have in common for one to continue the other."""
    return {
        "settings": json.loads(settings.model_dump_json()),
        "scene_digest": settings.load_scene().digest,
        "code": settings.code(),
    }


def numbered(settings: Settings, root: str | Path = "runs") -> Settings:
    """Return the settings with a name under which training can begin or continue.

    The name is numbered, as in ``first-2``, while its run is finished or has other settings.
    """
    numbers = (f"{settings.name}-{number}" for number in itertools.count(2))
    names = itertools.chain([settings.name], numbers)
    candidates = (settings.model_copy(update={"name": name}) for name in names)
    return next(candidate for candidate in candidates if Run(candidate.name, root).takes(candidate))
