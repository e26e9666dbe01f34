"""Does the reference show every command that there is?"""

import argparse
import re
from pathlib import Path

import pytest

from agents.__main__ import commands
from mm_gym import __main__ as physics

PAGE = (Path(__file__).parents[2] / "docs/reference/commands.md").read_text("utf-8")


def physics_commands():
    """Return the names of the commands of `python -m mm_gym`."""
    (choice,) = (
        action
        for action in physics._parser()._actions
        if isinstance(action, argparse._SubParsersAction)
    )
    return choice.choices


@pytest.mark.parametrize(
    ("program", "names"), [("agents", commands()), ("mm_gym", physics_commands())]
)
def test_every_command_is_in_the_reference(program, names):
    shown = re.findall(rf"program-output}} python -m {program} ([\w-]+) --help", PAGE)
    assert sorted(shown) == sorted(names)
