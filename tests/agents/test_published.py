"""Do published policies score what their page says, to the last printed digit?"""

import json
import shutil
import sys
from collections import Counter

import pytest

from agents.commands import evaluate as command
from agents.policies import PolicyError
from agents.report.pages import printed
from agents.report.published import (
    FOLDER,
    LARGEST,
    PAGE,
    RECORD,
    page,
    publish,
    read_published,
    scored_again,
)
from mm_gym import SceneError
from mm_gym.tasks import robust_ids

RECORDED = read_published()


def few(rows):
    """A row of every task, of the algorithm that the fewest of the others are of, and the rest.

    These are one row of each algorithm that no task has by then.
    """
    counts, found = Counter(), []
    for task in sorted({row.task for row in rows}):
        own = [row for row in rows if row.task == task]
        found.append(min(own, key=lambda row: counts[row.algorithm]))
        counts[found[-1].algorithm] += 1
    others = {row.algorithm: row for row in rows if row.algorithm not in counts}
    return [*found, *others.values()]


PUBLISHED = [row for row in RECORDED.rows if row.file is not None]
QUICK = few(PUBLISHED)


@pytest.fixture
def folder(tmp_path):
    """A copy of the folder with the record of one policy."""
    first = RECORDED.rows[0]
    shutil.copy(FOLDER / first.file, tmp_path)
    one = RECORDED.model_copy(update={"rows": [first]})
    (tmp_path / RECORD).write_text(one.model_dump_json())
    return tmp_path


def change(folder, **fields):
    record = json.loads((folder / RECORD).read_text())
    record["rows"][0] |= fields
    (folder / RECORD).write_text(json.dumps(record))


def test_page_is_made_of_the_record():
    assert PAGE.read_text(encoding="utf-8") == page(RECORDED)


def test_what_has_no_training_here_stays_published(folder):
    before, first = read_published(folder), RECORDED.rows[0]
    others = folder / "mine.safetensors", folder / "data.npz"
    for other in others:
        other.write_text("of no policy here")
    assert publish([], [], folder, folder) == before == read_published(folder)
    assert all(other.exists() for other in others)
    assert (folder / first.file).read_bytes() == (FOLDER / first.file).read_bytes()


def test_page_names_what_is_not_published():
    one, *_, other = (row for row in RECORDED.rows if row.task not in robust_ids())
    assert one.task != other.task
    assert one.algorithm != other.algorithm
    found = page(RECORDED.model_copy(update={"rows": [one, other]}))
    for row, lacking in ((one, other), (other, one)):
        assert f"- {row.algorithm}: {lacking.name.partition(',')[0]}.\n" in found


def test_folder_holds_the_policies_of_the_record_and_each_is_small():
    files = {row.file for row in RECORDED.rows if row.file is not None}
    assert {file.name for file in FOLDER.iterdir()} == {RECORD, *files}
    for row in RECORDED.rows:
        assert (row.size <= LARGEST) is (row.file is not None)
        assert row.least <= row.cost <= row.most
        assert row.file is None or (FOLDER / row.file).stat().st_size == row.size


@pytest.mark.parametrize(
    "row",
    [
        pytest.param(row, id=row.name, marks=() if row in QUICK else pytest.mark.slow)
        for row in PUBLISHED
    ],
)
def test_every_policy_scores_again_what_its_page_says(row):
    ((_, cost),) = scored_again(RECORDED.model_copy(update={"rows": [row]}))
    assert row.has(cost)


def test_only_around_a_designed_controller_may_a_cost_differ_by_rounding():
    row = RECORDED.rows[0].model_copy(update={"cost": 0.5})
    around = row.model_copy(update={"base": "lqr"})
    found = [(one.has(0.5004), one.has(0.501)) for one in (row, around)]
    assert found == [(False, False), (True, False)]


def test_some_of_every_task_and_algorithm_are_scored_each_time():
    for field in ("task", "algorithm"):
        assert {getattr(row, field) for row in QUICK} == {getattr(row, field) for row in PUBLISHED}


def test_command_names_what_differs_in_the_last_printed_digit(folder, monkeypatch, capsys):
    monkeypatch.setattr(command, "read_published", lambda: read_published(folder))
    monkeypatch.setattr(command, "scored_again", lambda record: scored_again(record, folder))
    monkeypatch.setattr(sys, "argv", ["evaluate", "--published"])
    assert command.main() is None
    first = RECORDED.rows[0]
    assert first.name in capsys.readouterr().out
    change(folder, cost=first.cost + 1e-4)
    name = f"{first.name}: published {printed(first.cost + 1e-4)}, now {printed(first.cost)}"
    assert command.main() == f"error: published policies have other costs\n{name}"


def test_policy_of_another_scene_or_without_a_file_is_named(folder):
    change(folder, scene_digest="0" * 16)
    with pytest.raises(PolicyError, match="made for another scene than mm_gym/"):
        list(scored_again(read_published(folder), folder))
    change(folder, scene_digest=RECORDED.rows[0].scene_digest, file="none.safetensors")
    with pytest.raises(PolicyError, match=r"none\.safetensors: no such file"):
        list(scored_again(read_published(folder), folder))


@pytest.mark.parametrize(
    ("fields", "words"),
    [({"cost": -1.0}, r"rows\.0\.cost"), ({"file": "../a.safetensors"}, r"rows\.0\.file")],
)
def test_damaged_record_is_named(folder, fields, words):
    change(folder, **fields)
    with pytest.raises(SceneError, match=f"not a record of published policies: {words}"):
        read_published(folder)


def test_damaged_numbers_are_named_with_their_policy(folder):
    change(folder, base="velocity-feedback", numbers=[0.1, 0.2])
    name = RECORDED.rows[0].name
    with pytest.raises(SceneError, match=f"published.json: {name}: numbers: .* got 2 numbers"):
        list(scored_again(read_published(folder), folder))


def test_flags_that_have_no_effect_are_refused(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["evaluate", "lqr", "--published"])
    assert command.main() == "error: --published: got lqr too; allowed: nothing else to evaluate"
