"""Does a sweep do every training once, whatever happens to its processes?"""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress

import pytest

from agents.commands import sweep as command
from agents.commands.sweep import sweep
from agents.evolution.search import EvolveSettings, evolve
from agents.gradient.settings import GradientSettings
from agents.sweeps.results import _digest, training_of
from agents.sweeps.trials import (
    SweepSettings,
    algorithm_of,
    check_settings,
    do_trial,
    write_results,
)
from agents.training.config import good_settings
from agents.training.reinforcement import train
from agents.training.runs import Run, RunError
from mm_gym import SceneError

SMALL = {
    "lanes": 8,
    "steps": 800,
    "evaluations": 8,
    "ppo.rollout": 10,
    "ppo.batch_size": 40,
    "ppo.hidden": [8],
}
TWO = SweepSettings(
    name="two",
    tasks=("CarriageForce",),
    settings=SMALL,
    variants={"plain": {}, "bad": {"reward": "absent.py:cost"}},
)


def kill_first(folder, killed):
    for _ in range(60_000):
        time.sleep(0.01)
        for checkpoint in folder.glob("*/checkpoint.npz"):
            number = int((checkpoint.parent / ".lock").read_text().split()[1])
            os.kill(number, signal.SIGKILL)
            killed.append(checkpoint.parent.name)
            return


@pytest.mark.parametrize("processes", [1, 2])
def test_killed_process_is_repeated_and_a_training_that_fails_stops_no_other(tmp_path, processes):
    killed, environment = [], dict(os.environ)
    killer = threading.Thread(target=kill_first, args=(tmp_path / "two", killed))
    killer.start()
    problems = sweep(TWO.model_copy(update={"processes": processes}), tmp_path)
    killer.join()
    assert killed == ["CarriageForce-ppo-plain-0"]
    assert dict(os.environ) == environment  # that of the processes is not this one's
    assert problems.startswith("CarriageForce-ppo-bad-0: SceneError: reward: absent.py")
    rows = (tmp_path / "two" / "results.csv").read_text().splitlines()
    assert [row.rpartition(",")[0].rpartition(",")[0] for row in rows[1:]] == [
        "CarriageForce,ppo,plain,0,800.0"
    ]
    alone = Run("CarriageForce-ppo-plain-0", tmp_path / "alone")
    train(TWO.trials()[0], alone, bar=False)
    swept = Run(alone.folder.name, tmp_path / "two")
    assert swept.policy.read_bytes() == alone.policy.read_bytes()
    assert swept.metrics.read_text() == alone.metrics.read_text()
    assert (
        float(rows[1].split(",")[-1])
        == json.loads((swept.folder / "result.json").read_text())["cost"]
    )


def test_every_combination_is_a_training_of_its_own_name():
    settings = SweepSettings(
        tasks=("mm_gym/Hybrid-v0", "PreStretch"),
        algorithms=("sac", "ppo"),
        seeds=3,
        variants={"a": {"sac.hidden": [4]}, "b": {}},
        settings={"sac.tau": 0.1, "steps": 10},
    )
    trials = settings.trials()
    assert len({trial.name for trial in trials}) == len(trials) == 24
    assert trials[0].sac.hidden == (4,)
    assert {trial.sac.tau for trial in trials if trial.algorithm == "sac"} == {0.1}
    assert {trial.steps for trial in trials} == {10}


def test_settings_of_another_algorithm_are_no_part_of_a_training(tmp_path):
    plain = SweepSettings(algorithms=("ppo", "sac"))
    (ppo, sac), (other, changed) = (
        plain.trials(),
        plain.model_copy(update={"settings": {"sac.tau": 0.1}}).trials(),
    )
    assert (other, _digest(other)) == (ppo, _digest(ppo))
    assert _digest(changed) != _digest(sac)
    run = Run(sac.name, tmp_path)
    asked = json.loads(sac.model_dump_json())
    score = {"cost": 1.0, "episodes": [1.0], "injected": None, "asked": asked}
    run.folder.mkdir()
    (run.folder / "result.json").write_text(json.dumps(score))
    (_, slower) = plain.model_copy(update={"settings": {"ppo.epochs": 3}}).trials()
    check_settings(slower, run)
    with pytest.raises(RunError, match=r"other settings \(sac.tau .*, now 0.1\)"):
        check_settings(changed, run)
    wrong = plain.model_copy(update={"algorithms": ("ppo",), "settings": {"sac.tao": 0.1}})
    with pytest.raises(SceneError, match=r"sac\.tao"):
        wrong.trials()


def test_evolution_is_an_algorithm_with_settings_of_its_own(tmp_path):
    settings = SweepSettings(
        tasks=("CarriageForce", "PreStretch"),
        algorithms=("evolution", "ppo"),
        settings={"evolution.hidden": 4, "evaluations": 3},
        algorithm_settings={"ppo": {"steps": 10}},
        task_settings={"CarriageForce": {"evolution.generations": 2, "evolution.candidates": 4}},
    )
    trials = settings.trials()
    assert [trial.name for trial in trials[:2]] == [
        "CarriageForce-evolution-plain-0",
        "CarriageForce-ppo-plain-0",
    ]
    evolution, ppo, other, _ = trials
    assert (evolution.hidden, evolution.generations, evolution.threads) == (4, 2, 1)
    assert (other.hidden, other.generations) == (4, EvolveSettings().generations)
    assert ppo.steps == 10
    assert {trial.evaluations for trial in trials} == {3}  # what is common reaches all
    do_trial(evolution.model_dump_json(), tmp_path)
    alone = Run(evolution.name, tmp_path / "alone")
    evolve(evolution, alone, bar=False)
    swept = Run(evolution.name, tmp_path)
    assert swept.metrics.read_text() == alone.metrics.read_text()
    cost = json.loads((swept.folder / "result.json").read_text())["cost"]
    rows = write_results(trials[:1], tmp_path).read_text().splitlines()
    assert rows[1].startswith("CarriageForce,evolution,plain,0,")
    assert float(rows[1].split(",")[-1]) == cost


def test_search_begins_with_the_good_settings_of_the_task_but_not_on_an_own_scene(tmp_path):
    task = {"tasks": ("PreStretchNoise",), "algorithms": ("gradient",)}
    good = good_settings("mm_gym/PreStretchNoise-v0", GradientSettings)
    name = {"name": "PreStretchNoise-gradient-plain-0"}
    (trial,) = SweepSettings(**task).trials()
    assert trial == good.model_copy(update=name)
    assert trial.hidden != GradientSettings().hidden
    (trial,) = SweepSettings(settings={"gradient.hidden": 3}, **task).trials()
    assert trial == good.model_copy(update={"hidden": 3, **name})
    own = tmp_path / "own.toml"
    own.write_text(SCENE)
    for setting in ("gradient.scene", "scene"):
        (trial,) = SweepSettings(settings={setting: str(own)}, **task).trials()
        assert trial == GradientSettings(task=good.task, scene=str(own), **name)


def test_recurrent_is_gradient_with_settings_of_its_own():
    settings = SweepSettings(
        tasks=("PreStretchNoise",),
        algorithms=("gradient", "recurrent"),
        settings={"gradient.iterations": 4, "recurrent.cell": 3, "recurrent.iterations": 5},
    )
    gradient, recurrent = settings.trials()
    assert (gradient.cell, gradient.iterations) == (0, 4)
    assert (recurrent.cell, recurrent.iterations) == (3, 5)
    assert recurrent.hidden == gradient.hidden > GradientSettings().hidden  # of the task's file


def test_evolved_residual_is_evolution_with_settings_of_its_own():
    settings = SweepSettings(
        tasks=("CarriageForce",),
        algorithms=("evolution", "evolved_residual"),
        settings={"evolution.hidden": 4, "evolved_residual.base": "lqg"},
    )
    evolution, added = settings.trials()
    assert (evolution.base, evolution.hidden) == (None, 4)
    assert (added.base, added.hidden) == ("lqg", EvolveSettings().hidden)


def test_residual_is_ppo_around_a_law_and_each_table_goes_over_the_one_before():
    common = {"steps": 10, "ppo": {"epochs": 3}}
    settings = SweepSettings(
        tasks=("CarriageForce", "Hybrid"),
        algorithms=("ppo", "residual", "sac"),
        settings=common,
        algorithm_settings={"residual": {"steps": 20}, "sac": {"lanes": 4}},
        task_settings={
            "CarriageForce": {
                "ppo.discount": 0.9,
                "residual.base": "lqr",
                "residual.ppo.initial_log_std": -1.0,
            }
        },
    )
    ppo, residual, sac, other, *_ = settings.trials()
    assert [algorithm_of(trial) for trial in (ppo, residual, sac)] == ["ppo", "residual", "sac"]
    assert [trial.algorithm for trial in (ppo, residual, sac)] == ["ppo", "ppo", "sac"]
    assert [trial.steps for trial in (ppo, residual, sac)] == [10, 20, 10]
    assert [trial.base for trial in (ppo, residual, sac)] == [None, "lqr", None]
    assert (residual.ppo.epochs, residual.ppo.discount) == (3, 0.9)
    assert (residual.ppo.initial_log_std, ppo.ppo.initial_log_std) == (-1.0, -0.5)
    assert (sac.lanes, ppo.lanes) == (4, 128)
    assert other.ppo.discount == 0.97  # the tables themselves are left alone


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"tasks": ("Hybrit",)}, "did you mean 'Hybrid'"),
        ({"algorithms": ("pqo",)}, "algorithms.0: got 'pqo'; did you mean 'ppo'"),
        ({"settings": {"stepps": 3}}, "stepps: unknown key; did you mean 'steps'"),
        ({"variants": {"a": 3}}, "variants.a: got 3; allowed: a table of settings"),
        ({"settings": {"steps": 3, "steps.x": 4}}, "exclude each other"),
        ({"task_settings": {"Hybrit": {}}}, "task_settings: got 'Hybrit'"),
        ({"task_settings": {"PreStretch": 3}}, "task_settings.PreStretch: got 3; allowed: a table"),
        (
            {"algorithms": ("evolution",), "settings": {"evolution.hiddens": 3}},
            "hiddens: unknown key; did you mean 'hidden'",
        ),
        (
            {"algorithms": ("evolution",), "settings": {"evolution": 3}},
            "settings.evolution: got 3; allowed: a table",
        ),
        (
            {"algorithms": ("ppo", "evolution"), "settings": {"lanes": 4}},
            "PreStretch-evolution-plain-0: lanes: evolution has no such setting; state it",
        ),
        (
            {"algorithms": ("evolution", "ppo"), "settings": {"generations": 4}},
            "PreStretch-ppo-plain-0: generations: ppo has no such setting; state it",
        ),
        ({"settings": {"seed": 4}}, "seed: made by the sweep, from its seeds"),
        (
            {"settings": {"scene": "absent.toml"}},
            "PreStretch-ppo-plain-0: absent.toml: no such file",
        ),
        (
            {
                "algorithms": ("evolution", "ppo"),
                "settings": {"evolution.changes": {"control.steps": 5}},
            },
            "that of PreStretch-ppo-plain-0 is not that of PreStretch-evolution-plain-0",
        ),
        (
            {"tasks": ("Hybrid", "mm_gym/Hybrid-v0")},
            "tasks: got 'Hybrid' twice; allowed: each once",
        ),
        ({"algorithms": ("ppo", "sac", "ppo")}, "algorithms: got 'ppo' twice; allowed: each once"),
        ({"variants": {}}, "variants: got none; allowed: one or more tables of settings"),
        *(
            ({"name": name}, f"name: got {name!r}; allowed: a printable file name")
            for name in ("", "../up", "a/b", ".hidden")
        ),
        ({"algorithm_settings": {"pqo": {}}}, "algorithm_settings: got 'pqo'; did you mean 'ppo'"),
        ({"algorithm_settings": {"ppo": 3}}, "algorithm_settings.ppo: got 3; allowed: a table"),
    ],
)
def test_wrong_sweep_is_refused_before_a_folder_is_made(tmp_path, fields, words):
    with pytest.raises(SceneError) as caught:
        sweep(SweepSettings(**fields), tmp_path)
    assert words in str(caught.value)
    assert not list(tmp_path.iterdir())


SCENE = "[carriage]\nmass = 0.2\n[actuation.force]\n[objective]\neffort_weight = 0.01\n"

LEARNERS = {
    "name": "own",
    "tasks": ("CarriageForce",),
    "algorithms": ("evolution", "gradient", "ppo", "residual"),
    "processes": 1,
    "algorithm_settings": {
        "evolution": {"candidates": 4, "generations": 1, "episodes": 2},
        "gradient": {"iterations": 1, "episodes": 2},
        "ppo": {"lanes": 8, "steps": 80, "ppo.rollout": 10},
        "residual": {"lanes": 8, "steps": 80, "ppo.rollout": 10, "base": "lqr"},
    },
}


def here(work, _, report):
    """Train in this process, in the place of those of `work_here`."""
    for number, (text, folder) in enumerate(work):
        do_trial(text, folder)
        report(number, None)


@pytest.mark.usefixtures("untuned")
def test_common_scene_reaches_every_algorithm_and_another_one_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(command, "work_here", here)
    file = tmp_path / "own.toml"
    file.write_text(SCENE)
    common = {"scene": str(file), "changes": {"control.steps": 20}, "evaluations": 1}
    settings = SweepSettings(settings=common, **LEARNERS)
    assert sweep(settings, tmp_path) is None
    records = [Run(trial.name, tmp_path / "own").read() for trial in settings.trials()]
    assert len(records) == 4
    assert {record["settings"]["scene"] for record in records} == {str(file)}
    assert {record["scene"]["carriage"]["mass"] for record in records} == {0.2}
    assert {record["scene"]["control"]["steps"] for record in records} == {20}
    assert sweep(settings, tmp_path) is None  # done, though what was measured is in the records
    file.write_text(SCENE.replace("0.2", "0.3"))
    before = (tmp_path / "own" / "results.csv").read_bytes()
    more = settings.model_copy(update={"seeds": 2})
    with pytest.raises(SceneError, match="scene: that of CarriageForce-evolution-plain-1 is not"):
        sweep(more, tmp_path)  # before it trains
    assert len(list((tmp_path / "own").glob("*-1"))) == 0
    assert (tmp_path / "own" / "results.csv").read_bytes() == before


def test_processes_are_sent_what_is_asked_for_alone(tmp_path, monkeypatch):
    sent = []
    monkeypatch.setattr(command, "work_here", lambda work, *_: sent.extend(work))
    (tmp_path / "own.toml").write_text(SCENE)
    common = {"scene": str(tmp_path / "own.toml"), "time_budget": 5.0, "ppo.epochs": 3}
    settings = SweepSettings(
        tasks=("CarriageForce",), algorithms=("ppo", "gradient", "evolution"), settings=common
    )
    assert sweep(settings, tmp_path) is None
    always = {"task": "mm_gym/CarriageForce-v0", "seed": 0}
    always |= {key: common[key] for key in ("scene", "time_budget")}
    ppo, gradient, evolution = (json.loads(text) for text, _ in sent)
    for told in (ppo, gradient, evolution):
        assert always.items() <= told.items()
    assert ppo["ppo"] == {"epochs": 3}
    assert not {"rate", "episodes", "iterations", "horizon", "floor"} & gradient.keys()
    assert "generations" not in evolution
    for trial, told in zip(settings.trials(), (ppo, gradient, evolution), strict=True):
        assert type(trial).of(told) == trial


@pytest.mark.usefixtures("untuned")
@pytest.mark.parametrize("is_own", [False, True])
def test_finished_training_of_other_settings_is_refused(tmp_path, monkeypatch, is_own):
    monkeypatch.setattr(command, "work_here", here)
    (tmp_path / "own.toml").write_text(SCENE)
    common = {"candidates": 4, "generations": 1, "episodes": 2, "evaluations": 1}
    if is_own:
        common["scene"] = str(tmp_path / "own.toml")
    settings = SweepSettings(
        tasks=("CarriageForce",), algorithms=("evolution",), settings=common, name="s"
    )
    other = settings.model_copy(update={"settings": common | {"generations": 2, "spread": 0.1}})
    assert sweep(settings, tmp_path) is None
    (file,) = (tmp_path / "s").glob("*/result.json")
    told = rf"{file.parent}: .* \(generations 1, now 2; spread 0\.3, now 0\.1\)"
    with pytest.raises(RunError, match=told):
        sweep(other, tmp_path)
    with pytest.raises(RunError, match=told):
        training_of(other.trials()[0], tmp_path / "s")
    data = json.loads(file.read_text())
    del data["asked"]["spread"]  # as if there had been no such setting
    file.write_text(json.dumps(data))
    assert sweep(settings, tmp_path) is None
    with pytest.raises(RunError, match=told):
        sweep(other, tmp_path)
    del data["asked"]  # as earlier versions wrote it
    file.write_text(json.dumps(data))
    assert sweep(settings, tmp_path) is None
    if is_own:  # its record has what was measured
        assert sweep(other, tmp_path) is None
    else:
        with pytest.raises(RunError, match=told):
            sweep(other, tmp_path)


@pytest.mark.usefixtures("untuned")
def test_known_trainings_are_not_done_and_stay_in_the_table(tmp_path, monkeypatch):
    monkeypatch.setattr(command, "work_here", here)
    common = {"candidates": 4, "generations": 1, "episodes": 2, "evaluations": 1}
    settings = SweepSettings(
        tasks=("CarriageForce",), algorithms=("evolution",), seeds=2, settings=common, name="s"
    )
    first, second = (trial.name for trial in settings.trials())
    for known in ({second}, {first, second}):
        assert sweep(settings, tmp_path, known) is None
        assert [file.parent.name for file in tmp_path.glob("s/*/result.json")] == [first]
        rows = (tmp_path / "s" / "results.csv").read_text().splitlines()
        assert [row.split(",")[3] for row in rows[1:]] == ["0"]


def test_results_of_different_scenes_are_not_written_beside_each_other(tmp_path):
    trials = SweepSettings(tasks=("CarriageForce",), seeds=2).trials()
    for trial, mass in zip(trials, (0.2, 0.3), strict=True):
        run = Run(trial.name, tmp_path)
        run.open(trial.model_copy(update={"changes": {"carriage.mass": mass}}))
        (run.folder / "result.json").write_text(
            '{"cost": 0.5, "episodes": [0.5], "injected": null}'
        )
    with pytest.raises(SceneError, match="the same for all trainings of a task and a variant"):
        write_results(trials, tmp_path)
    assert not (tmp_path / "results.csv").exists()


def test_a_training_that_cannot_be_read_keeps_no_other_from_the_results(tmp_path):
    trials = SweepSettings(tasks=("CarriageForce",), seeds=3).trials()
    for trial, cost in zip(trials, (0.5, "broken", 0.5), strict=True):
        run = Run(trial.name, tmp_path)
        run.open(trial)
        run.metrics.write_text(f"steps [-],cost [-]\n8,{cost}\n")
        run.times.write_text("steps [-],time [s]\n8,1\n")
        (run.folder / "result.json").write_text(
            '{"cost": 0.25, "episodes": [0.25], "injected": null}'
        )
    with pytest.raises(RunError, match=r"CarriageForce-ppo-plain-1/metrics\.csv:2: got .8,broken"):
        write_results(trials, tmp_path)
    rows = (tmp_path / "results.csv").read_text().splitlines()
    start = "CarriageForce,ppo,plain"
    assert rows[1:] == [f"{start},0,8.0,0.5,0.25", f"{start},2,8.0,0.5,0.25"]


def is_training(run):
    try:
        with run.locked():
            return False
    except RunError:
        return True


@contextmanager
def endless_sweep(folder):
    """Begin a sweep whose training never ends, as in a terminal, and wait until it trains."""
    words = ["--name", "long", "--tasks", "CarriageForce", "--settings"]
    words.append(json.dumps(SMALL | {"steps": 10**9}))
    run = Run("CarriageForce-ppo-plain-0", folder / "runs" / "long")
    # A shell that runs the tests in the background has Ctrl-C ignored.
    code = (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
        "from agents.__main__ import main; main()"
    )
    command = [sys.executable, "-c", code, "sweep", *words]
    with (folder / "errors").open("w") as errors:
        one = subprocess.Popen(command, cwd=folder, stderr=errors, start_new_session=True)
    try:
        while not run.checkpoint.exists():
            assert one.poll() is None
            time.sleep(0.1)
        assert is_training(run)
        yield one, run
    finally:
        with suppress(ProcessLookupError):
            os.killpg(one.pid, signal.SIGKILL)
        one.wait()


def test_trainings_end_with_a_sweep_that_is_killed(tmp_path):
    with endless_sweep(tmp_path) as (one, run):
        one.kill()
        for _ in range(600):
            if not is_training(run):
                return
            time.sleep(0.1)
    pytest.fail("the training goes on without its sweep")


@pytest.mark.parametrize("send", [os.kill, os.killpg])  # to the sweep alone, or as a terminal does
def test_interrupted_sweep_ends_once_its_trainings_have_written_checkpoints(tmp_path, send):
    with endless_sweep(tmp_path) as (one, run):
        before = run.checkpoint.stat().st_mtime_ns
        send(one.pid, signal.SIGINT)
        assert one.wait(timeout=60) == 130
        assert not is_training(run)
        assert run.checkpoint.stat().st_mtime_ns > before
    told = (tmp_path / "errors").read_text()
    assert told.endswith("interrupted: runs/long: give the same command again to continue\n")
    assert "Traceback" not in told


def test_second_ctrl_c_ends_a_sweep_whose_training_does_not_end(tmp_path):
    with endless_sweep(tmp_path) as (one, run):
        training = int((run.folder / ".lock").read_text().split()[1])
        os.kill(training, signal.SIGSTOP)  # so that it writes no checkpoint
        one.send_signal(signal.SIGINT)
        with pytest.raises(subprocess.TimeoutExpired):
            one.wait(timeout=3)
        one.send_signal(signal.SIGINT)
        assert one.wait(timeout=60) == 130
        assert not is_training(run)


def test_tasks_and_variants_may_have_scenes_of_their_own():
    settings = SweepSettings(
        tasks=("CarriageForce", "Hybrid"),
        algorithms=("evolution", "ppo"),
        variants={"light": {"changes": {"carriage.mass": 0.05}}, "plain": {}},
        task_settings={"Hybrid": {"changes": {"control.steps": 30}}},
    )
    assert len({trial.load_scene().digest for trial in settings.trials()}) == 4


@pytest.mark.parametrize(
    ("words", "want"),
    [
        (["--ray"], ("none", 1)),
        (["--ray", "--seeds", "2"], ("none", 2)),
        (["--ray", "10.0.0.1:6379"], ("10.0.0.1:6379", 1)),
        (["--seeds", "2"], (None, 2)),
    ],
)
def test_ray_takes_an_address_or_none(words, want, monkeypatch):
    monkeypatch.setattr("sys.argv", ["sweep", *words])
    found = []
    monkeypatch.setattr(command, "sweep", found.append)
    assert command.main() is None
    (settings,) = found
    assert (settings.ray, settings.seeds) == want


def test_missing_ray_is_named_with_its_extra(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "ray", None)
    monkeypatch.setattr("sys.argv", ["sweep", "--ray"])
    assert command.main() == "error: --ray needs Ray: install the extra `ray`"
