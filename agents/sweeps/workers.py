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
from multiprocessing.connection import Connection
from multiprocessing.context import BaseContext
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


def work_here(trials: Trials, processes: int | None, report: Report) -> None:
    """Do all trainings on this machine, each in a process of its own.

    Parameters
    ----------
    trials
        The arguments of `do_trial` of each.
    processes
        Trainings at once; by default one for each processor.
    report
        Called with the number of a training that is over, and what went wrong or None.
    """
    before = dict(os.environ)
    os.environ |= ONE_THREAD  # of the processes, which inherit it
    # Windows knows no fork.
    way = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
    context = multiprocessing.get_context(way)
    context.set_forkserver_preload(["agents.training.reinforcement"])
    threads = ThreadPoolExecutor(processes or os.cpu_count() or 1)  # each waits for a process
    try:
        jobs = {threads.submit(_watched, context, *trial): k for k, trial in enumerate(trials)}
        for job in as_completed(jobs):
            report(jobs[job], job.result())
    finally:
        # After Ctrl-C, those that run write their checkpoints.
        threads.shutdown(cancel_futures=True)
        for name in ONE_THREAD:
            os.environ.pop(name)
        os.environ |= before


def _watched(context: BaseContext, text: str, folder: str) -> str | None:
    """Do a training in a process of its own, again if it is killed; return what went wrong."""
    for _ in range(MOST_KILLS):
        answer, call = context.Pipe(duplex=False)
        process = context.Process(target=_work, args=(text, folder, call))
        process.start()
        call.close()  # so that an answer ends with the process
        with suppress(EOFError, OSError):  # killed before its answer, or within it
            return answer.recv()
    return GIVEN_UP


def _work(text: str, folder: str, call: Connection) -> None:
    """Do a training in this process, and say what went wrong or None."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Thread(target=_end_with_sweep, daemon=True).start()
    with suppress(BrokenPipeError):  # nobody is there to be told
        try:
            call.send(_done(text, folder))
        except KeyboardInterrupt:
            call.send("interrupted")


def _end_with_sweep() -> None:
    """Interrupt this process, so that it writes a checkpoint, once that of the sweep is gone."""
    sweep = multiprocessing.parent_process()
    if sweep is not None:
        sweep.join()
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
