"""Lanes divided among numba's threads.

A pool of Python's threads hands over too slowly for a step of 16,384 lanes: two of them are 0.5
times as fast as one thread on CarriageForce and 1.1 times on PreStretch, where numba's are 1.5 and
1.8 times. Dry friction and the cubic spring gain twice with either. Sweeps, which take seconds, use
Python's pool (`mm_gym.analysis.bifurcation`).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from math import ceil
from threading import Lock
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from mm_gym.compiler.addresses import address_of
from mm_gym.compiler.jit import LINKED, entry_point
from mm_gym.lanes import layout
from mm_gym.lanes.threads import in_threads, nothing

Kernel = Callable[..., int]

_turn = Lock()  # some of numba's threading layers serve one caller at a time

_forked = False  # whether this process was forked from one whose threads it has not inherited


class Threads:
    """A number of lanes, divided among numba's threads.

    Parameters
    ----------
    count
        Number of lanes.
    threads
        Number of threads at most; never more than numba lets the caller use.

    Attributes
    ----------
    are_several
        Whether there are lanes for more than one thread.
    """

    def __init__(self, count: int, threads: int) -> None:
        # Whole blocks for each thread, so that no two write to the same cache line.
        length = layout.BLOCK * ceil(count / (layout.BLOCK * threads))
        self._statuses = np.zeros(ceil(count / length), np.int64)
        self._ranges = (self._statuses, length, count)
        self._all_lanes = (0, count)
        self.are_several = len(self._statuses) > 1 and LINKED
        if self.are_several:
            with _turn:
                _launch()

    def bind(
        self,
        work: Kernel,
        *arguments: object,
        then: tuple[Kernel, tuple[object, ...]] | None = None,
    ) -> Kernel:
        """Return a function that runs a kernel on all lanes and returns the largest status.

        Parameters
        ----------
        work
            A kernel ``(*arguments, *more, first, last) -> status``. The function takes `more`. Its
            first is an array, and kernels are compiled again only for another dtype of it.
        then
            A kernel and its arguments that each thread runs on its lanes as soon as `work` is done
            with them. Then `work` takes the first two of `more`, and this kernel the others.
        """
        second, others = then or (nothing, ())
        all_lanes = self._all_lanes
        entries: dict[np.dtype[Any], Kernel] = {}

        def in_one_thread(*more: NDArray[Any]) -> int:
            if then is None:
                run = entries.get(more[0].dtype)
                if run is None:
                    run = entry_point(work, *arguments, *more, *all_lanes)
                    entries[more[0].dtype] = run
                return run(*arguments, *more, *all_lanes)
            status = work(*arguments, *more[:2], *all_lanes)
            second(*others, *more[2:], *all_lanes)
            return status

        if not self.are_several:
            return in_one_thread
        compiled: dict[np.dtype[Any], Kernel] = {}

        def in_several_threads(*more: NDArray[Any]) -> int:
            if _forked:
                return in_one_thread(*more)
            own = len(more) if then is None else 2
            calls = (*arguments, *more[:own]), (*others, *more[own:])
            dtype = more[0].dtype
            run = compiled.get(dtype)
            if run is None:
                run = compiled[dtype] = self._compiled((work, second), calls)
            with _turn:
                return run(*calls)

        return in_several_threads

    def _compiled(
        self, kernels: tuple[Kernel, Kernel], calls: tuple[tuple[object, ...], tuple[object, ...]]
    ) -> Kernel:
        """Return a function that runs two kernels in threads, given arguments like these."""
        addresses = [
            address_of(kernel, *call, *self._all_lanes)
            for kernel, call in zip(kernels, calls, strict=True)
        ]
        constants = (*addresses, *self._ranges)
        return partial(entry_point(in_threads, *constants, *calls), *constants)


def _launch() -> None:
    """Start numba's threads, if they are not running, and let them wait actively for 0.1 ms only.

    By default GNU's OpenMP lets them for 15 ms. Where there are fewer free processors than threads,
    they would keep the very thread that they wait for from running: a step of 50 us took 3 ms.
    """
    if "GOMP_SPINCOUNT" in os.environ or "OMP_WAIT_POLICY" in os.environ:
        numba.get_num_threads()
        return
    os.environ["GOMP_SPINCOUNT"] = "2000"  # read when OpenMP is loaded
    try:
        numba.get_num_threads()
    finally:
        del os.environ["GOMP_SPINCOUNT"]


def _after_fork() -> None:
    """Use one thread if numba's threads ran: OpenMP ends a forked process that calls it again."""
    global _forked  # noqa: PLW0603 - a fact about the process
    try:
        numba.threading_layer()  # pyright: ignore[reportPrivateImportUsage] - documented
    except ValueError:  # none ran
        return
    _forked = True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
