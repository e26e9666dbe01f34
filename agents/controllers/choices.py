"""What searches choose when a controller is made, so that it is made again without them.

A search asks `chosen` for its number. The numbers stand in the order in which they are asked for,
and what is made is the same whenever the answers are.
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

_NOTED: ContextVar[list[float] | None] = ContextVar("noted", default=None)
_KNOWN: ContextVar[deque[float] | None] = ContextVar("known", default=None)


def recorded(
    make: Callable[[], Made], numbers: Sequence[float] | None = None
) -> tuple[Made, Sequence[float]]:
    """Return what is made, and the numbers that its searches chose, or chose before if known.

    Raise `SceneError` if known numbers are not as many as are asked for, or not of the kind.
    """
    if numbers is None:
        noted: list[float] = []
        with _with(_NOTED, noted):
            return make(), noted
    known = deque(numbers)
    with _with(_KNOWN, known):
        made = make()
    if known:
        _refuse(f"{len(numbers)} numbers", f"{len(numbers) - len(known)}")
    return made, numbers


def is_remade() -> bool:
    """Tell whether what is being made takes numbers that are known."""
    return _KNOWN.get() is not None


def note(numbers: Iterable[float]) -> None:
    """Note numbers that were chosen, for what is being made."""
    noted = _NOTED.get()
    if noted is not None:
        noted.extend(numbers)


def chosen(search: Callable[[], float]) -> float:
    """Return the number that a search finds, or the one that is known.

    What the search makes and drops is not noted.
    """
    known = _KNOWN.get()
    if known is None:
        with _with(_NOTED, None):
            found = search()
        note([found])
        return found
    if not known:
        _refuse("fewer numbers than are asked for", "all of them")
    return known.popleft()


def chosen_place(search: Callable[[], int], count: int) -> int:
    """Return the place among so many that a search finds, or the one that is known."""
    place = chosen(search)
    if place not in range(count):
        _refuse(f"{place:g} as a place among {count}", f"0 to {count - 1}")
    return int(place)


def _refuse(got: str, allowed: str) -> None:
    advice = "restore the record, or delete its `numbers`: the controller is then searched anew"
    refuse("numbers of a searched controller", got, f"{allowed}; {advice}", SceneError)


@contextmanager
def _with(variable: ContextVar[Kept], value: Kept) -> Iterator[None]:
    token = variable.set(value)
    try:
        yield
    finally:
        variable.reset(token)
