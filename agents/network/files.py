"""Files of policies: arrays and a JSON text in safetensors' format, or NumPy's of earlier versions.

Reading one runs no code, and is bounded. The content is not trusted: members are counted before
they are listed, sizes are added up before anything is unpacked, and an array must hold exactly the
bytes that its header states.
"""

import io
import json
import math
import struct
import zipfile
import zlib
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy
from numpy.lib import format as npy
from numpy.typing import DTypeLike, NDArray
from safetensors import SafetensorError

from agents.network.interface import Interface, counted
from mm_gym.errors import refuse
from mm_gym.files import parse_json, write_bytes

Arrays = Mapping[str, NDArray[Any]]

LARGEST = 64 * 2**20
"""Size of a file [bytes], and of what it unpacks to; a policy of two layers of 64 has 40 kB."""

ENDINGS = (".safetensors", ".npz")
"""Of files of policies; those with the second are of earlier versions, NumPy's archives."""

ARCHIVE = b"PK"  # what NumPy's archives begin with


class PolicyError(RuntimeError):
    """A policy cannot be read, or does not suit the scene."""


class FilePolicy(ABC):
    """A policy that a file can hold: a network, or a table of value iteration."""

    # observed, actions, remembers: numbers of an observation, of an action, and kept between steps
    observed: int
    actions: int
    remembers: int = 0

    def begin(self, lanes: int) -> NDArray[np.float64]:
        """Return the memory (lanes, m) with which an episode begins."""
        return np.zeros((lanes, self.remembers))

    def check(self, observation: int, action: int, of: str = "the scene") -> None:
        """Raise `PolicyError` unless observation and action have so many numbers."""
        if (self.observed, self.actions) != (observation, action):
            msg = (
                f"policy: got {counted(self.observed, 'observed number')} and "
                f"{counted(self.actions, 'action')}; {of} has {observation} and {action}"
            )
            raise PolicyError(msg)

    def save(self, path: str | Path, interface: Interface | None = None) -> None:
        """Write the policy whole: a kill leaves the old file or the new one."""
        write_bytes(path, self.to_bytes(interface))

    def to_bytes(self, interface: Interface | None = None) -> bytes:
        """Return the content of the policy's file."""
        description, arrays = self._content()
        if interface is not None:
            description["interface"] = interface.model_dump(mode="json")
        return content_of(description, arrays)

    @abstractmethod
    def _content(self) -> tuple[dict[str, Any], Arrays]:
        """Return what a file says of it in JSON, and its arrays."""


MOST_MEMBERS = 4096  # of an archive; a training's checkpoint has some hundred arrays
MEMBER = b"PK\x01\x02"  # what the entry of each member in an archive's directory begins with

METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Of compression: those whose output can be read up to a limit."""

DAMAGE = (
    *(zipfile.BadZipFile, zlib.error, struct.error, EOFError, OSError, OverflowError),
    *(NotImplementedError, UnicodeError),
)
"""What zipfile raises for what is no archive."""

HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
"""By the version of an array's file: what reads its header, of at most 10,000 bytes."""

KINDS = "biufU"  # of types: truth values, integers, floating-point numbers and text


def arrays_in(content: bytes, *, most: int) -> dict[str, NDArray[Any]]:
    """Return the arrays in the content of an ``.npz`` file, which unpacks to at most `most` bytes.

    Raise `ValueError` if it is damaged, too large, or holds anything but arrays of numbers and
    text.
    """
    with _opened(content, most) as archive:
        members = archive.infolist()
        found = {member.filename: _unpacked(archive, member) for member in members}
    if len(found) < len(members):
        msg = f"got {len(members)} arrays of {len(found)} names; allowed: one of each name"
        raise ValueError(msg)
    return {name.removesuffix(".npy"): array_in(data, name) for name, data in found.items()}


def check_archive(content: bytes, *, most: int) -> None:
    """Raise `ValueError` unless it is a zip archive that unpacks to at most `most` bytes."""
    with _opened(content, most) as archive:
        for member in archive.infolist():
            _unpacked(archive, member)


@contextmanager
def _opened(content: bytes, most: int) -> Iterator[zipfile.ZipFile]:
    """Open an archive of few members, that unpack to little; name what is damaged in it."""
    if content.count(MEMBER) > MOST_MEMBERS:
        msg = f"got more than {MOST_MEMBERS} members; allowed: at most {MOST_MEMBERS}"
        raise ValueError(msg)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            unpacked = sum(member.file_size for member in archive.infolist())
            if unpacked > most:
                msg = f"it unpacks to {unpacked} bytes; allowed: at most {most}"
                raise ValueError(msg)
            yield archive
    except DAMAGE as error:
        msg = f"not an archive: {error}"
        raise ValueError(msg) from None


def _unpacked(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    """Return the content of a member: no more of it is unpacked than its size that is stated."""
    if member.flag_bits & 1 or member.compress_type not in METHODS:
        msg = f"{member.filename}: got a member that is encrypted or compressed in another way"
        raise ValueError(msg)
    with archive.open(member) as stream:
        return stream.read(member.file_size + 1)


def array_in(data: bytes, name: str = "array") -> NDArray[Any]:
    """Return the array in the content of an ``.npy`` file.

    The name is for messages. Raise `ValueError` if it is damaged, or an array of anything but
    numbers or text.
    """
    stream = io.BytesIO(data)
    try:
        shape, is_fortran, dtype = HEADERS[npy.read_magic(stream)](stream)
    except Exception as error:  # noqa: BLE001 - Python's parser reads it
        msg = f"{name}: not an array: {error}"
        raise ValueError(msg) from None
    if not all(type(n) is int and n >= 0 for n in shape):
        refuse(name, f"shape {shape}", "numbers of at least 0", ValueError)
    if dtype.kind not in KINDS or not dtype.itemsize:
        refuse(name, f"type {dtype.str!r}", "numbers or text", ValueError)
    size, got = math.prod(shape) * dtype.itemsize, len(data) - stream.tell()
    if size != got:
        msg = f"{name}: got {got} bytes; its shape {shape} needs {size}"
        raise ValueError(msg)
    if not size:
        return np.empty(shape, dtype)
    order = "F" if is_fortran else "C"
    return np.frombuffer(stream.read(), dtype).reshape(shape, order=order).copy(order)


def numbers(
    arrays: Arrays, name: str, shape: tuple[int, ...], dtype: DTypeLike = np.float64
) -> NDArray[Any]:
    """Return one of several arrays, of finite numbers, in C order and of a type.

    Raise `ValueError` if it is missing, of another shape, of text, or not finite in the type.
    """
    check_shapes(arrays, {name: shape})
    array = arrays[name]
    with np.errstate(over="ignore"):
        array = np.ascontiguousarray(array, dtype).reshape(shape)
    if not np.isfinite(array).all():
        refuse(name, "numbers that are not finite", "finite numbers", ValueError)
    return array


def check_shapes(arrays: Arrays, shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Raise `ValueError` unless there are arrays of numbers of these shapes."""
    for name, shape in shapes.items():
        if name not in arrays:
            msg = f"{name}: missing; allowed: finite numbers of shape {shape}"
            raise ValueError(msg)
        array = arrays[name]
        if array.dtype.kind not in "biuf" or array.shape != shape:
            what = "text" if array.dtype.kind == "U" else f"shape {array.shape}"
            refuse(name, what, f"finite numbers of shape {shape}", ValueError)


def described(arrays: Arrays) -> dict[str, object]:
    """Return the JSON table in the text called "description"; raise `ValueError` if it is none."""
    text = arrays.get("description", np.empty(0))
    data = parse_json(str(text)) if text.dtype.kind == "U" and text.ndim == 0 else None
    if isinstance(data, dict):
        return data
    msg = "description: missing; allowed: the text of a JSON table"
    raise ValueError(msg)


def content_of(description: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Return the content of a file of a description and arrays."""
    # In the order of their names, so that the same policy is the same file.
    ordered = {name: np.ascontiguousarray(arrays[name]) for name in sorted(arrays)}
    return safetensors.numpy.save(ordered, {"description": json.dumps(description)})


def read_content(content: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return the description and the arrays in the content of a file.

    Raise `ValueError` if it is damaged, or holds anything but a description and arrays.
    """
    if content.startswith(ARCHIVE):
        arrays = arrays_in(content, most=LARGEST)
        return described(arrays), arrays
    try:
        arrays = safetensors.numpy.load(content)
    except (SafetensorError, KeyError, ValueError, TypeError) as error:
        msg = f"not in safetensors' format: {error}"
        raise ValueError(msg) from None
    header = parse_json(content[8 : 8 + int.from_bytes(content[:8], "little")].decode())
    told = header.get("__metadata__", {}) if isinstance(header, dict) else {}
    return described({"description": np.array(told.get("description", ""))}), arrays
