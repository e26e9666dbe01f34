"""Lanes shared among threads."""

from __future__ import annotations

import os
from functools import partial
from math import ceil
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np
from numba.np.ufunc import get_num_threads, threading_layer

from mm_gym.kernels import layout as at
from mm_gym.kernels.jit import COMPILED, entry_point
from mm_gym.kernels.threads import address_of, in_threads, nothing

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Kernel = Callable[..., int]

_turn = Lock()
"""Some of numba's threading layers serve one caller at a time."""

_alone = False
"""Whether this process was forked from one whose threads it has not inherited."""


class Threads:
    """So many lanes, shared among numba's threads.

    Parameters
    ----------
    count
        Number of lanes.
    threads
        Number of shares at most. No more of numba's threads work than it lets the caller use.
    """

    def __init__(self, count: int, threads: int) -> None:
        # Whole blocks for each thread, so that none works on the cache lines of another.
        length = at.BLOCK * ceil(count / (at.BLOCK * threads))
        self._statuses = np.zeros(ceil(count / length), np.int64)
        self._place = (self._statuses, length, count)
        self._whole = (0, count)
        self.are_several = len(self._statuses) > 1 and COMPILED
        if self.are_several:
            with _turn:
                _launch()

    def bind(
        self,
        work: Kernel,
        *arguments: object,
        then: tuple[Kernel, tuple[object, ...]] | None = None,
    ) -> Kernel:
        """Return a function that has a kernel work on all lanes, and returns the largest status.

        The function's arguments follow those given here; the first is an array, whose type tells
        those of the others. The kernel's last two are the first lane and the one after the last.

        Parameters
        ----------
        then
            A kernel and its arguments that works on each share as soon as the first is done with
            it. Of the function's arguments it gets all but one.
        """
        second, others = then or (nothing, ())
        whole = self._whole

        def alone(*more: NDArray[Any]) -> int:
            if then is None:
                return work(*arguments, *more, *whole)
            status = work(*arguments, more[0], *whole)
            second(*others, *more[1:], *whole)
            return status

        if not self.are_several:
            return alone
        ready: dict[np.dtype[Any], Kernel] = {}

        def share(*more: NDArray[Any]) -> int:
            if _alone:
                return alone(*more)
            own = len(more) if then is None else 1
            calls = (*arguments, *more[:own]), (*others, *more[own:])
            kind = more[0].dtype
            work_in_shares = ready.get(kind)
            if work_in_shares is None:
                work_in_shares = ready[kind] = self._compiled((work, second), calls)
            with _turn:
                return work_in_shares(*calls)

        return share

    def _compiled(
        self, works: tuple[Kernel, Kernel], calls: tuple[tuple[object, ...], tuple[object, ...]]
    ) -> Kernel:
        """Return what has two kernels work in shares, given such arguments."""
        addresses = [
            address_of(work, *call, *self._whole) for work, call in zip(works, calls, strict=True)
        ]
        place = (*addresses, *self._place)
        return partial(entry_point(in_threads, *place, *calls), *place)


def _launch() -> None:
    """Start numba's threads, if they are not running, and let them wait awake for some 0.1 ms only.

    GNU's OpenMP lets them for 15 ms. Where there is more to do than there are processors, they
    would keep the very thread that they wait for from running: a step of 50 us took 3 ms.
    """
    if "GOMP_SPINCOUNT" in os.environ or "OMP_WAIT_POLICY" in os.environ:
        get_num_threads()
        return
    os.environ["GOMP_SPINCOUNT"] = "2000"  # read when OpenMP is loaded
    try:
        get_num_threads()
    finally:
        del os.environ["GOMP_SPINCOUNT"]


def _after_fork() -> None:
    """Work alone if numba's threads ran: OpenMP ends a forked process that calls it again."""
    global _alone  # noqa: PLW0603 - a fact about the process
    try:
        threading_layer()
    except ValueError:  # none ran
        return
    _alone = True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
