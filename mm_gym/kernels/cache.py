"""Compiled kernels on disk: those of the sources as a whole, and never a reason to fail."""

from __future__ import annotations

import hashlib
import pickle
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numba
from numba.core import caching
from numba.core.compiler import compile_result
from numba.core.runtime import rtsys

from mm_gym.kernels.intermediate_code import IntermediateCode
from mm_gym.kernels.lock import locked

if TYPE_CHECKING:
    from collections.abc import Callable

    from numba.core.compiler import CompileResult


def sources() -> list[Path]:
    """Return the files that compiled code is made from."""
    package = Path(__file__).parents[1]
    places = ("kernels/*.py", "**/*kernel.py", "methods/*/layout.py", "sensitivity/*layout.py")
    return sorted({file for place in places for file in package.glob(place)})


def _digest_of_sources() -> str:
    files = sources()
    return hashlib.sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()


_STAMP = (numba.__version__, _digest_of_sources())
"""Of the sources as imported: edited later, they are not those that this process runs. Numba would
stamp with one file only: a kernel whose helper in another changed would stay stale."""

_DIGEST_SIZE = hashlib.sha256().digest_size

NOT_KEPT = "each process compiles anew, for compiled code cannot be written"

_warned: list[str] = []
"""The warnings of this process: one is enough."""


def _warn(message: str) -> None:
    if not _warned:
        advice = "set NUMBA_CACHE_DIR to choose another folder"
        warnings.warn(f"{message}; {advice}", RuntimeWarning, stacklevel=2)
    _warned.append(message)


class _UserWide(caching.UserWideCacheLocator):
    @classmethod
    def from_function(cls, py_func: object, py_file: str) -> _UserWide | None:
        # A user without a home: the folder would be made where the process happens to run.
        if not Path(cls(py_func, py_file).get_cache_path()).is_absolute():
            return None
        return super().from_function(py_func, py_file)


class _Unchecked(caching.InTreeCacheLocator):
    """The package's own folder although it cannot be written to: it may have been filled before."""

    @classmethod
    def from_function(cls, py_func: object, py_file: str) -> _Unchecked:
        return cls(py_func, py_file)


class _Implementation(caching.CompileResultCacheImpl):
    _locator_classes = (
        caching.UserProvidedCacheLocator,
        caching.InTreeCacheLocator,
        _UserWide,
        _Unchecked,
    )


class _Entries(caching.IndexDataCacheFile):
    """Entries that say what they are of, in files that are used only if they are whole.

    Numba numbers entries, and writes the index first. After a full disk, a kill, or two processes
    at once, a number in the index may lead to code for other arguments or from older sources. A
    file from other sources is not unpickled: it may name modules that are gone.
    """

    def load(self, key: object) -> object | None:
        entry = super().load(key)
        return None if entry is None or entry[0] != key else entry[1]

    def save(self, key: object, data: object) -> None:
        super().save(key, (key, data))

    @property
    def _mark(self) -> bytes:
        """The sources' mark, with which a file's content begins."""
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
            content = Path(path).read_bytes()
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


class _IntermediateImplementation(_Implementation):
    """How code is saved that others link, see `mm_gym.kernels.dispatcher`."""

    def reduce(self, result: CompileResult) -> tuple[object, ...]:
        """Return what `rebuild` takes."""
        fndesc = result.fndesc
        fndesc.typemap = fndesc.calltypes = None  # as numba's own `reduce` leaves them
        library = result.library
        return library.name, library.bitcode(), fndesc, result.environment, result.signature

    def rebuild(self, target_context: Any, payload: tuple[Any, ...]) -> CompileResult:  # noqa: ANN401
        """Return a result as far as those need it who link it."""
        name, bitcode, fndesc, environment, signature = payload
        library = IntermediateCode.loaded(target_context.codegen(), name, bitcode)
        return compile_result(
            typing_context=target_context.typing_context,
            target_context=target_context,
            library=library,
            fndesc=fndesc,
            environment=environment,
            signature=signature,
            objectmode=False,
            lifted=(),
            reload_init=(),
        )


class KernelCache(caching.FunctionCache):
    """The compiled code of a kernel on disk; what cannot be written is compiled by each process.

    Parameters
    ----------
    py_func
        The kernel as plain Python.
    intermediate
        Whether it is the intermediate code, which others link, or the machine code.
    """

    _impl_class = _Implementation

    def __init__(self, py_func: Callable[..., Any], *, intermediate: bool = False) -> None:
        super().__init__(py_func)
        if intermediate:
            self._impl = _IntermediateImplementation(py_func)
        # Not the name of files without digests.
        name = f"{self._impl.filename_base}.{'linked' if intermediate else 'whole'}"
        self._cache_file = _Entries(self._cache_path, name, _STAMP)
        self._lock = Path(self._cache_path) / f"{name}.lock"

    def loaded_or_made(
        self,
        sig: object,
        target_context: Any,  # noqa: ANN401 - numba's
        make: Callable[[], CompileResult],
    ) -> tuple[CompileResult, bool]:
        """Return the code for a signature, and whether it was made here and now.

        Of several processes that need it at once, one makes it, and the others wait.
        """
        found = self.load_overload(sig, target_context)
        if found is not None:
            return found, False
        with locked(self._lock) as is_held:
            if is_held:  # another process may have made it meanwhile
                found = self.load_overload(sig, target_context)
                if found is not None:
                    return found, False
            made = make()
            self.save_overload(sig, made)
        return made, True

    def load_overload(self, sig: object, target_context: Any) -> CompileResult | None:  # noqa: ANN401
        """Return the code for a signature from disk, or None.

        Numba's own method first imports and registers all that the compiler knows, SciPy's linear
        algebra among it. Code that is compiled needs the run-time library only.
        """
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)

    def save_overload(self, sig: object, data: CompileResult) -> None:
        """Save compiled code for a signature."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _warn(f"{NOT_KEPT}: {error}")

    def _index_key(self, sig: object, codegen: Any) -> tuple[object, ...]:  # noqa: ANN401 - numba's
        # Kernels close over other kernels only, and the stamp covers their text: their names
        # identify the closure.
        return (sig, codegen.magic_tuple(), closed_over(self._py_func))


def closed_over(function: Callable[..., Any]) -> tuple[object, ...]:
    """Return the names of the kernels that a kernel closes over, and that those close over."""
    kernels = [cell.cell_contents for cell in function.__closure__ or ()]
    return tuple(
        (kernel.__module__, kernel.__qualname__, closed_over(getattr(kernel, "py_func", kernel)))
        for kernel in kernels
    )
