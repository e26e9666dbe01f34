"""Does every result on a generated page come from data, and none from a constant in code?"""

import ast
import re
from pathlib import Path

import pytest

from agents import report
from mm_gym.tasks import ids

TASK = "|".join(name.removeprefix("mm_gym/").rpartition("-v")[0] for name in ids())
RESULT = re.compile(rf"\b({TASK})\b|\d\.\d|\d %|\b(than|twice|times|half|gains|loses)\b")
"""What a sentence on a result has: a task, a measured number, or a comparison."""

NO_RESULT = {
    "95 %": "the level of all intervals",
    "does better than that of a column": "says what a cell is",
    "costs more than the specialist on the task without delay": "the same",
    "reads more than an agent": "says what a colour is",
    "cost less than the best controller in": "says what a cell is",
    "fewer than seeds": "precedes a list from data",
    "Costs above twice that cost are left out": "says what a figure leaves out",
    "no better than the best constant": "a sentence that costs choose",
    "costs less than": "the same",
    'gymnasium.make("mm_gym/PreStretch-v0")': "a program",
    "never returned more energy than": "says what zero means",
    "an early end is worse than": "follows from the definition above it",
    "0.4": "a grey",
    "made for another scene than": "an error",
    "cost less than its own": "says what a cell is",
    "A policy of more than kB": "says what the page leaves out",
    "evaluate docs/policies/PreStretch": "a command",
    "by less than the interval": "precedes a list from data",
    "the difference is less than": "precedes a margin from data",
    "On each variant an agent for the rigs": "a sentence that costs choose",
    "costs at most more than the clairvoyant": "the same",
}
"""Part of a sentence -> why it is no result."""


def sentences(path):
    """Yield the sentences of all strings of a module that are not docstrings."""
    tree = ast.parse(path.read_text("utf-8"))
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and id(node) not in docstrings:
            parts = re.split(r"[.:;]\s", node.value) if isinstance(node.value, str) else ()
            yield from (" ".join(part.split()) for part in parts)


def written(path):
    """Yield the sentences of a template, without the names of data in it."""
    text = re.sub(r"{[{%].*?[%}]}", "", path.read_text("utf-8"), flags=re.DOTALL)
    yield from (" ".join(part.split()) for part in re.split(r"[.:;]\s", text))


ROOM = Path(report.__file__).parent
FOUND = [
    (path.name, sentence)
    for read, pattern in ((sentences, "*.py"), (written, "templates/*.jinja"))
    for path in sorted(ROOM.glob(pattern))
    for sentence in read(path)
    if RESULT.search(sentence)
]


def test_generators_of_pages_state_no_result():
    stated = [one for one in FOUND if not any(part in one[1] for part in NO_RESULT)]
    assert stated == [], "compute it from the data of the page"


@pytest.mark.parametrize("part", NO_RESULT)
def test_every_exception_is_still_needed(part):
    assert any(part in sentence for _, sentence in FOUND)
