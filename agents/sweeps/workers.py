"""Processes that do the trainings of a sweep, on this machine or on a Ray cluster.

Either way a training has one processor and one thread, and one whose process was killed is done
again from its checkpoint.
"""

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TypeAlias

from gymnasium.error import DependencyNotInstalled

from agents.sweeps.trials import do_trial

Trials: TypeAlias = Sequence[tuple[str, str]]
Report: TypeAlias = Callable[[int, str | None], None]

ROOT = Path(__file__).parents[2]

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""Environment of a process that trains."""

MOST_KILLS = 20
"""Kills of one training after which it is given up, so that none keeps a sweep busy forever."""

GIVEN_UP = f"its process was killed {MOST_KILLS} times"

PAUSE = 0.05  # time between two looks at the processes [s]


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
    waiting, kills = list(range(len(trials))), [0] * len(trials)
    running: dict[int, tuple[BaseProcess, Connection]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < (processes or os.cpu_count() or 1):
                number = waiting.pop(0)
                answer, call = context.Pipe(duplex=False)
                process = context.Process(target=_work, args=(*trials[number], call))
                process.start()
                call.close()  # so that an answer ends with the process
                running[number] = process, answer
            time.sleep(PAUSE)
            for number in [n for n, (process, _) in running.items() if not process.is_alive()]:
                _, answer = running.pop(number)
                try:
                    problem = answer.recv()
                except (EOFError, OSError):  # killed before its answer, or within it
                    kills[number] += 1
                    if kills[number] < MOST_KILLS:
                        waiting.insert(0, number)
                        continue
                    problem = GIVEN_UP
                report(number, problem)
    except KeyboardInterrupt:
        for process, _ in running.values():
            process.join()  # it writes its checkpoint
        raise
    finally:
        for name in ONE_THREAD:
            os.environ.pop(name)
        os.environ |= before


def _work(text: str, folder: str, call: Connection) -> None:
    """Do a training in this process, and say what went wrong or None."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        call.send(_done(text, folder))
    except KeyboardInterrupt:
        call.send("interrupted")


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
    try:
        import ray  # noqa: PLC0415 - an extra
    except ImportError as error:
        msg = "--ray needs Ray: install the extra `ray`"
        raise DependencyNotInstalled(msg) from error
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
