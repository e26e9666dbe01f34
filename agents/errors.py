"""What a command tells in a line, without a traceback, and how it ends."""

import sys
from collections.abc import Callable
from functools import wraps
from typing import NoReturn, TypeAlias, get_type_hints

from gymnasium.error import DependencyNotInstalled
from tyro import cli

from agents.network.files import PolicyError
from agents.training.config import settings_from_command_line
from agents.training.runs import INTERRUPTED, RunError
from mm_gym.errors import ERRORS
from mm_gym.scene import Document

Outcome: TypeAlias = str | int | None  # how a command ends: with an error's text, a status, or well


class DatasetError(RuntimeError):
    """A dataset cannot be written."""


EVERY = (*ERRORS, DatasetError, DependencyNotInstalled, PolicyError, RunError)

FAILED = 2  # exit status after an error, that of a wrong flag and of `mm_gym` too


def command(main: Callable[..., Outcome]) -> Callable[[], Outcome]:
    """Let a function be a command, which returns the text of an error, and the status of Ctrl-C.

    Its module's docstring says what it does. Its only argument, if it is a class, has the flags:
    named settings may also come from a file. Otherwise its arguments are flags.
    """

    @wraps(main)
    def ended() -> Outcome:
        try:
            return _called(main)
        except EVERY as error:
            return f"error: {error}"
        except KeyboardInterrupt as interrupt:
            told = interrupt.args  # how far it came, and what to do
            done, advice = (*told, *("", "give the same command again")[len(told) :])
            print(f"{f'interrupted {done}'.rstrip()}: {advice}", file=sys.stderr)
            return INTERRUPTED

    return ended


def _called(main: Callable[..., Outcome]) -> Outcome:
    """Call a function with what the command line says."""
    text = (sys.modules[main.__module__].__doc__ or "").replace("``", "`")
    description = "\n\n".join(" ".join(part.split()) for part in text.split("\n\n"))
    kind = next(iter(get_type_hints(main).values()))
    if not (isinstance(kind, type) and issubclass(kind, Document)):
        return cli(main, description=description)
    if "name" in kind.model_fields:
        return main(settings_from_command_line(kind, description))
    return main(cli(kind, description=description))


def leave(outcome: Outcome) -> NoReturn:
    """End the process with a status, or with an error's text on standard error."""
    if isinstance(outcome, str):
        print(outcome, file=sys.stderr)
        sys.exit(FAILED)
    sys.exit(outcome)
