"""The guard of numba's private names, by which kernels are linked and kept."""

from __future__ import annotations

import re
from importlib import import_module
from pkgutil import resolve_name
from typing import Any

import numba

OLDEST, NEWEST = (0, 62), (0, 68)
"""Versions of numba that `make test-numba` runs with; those between have been tested too."""

INSTALL = f"install numba>={OLDEST[0]}.{OLDEST[1]},<{NEWEST[0]}.{NEWEST[1] + 1}"
"""How messages on a numba that is not one of them end."""

USED_LATER = (
    "numba.core.bytecode:FunctionIdentity._unique_ids",
    "numba.core.caching:IndexDataCacheFile",
    "numba.core.caching:InTreeCacheLocator.get_cache_path",
    "numba.core.caching:UserProvidedCacheLocator.get_cache_path",
    "numba.core.caching:UserWideCacheLocator.get_cache_path",
    "numba.core.codegen:CPUCodegen.magic_tuple",
    "numba.core.codegen:CPUCodeLibrary.add_linking_library",
    "numba.core.codegen:CPUCodeLibrary._finalize_dynamic_globals",
    "numba.core.codegen:CPUCodeLibrary._finalize_final_module",
    "numba.core.codegen:CPUCodeLibrary._optimize_final_module",
    "numba.core.codegen:JITCodeLibrary.get_pointer_to_function",
    "numba.core.compiler:CompileResult._reduce",
    "numba.core.compiler:CompileResult._rebuild",
    "numba.core.compiler:_make_subtarget",
    "numba.core.compiler:compile_extra",
    "numba.core.sigutils:normalize_signature",
    "numba.core.typing:make_concrete_template",
)
"""Names that are read when a kernel is compiled. Those of an import are missed at once."""


def dispatchers() -> tuple[Any, str | None]:
    """Return the module of this package's dispatchers, or None and what stands against it."""
    version = re.match(r"(\d+)\.(\d+)", numba.__version__)
    if version is None or not OLDEST <= (int(version[1]), int(version[2])) <= NEWEST:
        tested = " to ".join(f"{major}.{minor}" for major, minor in (OLDEST, NEWEST))
        return None, f"numba {numba.__version__} is none of the versions that were tested, {tested}"
    try:
        for name in USED_LATER:
            resolve_name(name)
        return import_module("mm_gym.compiler.dispatcher"), None
    except (ImportError, AttributeError) as error:
        return None, lacks(error)


def lacks(error: Exception) -> str:
    """Return what stands against a numba in which a private name was looked for in vain."""
    return f"numba {numba.__version__} lacks a private name: {error}"
