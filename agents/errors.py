"""What a command tells in a line, without a traceback, and how it ends."""

from __future__ import annotations

import sys
from typing import NoReturn

from gymnasium.error import DependencyNotInstalled

from agents.policy_file import PolicyError
from agents.training.runs import RunError
from mm_gym import ActionError, CompileError, DesignError, SceneError, SimulationError


class DatasetError(RuntimeError):
    """A dataset cannot be written."""


ERRORS = (
    ActionError,
    CompileError,
    DatasetError,
    DependencyNotInstalled,
    DesignError,
    OSError,  # a full disk
    PolicyError,
    RunError,
    SceneError,
    SimulationError,
)

FAILED = 2
"""Exit status after an error, that of a wrong flag and of `mm_gym` too."""


def leave(outcome: str | int | None) -> NoReturn:
    """End the process with a status, or with an error's text on standard error."""
    if isinstance(outcome, str):
        print(outcome, file=sys.stderr)
        sys.exit(FAILED)
    sys.exit(outcome)
