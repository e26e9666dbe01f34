"""Does every search write for TensorBoard what it writes to its files?"""

import json

import numpy as np
import pytest
from pages import BLOCK, ROOT
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from agents.evolution.search import EvolveSettings, evolve
from agents.gradient.descent import descend
from agents.gradient.settings import GradientSettings
from agents.training.runs import Run
from agents.value_iteration.iteration import IterateSettings, iterate

FORCE, SHOCK = "mm_gym/CarriageForce-v0", "mm_gym/PreStretchShock-v0"
EVOLVE = EvolveSettings(
    task=FORCE, generations=4, evaluations=2, candidates=4, episodes=2, threads=1
)
SEARCHES = {
    "evolve": (evolve, EVOLVE, {"search/least", "search/median"}),
    "descend": (
        descend,
        GradientSettings(task=FORCE, iterations=4, evaluations=2, episodes=2, hidden=4),
        {"search/gradient"},
    ),
    "iterate": (
        iterate,
        IterateSettings(
            task=SHOCK, points=5, stretches=5, sizes=3, sweeps=21, evaluations=1, threads=1
        ),
        {"search/mean", "search/residual"},
    ),
}


def logged(run):
    found = EventAccumulator(str(run.folder / "tensorboard"))
    found.Reload()
    return {name: found.Scalars(name) for name in found.Tags()["scalars"]}


@pytest.mark.parametrize("name", SEARCHES)
def test_log_has_the_validations_and_what_each_round_told(name, tmp_path):
    search, settings, names = SEARCHES[name]
    run = Run("a", tmp_path)
    search(settings, run, bar=False)
    found = logged(run)
    assert set(found) == {"validation/cost", *names}
    steps, costs, _ = run.validations()
    assert [event.step for event in found["validation/cost"]] == steps.tolist()
    # The log is in single precision.
    values = [event.value for event in found["validation/cost"]]
    np.testing.assert_allclose(values, costs, rtol=1e-6)
    for own in names:
        assert all(np.isfinite(event.value) for event in found[own])
        assert found[own][-1].step == steps[-1]


def test_continued_run_adds_what_is_new(tmp_path):
    run = Run("a", tmp_path)
    evolve(EVOLVE, run, bar=False)
    evolve(EVOLVE.model_copy(update={"generations": 6}), run, bar=False)
    steps = [event.step for event in logged(run)["search/median"]]
    assert steps == sorted(set(steps))
    assert len(steps) == 6


def test_page_reads_settings_and_all_logs_of_a_run(tmp_path):
    run = Run("a", tmp_path)
    evolve(EVOLVE, run, bar=False)
    first, *_ = BLOCK.findall((ROOT / "docs" / "logs.md").read_text(encoding="utf-8"))
    page = {}
    exec(first[1], page)  # noqa: S102 - the page's own code
    settings, curves = page["logged"](str(run.folder))
    assert settings["task"] == FORCE
    assert settings == json.loads(run.record.read_text())["settings"]
    want = {name: [(e.step, e.value) for e in events] for name, events in logged(run).items()}
    assert curves == want
