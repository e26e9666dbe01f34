"""The processes that do a sweep's trainings, on this machine or on a Ray cluster.

Either way a training has one processor and one thread, and one whose process was killed is done
again from its checkpoint.
"""

import _thread
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TypeAlias

from agents.sweeps.trials import do_trial
from mm_gym.extras import optional

Trials: TypeAlias = Sequence[tuple[str, str]]
Report: TypeAlias = Callable[[int, str | None], None]

ROOT = Path(__file__).parents[2]

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""Environment of a process that trains."""

MOST_KILLS = 20
"""Kills of one training after which it is given up, so that none keeps a sweep busy forever."""

GIVEN_UP = f"its process was killed {MOST_KILLS} times"
STOPPED = "interrupted"


def work_here(trials: Trials, processes: int | None, report: Report) -> None:
    """Do all trainings on this machine, each in a process of its own.

    Ctrl-C, and whatever else ends this early, interrupts those that run: they write their
    checkpoints first. A second Ctrl-C kills them.

    Parameters
    ----------
    trials
        The arguments of `do_trial` of each.
    processes
        Trainings at once; by default one for each processor.
    report
        Called with the number of a training that is over, and what went wrong or None.
    """
    if not trials:
        return
    before = dict(os.environ)
    threads = ThreadPoolExecutor(processes or os.cpu_count() or 1)  # each waits for a process
    workers = _Workers()
    try:
        os.environ |= ONE_THREAD  # of the processes, which inherit it
        workers.begin()
        jobs = {threads.submit(workers.do, *trial): k for k, trial in enumerate(trials)}
        for job in as_completed(jobs):
            report(jobs[job], job.result())
    finally:
        try:
            workers.interrupt()
            threads.shutdown(cancel_futures=True)
        finally:
            workers.kill()
            for name in ONE_THREAD:
                os.environ.pop(name, None)
            os.environ |= before


class _Workers:
    """The processes of trainings: they work until this one interrupts them, or is gone."""

    def __init__(self) -> None:
        # Windows knows no fork.
        forks = "forkserver" in multiprocessing.get_all_start_methods()
        self._context = multiprocessing.get_context("forkserver" if forks else "spawn")
        # Processes wait for the end of the line, which also comes when nobody holds it any more.
        self._line, self._held = self._context.Pipe(duplex=False)
        self._running: set[BaseProcess] = set()
        self._over = False

    def begin(self) -> None:
        """Begin the process from which the others fork, where they do."""
        if self._context.get_start_method() == "forkserver":
            self._context.set_forkserver_preload(["agents.training.reinforcement"])
            _begin_server()

    def do(self, text: str, folder: str) -> str | None:
        """Do a training in a process, again if it is killed; return what went wrong."""
        for _ in range(MOST_KILLS):
            if self._over:
                return STOPPED
            answer, call = self._context.Pipe(duplex=False)
            process = self._context.Process(target=_work, args=(text, folder, call, self._line))
            process.start()
            call.close()  # so that an answer ends with the process
            self._running.add(process)
            try:
                return answer.recv()
            except (EOFError, OSError):  # killed before its answer, or within it
                continue
            finally:
                self._running.discard(process)
        return GIVEN_UP

    def interrupt(self) -> None:
        """Let all processes write their checkpoints and end, and begin no others."""
        self._over = True
        self._held.close()

    def kill(self) -> None:
        """Kill all processes that still run."""
        for process in tuple(self._running):
            process.kill()


def _begin_server() -> None:
    """Begin the process from which the others fork, which Ctrl-C in a terminal reaches too."""
    resource_tracker.ensure_running()  # it would let signals through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # a new process inherits it
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _work(text: str, folder: str, call: Connection, line: Connection) -> None:
    """Do a training in this process, and say what went wrong or None."""
    with suppress(BrokenPipeError):  # nobody is there to be told
        try:
            if hasattr(signal, "pthread_sigmask"):  # the sweep tells of Ctrl-C, once
                signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            signal.signal(signal.SIGINT, signal.default_int_handler)
            threading.Thread(target=_end_with_sweep, args=(line,), daemon=True).start()
            outcome = _done(text, folder)
        except KeyboardInterrupt:
            outcome = STOPPED
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the sweep may be over before this process
        call.send(outcome)


def _end_with_sweep(line: Connection) -> None:
    """Interrupt this process, so that it writes a checkpoint, once the sweep is over or gone."""
    with suppress(EOFError, OSError):
        line.recv()
    _thread.interrupt_main()


def _done(text: str, folder: str) -> str | None:
    try:
        do_trial(text, folder)
    except Exception as error:  # noqa: BLE001 - one training's errors do not stop the others
        return f"{type(error).__name__}: {error}"
    return None


def work_on_ray(trials: Trials, address: str | None, processes: int | None, report: Report) -> None:
    """Do all trainings on a Ray cluster, each with one processor.

    Raise `DependencyNotInstalled` if Ray is missing; `ConnectionError` if there is no cluster at
    the address.

    Parameters
    ----------
    trials, report
        As for `work_here`.
    address
        Of a cluster whose machines have this checkout and the sweep's folder under the same paths;
        None begins one on this machine.
    processes
        Processors of a cluster on this machine; by default all.
    """
    ray = optional("ray", "--ray needs Ray: install the extra `ray`")
    ray.init(
        address=address,
        num_cpus=None if address else processes,
        runtime_env={"env_vars": {**ONE_THREAD, "PYTHONPATH": str(ROOT)}},
        include_dashboard=False,
        log_to_driver=False,
    )
    try:
        done = ray.remote(num_cpus=1, max_retries=MOST_KILLS)(_done)
        numbers = {done.remote(*trial): number for number, trial in enumerate(trials)}
        waiting = list(numbers)
        while waiting:
            (reference, *_), waiting = ray.wait(waiting)
            try:
                report(numbers[reference], ray.get(reference))
            except ray.exceptions.RayError as error:
                report(numbers[reference], f"{type(error).__name__}: {error}")
    finally:
        ray.shutdown()
