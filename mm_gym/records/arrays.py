"""Arrays of numbers in files of NumPy (.npy, .npz) and MATLAB (.mat, versions 5 and 7.3).

Nothing in a file is executed, and none takes more memory than `MOST_ARRAY_BYTES` for an array,
whatever it claims: sizes are checked before the numbers are read. Files of version 5 are read here,
because `scipy.io.loadmat` inflates whatever a file claims, and some damaged ones end its process.
"""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from io import BytesIO
from math import prod
from pathlib import Path
from tokenize import TokenError
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from mm_gym.errors import SceneError, suggest
from mm_gym.extras import optional
from mm_gym.files import read_bytes
from mm_gym.records.options import LARGEST, Options, Samples
from mm_gym.records.text import MOST_BYTES, refuse, series

MOST_ARRAY_BYTES = 2**26  # largest array: 8 million samples in double precision
REAL = "fiu"  # kinds of NumPy's types that hold real numbers

MATLAB_REAL = {"double", "single"} | {f"{u}int{n}" for u in ("", "u") for n in (8, 16, 32, 64)}
"""MATLAB's classes of real numbers."""

MAT_HEADER, MAT_VERSIONS = 128, (b"\x00\x01IM", b"\x01\x00MI")
MAT4_TYPES = {f"{m}0{p}{t}" for m in range(5) for p in range(6) for t in range(3)}
"""Decimal digits of the number that a file of version 4 begins with: the machine's numbers, the
type of the array's and what the array is."""

MAT_MATRIX, MAT_COMPRESSED = 14, 15
MAT_CLASS, MAT_UNREAL, MAT_REAL, MAT_STRUCT = 0xFF, 0x0A00, range(6, 16), 2
"""Bits of an array's flags: its class, and if it is complex or logical; the classes of numbers, and
that of structs."""

MOST_DEPTH = 16  # structs in structs that are looked into

MAT_TYPES = dict(
    zip(
        (1, 2, 3, 4, 5, 6, 7, 9, 12, 13),
        ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8", "i8", "u8"),
        strict=True,
    )
)
"""Type of a data element -> that of NumPy."""

HDF5_PLACES, HDF5_MARK = (0, 512), b"\x89HDF\r\n\x1a\n"
DEFLATE, SHUFFLE = 1, 2  # HDF5's filters that are read


def read_arrays(file: Path, options: Options) -> Samples:
    """Return the instants [s], the samples in the file's unit, and their least spacing [s]."""
    if options.skip:
        refuse(file, None, f"skip: got {options.skip}; it has no effect: the file is not text")
    content = read_bytes(file, most=MOST_BYTES)
    name, array = READERS[file.suffix.lower()](file, content, options.variable)
    where = f"{file}: {name}"
    if array.dtype.kind not in REAL:
        msg = f"{where}: got numbers of type {array.dtype}; allowed: real numbers"
        raise SceneError(msg)
    shape = array.shape
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2 or not array.size:  # noqa: PLR2004
        msg = f"{where}: got shape {shape}; allowed: (n,), or (n, k) or (k, n) of k series"
        raise SceneError(msg)
    in_rows = array.shape[0] < array.shape[1]  # Simulink writes a row for each series
    if in_rows:
        array = array.T

    def refuse_columns(text: str) -> NoReturn:
        rows = " with its rows as columns" if in_rows else ""
        msg = f"{where} of shape {shape}{rows}: {text}"
        raise SceneError(msg)

    def place(sample: int, series: int) -> str:
        row, column = (series, sample) if in_rows else (sample, series)
        return f"{where}, row {row + 1}, column {column + 1}"

    places = options.places(array.shape[1], (), refuse_columns)
    values = array[:, places].astype(np.float64)
    wrong = np.argwhere(~(np.abs(values) <= LARGEST))
    if len(wrong):
        row, k = (int(index) for index in wrong[0])
        allowed = f"a number of magnitude at most {LARGEST:g}"
        msg = f"{place(row, places[k])}: got {values[row, k]:g}; allowed: {allowed}"
        raise SceneError(msg)
    return series(values, options.time_step, lambda row: place(row, 0))


def _chosen(file: Path, variable: str | None, names: Sequence[str]) -> str:
    """Return the name of the array to read: the one asked for, or the only one."""
    if variable is None and len(names) == 1:
        return names[0]
    allowed = ", ".join(map(repr, sorted(names))) or "none, the file has no array of real numbers"
    if variable is None:
        refuse(file, None, f"variable: missing; allowed: {allowed}")
    if names.count(variable) > 1:
        refuse(file, None, f"variable: got {variable!r}, the name of several; allowed: {allowed}")
    if variable not in names:
        refuse(
            file, None, f"variable: got {variable!r}{suggest(variable, names)}; allowed: {allowed}"
        )
    return variable


def _check_size(file: Path, name: str, shape: Sequence[int], itemsize: int) -> None:
    size = prod(shape) * itemsize
    if not 0 <= size <= MOST_ARRAY_BYTES:
        refuse(file, None, f"{name}: got {size} bytes; allowed: at most {MOST_ARRAY_BYTES} bytes")


def _read_npy(file: Path, content: bytes, variable: str | None) -> tuple[str, NDArray[Any]]:
    if variable is not None:
        refuse(file, None, f"variable: got {variable!r}; it has no effect: the file has one array")
    try:
        return "array", _of_npy(content)
    except (ValueError, EOFError, OverflowError) as error:
        refuse(file, None, f"not an .npy file of plain numbers: {error}")


def _read_npz(file: Path, content: bytes, variable: str | None) -> tuple[str, NDArray[Any]]:
    try:
        archive = zipfile.ZipFile(BytesIO(content))
        members = {
            entry.filename.removesuffix(".npy"): entry
            for entry in archive.infolist()
            if entry.filename.endswith(".npy")
        }
        name = _chosen(file, variable, list(members))
        size = members[name].file_size
        _check_size(file, name, (size,), 1)
        with archive.open(members[name]) as stream:
            return name, _of_npy(stream.read(size))
    except SceneError:
        raise
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError) as error:
        refuse(file, None, f"not a whole .npz file: {error}")
    except (ValueError, RuntimeError, OverflowError, OSError) as error:
        refuse(file, None, f"not an .npz file of plain numbers: {error}")


def _of_npy(data: bytes) -> NDArray[Any]:
    """Return the array of an .npy file; raise `ValueError` if it is not whole, or has objects."""
    stream = BytesIO(data)
    form = np.lib.format
    version = form.read_magic(stream)
    headers = {(1, 0): form.read_array_header_1_0, (2, 0): form.read_array_header_2_0}
    if version not in headers:
        msg = f"version {version} of the .npy format; allowed: 1.0 or 2.0"
        raise ValueError(msg)
    try:
        shape, is_fortran, dtype = headers[version](stream)
    except (SyntaxError, TokenError) as error:  # the header is Python's text of a dictionary
        msg = f"its header is damaged: {error}"
        raise ValueError(msg) from error
    rest = len(data) - stream.tell()
    if dtype.kind not in REAL or prod(shape) * dtype.itemsize != rest:
        got = f"got type {dtype}, shape {shape} and {rest} bytes"
        msg = f"{got}; allowed: all of an array of numbers"
        raise ValueError(msg)
    flat = np.frombuffer(data, dtype, offset=stream.tell())
    return flat.reshape(shape, order="F" if is_fortran else "C")


def _read_mat(file: Path, content: bytes, variable: str | None) -> tuple[str, NDArray[Any]]:
    if any(content[place : place + len(HDF5_MARK)] == HDF5_MARK for place in HDF5_PLACES):
        return _read_hdf5(file, content, variable)
    if content[MAT_HEADER - 4 : MAT_HEADER] not in MAT_VERSIONS:
        first = content[:4].ljust(4, b"\xff")
        begins = {f"{int.from_bytes(first, order):04d}" for order in ("little", "big")}
        other = ", but of version 4" if begins & MAT4_TYPES else ""
        how = "load it in MATLAB and save it with -v7 or -v7.3"
        refuse(file, None, f"not a MATLAB file of version 5 or 7.3{other} ({how})")
    order = "<" if content.endswith(b"IM", 0, MAT_HEADER) else ">"
    arrays: list[tuple[str, tuple[int, ...], NDArray[Any]]] = []
    room, data = MOST_ARRAY_BYTES, memoryview(content)[MAT_HEADER:]
    try:
        for kind, body in _elements(data, order):
            matrix = kind, body
            if kind == MAT_COMPRESSED:
                stream = zlib.decompressobj()
                inflated = stream.decompress(body, room)
                room -= len(inflated)
                if not stream.eof or not room:
                    refuse(file, None, "a variable is not whole, or too large")
                matrix = next(_elements(memoryview(inflated), order))
            if matrix[0] == MAT_MATRIX:
                arrays += _matrices(matrix[1], order)
        name = _chosen(file, variable, [name for name, _, _ in arrays])
        shape, flat = next((shape, flat) for one, shape, flat in arrays if one == name)
        return name, flat.reshape(shape, order="F")
    except SceneError:
        raise
    except (ValueError, StopIteration, struct.error, zlib.error) as error:
        refuse(file, None, f"not a whole MATLAB file: {error}")


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Yield type and content of each data element; raise `ValueError` where the data end in one."""
    place = 0
    while place < len(data):
        kind, size = struct.unpack_from(order + "II", data, place)
        start = place + 8
        if kind >> 16:  # the content is small, and part of the tag
            kind, size, start = kind & 0xFFFF, kind >> 16, place + 4
        end = max(start + size, place + 8)
        if end > len(data):
            msg = f"it ends in an element of {size} bytes"
            raise ValueError(msg)
        yield kind, data[start : start + size]
        place = end if kind == MAT_COMPRESSED else end + -end % 8


def _matrices(
    data: memoryview, order: str, outer: Sequence[str] = ()
) -> list[tuple[str, tuple[int, ...], NDArray[Any]]]:
    """Return name, shape and numbers of a variable, or of its fields, whose structs are `outer`."""
    parts = _elements(data, order)
    flags, _ = struct.unpack(order + "II", next(parts)[1])
    kind = flags & MAT_CLASS
    if kind not in {MAT_STRUCT, *MAT_REAL} or flags & MAT_UNREAL:
        return []  # before the shape: tables, strings and other objects have none
    shape = tuple(np.frombuffer(next(parts)[1], order + "i4").tolist())
    own = bytes(next(parts)[1]).decode("ascii", "replace")
    names = outer or (own,)
    if kind == MAT_STRUCT:
        if prod(shape) != 1 or len(names) >= MOST_DEPTH:
            return []
        (length,) = struct.unpack(order + "i", next(parts)[1])
        words = bytes(next(parts)[1])
        starts = range(0, len(words), max(length, 1))
        texts = (words[i : i + length].partition(b"\0")[0] for i in starts)
        fields = (text.decode("ascii", "replace") for text in texts)
        inner = ((field, part) for field, (_, part) in zip(fields, parts, strict=True) if part)
        return [one for field, part in inner for one in _matrices(part, order, (*names, field))]
    name = ".".join(names)
    if not name:  # what the objects of a file are made of
        return []
    number, numbers = next(parts, (9, data[:0]))
    if number not in MAT_TYPES:
        msg = f"{name}: got numbers of type {number}"
        raise ValueError(msg)
    return [(name, shape, np.frombuffer(numbers, order + MAT_TYPES[number]))]


def _read_hdf5(file: Path, content: bytes, variable: str | None) -> tuple[str, NDArray[Any]]:
    h5py = optional("h5py", f"{file}: MATLAB 7.3 needs h5py; install the extra `matlab`")
    try:
        with h5py.File(BytesIO(content), "r") as data:
            arrays: dict[str, Any] = {}

            def note(path: str, found: Any) -> None:  # noqa: ANN401 - of h5py, which is optional
                # "#refs#" has the elements of cells, and of arrays of structs, without their order.
                is_array = isinstance(found, h5py.Dataset) and path[0] != "#" and _is_real(found)
                if is_array and "MATLAB_sparse" not in found.parent.attrs:
                    arrays[path.replace("/", ".")] = found

            data.visititems(note)  # of links only hard ones, each object once
            name = _chosen(file, variable, list(arrays))
            one = arrays[name]
            _check_size(file, name, one.shape, one.dtype.itemsize)
            if one.is_virtual or one.external:
                refuse(file, None, f"{name}: its numbers are in another file")
            return name, (one[()] if one.chunks is None else _of_chunks(file, name, one)).T
    except SceneError:
        raise
    except Exception as error:  # noqa: BLE001 - h5py raises what HDF5's library says
        refuse(file, None, f"not a whole MATLAB file: {type(error).__name__}: {error}")


def _is_real(dataset: Any) -> bool:  # noqa: ANN401 - of h5py, which is optional
    kind = dataset.attrs.get("MATLAB_class", b"double")
    name = kind.decode("ascii", "replace") if isinstance(kind, bytes) else str(kind)
    is_empty = bool(dataset.attrs.get("MATLAB_empty", 0))
    return name in MATLAB_REAL and dataset.dtype.kind in REAL and not is_empty


def _of_chunks(file: Path, name: str, dataset: Any) -> NDArray[Any]:  # noqa: ANN401 - as above
    """Return a dataset that is stored in chunks: HDF5 would inflate whatever they claim."""
    plist = dataset.id.get_create_plist()
    filters = [plist.get_filter(i)[0] for i in range(plist.get_nfilters())]
    if not set(filters) <= {DEFLATE, SHUFFLE}:
        refuse(file, None, f"{name}: got HDF5 filters {filters}; allowed: {[SHUFFLE, DEFLATE]}")
    _check_size(file, name, dataset.chunks, dataset.dtype.itemsize)
    size = prod(dataset.chunks) * dataset.dtype.itemsize
    array = np.zeros(dataset.shape, dataset.dtype)
    for i in range(dataset.id.get_num_chunks()):
        offset = dataset.id.get_chunk_info(i).chunk_offset
        left_out, raw = dataset.id.read_direct_chunk(offset)
        for bit in reversed(range(len(filters))):
            if left_out >> bit & 1:
                continue
            if filters[bit] == DEFLATE:
                raw = zlib.decompressobj().decompress(raw, size + 1)
            else:
                raw = np.frombuffer(raw, np.uint8).reshape(dataset.dtype.itemsize, -1).T.tobytes()
        chunk = np.frombuffer(raw, dataset.dtype).reshape(dataset.chunks)
        places = tuple(
            slice(start, min(start + length, end))
            for start, length, end in zip(offset, dataset.chunks, dataset.shape, strict=True)
        )
        array[places] = chunk[tuple(slice(place.stop - place.start) for place in places)]
    return array


READERS: dict[str, Callable[[Path, bytes, str | None], tuple[str, NDArray[Any]]]] = {
    ".npy": _read_npy,
    ".npz": _read_npz,
    ".mat": _read_mat,
}
"""End of a file's name -> (file, content, variable) -> name of the array, and the array."""
