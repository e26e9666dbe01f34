"""Whatever is done to a file, its reader names what is wrong, soon, and changes nothing.

The rows of the table are the readers, its columns the damages.
"""

import io
import json
import os
import signal
import sqlite3
import struct
import time
import zipfile
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import policy_files
import pytest

from agents.commands import evaluate, export, ranking
from agents.commands.headroom import _kept_plans
from agents.evaluation.headroom import SCORES, read_scores
from agents.policies import PolicyError, load_policy, network
from agents.sweeps.results import FILE as RESULTS
from agents.sweeps.results import read_results
from agents.sweeps.trials import read_score
from agents.training.arrays import save_checkpoint
from agents.training.config import RunSettings, TrainSettings, read_settings
from agents.training.progress import Ending, read_ending
from agents.training.runs import METRICS, TIMES, Run, RunError
from agents.training.search import Search
from agents.value_table.kernel import NODES
from agents.value_table.policy import TablePolicy
from mm_gym import SceneError, load_scene
from mm_gym.files import read_columns, write_csv
from mm_gym.records import read_record
from mm_gym.user_code import source

NAMED = (SceneError, PolicyError, RunError)  # the project's errors
MOST_TIME = 2.0  # of this process [s], whatever else the machine does; most take a hundredth of it
PATIENCE = 60  # time after which a reader that waits is interrupted [s]

NETWORK = network(
    weights=(np.ones((4, 3), np.float32), np.ones((1, 4), np.float32)),
    biases=(np.zeros(4, np.float32), np.zeros(1, np.float32)),
    activation="tanh",
    low=np.full(1, -1.0, np.float32),
    high=np.full(1, 1.0, np.float32),
)
TABLE = TablePolicy(
    after=np.zeros((2, 4, NODES, NODES, NODES, 2), np.float32),
    stretches=np.array([1.0, 2.0]),
    squares=np.array([0.0, 1.0]),
    moves=np.zeros((2, 4, 4)),
    cost=np.ones(4),
    reads=np.ones((5, 3)),
    travel=0.5,
    is_rate=True,
)
PLANS = np.zeros((5, 3, 1))
OLD = Path(__file__).parents[1] / "data" / "policies" / "format_3.npz"


class Sums(Search):
    """A search of two numbers, which needs no kernel."""

    _advance = None

    def __init__(self):
        super().__init__(SimpleNamespace(growing=["rounds"], rounds=10, scene=None), None)
        self.vector = np.zeros(2)

    def _present(self):
        return {"vector": self.vector}

    def _policy(self, parameters):
        raise NotImplementedError

    def _state(self):
        return {
            "sums/rounds": np.asarray(self.rounds),
            "sums/vector": self.vector,
            "sums/costs": np.zeros((0, 3)),
        }

    def _restore(self, arrays):
        self.rounds, self.vector = int(arrays["sums/rounds"]), arrays["sums/vector"]


Sums.__abstractmethods__ = frozenset()


def write_checkpoint(path):
    search = Sums()
    search.progress.best = search._present()
    search.progress.add(100, 0.5)
    save_checkpoint(path, search.progress.arrays() | search._state())


def read_checkpoint(path):
    search = Sums()
    search._continue(SimpleNamespace(checkpoint=path))
    return search.progress.rows.tolist()


def run_of(path):
    return Run(path.parent.name, path.parent.parent)


def write_run(path):
    settings = {"task": "mm_gym/CarriageForce-v0", "name": path.parent.name}
    run_of(path).open(RunSettings.of(settings))


def write_end(path):
    costs = {"cost": 0.5, "began_with": 0.6, "no_control": 0.7}
    ending = Ending(unit="sweep", done=1, total=2, time_budget=3.0, began_as="a law", **costs)
    ending.write(run_of(path))


def write_validations(path):
    write_csv(path, METRICS, [[100.0, 200.0], [0.5, 0.4]])
    write_csv(path.with_name("times.csv"), TIMES, [[100.0, 200.0], [1.0, 2.0]])


def write_study(path):
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE numbers (one INTEGER)")
        database.executemany("INSERT INTO numbers VALUES (?)", [(i,) for i in range(5000)])
    database.close()


def read_study(path):
    studies = pytest.importorskip("agents.training.studies")
    studies._check_database(path)


def write_archive(path):
    """Write an archive that is whole, but of no model: to make one takes seconds."""
    import agents.training.algorithms  # noqa: F401, PLC0415 - torch, whose import is not measured

    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("data", json.dumps({"policy_class": "none"} | {"x": "y" * 1000}))


def read_archive(path):
    from agents.training.algorithms import open_trusted  # noqa: PLC0415 - torch, of this row alone

    return open_trusted(path)


@dataclass(frozen=True)
class Reader:
    """A row of the table: how a file is made, and how it is read."""

    name: str
    write: Any
    read: Any


READERS = {
    "scene": Reader(
        "scene.toml",
        lambda path: path.write_text("[carriage]\nmass = 0.2\nstiffness = 300.0\n"),
        lambda path: load_scene(path).digest,
    ),
    "settings": Reader(
        "settings.toml",
        lambda path: path.write_text('task = "mm_gym/Hybrid-v0"\nlanes = 32\n'),
        lambda path: read_settings(path, TrainSettings).lanes,
    ),
    "record in columns": Reader(
        "motion.csv",
        lambda path: path.write_text("time,a\n" + "".join(f"{i},{-i}.5\n" for i in range(20))),
        lambda path: read_record(path, unit="g").values.tolist(),
    ),
    "record of PEER": Reader(
        "motion.AT2",
        lambda path: path.write_text("A\nB\nC IN UNITS OF G\nNPTS= 4, DT= .01 SEC\n.1 .2 .3 .4\n"),
        lambda path: read_record(path, unit="g").values.tolist(),
    ),
    "network": Reader("policy.safetensors", NETWORK.save, lambda path: load_policy(path).observed),
    "old network": Reader(
        "policy.npz",
        lambda path: path.write_bytes(OLD.read_bytes()),
        lambda path: load_policy(path).observed,
    ),
    "value table": Reader(
        "policy.safetensors", TABLE.save, lambda path: load_policy(path).observed
    ),
    "checkpoint": Reader("checkpoint.npz", write_checkpoint, read_checkpoint),
    "run": Reader("run.json", write_run, lambda path: run_of(path).read()["settings"]["task"]),
    "scene of a run": Reader("run.json", write_run, lambda path: run_of(path).scene().digest),
    "validations": Reader(
        "metrics.csv", write_validations, lambda path: run_of(path).validations()[0].tolist()
    ),
    "score": Reader(
        "result.json",
        lambda path: path.write_text('{"cost": 0.25, "episodes": [0.25], "injected": null}\n'),
        lambda path: read_score(run_of(path)).cost,
    ),
    "results": Reader(
        "results.json",
        lambda path: path.write_bytes(RESULTS.read_bytes()),
        lambda path: len(read_results(path).trainings),
    ),
    "end of a run": Reader("end.json", write_end, lambda path: read_ending(run_of(path))),
    "scores of tasks": Reader(
        "scores.json",
        lambda path: path.write_bytes(SCORES.read_bytes()),
        lambda path: len(read_scores(path, ["mm_gym/Hybrid-v0"])),
    ),
    "plans": Reader(
        "hybrid.npy",
        lambda path: np.save(path, PLANS),
        lambda path: _kept_plans(path, PLANS.shape).tolist(),
    ),
    "study": Reader("study.db", write_study, read_study),
    "archive": Reader("archive.zip", write_archive, read_archive),
    "user's code": Reader(
        "mine.py",
        lambda path: path.write_text("class Mine:\n    pass\n"),
        lambda path: source(path, "--controller"),
    ),
}


def header(shape, descr="<f8"):
    """Return the beginning of an array's file."""
    text = repr({"descr": descr, "fortran_order": False, "shape": shape}).encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


def zipped(members, **options):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", **options) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return stream.getvalue()


@cache
def many_members():
    """Return an archive of 200,000 empty members, made without the time zipfile takes."""
    names = [b"%07d" % i for i in range(200_000)]
    entry = struct.pack("<4s6H3L5H2L", b"PK\1\2", 20, 20, 0, 0, 0, 0, 0, 0, 0, 7, 0, 0, 0, 0, 0, 0)
    listed = b"".join(entry + name for name in names)
    local = struct.pack("<4s5H3L2H", b"PK\3\4", 20, 0, 0, 0, 0, 0, 0, 0, 7, 0) + names[0]
    end = struct.pack("<4s4H2LH", b"PK\5\6", 0, 0, 0xFFFF, 0xFFFF, len(listed), len(local), 0)
    return local + listed + end


@cache
def bomb():
    return zipped([("description.npy", bytes(2**27))], compression=zipfile.ZIP_DEFLATED)


def bomb_that_lies():
    """Return an archive whose member unpacks to a thousand times what it states."""
    return bomb().replace(struct.pack("<L", 2**27), struct.pack("<L", 2**17))


BYTES = {
    "empty": lambda _: b"",
    "one byte": lambda _: b"x",
    "cut in half": lambda whole: whole[: len(whole) // 2],
    "without its last byte": lambda whole: whole[:-1],
    "random bytes": lambda whole: np.random.default_rng(len(whole)).bytes(3000),
    "other magic": lambda whole: b"GIF89a" + whole[6:],
    "table": lambda _: b"{}",
    "list": lambda _: b"[]",
    "deep list": lambda _: b"[" * 100_000,
    "deep whole list": lambda _: b"[" * 900 + b"]" * 900,
    "deep whole table": lambda _: b'{"a":' * 900 + b"1" + b"}" * 900,
    "deep value": lambda _: b"a = [\n" * 900 + b"]" * 900,
    "Latin-1": lambda _: "à é = ö".encode("latin-1"),
    "zero bytes": lambda _: bytes(1000),
    "zero byte within": lambda whole: whole[: len(whole) // 2] + b"\0" + whole[len(whole) // 2 :],
    "infinity": lambda _: b'{"cost": Infinity, "rows": 1e999}',
    "no number": lambda _: b'{"cost": NaN}',
    "very long number": lambda _: b'{"cost": ' + b"9" * 10_000 + b"}",
    "many members": lambda _: many_members(),
    "bomb": lambda _: bomb(),
    "bomb that lies": lambda _: bomb_that_lies(),
    "other compression": lambda _: zipped(
        [("description.npy", bytes(2**20))], compression=zipfile.ZIP_BZIP2
    ),
    "huge shape": lambda _: zipped([("description.npy", header((10**15,)))]),
    "huge shape of nothing": lambda _: zipped([("after.npy", header((10**12,), "<U0"))]),
    "shape beyond integers": lambda _: zipped([("after.npy", header((10**12, 10**12)))]),
    "negative shape": lambda _: zipped([("after.npy", header((-1, -1)) + bytes(8))]),
    "objects": lambda _: zipped([("description.npy", header((1,), "|O") + bytes(8))]),
    "array of huge shape": lambda _: header((10**15,)),
    "array that is not finite": lambda _: header(PLANS.shape) + b"\xff" * PLANS.nbytes,
    "array of zero rows": lambda _: header((0, 3, 1)),
    "array of objects": lambda _: header((1,), "|O") + bytes(8),
}
"""What is written in the place of a whole file."""


def link_to_pipe(path):
    os.mkfifo(path.with_name("pipe"))
    path.symlink_to("pipe")


def large_hole(path):
    path.touch()
    os.truncate(path, 2**40)


PLACES = {
    "missing": lambda path: path,
    "folder": lambda path: path.mkdir(),
    "pipe": os.mkfifo,
    "link to nothing": lambda path: path.symlink_to("nothing"),
    "link to itself": lambda path: path.symlink_to(path.name),
    "link to zeros": lambda path: path.symlink_to("/dev/zero"),
    "link to a pipe": link_to_pipe,
    "link to a folder": lambda path: path.symlink_to("."),
    "large hole": large_hole,
    "link to the file": lambda path: path.symlink_to("moved"),
}
"""What is put in the place of a file, which is moved away."""

WHOLE = {
    *((name, "link to the file") for name in READERS if name != "archive"),
    ("study", "missing"),  # it is begun
    ("study", "empty"),  # the same: a process was killed as it began it
    ("scene", "empty"),  # all is as by default
    ("settings", "empty"),
    ("user's code", "empty"),
    *(("user's code", kind) for kind in ("one byte", "cut in half", "without its last byte")),
    *(("user's code", kind) for kind in ("table", "list", "deep whole list", "deep whole table")),
    *(("user's code", kind) for kind in ("infinity", "no number", "very long number")),
    *(("user's code", kind) for kind in ("deep value", "zero byte within", "zero bytes")),
    ("user's code", "other magic"),
    ("record in columns", "cut in half"),
    *((f"record {kind}", "other magic") for kind in ("in columns", "of PEER")),  # in a heading
    *((name, "without its last byte") for name in ("scene", "settings", "record in columns")),
    *((name, "without its last byte") for name in ("record of PEER", "run", "scene of a run")),
    *((name, "without its last byte") for name in ("validations", "score", "scores of tasks")),
    ("results", "without its last byte"),
    *(("end of a run", kind) for kind in ("missing", "without its last byte")),  # of an earlier run
}
"""What is left whole, or is only read as text: then the reader returns something."""


@contextmanager
def interrupted():
    """Interrupt what waits."""

    def late(*_):
        msg = f"still waiting after {PATIENCE} s"
        raise TimeoutError(msg)

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(PATIENCE)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def listing(folder):
    """Return all that is in a folder, with what stands in its regular files but for holes."""
    return {
        path: path.read_bytes() if path.is_file() and path.stat().st_size < 2**24 else None
        for path in folder.iterdir()
    }


def outcome(reader, path):
    """Return what a reader returned, or its error, after less than `MOST_TIME`."""
    before, begun = listing(path.parent), time.process_time()
    try:
        with interrupted():
            found = reader.read(path)
    except NAMED as error:
        found = error
    assert not isinstance(found, Exception) or str(path.parent) in str(found)
    assert time.process_time() - begun < MOST_TIME
    assert listing(path.parent) == before
    return found


@pytest.fixture(params=READERS)
def row(request, tmp_path):
    """Return a reader and a whole file of its own."""
    reader = READERS[request.param]
    folder = tmp_path / "run"
    folder.mkdir()
    reader.write(folder / reader.name)
    if request.param != "archive":
        assert not isinstance(outcome(reader, folder / reader.name), Exception)
    return request.param, reader, folder / reader.name


def test_every_damage_is_named_by_every_reader(row):
    name, reader, path = row
    whole, wrong = path.read_bytes(), []
    for kind, damage in BYTES.items():
        path.write_bytes(damage(whole))
        found = outcome(reader, path)
        if isinstance(found, Exception) == ((name, kind) in WHOLE):
            wrong.append((kind, found))
    for kind, put in PLACES.items():
        path.with_name("moved").write_bytes(whole)
        path.unlink(missing_ok=True)
        put(path)
        found = outcome(reader, path)
        if isinstance(found, Exception) == ((name, kind) in WHOLE):
            wrong.append((kind, found))
        if path.is_dir() and not path.is_symlink():
            path.rmdir()
        else:
            path.unlink(missing_ok=True)
        path.with_name("pipe").unlink(missing_ok=True)
    assert not wrong


def set_first(value):
    def change(array):
        array = array.astype(np.float64)
        array[(slice(1),) * array.ndim] = value
        return array

    return change


CHANGES = {
    "not a number": set_first(np.nan),
    "infinite": set_first(np.inf),
    "text": lambda array: array.astype(str),
    "no rows": lambda array: array[:0] if array.ndim else np.zeros(0),
    "no columns": lambda array: array[..., :0] if array.ndim else np.zeros((1, 0)),
    "one more row": lambda array: np.append(array, array[-1:], 0) if array.ndim else np.zeros(2),
    "another axis": lambda array: array[None],
    "fewer axes": lambda array: array[0] if array.ndim and len(array) else np.zeros(2),
    "one number": lambda array: np.array(1.0) if array.ndim else np.zeros(2),
    "complex": lambda array: array.astype(complex),
}


@pytest.mark.parametrize("change", [*CHANGES, "missing", "one more"])
@pytest.mark.parametrize("name", ["network", "old network", "value table", "checkpoint"])
def test_every_array_of_numbers_is_checked(name, change, tmp_path):
    reader, path = READERS[name], tmp_path / READERS[name].name
    reader.write(path)
    whole, passed = policy_files.read(path), []
    for key, array in whole.items():
        if key == "description":
            continue
        arrays = dict(whole)
        if change == "missing":
            del arrays[key]
        elif change == "one more":
            arrays[f"{key}x"] = array
        else:
            arrays[key] = CHANGES[change](array)
        policy_files.write(path, arrays)
        if not isinstance(outcome(reader, path), NAMED):
            passed.append(key)
    if name == "checkpoint":
        # Of costs, of which there are none, there may be any number; what nobody reads is no harm.
        longer = ["sums/costs", "progress/rows"]
        allowed = {"one more": [*whole], "one more row": longer, "missing": [], "text": []}
        assert set(passed) <= set(allowed.get(change, ["sums/costs"]))
    else:  # an old network may be without direct weights
        assert passed == (["direct"] if (name, change) == ("old network", "missing") else [])


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("network", {"format": 5}, "format: got 5; allowed: 1, 2 or 3"),
        ("network", {"observed": 0}, "observed, layers: got 0"),
        ("network", {"observed": 4}, r"dense, weight: got shape \(4, 3\)"),
        ("network", {"layers": []}, r"observed, layers: got 3 and \[\]"),
        ("network", {"layers": [{"kind": "system"}]}, "0.kind: got .*system"),
        ("network", {"layers": [{"kind": "dense", "rate": 1}]}, "0.dense: got rate, weight, bias"),
        ("old network", {"low": [1.0, 1.0], "high": [-1.0, 2.0]}, "allowed: low < high"),
        ("old network", {"low": [], "high": []}, r"low: got shape \(0,\)"),
        ("old network", {"low": [float("nan")]}, "got NaN; allowed: finite numbers"),
        ("old network", {"sizes": [3, 0, 1]}, "sizes.1: got 0"),
        ("old network", {"sizes": [5, 10**30, 2]}, "sizes: got"),
        ("old network", {"authority": -1}, "authority: got -1"),
        ("old network", {"squashed": "no"}, "squashed: got 'no'"),
        ("old network", {"horizon": 1}, "horizon: unknown key"),
        ("value table", {"travel": float("nan")}, "got NaN; allowed: finite numbers"),
        ("value table", {"travel": float("inf")}, "got Infinity; allowed: finite numbers"),
        ("value table", {"travel": 0}, "travel: got 0"),
        ("value table", {"travel": "far"}, "travel: got 'far'"),
        ("value table", {"is_rate": 2}, "is_rate: got 2"),
    ],
)
def test_every_number_of_a_description_is_checked(name, change, message, tmp_path):
    reader, path = READERS[name], tmp_path / "policy.safetensors"
    reader.write(path)
    policy_files.change(path, **change)
    with pytest.raises(PolicyError, match=message):
        load_policy(path)


@pytest.mark.parametrize("reverse", ["stretches", "squares"])
def test_grid_that_falls_is_refused(reverse, tmp_path):
    path = tmp_path / "policy.safetensors"
    TABLE.save(path)
    arrays = policy_files.read(path)
    arrays[reverse] = arrays[reverse][::-1]
    policy_files.write(path, arrays)
    with pytest.raises(PolicyError, match="allowed: numbers that increase"):
        load_policy(path)


@pytest.mark.parametrize(("rounds", "rows"), [(-1, 1), (2, 0)], ids=["negative", "best of nothing"])
def test_checkpoint_of_impossible_progress_is_refused(rounds, rows, tmp_path):
    path = tmp_path / "checkpoint.npz"
    write_checkpoint(path)
    arrays = policy_files.read(path) | {"sums/rounds": np.asarray(rounds)}
    arrays["progress/rows"] = arrays["progress/rows"][:rows]
    save_checkpoint(path, arrays)
    with pytest.raises(RunError, match=r"checkpoint\.npz: not a checkpoint .*allowed: "):
        read_checkpoint(path)


RECORDS = {
    "no settings": lambda record: record.pop("settings"),
    "settings that are a list": lambda record: record.update(settings=[]),
    "no task": lambda record: record["settings"].pop("task"),
    "task that is a number": lambda record: record["settings"].update(task=3),
    "base that is a list": lambda record: record["settings"].update(base=[1]),
    "schedules of text": lambda record: record["settings"].update(schedules="yes"),
    "schedules of the numbers of an LQR": lambda record: record["settings"].update(schedules=True),
    "authority of text": lambda record: record["settings"].update(authority="1"),
    "no scene": lambda record: record.pop("scene"),
    "scene of nothing": lambda record: record.update(scene=None),
    "scene that is a list": lambda record: record.update(scene=[]),
    "scene of another kind": lambda record: record.update(scene={"carriage": {"mass": "x"}}),
    "scene with a missing file": lambda record: record["scene"].update(
        excitation=[{"kind": "record", "file": "missing.csv", "unit": "g", "target": "ground"}]
    ),
    "no digest": lambda record: record.pop("scene_digest"),
    "code that is a list": lambda record: record.update(code=[]),
}

COMMANDS = {
    "evaluate": (evaluate, ["--episodes", "1"]),
    "export": (export, ["--out", "policy.c"]),
    "ranking": (ranking, []),
}


@pytest.mark.parametrize("kind", [*RECORDS, *BYTES])
def test_commands_name_what_is_wrong_with_the_record_of_a_run(kind, tmp_path, monkeypatch, capsys):
    run = Run("given", tmp_path / "runs")
    run.folder.mkdir(parents=True)
    write_run(run.record)
    if kind in RECORDS:
        record = json.loads(run.record.read_text())
        # A base is what an exported policy needs the scene for.
        record["settings"] |= {"base": "lqr", "authority": 0.5}
        RECORDS[kind](record)
        run.record.write_text(json.dumps(record))
    else:
        run.record.write_bytes(BYTES[kind](run.record.read_bytes()))
        if kind == "without its last byte":  # the end of a line
            return
    NETWORK.save(run.policy)
    monkeypatch.chdir(tmp_path)
    before = listing(run.folder)
    for name, (command, options) in COMMANDS.items():
        if name == "ranking" and "scene" in kind:
            continue  # it takes the task's own
        monkeypatch.setattr("sys.argv", [name, str(run.folder), *options])
        with interrupted():
            message = command.main()
        assert isinstance(message, str), name
        assert message.startswith("error: "), name
        assert "\n" not in message, name
        assert not capsys.readouterr().err
    assert listing(run.folder) == before


@pytest.mark.parametrize("text", ["{}", "[]", "{", '{"mm_gym/Hybrid-v0": {"rows": []}}'])
def test_pages_of_scores_are_not_written_from_damaged_scores(text, tmp_path, monkeypatch):
    file, page = tmp_path / "scores.json", tmp_path / "tasks.md"
    file.write_text(text)
    monkeypatch.setattr(ranking, "SCORES", file)
    monkeypatch.setattr(ranking, "RANKING", page)
    monkeypatch.setattr(ranking, "TASKS", page)
    monkeypatch.setattr("sys.argv", ["agents"])
    assert str(ranking.main()).startswith(f"error: {file}: ")
    assert not page.exists()


LOCKS = {
    "link to a file": lambda lock, target: lock.symlink_to(target),
    "link to nothing": lambda lock, _: lock.symlink_to("nothing"),
    "link to a device": lambda lock, _: lock.symlink_to("/dev/zero"),
    "pipe": lambda lock, _: os.mkfifo(lock),
    "folder": lambda lock, _: lock.mkdir(),
    "second name of a file": lambda lock, target: lock.hardlink_to(target),
    "file of somebody": lambda lock, _: lock.write_text("mine"),
}


@pytest.mark.parametrize("kind", LOCKS)
def test_lock_changes_nothing_that_is_not_its_own(kind, tmp_path):
    run, target = Run("given", tmp_path / "runs"), tmp_path / "target"
    run.folder.mkdir(parents=True)
    target.write_text("precious")
    LOCKS[kind](run.folder / ".lock", target)
    before = listing(tmp_path), listing(run.folder)
    with interrupted(), pytest.raises(RunError, match="cannot be"), run.locked():
        pass
    assert (listing(tmp_path), listing(run.folder)) == before


def test_lock_that_a_dead_process_held_is_taken(tmp_path):
    run = Run("given", tmp_path)
    for _ in range(2):
        with run.locked():
            assert (run.folder / ".lock").read_text().startswith("process ")


def test_only_files_that_a_killed_process_left_are_deleted(tmp_path):
    run = Run("given", tmp_path)
    run.folder.mkdir()
    left = run.folder / ".run.json.0123456789abcdef"
    kept = [run.folder / f".run.json.{end}" for end in ("bak", "0123456789abcdeg", "old")]
    for file in (left, *kept):
        file.write_text("mine")
    (run.folder / ".policy.safetensors.0123456789abcdef").symlink_to(kept[0])
    with run.locked():
        pass
    assert not left.exists()
    assert all(file.read_text() == "mine" for file in kept)
    assert (run.folder / ".policy.safetensors.0123456789abcdef").is_symlink()


@pytest.mark.parametrize("name", READERS)
def test_file_without_permission_is_named(name, tmp_path):
    reader, path = READERS[name], tmp_path / "run" / READERS[name].name
    path.parent.mkdir()
    reader.write(path)
    path.chmod(0)
    found = outcome(reader, path) if not os.access(path, os.R_OK) else None
    # The system lets root read it nevertheless.
    assert isinstance(found, NAMED) or os.geteuid() == 0


def test_columns_are_read_with_all_their_digits(tmp_path):
    values = np.random.default_rng(0).normal(size=(2, 50))
    write_csv(tmp_path / "a.csv", METRICS, values)
    np.testing.assert_array_equal(read_columns(tmp_path / "a.csv", METRICS), values)
    for text in ("", "a,b\n1,2\n", ",".join(METRICS) + "\n", ",".join(METRICS) + "\n1,nan\n"):
        (tmp_path / "a.csv").write_text(text)
        with pytest.raises(SceneError, match="allowed: "):
            read_columns(tmp_path / "a.csv", METRICS, infinite=True)
    (tmp_path / "a.csv").write_text(",".join(METRICS) + "\n1,inf\n")
    assert read_columns(tmp_path / "a.csv", METRICS, infinite=True).tolist() == [[1.0], [np.inf]]
    with pytest.raises(SceneError, match="finite numbers"):
        read_columns(tmp_path / "a.csv", METRICS)
