"""Kernels as numba's dispatchers, compiled once and in a fraction of numba's own time.

Numba compiles every function that a compiled one calls as if Python called it too: to machine code
of its own, in two wrappers, optimised anew at each level of calls. Here each kernel is lowered to
intermediate code, once, which others link. Only what Python calls is optimised and becomes machine
code, as a whole. And the compiler leaves out its passes for what no kernel contains.
"""

# ruff: noqa: SLF001 - numba has no public interface for this

from __future__ import annotations

import gc
import secrets
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from functools import cached_property
from typing import Any

from numba.core import bytecode, compiler, sigutils, typed_passes, typing, untyped_passes
from numba.core.compiler import CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import PassManager
from numba.core.registry import CPUDispatcher
from numba.core.runtime import rtsys
from numba.core.types import unliteral
from numba.core.typing import Signature

from mm_gym.compiler.cache import IntermediateCode, KernelCache
from mm_gym.compiler.notice import announce

Kinds = tuple[Any, ...]
"""Types of arguments."""

PASSES = (
    untyped_passes.TranslateByteCode,
    untyped_passes.FixupArgs,
    untyped_passes.IRProcessing,
    untyped_passes.RewriteSemanticConstants,
    untyped_passes.DeadBranchPrune,
    untyped_passes.GenericRewrites,
    untyped_passes.ReconstructSSA,
    typed_passes.NopythonTypeInference,
    typed_passes.PreLowerStripPhis,
    typed_passes.InlineOverloads,
    typed_passes.NopythonRewrites,
    typed_passes.IRLegalization,
    typed_passes.NativeLowering,
    typed_passes.NoPythonBackend,
)
"""Numba's, without those for closures, generators, literal types and lifted loops."""


@contextmanager
def _names_of_no_other_process() -> Generator[None]:
    """Let numba name what it compiles meanwhile as no other process does.

    Numba tells functions of one name apart by a count that every process begins anew: linked from a
    cache that several processes filled, one would come in the place of another
    (https://github.com/numba/numba/issues/10486). The count of other code goes on afterwards.
    """
    count = bytecode.FunctionIdentity._unique_ids
    bytecode.FunctionIdentity._unique_ids = iter(lambda: secrets.randbits(64), None)
    try:
        yield
    finally:
        bytecode.FunctionIdentity._unique_ids = count


@contextmanager
def _no_garbage_collected() -> Generator[None]:
    """Let Python not look for garbage meanwhile: the compiler makes millions of small objects."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


@contextmanager
def _calls_typed_once(context: typing.Context) -> Generator[None]:
    """Let numba know the type of a call again: it tries all candidates at every call of one."""
    if "resolve_function_type" in vars(context):  # within another compilation
        yield
        return
    known: dict[object, Signature] = {}
    look_up = context.resolve_function_type

    def resolve(function: Any, args: Any, kws: Any) -> Signature | None:  # noqa: ANN401 - numba's
        key = function, tuple(args), tuple(kws.items()) if kws else ()
        try:
            found = known.get(key)
        except TypeError:  # a slice
            return look_up(function, args, kws)
        if found is None and (found := look_up(function, args, kws)) is not None:
            known[key] = found
        return found

    context.resolve_function_type = resolve
    try:
        yield
    finally:
        del context.resolve_function_type


class Pipeline(compiler.CompilerBase):
    """The way from a function's byte code to its intermediate code."""

    def define_pipelines(self) -> list[PassManager]:
        """Return the only pipeline."""
        manager = PassManager("kernel")
        for step in PASSES:
            manager.add_pass(step, step.__name__)
        manager.finalize()
        return [manager]


class Flags(compiler.Flags):
    """Options of a compilation, compared by those that are set.

    Numba looks overloads up by them at every call, and compares all there are.
    """

    __slots__ = ()

    def __hash__(self) -> int:
        return hash(frozenset(self._values))

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Flags):
            return self._values == other._values
        return super().__eq__(other)


class OnceDispatcher(CPUDispatcher):
    """What numba's decorators return, of which several processes at once compile one."""

    def __init__(self, function: Callable[..., Any], options: Mapping[str, object]) -> None:
        super().__init__(function, targetoptions=dict(options))
        del self._cache  # numba's, which keeps nothing

    @cached_property
    def _cache(self) -> KernelCache:
        """The machine code on disk. To find a place for it takes longer than to load it."""
        return KernelCache(self.py_func)

    def compile(self, sig: Kinds) -> Callable[..., Any]:
        """Return the machine code for arguments of some types."""
        with global_compiler_lock:
            kinds, _ = sigutils.normalize_signature(sig)
            result = self.overloads.get(kinds)
            if result is None:
                result, is_new = self._cache.loaded_or_made(
                    kinds, self.targetctx, lambda: self._announced_and_made(kinds)
                )
                (self._cache_misses if is_new else self._cache_hits)[kinds] += 1
                self.add_overload(result)
            return result.entry_point

    def _announced_and_made(self, kinds: Kinds) -> CompileResult:
        announce(self)
        typed_once = _calls_typed_once(self.typingctx)
        with typed_once, _no_garbage_collected(), _names_of_no_other_process():
            return self._made(kinds)

    def _made(self, kinds: Kinds) -> CompileResult:
        return self._compiler.compile(kinds, None)


class KernelDispatcher(OnceDispatcher):
    """A kernel: intermediate code for other kernels, and machine code for Python."""

    def __init__(self, function: Callable[..., Any], options: Mapping[str, object]) -> None:
        super().__init__(function, options)
        self._intermediate: dict[Kinds, CompileResult] = {}

    @cached_property
    def _flags(self) -> Flags:
        flags = Flags()
        self.targetdescr.options.parse_as_flags(flags, self.targetoptions)
        flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        return flags

    def get_call_template(self, args: Kinds, kws: Mapping[str, Any]) -> tuple[Any, ...]:
        """Return what numba types a call of this kernel in another one by.

        A constant is a number like others: numba would make the kernel anew for each.
        """
        signature, folded = self._compiler.fold_argument_types(args, kws)
        kinds = tuple(unliteral(kind) for kind in folded)
        name = self.py_func.__name__
        template = typing.make_concrete_template(
            f"CallTemplate({name})", key=name, signatures=[self._lowered(kinds).signature]
        )
        return template, signature, kinds, {}

    def get_overload(self, sig: Kinds | Signature) -> object:
        """Return the key under which numba finds the code of such a call."""
        return self._lowered(sigutils.normalize_signature(sig)[0]).fndesc

    def _lowered(self, kinds: Kinds) -> CompileResult:
        with global_compiler_lock:
            result = self._intermediate.get(kinds)
            if result is None:
                cache = KernelCache(self.py_func, intermediate=True)
                result, _ = cache.loaded_or_made(kinds, self.targetctx, lambda: self._lower(kinds))
                self._intermediate[kinds] = result
                key = result.fndesc
                self.targetctx.insert_user_function(key, key, [result.library])
            return result

    def _lower(self, kinds: Kinds) -> CompileResult:
        library = IntermediateCode(self.targetctx.codegen(), self.py_func.__qualname__)
        with _names_of_no_other_process():
            result = compiler.compile_extra(
                self.typingctx,
                self.targetctx,
                self.py_func,
                args=kinds,
                return_type=None,
                flags=self._flags,
                locals={},
                library=library,
                pipeline_class=Pipeline,
            )
        library.finalize()
        return result

    def _made(self, kinds: Kinds) -> CompileResult:
        # Lowered anew, under a name of its own, though others may link it: the wrapper adds objects
        # of Python, such as an array's type, and a process knows the objects of a name only once.
        lowered = self._lower(kinds)
        context = compiler._make_subtarget(self.targetctx, self._flags)
        kernel, environment = lowered.fndesc, lowered.environment
        library = context.codegen().create_library(kernel.qualname)
        library.enable_object_caching()
        library._final_module.link_in(lowered.library._final_module, preserve=True)
        library.add_linking_library(rtsys.library)
        context.create_cpython_wrapper(library, kernel, environment, None, release_gil=True)
        function = context.get_executable(library, kernel, environment)
        return lowered._replace(library=library, entry_point=function)
