"""The numbers that searches choose while a controller is designed.

With the same numbers the design is repeated without the searches. A search asks `chosen` for its
number; the numbers are in the order in which they are asked for.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

from mm_gym import SceneError
from mm_gym.errors import refuse

Kept = TypeVar("Kept")
Made = TypeVar("Made")

WHAT = "a searched controller"

_NOTED: ContextVar[list[float] | None] = ContextVar("noted", default=None)
_KNOWN: ContextVar[deque[float] | None] = ContextVar("known", default=None)


def recorded(
    make: Callable[[], Made], numbers: Sequence[float] | None = None, file: object = "run.json"
) -> tuple[Made, Sequence[float]]:
    """Return what is made, and the numbers that its searches chose.

    With the numbers of an earlier call nothing is searched. Raise `SceneError`, which names their
    file, if there are more or fewer of them than are asked for, or nothing can be made with them.
    """
    if numbers is None:
        noted: list[float] = []
        with _with(_NOTED, noted):
            return make(), noted
    known = deque(numbers)
    try:
        with _with(_KNOWN, known):
            made = make()
        if known:
            refuse(WHAT, f"{len(numbers)} numbers", f"{len(numbers) - len(known)}")
    except (ArithmeticError, ValueError) as error:  # this project's errors among them
        advice = "restore the file, or delete its `numbers`: the controller is then searched anew"
        msg = f"{file}: numbers: {error.args[-1]}; {advice}"
        raise SceneError(msg) from error
    return made, numbers


def is_remade() -> bool:
    """Tell whether the design in progress uses known numbers in place of searches."""
    return _KNOWN.get() is not None


def note(numbers: Iterable[float]) -> None:
    """Add chosen numbers to the record of the design in progress, if there is one."""
    noted = _NOTED.get()
    if noted is not None:
        noted.extend(numbers)


def chosen(search: Callable[[], float]) -> float:
    """Return the known number, or else the one that a search finds.

    Numbers of the designs that the search tries are not recorded.
    """
    known = _KNOWN.get()
    if known is None:
        with _with(_NOTED, None):
            found = search()
        note([found])
        return found
    if not known:
        refuse(WHAT, "too few numbers", "as many as the controller chooses")
    return known.popleft()


def chosen_place(search: Callable[[], int], count: int) -> int:
    """Return the known place in a list of `count`, or else the one that a search finds."""
    place = chosen(search)
    if place not in range(count):
        refuse(WHAT, f"{place:g} as a place among {count}", f"0 to {count - 1}")
    return int(place)


@contextmanager
def _with(variable: ContextVar[Kept], value: Kept) -> Iterator[None]:
    token = variable.set(value)
    try:
        yield
    finally:
        variable.reset(token)
