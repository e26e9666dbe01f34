"""Compiled kernels on disk: those of the sources as a whole, and never a reason to fail."""

# ruff: noqa: SLF001 - numba has no public interface for this

from __future__ import annotations

import hashlib
import inspect
import os
import pickle
import sys
import tempfile
import uuid
import warnings
from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

import numba
from llvmlite import binding
from numba.core import caching
from numba.core.codegen import CodeLibrary, JITCodeLibrary
from numba.core.compiler import CompileResult, compile_result
from numba.core.runtime import rtsys

from mm_gym.compiler.lock import locked
from mm_gym.compiler.notice import NOT_KEPT
from mm_gym.compiler.trust import UntrustedError, check_folder, read_trusted


def sources() -> list[Path]:
    """Return the files that compiled code is made from."""
    package = Path(__file__).parents[1]
    places = (
        "arrays.py",
        "compiler/*.py",
        "lanes/*.py",
        "law/*.py",
        "excitation/*.py",
        "step/*.py",
        "**/*kernel.py",
        "methods/*/layout.py",
        "sensitivity/*layout.py",
    )
    return sorted({file for place in places for file in package.glob(place)})


def _digest_of_sources() -> str:
    files = sources()
    return hashlib.sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()


@cache
def _digest_of(file: str) -> str:
    """Return the digest of a kernel's own file, which need not be one of the package."""
    return hashlib.sha256(Path(file).read_bytes()).hexdigest()


_STAMP = (numba.__version__, _digest_of_sources())
"""Of the sources as imported: edited later, they are not those that this process runs. Numba would
stamp with one file only: a kernel whose helper in another changed would stay stale."""

_DIGEST_SIZE = hashlib.sha256().digest_size

_warned: list[str] = []
"""The warnings of this process: one is enough."""


def _warn(message: str) -> None:
    if not _warned:
        advice = "set NUMBA_CACHE_DIR to choose another folder"
        warnings.warn(f"{message}; {advice}", RuntimeWarning, stacklevel=2)
    _warned.append(message)


class _Entries(caching.IndexDataCacheFile):
    """Entries that say what they are of, in files that are used only if they are whole.

    Numba numbers entries, and writes the index first. After a full disk, a kill, or two processes
    at once, a number in the index may lead to code for other arguments or from older sources. A
    file of another kernel or from other sources is not unpickled: it may name modules that are
    gone. Nor is one that others can have written: to unpickle is to run.
    """

    def load(self, key: object) -> object | None:
        entry = super().load(key)
        return None if entry is None or entry[0] != key else entry[1]

    def save(self, key: object, data: object) -> None:
        super().save(key, (key, data))

    @property
    def _mark(self) -> bytes:
        """The mark of kernel and sources, with which a file's content begins."""
        return hashlib.sha256(repr(self._source_stamp).encode()).digest()

    def _load_index(self) -> dict[Any, str]:
        return self._read(self._index_path) or {}

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_path, overloads)

    def _load_data(self, name: str) -> Any | None:  # noqa: ANN401 - what was pickled
        return self._read(self._data_path(name))

    def _save_data(self, name: str, data: object) -> None:
        self._write(self._data_path(name), data)

    def _read(self, path: str) -> Any | None:  # noqa: ANN401 - the same
        try:
            content = read_trusted(Path(path))
        except UntrustedError as error:
            _warn(f"compiled again instead of loaded, for {error}")
            return None
        except OSError:  # none yet; if there is more to it, writing fails too and says so
            return None
        digest, content = content[:_DIGEST_SIZE], content[_DIGEST_SIZE:]
        if hashlib.sha256(content).digest() != digest:
            _warn(f"compiled again, for the file is damaged: {path}")
            return None
        if not content.startswith(self._mark):
            return None
        return pickle.loads(content[_DIGEST_SIZE:])  # noqa: S301 - ours, as its digest says

    def _write(self, path: str, data: object) -> None:
        content = self._mark + self._dump(data)
        with self._open_for_write(path) as stream:
            stream.write(hashlib.sha256(content).digest() + content)

    @contextmanager
    def _open_for_write(self, filepath: str) -> Generator[BinaryIO]:
        """Write a file as a whole, which others cannot write: see `read_trusted`."""
        temporary = Path(f"{filepath}.tmp.{uuid.uuid4().hex}")
        try:
            with open(temporary, "xb", opener=_opened_for_the_user) as stream:
                yield stream
            temporary.replace(filepath)
        finally:
            temporary.unlink(missing_ok=True)


def _opened_for_the_user(path: str, flags: int) -> int:
    return os.open(path, flags, 0o644)  # whatever his `umask`


class IntermediateCode(JITCodeLibrary):
    """The code of a kernel as others link it: with all that it calls, neither optimised nor run."""

    @classmethod
    def loaded(cls, codegen: Any, name: str, bitcode: bytes) -> IntermediateCode:  # noqa: ANN401
        """Return a library as `bitcode` saves it."""
        library = cls(codegen, name)
        library._final_module = binding.parse_bitcode(bitcode)
        library._finalized = True
        return library

    def bitcode(self) -> bytes:
        """Return the code in bytes."""
        return self._final_module.as_bitcode()

    def add_linking_library(self, library: CodeLibrary) -> None:
        """Add a library that this one calls; numba's runtime comes with the machine code."""
        if library is not rtsys.library:
            super().add_linking_library(library)

    def _optimize_final_module(self) -> None:
        """Leave it to the machine code of which this becomes a part."""

    def _finalize_final_module(self) -> None:
        """Keep the code out of the memory of what runs."""
        self._finalize_dynamic_globals()
        self._finalized = True


class _MachineCode:
    """What is saved of code that runs."""

    @staticmethod
    def reduced(result: CompileResult) -> tuple[Any, ...]:
        """Return what `rebuilt` takes."""
        return result._reduce()

    @staticmethod
    def rebuilt(target_context: Any, payload: tuple[Any, ...]) -> CompileResult:  # noqa: ANN401
        """Return what can be called."""
        return CompileResult._rebuild(target_context, *payload)


class _LinkedCode:
    """What is saved of code that others link, see `mm_gym.compiler.dispatcher`."""

    @staticmethod
    def reduced(result: CompileResult) -> tuple[Any, ...]:
        """Return what `rebuilt` takes."""
        fndesc = result.fndesc
        fndesc.typemap = fndesc.calltypes = None  # as numba's own `_reduce` leaves them
        return result.library.name, result.library.bitcode(), fndesc, result.signature

    @staticmethod
    def rebuilt(target_context: Any, payload: tuple[Any, ...]) -> CompileResult:  # noqa: ANN401
        """Return a result as far as those need it who link it."""
        name, bitcode, fndesc, signature = payload
        return compile_result(
            typing_context=target_context.typing_context,
            target_context=target_context,
            library=IntermediateCode.loaded(target_context.codegen(), name, bitcode),
            fndesc=fndesc,
            signature=signature,
            objectmode=False,
            lifted=(),
            reload_init=(),
        )


class KernelCache:
    """The compiled code of a kernel on disk; what cannot be written is compiled by each process.

    Parameters
    ----------
    py_func
        The kernel as plain Python.
    intermediate
        Whether it is the intermediate code, which others link, or the machine code.
    """

    def __init__(self, py_func: Callable[..., Any], *, intermediate: bool = False) -> None:
        self._py_func = py_func
        self._code = _LinkedCode if intermediate else _MachineCode
        self._name = _file_name(py_func, "linked" if intermediate else "whole")
        self._problems: list[OSError] = []
        stamp = (*_STAMP, _digest_of(inspect.getfile(py_func)), py_func.__module__, self._name)
        self._files = {
            place: _Entries(str(place), self._name, stamp) for place in self._trusted_places()
        }

    @property
    def cache_path(self) -> str | None:
        """The first folder that is looked at, for numba's statistics."""
        return next(map(str, self._files), None)

    def loaded_or_made(
        self,
        sig: object,
        target_context: Any,  # noqa: ANN401 - numba's
        make: Callable[[], CompileResult],
    ) -> tuple[CompileResult, bool]:
        """Return the code for a signature, and whether it was made here and now.

        Of several processes that need it at once, one makes it, and the others wait.
        """
        # Kernels close over other kernels only, and the stamp covers their text: their names
        # identify the closure.
        key = (sig, target_context.codegen().magic_tuple(), closed_over(self._py_func))
        found = self._loaded(key, target_context)
        if found is not None:
            return found, False
        place = self._place_to_write()
        if place is None:
            return make(), True
        with locked(place / f"{self._name}.lock") as is_held:
            if is_held:  # another process may have made it meanwhile
                found = self._loaded(key, target_context)
                if found is not None:
                    return found, False
            made = make()
            try:
                self._files[place].save(key, self._code.reduced(made))
            except OSError as error:
                _warn(f"{NOT_KEPT}: {error}")
        return made, True

    def _loaded(self, key: object, target_context: Any) -> CompileResult | None:  # noqa: ANN401
        """Return the code from disk, or None.

        Numba's own method first imports and registers all that the compiler knows, SciPy's linear
        algebra among it. Code that is compiled needs the run-time library only.
        """
        rtsys.initialize(target_context)
        for entries in self._files.values():
            payload = entries.load(key)
            if payload is not None:
                return self._code.rebuilt(target_context, payload)
        return None

    def _trusted_places(self) -> Generator[Path]:
        """Yield the folders that only the user and root can change."""
        for place, is_named in _places(self._py_func):
            try:
                check_folder(place)
            except UntrustedError as error:
                self._problems.append(error)
                if is_named:
                    _warn(f"another folder is used for compiled code, for {error}")
            except OSError as error:
                self._problems.append(error)
            else:
                yield place

    def _place_to_write(self) -> Path | None:
        """Return the first folder that can be written to, or None after a warning."""
        for place in self._files:
            try:
                _prepare(place)
            except OSError as error:
                self._problems.append(error)
            else:
                return place
        _warn(f"{NOT_KEPT}: {self._problems[0]}")
        return None


def _places(py_func: Callable[..., Any]) -> list[tuple[Path, bool]]:
    """Return the folders for a kernel's code, and whether the user has named them."""
    file, named = inspect.getfile(py_func), caching.UserProvidedCacheLocator
    locators = [caching.InTreeCacheLocator, caching.UserWideCacheLocator]
    if numba.config.CACHE_DIR:
        locators.insert(0, named)
    places = [(locator(py_func, file).get_cache_path(), locator is named) for locator in locators]
    # Without a home, the user's folder would be one where the process happens to run.
    homes = [(place, is_named) for place, is_named in places if not place.startswith("~")]
    return [(Path(place).absolute(), is_named) for place, is_named in homes]


def _prepare(place: Path) -> None:
    """Make a folder that only the user can write, whatever his `umask`, and try it."""
    for folder in (*reversed(place.parents), place):
        if not folder.is_dir():
            folder.mkdir(0o755, exist_ok=True)
    check_folder(place)
    tempfile.TemporaryFile(dir=place).close()


def _file_name(function: Callable[..., Any], kind: str) -> str:
    """Return the name of a kernel's files."""
    code = function.__code__
    name = function.__qualname__.replace("<", "").replace(">", "")  # Windows forbids them
    python = f"py{sys.version_info[0]}{sys.version_info[1]}{getattr(sys, 'abiflags', '')}"
    return f"{Path(code.co_filename).stem}.{name}-{code.co_firstlineno}.{python}.{kind}"


def closed_over(function: Callable[..., Any]) -> tuple[object, ...]:
    """Return the names of the kernels that a kernel closes over, and that those close over.

    Of a constant it is how it represents itself.
    """
    return tuple(_name_of(cell.cell_contents) for cell in function.__closure__ or ())


def _name_of(value: Any) -> object:  # noqa: ANN401 - a kernel or a constant
    if not callable(value):
        return repr(value)
    return value.__module__, value.__qualname__, closed_over(getattr(value, "py_func", value))
