"""Is the right column or array of a file read, or refused with its place?"""

import io
import struct
import sys

import h5py
import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled
from scipy.io import loadmat, savemat
from scipy.sparse import csc_array

from mm_gym import SceneError
from mm_gym.records import read_record

from .files import COUNTS, SAMPLES, matlab, matlab73, numpy_archive, numpy_array, peer, read

TABLE = [
    ["time [s]", "north [g]", "east [m/s^2]"],
    ["0.00", "1.5", "-2.25"],
    ["0.01", "2.5", "0.125"],
    ["0.03", "-1e-1", "4"],
]
TIMES = [0.0, 0.01, 0.03]
NORTH, EAST = [1.5, 2.5, -0.1], [-2.25, 0.125, 4.0]


def text(mark, *, comma=False, rows=TABLE):
    lines = [mark.join(row) for row in rows]
    return "\n".join(line.replace(".", ",") if comma else line for line in lines) + "\n"


@pytest.mark.parametrize(
    ("mark", "comma"), [(",", False), (";", False), (";", True), ("\t", False), (" ; ", True)]
)
def test_column_is_read_by_number_or_name_with_any_separator(tmp_path, mark, comma):
    content = text(mark, comma=comma)
    for column in (2, "north [g]"):
        record = read(tmp_path, content, "m.csv", unit="g", column=column)
        assert record.times.tolist() == TIMES
        assert record.values.tolist() == [value * 9.80665 for value in NORTH]
        assert record.time_step == 0.01
    for column in (3, "east [m/s^2]"):
        record = read(tmp_path, content, "m.csv", unit="m/s^2", column=column)
        assert record.values.tolist() == EAST
        with pytest.raises(SceneError, match=r":1: the header states units of M/S\^2; got unit"):
            read(tmp_path, content, "m.csv", unit="g", column=column)


def test_columns_that_are_not_read_may_hold_anything(tmp_path):
    content = "when,t,a\n2020-01-01,x,1\n2020-01-02,,2\n2020-01-03,nan,1e99\n"
    record = read(tmp_path, content[:-5] + "3\n", "m.csv", unit="N", column="a", time_step=0.5)
    assert record.values.tolist() == [1.0, 2.0, 3.0]
    assert record.times.tolist() == [0.0, 0.5, 1.0]
    with pytest.raises(SceneError, match=":4: column 3: got '1e99'; allowed: a number of magnitu"):
        read(tmp_path, content, "m.csv", unit="N", column=3, time_step=0.5)


def test_blanks_separate_columns_and_names(tmp_path):
    content = "# t  x   y\n 0 1 2\n 1\t3  4\n"
    assert read(tmp_path, content, "m.txt", unit="N", column="y").values.tolist() == [2.0, 4.0]
    assert read(tmp_path, content, "m.txt", unit="N", column=2).values.tolist() == [1.0, 3.0]


def test_column_of_times_becomes_samples_with_a_time_step(tmp_path):
    record = read(tmp_path, "1,2\n3,4\n", "m.csv", unit="N", column=1, time_step=0.1)
    assert record.values.tolist() == [1.0, 3.0]


def test_lines_are_skipped_and_still_counted(tmp_path):
    content = "run 7 of 9\n3,4,5,6\n" + text(",")
    record = read(tmp_path, content, "m.csv", unit="g", column=2, skip=2)
    assert record.times.tolist() == TIMES
    with pytest.raises(SceneError, match=r"m\.csv:5: column 2: got 'x'; allowed"):
        read(tmp_path, content.replace("2.5", "x"), "m.csv", unit="g", column=2, skip=2)
    with pytest.raises(SceneError, match="skip: got 7; the file has 6 lines"):
        read(tmp_path, content.rstrip("\n"), "m.csv", unit="g", column=2, skip=7)
    for counts in COUNTS:
        behind = "17\n" * 3 + peer(SAMPLES, counts=counts)
        assert np.array_equal(
            read(tmp_path, behind, skip=3).values, read(tmp_path, peer(SAMPLES)).values
        )
    with pytest.raises(SceneError, match=r":9: got 7 samples; line 7 promises 8"):
        read(tmp_path, behind.replace("7, .0050", "8, .0050"), skip=3)
    with pytest.raises(SceneError, match=r":9: the file ends within its header"):
        read(tmp_path, behind.rstrip("\n"), skip=9)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, ":2: got 3 columns (time [s], north [g], east [m/s^2]); allowed: one, or two"),
        ({"column": 4}, ":2: column: got 4; allowed: 1 to 3"),
        ({"column": 1}, ":2: column 1 has the times; allowed: 2 or more, or 1 with time_step"),
        (
            {"column": "nort [g]"},
            ":2: column: got 'nort [g]'; did you mean 'north [g]'?; allowed: 1 to 3, 'time [s]', ",
        ),
        ({"column": 0}, "column: got 0; allowed: a number from 1 to 1000, or a name"),
        ({"column": True}, "column: got True; allowed: a number from 1 to 1000, or a name"),
        ({"column": ""}, "column: got ''; allowed: a number from 1 to 1000, or a name"),
        ({"column": 2.0}, "column: got 2.0; allowed: a number from 1 to 1000, or a name"),
        ({"skip": -1}, "skip: got -1; allowed: an integer from 0 to 16777216"),
        ({"skip": 2**63}, "skip: got 9223372036854775808; allowed: an integer from 0 to"),
        ({"skip": 4}, "m.csv: skip: got 4; the file has"),
        ({"time_step": 0.1}, ":2: got 3 columns (time"),
        ({"variable": "a"}, "variable: no effect; allowed: for files named .npz, .mat"),
        ({"variable": 1}, "variable: got 1; allowed: the name of a variable"),
    ],
)
def test_options_that_do_not_fit_a_text_are_refused(tmp_path, options, words):
    with pytest.raises(SceneError) as caught:
        read(tmp_path, text(",").rstrip("\n"), "m.csv", **options)
    assert words in str(caught.value)


def test_name_of_several_columns_is_refused(tmp_path):
    with pytest.raises(SceneError, match="column: got 'a', the name of several; allowed: 1 to 3"):
        read(tmp_path, "t,a,a\n0,1,2\n1,2,3\n", "m.csv", unit="N", column="a")
    with pytest.raises(SceneError, match="no line above the samples names as many columns"):
        read(tmp_path, "0,1,2\n1,2,3\n", "m.csv", unit="N", column="a")


SERIES = np.array([TIMES, NORTH]).T
WRITERS = {
    "m.npz": numpy_archive,
    "5.mat": matlab,
    "5z.mat": lambda arrays: matlab(arrays, compressed=True),
    "73.mat": matlab73,
    "73z.mat": lambda arrays: matlab73(arrays, compressed=True),
}


@pytest.mark.parametrize("name", WRITERS)
def test_arrays_are_read_from_files_of_numpy_and_matlab(tmp_path, name):
    content = WRITERS[name]({"both": SERIES, "north": np.array(NORTH), "three": np.eye(3)})
    for options in ({"variable": "both"}, {"variable": "both", "column": 2}):
        record = read(tmp_path, content, name, unit="kN", **options)
        assert record.times.tolist() == TIMES
        assert record.values.tolist() == [1000.0 * value for value in NORTH]
    record = read(tmp_path, content, name, unit="N", variable="north", time_step=0.2)
    assert record.values.tolist() == NORTH
    assert record.times.tolist() == [0.0, 0.2, 0.4]
    record = read(tmp_path, content, name, unit="N", variable="three", column=2, time_step=1.0)
    assert record.values.tolist() == [0.0, 1.0, 0.0]
    alone = WRITERS[name]({"any": SERIES})
    assert read(tmp_path, alone, name, unit="N").values.tolist() == NORTH


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("count", [3, 1000, 1001])  # 1000 columns is the most of a file
def test_array_with_its_series_in_rows_has_the_numbers_of_its_transpose(tmp_path, name, count):
    times = 0.01 * np.arange(count)
    array = np.stack([times, np.sin(times), np.cos(times)])[: min(3, count - 1)]
    for series in range(1, len(array)):
        for one in (array, array.T):
            content = WRITERS[name]({"a": one})
            record = read(tmp_path, content, name, unit="N", column=series + 1)
            assert np.array_equal([record.times, record.values], [times, array[series]])
            record = read(tmp_path, content, name, unit="N", column=series + 1, time_step=0.5)
            assert np.array_equal(record.values, array[series])
            assert np.array_equal(record.times, 0.5 * np.arange(count))
    for one in (array[:2], array[:2].T):
        record = read(tmp_path, WRITERS[name]({"a": one}), name, unit="N")
        assert np.array_equal([record.times, record.values], array[:2])


@pytest.mark.parametrize("name", WRITERS)
def test_square_array_has_its_series_in_columns(tmp_path, name):
    content = WRITERS[name]({"a": np.array([[0.0, 5.0], [1.0, 7.0]])})
    record = read(tmp_path, content, name, unit="N")
    assert record.times.tolist() == [0.0, 1.0]
    assert record.values.tolist() == [5.0, 7.0]


@pytest.mark.parametrize(
    "kind", ["f4", "f8", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", ">f8", ">i4"]
)
def test_arrays_of_every_type_are_read_as_scipy_and_numpy_do(tmp_path, kind):
    array = np.array([[0, 3], [2, 5], [4, 100]], kind)
    for name, write in WRITERS.items():
        record = read(tmp_path, write({"a": array}), name, unit="N")
        known = np.load if name == "m.npz" else loadmat
        if name.startswith(("m.", "5")):
            array = known(tmp_path / name)["a"]
        assert np.array_equal([record.times, record.values], array.T)


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize(
    ("arrays", "options", "words"),
    [
        ({"a": SERIES, "b": SERIES}, {}, "variable: missing; allowed: 'a', 'b'"),
        (
            {"north": SERIES, "b": SERIES},
            {"variable": "nort"},
            "variable: got 'nort'; did you mean 'north'?; allowed: 'b', 'north'",
        ),
        (
            {"a": np.array([[0.0, 1.0], [1.0, np.nan]])},
            {},
            "a, row 2, column 2: got nan; allowed: a number of magnitude at most 1e+12",
        ),
        (
            {"a": np.array([[0.0, 1.0], [1.0, 2.0], [1.0, 2.0]])},
            {},
            "a, row 3, column 1: time: got 1; allowed: at least 1e-09 s more than 1, the one",
        ),
        ({"a": np.array([[-1.0, 1.0], [1.0, 2.0]])}, {}, "a, row 1, column 1: time: got -1; all"),
        ({"a": np.array(NORTH)}, {}, "a file with one column states no times; set time_step"),
        ({"a": np.eye(3)}, {}, "a of shape (3, 3): got 3 columns; allowed: one, or two with the"),
        ({"a": np.eye(3)}, {"column": 4}, "a of shape (3, 3): column: got 4; allowed: 1 to 3"),
        ({"a": np.eye(3)}, {"column": "x"}, "column: got 'x'; allowed: 1 to 3; no line"),
        ({"a": SERIES}, {"skip": 1}, "skip: got 1; it has no effect: the file is not text"),
        ({"a": np.array([1.0])}, {"time_step": 0.1}, "got one sample; allowed: at least two"),
        ({"a": np.zeros((2, 2, 2))}, {}, "a: got shape (2, 2, 2); allowed: (n,), or (n, k)"),
        ({"a": np.zeros((3, 9))}, {}, "a of shape (3, 9) with its rows as columns: got 3 columns"),
        (
            {"a": np.array([[0.0, 1.0, 1.0], [4.0, 5.0, 6.0]])},
            {},
            "a, row 1, column 3: time: got 1; allowed: at least 1e-09 s more than 1, the one",
        ),
        (
            {"a": np.array([[0.0, 1.0, 2.0], [4.0, 5.0, np.nan]])},
            {},
            "a, row 2, column 3: got nan; allowed: a number of magnitude at most 1e+12",
        ),
    ],
)
def test_arrays_that_are_wrong_are_refused_with_their_place(tmp_path, name, arrays, options, words):
    with pytest.raises(SceneError) as caught:
        read(tmp_path, WRITERS[name](arrays), name, unit="N", **options)
    assert str(caught.value).startswith(str(tmp_path / name))
    assert words in str(caught.value)


def test_only_real_numbers_are_arrays_of_a_record(tmp_path):
    others = {
        "letters": "abc",
        "parts": {"x": "abc"},
        "cells": np.array([1, "a"], dtype=object),
        "complex": SERIES * 1j,
        "flags": SERIES > 0.0,
    }
    content = matlab(others | {"a": SERIES})
    assert read(tmp_path, content, "m.mat", unit="N").values.tolist() == NORTH
    with pytest.raises(SceneError, match="allowed: none, the file has no array of real numbers"):
        read(tmp_path, matlab(others), "m.mat", unit="N")
    letters = {"a": SERIES, "letters": np.array([[97, 98]], "u2")}
    content = matlab73(letters, classes={"letters": "char"})
    assert read(tmp_path, content, "m.mat", unit="N").values.tolist() == NORTH


STRUCTS = {
    "run": {"table": {"acc": SERIES, "name": "x"}, "dt": 0.01},
    "acc": np.array([[0.0, 1.0], [1.0, 2.0]]),
}


@pytest.mark.parametrize(
    "write", [matlab, lambda arrays: matlab(arrays, compressed=True), matlab73]
)
def test_field_of_a_struct_has_the_names_of_its_structs_before_its_own(tmp_path, write):
    structs = STRUCTS
    if write is matlab73:  # h5py has no characters as MATLAB has them
        structs = STRUCTS | {"run": {"table": {"acc": SERIES}, "dt": 0.01}}
    content = write(structs)
    record = read(tmp_path, content, "m.mat", unit="N", variable="run.table.acc")
    assert np.array_equal([record.times, record.values], SERIES.T)
    assert read(tmp_path, content, "m.mat", unit="N", variable="acc").values.tolist() == [1.0, 2.0]
    with pytest.raises(SceneError, match=r"got 'run'.*; allowed: 'acc', 'run.dt', 'run.table.acc'"):
        read(tmp_path, content, "m.mat", unit="N", variable="run")


def test_struct_arrays_cells_and_deep_structs_are_no_arrays_of_a_record(tmp_path):
    inner = {"x": 1.0}
    for _ in range(100):
        inner = {"s": inner}
    fields = np.zeros((2, 1), dtype=[("x", object)])
    cells = np.array([np.eye(2), np.eye(3)], dtype=object)
    others = {"several": fields, "cells": cells, "deep": inner, "sparse": csc_array(np.eye(3))}
    content = matlab({"a": SERIES, "run": others})
    assert read(tmp_path, content, "m.mat", unit="N").values.tolist() == NORTH


@pytest.mark.parametrize("order", ["<", ">"])
def test_old_files_of_matlab_are_refused_by_their_version(tmp_path, order):
    """SciPy writes version 4 in the order of this processor; the first number states the order."""
    stream = io.BytesIO()
    savemat(stream, {"a": SERIES}, format="4")
    (_, *shape), rest = struct.unpack("=5i", stream.getvalue()[:20]), stream.getvalue()[20:]
    header = struct.pack(f"{order}5i", 1000 if order == ">" else 0, *shape)
    told = r"not a MATLAB file of version 5 or 7\.3, but of version 4 \(.* -v7 or -v7\.3\)"
    with pytest.raises(SceneError, match=told):
        read(tmp_path, header + rest, "m.mat", unit="N")


def matlab_object(name):
    """Return a variable of MATLAB's class 17, such as a string or a table: it has no shape."""
    texts = [name, b"MCOS", b"string"]
    parts = [struct.pack("<IIII", 6, 8, 17, 0)]
    parts += [struct.pack("<II", 1, len(text)) + text.ljust(8, b"\0") for text in texts]
    return struct.pack("<II", 14, sum(map(len, parts))) + b"".join(parts)


def test_objects_of_matlab_leave_the_other_variables_readable(tmp_path):
    unnamed = io.BytesIO(matlab({"x": np.arange(9, dtype="u1")})).getvalue()[128:]
    # Behind the last variable is what the objects are made of: numbers without a name.
    assert unnamed.count(struct.pack("<HH", 1, 1) + b"x\0\0\0") == 1
    unnamed = unnamed.replace(struct.pack("<HH", 1, 1) + b"x\0\0\0", struct.pack("<II", 1, 0))
    content = matlab({"a": SERIES}) + matlab_object(b"notes") + unnamed
    record = read(tmp_path, content, "m.mat", unit="N")
    assert np.array_equal([record.times, record.values], SERIES.T)


def test_sparse_matrices_of_hdf5_are_no_arrays_of_a_record(tmp_path):
    content = matlab73({"a": SERIES, "s": {"data": NORTH, "ir": [0, 1], "jc": [0, 1]}})
    with h5py.File(tmp_path / "m.mat", "w") as file, h5py.File(io.BytesIO(content)) as whole:
        whole.copy("a", file)
        whole.copy("s", file)
        file["s"].attrs["MATLAB_sparse"] = np.uint64(3)
    assert read_record(tmp_path / "m.mat", unit="N").values.tolist() == NORTH


def test_name_of_several_arrays_is_refused(tmp_path):
    content = matlab({"a": SERIES}) + matlab({"a": SERIES})[128:]
    with pytest.raises(SceneError, match="variable: got 'a', the name of several; allowed: 'a'"):
        read(tmp_path, content, "m.mat", unit="N", variable="a")


def test_array_alone_in_a_file_of_numpy_is_read(tmp_path):
    record = read(tmp_path, numpy_array({"a": SERIES}), "m.npy", unit="kN")
    assert record.times.tolist() == TIMES
    assert record.values.tolist() == [1000.0 * value for value in NORTH]
    with pytest.raises(SceneError, match=r"m\.npy: variable: got 'a'; it has no effect"):
        read(tmp_path, numpy_array({"a": SERIES}), "m.npy", unit="N", variable="a")
    with pytest.raises(SceneError, match=r"m\.npy: array, row 2, column 1: time: got 0; allowed"):
        read(tmp_path, numpy_array({"a": np.zeros((3, 2))}), "m.npy", unit="N")
    with pytest.raises(SceneError, match=r"not an \.npy file of plain numbers: got type object"):
        read(tmp_path, numpy_array({"a": np.array([Trap(), 1])}), "m.npy", unit="N")


class Trap:
    def __reduce__(self):
        return (pytest.fail, ("executed",))


def test_objects_in_a_file_are_refused_unseen(tmp_path):
    with pytest.raises(SceneError, match=r"not an \.npz file of plain numbers"):
        read(tmp_path, numpy_archive({"a": np.array([Trap(), 1])}), "m.npz", unit="N")


def test_hdf5_links_to_other_files_are_not_followed(tmp_path):
    np.arange(4.0).tofile(tmp_path / "raw")
    with h5py.File(tmp_path / "m.mat", "w", userblock_size=512) as file:
        file["a"] = h5py.ExternalLink("other.mat", "/x")
        file.create_dataset("raw", (4,), "f8", external=[(str(tmp_path / "raw"), 0, 32)])
    with pytest.raises(SceneError, match="variable: got 'a'; allowed: 'raw'"):
        read_record(tmp_path / "m.mat", unit="N", variable="a", time_step=0.1)
    with pytest.raises(SceneError, match="raw: its numbers are in another file"):
        read_record(tmp_path / "m.mat", unit="N", time_step=0.1)


@pytest.mark.parametrize("content", [b"", b"0 1\n1 2\n", b"MATLAB 5.0 MAT-file" + bytes(200)])
@pytest.mark.parametrize("name", ["m.mat", "m.npz", "m.npy"])
def test_other_files_are_refused_by_their_content(tmp_path, name, content):
    with pytest.raises(SceneError, match=r"m\.(mat|npz|npy): not a"):
        read(tmp_path, content, name, unit="N")


def test_unit_is_needed_for_arrays(tmp_path):
    with pytest.raises(SceneError, match=r"unit: missing; .*m\.npz is not in PEER's format"):
        read(tmp_path, numpy_archive({"a": SERIES}), "m.npz", unit=None)


def test_missing_extra_is_named(tmp_path, monkeypatch):
    content = matlab73({"a": SERIES})
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(DependencyNotInstalled, match="extra `matlab`"):
        read(tmp_path, content, "m.mat", unit="N")
