"""Code of kernels that other kernels link: lowered, not yet optimised."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from llvmlite import binding
from numba.core.codegen import JITCodeLibrary
from numba.core.runtime import rtsys

if TYPE_CHECKING:
    from numba.core.codegen import CodeLibrary


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
