"""Is docs/paper.md complete, is every line settled, and does every name in it lead somewhere?"""

import re
from collections import Counter
from functools import reduce
from importlib import import_module
from pathlib import Path
from typing import get_args

import gymnasium
import pytest

from mm_gym import Scene
from mm_gym.paper import NAMES
from mm_gym.paper.figures import FIGURES

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
MODEL = (ROOT / "docs" / "model.md").read_text(encoding="utf-8")
LINES = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in PAGE.splitlines()
    if re.match(r"\| \d", line)
]
ERRATA = set(re.findall(r"^\| (E\d+) \|", MODEL, re.MULTILINE))


def is_name_of_python(name):
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        try:
            module = import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        try:
            reduce(getattr, parts[length:], module)
        except AttributeError:
            return False
        return True
    return False


def is_field(name):
    part, _, field = name.partition(".")
    if part not in Scene.model_fields or not field:
        return False
    annotation = Scene.model_fields[part].annotation
    return any(field in one.model_fields for one in get_args(annotation) or (annotation,))


def is_optional_field(name):
    """Tell whether the name is one of `actuation`, whose fields are models or nothing."""
    part, _, field = name.partition(".")
    return part == "actuation" and field in Scene.model_fields[part].annotation.model_fields


def is_test_or_file(name):
    file, _, test = name.partition("::")
    path = ROOT / file
    return path.is_file() and (not test or f"\ndef {test}(" in path.read_text(encoding="utf-8"))


def leads_somewhere(name):
    if name.startswith("mm_gym/") and "-v" in name:
        return name in gymnasium.registry
    if "/" in name:
        return is_test_or_file(name)
    return (
        name in NAMES
        or name in FIGURES
        or is_field(name)
        or is_optional_field(name)
        or is_name_of_python(name)
    )


def test_every_line_has_five_cells_and_they_are_numbered():
    assert [line[0] for line in LINES] == [str(number + 1) for number in range(len(LINES))]
    assert {len(line) for line in LINES} == {5}
    assert all(all(line) for line in LINES)


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`([^`]+)`", " ".join(map(str, LINES))))))
def test_every_name_leads_somewhere(name):
    assert leads_somewhere(name)


def test_names_that_lead_nowhere_would_be_found():
    for name in (
        "fig2g",
        "mm_gym.paper.no_such_name",
        "tests/paper/test_paper.py::test_nothing_of_the_sort",
        "tests/paper/absent.py",
        "mm_gym/Absent-v0",
        "carriage.colour",
    ):
        assert not leads_somewhere(name)


def test_every_equation_section_and_erratum_is_in_the_model():
    for _, _, _, where, verdict in LINES:
        for number in re.findall(r"\((\d+)\)", where):
            assert rf"\tag{{{number}}}" in MODEL, number
        for number in re.findall(r"section (\d+) of \[model\]", where):
            assert f"\n## {number}. " in MODEL
        assert set(re.findall(r"\bE\d+\b", where + verdict)) <= ERRATA


def test_every_line_is_settled():
    kinds = Counter()
    for number, *_, verdict in LINES:
        kind = re.match(r"(agrees|paper wrong: E\d+|not covered, because .+\.$)", verdict)
        assert kind, (number, verdict)
        kinds[kind[0].partition(":")[0].partition(",")[0]] += 1
    counts = f"{kinds['agrees']} agree, {kinds['paper wrong']} name"
    assert f"Of {len(LINES)} lines {counts}" in PAGE
    assert f"and {kinds['not covered']} are not covered" in PAGE


def test_every_erratum_is_a_line_of_the_page():
    assert set(re.findall(r"paper wrong: (E\d+)", PAGE)) == ERRATA


def test_every_symbol_of_the_model_has_a_unit_and_a_field():
    table = MODEL.partition("| symbol |")[2].partition("\n\n")[0]
    rows = [[cell.strip() for cell in row.split("|")[1:-1]] for row in table.splitlines()[2:]]
    symbols = {symbol for row in rows for symbol in row[0].split(", ")}
    assert {"μ1", "μ2", "F_N", "v_r", "χ", "k0", "l0", "λ", "f(w)", "s(ξ)"} <= symbols
    for *_, unit, fields in rows:
        assert unit
        names = re.findall(r"`([^`]+)`", fields)
        assert names
        assert all(is_field(name) or name in Scene.model_fields for name in names)


def test_every_figure_and_every_system_is_named():
    named = set(re.findall(r"`([^`]+)`", PAGE))
    assert set(FIGURES) <= named
    assert {name for name in NAMES if not name.endswith("_caption")} <= named
