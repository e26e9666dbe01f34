"""What a command tells in a line, without a traceback, and how it ends."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import wraps
from typing import NoReturn, TypeAlias

from gymnasium.error import DependencyNotInstalled

from agents.network.files import PolicyError
from agents.training.runs import INTERRUPTED, RunError
from mm_gym import ActionError, CompileError, DesignError, SceneError, SimulationError

Outcome: TypeAlias = str | int | None  # how a command ends: with an error's text, a status, or well


class DatasetError(RuntimeError):
    """A dataset cannot be written."""


ERRORS = (
    ActionError,
    CompileError,
    ConnectionError,  # no cluster
    DatasetError,
    DependencyNotInstalled,
    DesignError,
    OSError,  # a full disk
    PolicyError,
    RunError,
    SceneError,
    SimulationError,
)

FAILED = 2  # exit status after an error, that of a wrong flag and of `mm_gym` too


def command(main: Callable[[], Outcome]) -> Callable[[], Outcome]:
    """Let a command return the text of an error, and the status of Ctrl-C, which is told."""

    @wraps(main)
    def ended() -> Outcome:
        try:
            return main()
        except ERRORS as error:
            return f"error: {error}"
        except KeyboardInterrupt as interrupt:
            told = interrupt.args  # how far it came, and what to do
            done, advice = (*told, *("", "give the same command again")[len(told) :])
            print(f"{f'interrupted {done}'.rstrip()}: {advice}", file=sys.stderr)
            return INTERRUPTED

    return ended


def leave(outcome: Outcome) -> NoReturn:
    """End the process with a status, or with an error's text on standard error."""
    if isinstance(outcome, str):
        print(outcome, file=sys.stderr)
        sys.exit(FAILED)
    sys.exit(outcome)
