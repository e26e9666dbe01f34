"""Threads that share work: all of it is done, errors arrive, and nothing hangs."""

import gc
import os
import signal
import threading

import pytest

from mm_gym.crew import Crew

SHARES = [(0, 2), (2, 5), (5, 9)]
SECONDS = 10


def test_every_share_is_done_once() -> None:
    crew = Crew(2)
    for _ in range(200):
        assert sorted(crew.share(lambda first, last: last - first, SHARES)) == [2, 3, 4]
    crew.dismiss()


@pytest.mark.parametrize("culprit", [0, 5])
def test_an_error_is_raised_when_all_are_done(culprit: int) -> None:
    crew, done = Crew(2), []

    def work(first: int, last: int) -> None:
        done.append((first, last))
        if first == culprit:
            raise KeyError(first)

    with pytest.raises(KeyError, match=str(culprit)):
        crew.share(work, SHARES)
    assert sorted(done) == SHARES
    assert len(crew.share(lambda first, last: last - first, SHARES)) == len(SHARES)
    crew.dismiss()


@pytest.mark.parametrize("forget", [False, True])
def test_a_dismissed_or_forgotten_crew_ends(*, forget: bool) -> None:
    before = set(threading.enumerate())
    crew = Crew(2)
    crew.share(lambda first, last: last - first, SHARES)
    hired = set(threading.enumerate()) - before
    assert len(hired) == 2
    if forget:
        del crew
        gc.collect()
    else:
        crew.dismiss()
    for thread in hired:
        thread.join(SECONDS)
        assert not thread.is_alive()


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_crew_works_in_a_forked_process() -> None:
    crew = Crew(2)
    child = os.fork()
    if child == 0:
        signal.alarm(SECONDS)
        os._exit(len(crew.share(lambda first, last: last - first, SHARES)))
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == len(SHARES)
    crew.dismiss()
