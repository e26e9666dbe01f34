"""Does the table at the end of docs/model.md name what exists?"""

import ast
import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TABLE = (ROOT / "docs" / "model.md").read_text("utf-8").partition("## 9. ")[2]
NAMES = sorted(set(re.findall(r"`((?:\w+\.)+\w+)`", TABLE)))
TESTS = sorted(set(re.findall(r"`(\w+/\w+\.py)::(\w+)`", TABLE)))


def test_table_has_every_equation():
    rows = [line.split("|")[1] for line in TABLE.splitlines() if line.startswith("| (")]
    found = set()
    for row in rows:
        for first, last in re.findall(r"\((\d+)\)(?:\u2013\((\d+)\))?", row.partition(";")[0]):
            found |= set(range(int(first), int(last or first) + 1))
    assert found == set(range(1, 22))


@pytest.mark.parametrize("name", NAMES)
def test_name_is_in_the_package(name):
    holder, _, last = name.rpartition(".")
    assert hasattr(importlib.import_module(f"mm_gym.{holder}"), last)


@pytest.mark.parametrize(("file", "test"), TESTS)
def test_test_exists(file, test):
    tree = ast.parse((ROOT / "tests" / file).read_text("utf-8"))
    assert test in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
