"""A crew of threads that share the lanes of a step."""

from __future__ import annotations

import os
from queue import SimpleQueue
from threading import Thread
from typing import TYPE_CHECKING, Any
from weakref import finalize

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Work = Callable[[int, int], Any]


class Crew:
    """Threads that wait for shares of work.

    Handing over a share takes half as long as to an executor of `concurrent.futures`.

    Parameters
    ----------
    size
        Number of threads, besides the one that calls.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._hire()

    def share(
        self, work: Callable[[int, int], Any], shares: Sequence[tuple[int, int]]
    ) -> list[Any]:
        """Return what ``work(first, last)`` returns for each share, in any order.

        The caller does the first. Whatever one of them raises is raised when all are done.
        """
        if self._process != os.getpid():
            self._hire()  # threads do not survive a fork
        results: SimpleQueue[tuple[Any, BaseException | None]] = SimpleQueue()
        for share in shares[1:]:
            self._inbox.put((work, share, results))
        _do(work, shares[0], results)
        done = [results.get() for _ in shares]
        for _, error in done:
            if error is not None:
                raise error
        return [result for result, _ in done]

    def dismiss(self) -> None:
        """End the threads."""
        self._end()

    def _hire(self) -> None:
        self._process = os.getpid()
        self._inbox: SimpleQueue[Any] = SimpleQueue()
        for _ in range(self._size):
            Thread(target=_serve, args=(self._inbox,), name="mm_gym", daemon=True).start()
        # The threads know the queue only, so that a forgotten crew ends them.
        self._end = finalize(self, _dismiss, self._inbox, self._size)


def _serve(inbox: SimpleQueue[Any]) -> None:
    while (order := inbox.get()) is not None:
        _do(*order)
        del order  # or what it refers to would live until the next


def _do(
    work: Work,
    share: tuple[int, int],
    results: SimpleQueue[tuple[Any, BaseException | None]],
) -> None:
    try:
        results.put((work(*share), None))
    except BaseException as error:  # noqa: BLE001 - raised where the results are collected
        results.put((None, error))


def _dismiss(inbox: SimpleQueue[Any], size: int) -> None:
    for _ in range(size):
        inbox.put(None)
