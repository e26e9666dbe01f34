"""Are damaged record files read or refused, in little time?"""

import contextlib
import os
import random
import subprocess
import sys
import time

import numpy as np
import pytest

from mm_gym import SceneError
from mm_gym.records import arrays, read_record, text
from mm_gym.records.text import MOST_BYTES

from .files import GOOD, SAMPLES, matlab, matlab73, numpy_archive, numpy_array, peer, read

SEEDS = [
    ("motion.at2", peer(SAMPLES * 3).encode()),
    ("motion.at2", peer(SAMPLES * 3, form="{:+.7E}", newline="\r\n").encode()),
    ("motion.csv", b"time,a\n" + b"".join(b"%d,%d.5\n" % (i, -i) for i in range(12))),
    ("motion.csv", b"".join(b"%d \t-.%dD-2 # x\n" % (i, i) for i in range(12))),
    ("motion.csv", b"t;a;b\n" + b"".join(b"%d;x;-%d,5\n" % (i, i) for i in range(12))),
]
COLUMN = {SEEDS[-1][1]: "b"}
SERIES = np.column_stack([0.01 * np.arange(40), np.sin(np.arange(40.0))])
ARRAYS = [
    *[("motion.npz", numpy_archive({"acc": SERIES}, compressed=one)) for one in (False, True)],
    *[
        ("motion.mat", matlab({"acc": SERIES, "name": "x"}, compressed=one))
        for one in (False, True)
    ],
    *[("motion.mat", matlab73({"acc": SERIES}, compressed=one)) for one in (False, True)],
    ("motion.mat", matlab({"run": {"acc": SERIES, "name": "x"}})),
    ("motion.mat", matlab73({"run": {"acc": SERIES}})),
    ("motion.npy", numpy_array({"acc": SERIES})),
]
VARIABLE = {ARRAYS[-1][1]: None} | {content: "run.acc" for _, content in ARRAYS[-3:-1]}
PIECES = [
    *[b"\n", b"\r", b",", b";", b" ", b"#", b"-", b"E", b".", b"nan", b"inf", b"1e999", b"\x00"],
    *[b"\xff", b"NPTS", b"DT=", b"=", b"9" * 400, b"\xe2\x80\xa8", b"\xef\xbb\xbf", b"1_0", b"0x1"],
]


def mutated(chance, content):
    """Return the content with some bytes or lines changed, removed, doubled or swapped."""
    for _ in range(chance.choice([1, 1, 2, 5])):
        lines = content.split(b"\n")
        i, j = chance.randrange(len(lines)), chance.randrange(len(lines))
        at = chance.randrange(len(content) + 1)
        kind = chance.randrange(7)
        if kind == 0:
            lines[i], lines[j] = lines[j], lines[i]
        elif kind == 1:
            del lines[i]
        elif kind == 2:
            lines.insert(i, lines[j])
        if kind < 3:
            content = b"\n".join(lines)
        elif kind == 3:
            content = content[:at] + chance.choice(PIECES) + content[at:]
        elif kind == 4:
            content = content[:at] + chance.choice(PIECES) + content[at + 1 :]
        elif kind == 5:
            content = content[:at] + bytes([chance.randrange(256)]) + content[at + 1 :]
        else:
            content = content[:at] + content[at + chance.randrange(1, 30) :]
    return content


@pytest.mark.parametrize("count", [2000, 100_000])
def test_mutated_file_is_read_or_refused(monkeypatch, count):
    content = b""
    # In memory, because writing and opening a file takes longer than all the rest.
    monkeypatch.setattr(text, "read_bytes", lambda *_, **__: content)
    accepted, slowest, messages = 0, 0.0, []
    for i in range(count):
        chance = random.Random(i)  # noqa: S311 - not cryptography
        name, whole = chance.choice(SEEDS)
        content = mutated(chance, whole)
        start = time.process_time()
        try:
            record = read_record(name, unit="g", column=COLUMN.get(whole))
        except SceneError as error:
            messages.append(str(error))
        else:
            accepted += 1
            assert len(record.times) == len(record.values) >= 2, content
            assert np.all(np.isfinite(record.values)), content
            assert np.all(np.diff(record.times) > 0.0), content
        slowest = max(slowest, time.process_time() - start)
    assert 0.1 * count < accepted < 0.9 * count, "the mutations are too tame or too wild"
    assert all(message and "\n" not in message for message in messages)
    assert slowest < 5.0


def damaged(chance, content):
    """Return the content with some bytes changed, removed or set to large numbers, or its start."""
    content = bytearray(content)
    for _ in range(chance.choice([1, 1, 2, 5])):
        at = chance.randrange(len(content))
        kind = chance.randrange(5)
        if kind == 0:
            content[at] = chance.randrange(256)
        elif kind == 1:
            content[at] ^= 1 << chance.randrange(8)
        elif kind == 2:
            del content[at : at + chance.randrange(1, 30)]
        elif kind == 3:
            content[at : at + 4] = chance.choice([b"\xff" * 4, bytes(4), b"\xff\xff\xff\x7f"])
        else:
            del content[max(at, 1) :]
    return bytes(content)


@pytest.mark.parametrize("kind", range(len(ARRAYS)))
def test_damaged_file_of_arrays_is_read_or_refused(monkeypatch, kind):
    name, whole = ARRAYS[kind]
    content = whole
    monkeypatch.setattr(arrays, "read_bytes", lambda *_, **__: content)
    record = read_record(name, unit="m/s^2")
    assert np.array_equal([record.times, record.values], SERIES.T)
    messages: list[str] = []
    slowest = 0.0
    for i in range(700):
        content = damaged(random.Random(i), whole)  # noqa: S311 - not cryptography
        start = time.process_time()
        try:
            record = read_record(name, unit="g", variable=VARIABLE.get(whole, "acc"))
        except SceneError as error:
            messages.append(str(error))
        else:
            assert np.all(np.abs(record.values) < 1e14), content
            assert np.all(np.diff(record.times) > 0.0), content
        slowest = max(slowest, time.process_time() - start)
    assert len(messages) > 350
    assert all(text.startswith(name) and "\n" not in text for text in messages)
    assert slowest < 1.0


def inflating(form):
    """Return a file of a few kilobytes that claims, or inflates to, gigabytes."""
    if form == "npz":
        whole = numpy_archive({"acc": np.zeros(2**24)}, compressed=True)
    elif form == "mat":
        whole = matlab({"acc": np.zeros(2**24)}, compressed=True)
    else:
        whole = matlab73({"acc": np.zeros(2**24)}, compressed=True)
    assert len(whole) < MOST_BYTES
    return whole


@pytest.mark.parametrize("form", ["npz", "mat", "mat73"])
def test_small_file_of_a_huge_array_is_refused_soon(monkeypatch, form):
    content = inflating(form)
    monkeypatch.setattr(arrays, "read_bytes", lambda *_, **__: content)
    start = time.process_time()
    with pytest.raises(SceneError, match=r"allowed: at most|too large"):
        read_record("motion.npz" if form == "npz" else "motion.mat", unit="g", time_step=0.01)
    assert time.process_time() - start < 1.0


@pytest.mark.parametrize("name", ["m.at2", "m.csv", "m.npz", "m.npy", "m.mat"])
def test_what_is_no_file_is_refused_at_once(tmp_path, name):
    os.mkfifo(tmp_path / name)
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / name).symlink_to("/dev/zero")
    start = time.perf_counter()
    for file in (tmp_path / name, tmp_path / "folder" / name):
        with pytest.raises(SceneError, match="cannot be read: not a file but a directory or a dev"):
            read_record(file, unit="g")
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / name).touch()
    with pytest.raises(SceneError, match=name):
        read_record(tmp_path / "empty" / name, unit="g")
    assert time.perf_counter() - start < 1.0


@pytest.mark.parametrize(
    "line",
    [
        *[piece * 10**5 for piece in (b"1", b"1.", b"-", b"1e", b" ", b"1-", b"\xff")],
        *[b"NPTS= " * 10**5, b"DT=" + b" " * 10**5, b"NPTS" + b"=1" * 10**5, b"UNITS " * 10**5],
    ],
)
def test_long_lines_take_no_more_time_than_short_ones(tmp_path, line):
    start = time.process_time()
    for number in range(6):
        lines = GOOD.encode().split(b"\n")
        lines[number] = line
        for name in ("motion.at2", "motion.csv"):
            with contextlib.suppress(SceneError):
                read(tmp_path, b"\n".join(lines), name)
    # A pattern that backtracks would take minutes; a good one takes a tenth of a second.
    assert time.process_time() - start < 30.0


def large(line, last, head=""):
    """Return a file of nearly 16 MB."""
    count = (MOST_BYTES - len(head) - len(last)) // len(line)
    return (head + line * count + last).encode()


LARGE = {
    "columns": ("motion.csv", large("1\n", "x\n")),
    "rows": ("motion.csv", large("0.125,-1.5\n", "7;8\n")),
    "comments": ("motion.csv", large("1 # 2\n", "x\n", "0\n")),
    "same times": ("motion.csv", large("1 1\n", "", "0 1\n")),
    "headings": ("motion.csv", large("a\n", "")),
    "wide": ("motion.at2", large(" 0.1234567E-01" * 8 + "\n", "***\n", GOOD)),
    "narrow": ("motion.at2", large("1\n", "", GOOD)),
    "one line": ("motion.at2", large("1 ", "x", GOOD)),
    "text in a row": ("motion.csv", large("0,1,x\n", "7,y,x\n")),
    "decimal commas": ("motion.csv", large("0;1\n", "7;1,5;2\n")),
    "glued": ("motion.at2", large("-0.1234567E-01" * 8 + "\n", "***\n", GOOD)),
}


STEPS = {"columns": 0.01, "comments": 0.01, "text in a row": 0.01}
COLUMNS = {"text in a row": 2}


@pytest.mark.parametrize("kind", LARGE)
def test_large_file_that_is_wrong_is_refused_soon(monkeypatch, kind):
    name, content = LARGE[kind]
    monkeypatch.setattr(text, "read_bytes", lambda *_, **__: content)
    start = time.process_time()
    with pytest.raises(SceneError):
        read_record(name, unit="g", time_step=STEPS.get(kind), column=COLUMNS.get(kind))
    # Most take a second or two, and eight million lines seven; what is not linear in their number
    # takes hours.
    assert time.process_time() - start < 20.0


def test_large_file_that_is_wrong_takes_little_memory(tmp_path):
    for kind, (name, content) in LARGE.items():
        (tmp_path / f"{kind} {name}").write_bytes(content)
    code = f"""
import resource, pathlib
from mm_gym import SceneError, records
largest = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
before = largest()
for file in pathlib.Path({str(tmp_path)!r}).iterdir():
    try:
        kind = file.name.rpartition(" ")[0]
        records.read_record(
            file, unit="g", time_step={STEPS}.get(kind), column={COLUMNS}.get(kind)
        )
    except SceneError:
        continue
    raise AssertionError(file)
print(largest() - before)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert int(done.stdout) < 300_000, "kB"
