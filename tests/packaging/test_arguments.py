"""Functions take few arguments: those that travel together are a record with a name."""

import ast
from pathlib import Path

import mm_gym

REPOSITORY = Path(mm_gym.__file__).parents[1]

MOST = 10


def functions_of(room):
    """Yield the names of a room's functions, each with how many arguments a caller gives."""
    for file in sorted((REPOSITORY / room).rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                own = node.args
                names = [one.arg for one in own.posonlyargs + own.args + own.kwonlyargs]
                count = len(names) - (names[:1] in (["self"], ["cls"]))
                yield f"{file.relative_to(REPOSITORY)}:{node.lineno} {node.name}", count


def test_functions_take_ten_arguments_at_most():
    found = {name: count for room in ("mm_gym", "agents") for name, count in functions_of(room)}
    assert len(found) > 1000
    assert {name: count for name, count in found.items() if count > MOST} == {}
