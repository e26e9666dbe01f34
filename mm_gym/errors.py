"""The errors that mm_gym raises, checks that raise them, and the suggestion of the nearest name."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray


class SceneError(ValueError):
    """A scene, a file or an argument has a value that is not allowed.

    The message lists every finding: field, value, what is allowed and, for a misspelt name, the
    nearest one.
    """


class StructureError(SceneError):
    """A structure has a matrix, a mode or a device location that is not allowed."""


class CompileError(ValueError):
    """No method covers the scene within its error bound, or the selected one does not apply."""


class DesignError(ValueError):
    """A controller or an absorber cannot be designed for the scene; the message says why."""


class OutOfReachError(DesignError):
    """No stretch of the scene's springs gives the required stiffness."""


class ActionError(ValueError):
    """An action has the wrong type or shape, or is not finite. The state is unchanged."""


class SimulationError(RuntimeError):
    """A simulation cannot be completed; the message says where and why."""


ERRORS = (
    *(ActionError, CompileError, DesignError, SceneError, SimulationError),
    *(OSError, MemoryError),
    UnicodeEncodeError,  # of a name that the output's encoding has no letters for
)
"""What a command tells in one message, next to what a missing package raises."""


def refuse(field: str, got: str, allowed: str, error: type[Exception] = SceneError) -> NoReturn:
    """Raise an error that says what a field has, and what it may have."""
    msg = f"{field}: got {got}; allowed: {allowed}"
    raise error(msg)


def check_name(
    field: str, name: str, allowed: Iterable[str], error: type[Exception] = SceneError
) -> None:
    """Refuse a value that is none of the allowed names, and say the nearest."""
    names = tuple(allowed)
    if not isinstance(name, str) or name not in names:  # pyright: ignore[reportUnnecessaryIsInstance] - callers may not check types
        refuse(field, f"{name!r}{suggest(str(name), names)}", ", ".join(names), error)


def as_array(field: str, value: object, error: type[Exception] = SceneError) -> NDArray[np.generic]:
    """Return a value as an array of any type; refuse rows of different lengths."""
    try:
        return np.asarray(value)
    except ValueError as problem:
        msg = f"{field}: not an array: {problem}"
        raise error(msg) from None


def finite_numbers(
    field: str, value: object, error: type[Exception] = SceneError
) -> NDArray[np.float64]:
    """Return finite numbers as an array; refuse anything else."""
    array = as_array(field, value, error)
    if array.size and array.dtype.kind not in "fiu":
        refuse(field, f"type {array.dtype}", "numbers", error)
    if not np.isfinite(array).all():
        refuse(field, "NaN or infinity", "finite numbers", error)
    return array.astype(np.float64)


def finite_number(
    field: str, value: object, error: type[Exception] = SceneError, above: float = -np.inf
) -> float:
    """Return a finite number greater than another; refuse anything else."""
    number = as_array(field, value, error)
    if number.shape or number.dtype.kind not in "fiu" or not above < float(number) < np.inf:
        greater = "" if above == -np.inf else f" greater than {above:g}"
        refuse(field, f"{value!r}", f"a finite number{greater}", error)
    return float(number)


def positive_number(field: str, value: object, error: type[Exception] = SceneError) -> float:
    """Return a finite number greater than 0; refuse anything else."""
    return finite_number(field, value, error, above=0.0)


def whole_number(
    field: str,
    value: int | np.integer,
    least: int = 1,
    most: float = np.inf,
    error: type[Exception] = SceneError,
) -> int:
    """Return an integer of Python or NumPy from `least` to `most`; refuse anything else."""
    is_integer = type(value) is int or isinstance(value, np.integer)
    if not is_integer or not least <= value <= most:
        some = f"of at least {least}" if most == np.inf else f"from {least} to {most}"
        refuse(field, f"{value!r}", f"an integer {some}", error)
    return int(value)


def suggest(name: str, allowed: Iterable[str]) -> str:
    """Return ``"; did you mean 'x'?"`` for the nearest allowed name, or an empty string."""
    nearest = get_close_matches(name, list(allowed), n=1)
    return f"; did you mean {nearest[0]!r}?" if nearest else ""
