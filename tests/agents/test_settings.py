"""Are wrong settings of a training refused by name, before anything is written?"""

import os

import kills
import pytest

from agents.commands.results import ResultsSettings
from agents.commands.tune import TuneSettings
from agents.evolution.search import EvolveSettings
from agents.gradient.settings import GradientSettings
from agents.sweeps.trials import SweepSettings
from agents.training.config import (
    CONFIGS,
    TrainSettings,
    good_settings,
    read_settings,
    settings_from_command_line,
)
from mm_gym import SceneError
from mm_gym.tasks import ids, path_of


@pytest.mark.parametrize(
    "name",
    [
        "",
        ".",
        "..",
        "../../x",
        "a/b",
        "a\\b",
        "/x",
        ".hidden",
        "a\nb",
        "a\0",
        " a",
        "x" * 201,
    ],
)
def test_name_that_is_no_plain_file_name_is_refused(name):
    with pytest.raises(SceneError, match=r"name: got .* allowed: a printable file name"):
        TrainSettings(name=name)


@pytest.mark.parametrize("name", ["first", "pre_stretch-2", "größer", "a b", "x..y"])
def test_plain_name_is_taken(name):
    assert TrainSettings(name=name).name == name


@pytest.mark.parametrize("seed", [-1, 2**32, 2**64])
def test_seed_that_the_generators_do_not_take_is_refused(seed):
    with pytest.raises(SceneError, match=f"seed: got {seed}"):
        TrainSettings(seed=seed)


def test_task_of_another_package_is_refused_before_a_folder_is_made(tmp_path):
    with pytest.raises(SceneError, match="task: got 'CartPole-v1'; allowed: ActiveMassDamper"):
        TrainSettings(task="CartPole-v1", scene=str(tmp_path / "scene.toml"))


def test_single_sample_between_updates_is_refused():
    with pytest.raises(SceneError, match=r"lanes: got 1 with ppo\.rollout = 1"):
        TrainSettings(lanes=1, ppo={"rollout": 1})


def pipe(file):
    os.mkfifo(file)


def endless(file):
    file.symlink_to("/dev/zero")


def large(file):
    file.write_text("# " + "x" * 1000 + "\n" * 2**16)


def deep(file):
    file.write_text("a = " + "[" * 1500)


def nested(file):
    file.write_text("a = " + "[" * 400 + "]" * 400)


def foreign(file):
    file.write_bytes(b'name = "\xff"')


def digits(file):
    file.write_text("steps = " + "9" * 5000)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (pipe, "cannot be read: not a file"),
        (endless, "cannot be read: not a file"),
        (large, "cannot be read: .* bytes; allowed: at most"),
        (deep, "not valid TOML: nested too deeply"),
        (nested, "a: unknown key|nested too deeply"),
        (foreign, "0xff"),
        (digits, "got 5008 characters; allowed: at most"),
    ],
)
def test_file_that_holds_no_settings_is_named(tmp_path, make, message):
    file = tmp_path / "agent.toml"
    make(file)
    with pytest.raises(SceneError, match=message) as caught:
        read_settings(file, TrainSettings)
    assert str(file) in str(caught.value)


def test_misspelt_keys_are_named_with_the_nearest(tmp_path):
    file = tmp_path / "agent.toml"
    file.write_text("tsk = 1\n[ppo]\nlerning_rate = 0.1\n")
    with pytest.raises(SceneError) as caught:
        read_settings(file, TrainSettings)
    assert "tsk: unknown key; did you mean 'task'?" in str(caught.value)
    assert "ppo.lerning_rate: unknown key; did you mean 'learning_rate'?" in str(caught.value)


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--task", "CartPole-v1", "--scene", "x.toml"], "CartPole-v1"),
        (["--name", "../x"], "'../x'"),
        (["--seed", "4294967296"], "4294967296"),
        (["--tsk", "x"], "--task"),
    ],
)
def test_command_line_refuses_without_a_folder(tmp_path, flags, words):
    process = kills.begin_command(flags, tmp_path)
    process.join()
    assert process.exitcode == 2
    errors = (tmp_path / "errors").read_text()
    assert words in errors
    assert "Traceback" not in errors
    assert [path.name for path in tmp_path.iterdir()] == ["errors"]


@pytest.mark.parametrize("path", ["agent.tom", "configs", ""])
def test_first_argument_that_is_neither_file_nor_task_is_refused_by_name(path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["train", path, "--seed", "1"])
    with pytest.raises(SceneError) as caught:
        settings_from_command_line(TrainSettings, "")
    message = str(caught.value)
    assert message.startswith(f"task or settings file: got {path!r}; allowed: ActiveMassDamper, ")
    assert message.endswith("or a path that ends in .toml, before the flags")


def test_task_is_named_without_its_prefix_and_version(monkeypatch):
    monkeypatch.setattr("sys.argv", ["train", "Hybrid", "--algorithm", "sac"])
    settings = settings_from_command_line(TrainSettings, "")
    assert (settings.task, settings.name) == ("mm_gym/Hybrid-v0", "Hybrid")
    assert settings.chosen == settings.sac


def test_single_fields_of_the_scene_change_in_the_file_and_on_the_command_line(
    tmp_path, monkeypatch
):
    file = tmp_path / "settings.toml"
    file.write_text('[changes]\n"control.steps" = 30\n"initial.sphere_offset" = [0.0, 0.01]\n')
    scene = read_settings(file, TrainSettings).load_scene()
    assert scene.control.steps == 30
    assert scene.initial.sphere_offset == (0.0, 0.01)
    monkeypatch.setattr("sys.argv", ["train", str(file)])
    assert settings_from_command_line(TrainSettings, "") == read_settings(file, TrainSettings)
    monkeypatch.setattr("sys.argv", ["train", str(file), "--changes", '{"control.steps": 40}'])
    scene = settings_from_command_line(TrainSettings, "").load_scene()
    assert (scene.control.steps, scene.initial.sphere_offset) == (40, 0.0)
    with pytest.raises(SceneError, match=r"control\.stepz: unknown key; did you mean 'steps'\?"):
        TrainSettings(changes={"control.stepz": 40}).load_scene()


def test_help_on_a_file_of_settings_warns_of_nothing(tmp_path, monkeypatch, capsys, recwarn):
    file = tmp_path / "sweep.toml"
    file.write_text("[settings.evolution]\nhidden = 8\n")
    monkeypatch.setattr("sys.argv", ["sweep", str(file), "--help"])
    with pytest.raises(SystemExit):
        settings_from_command_line(SweepSettings, "")
    assert '{"hidden": 8}' in "".join(capsys.readouterr().out.split("│"))
    assert [str(one.message) for one in recwarn] == []


def read_from(monkeypatch, kind, *words):
    monkeypatch.setattr("sys.argv", ["command", *words])
    return settings_from_command_line(kind, "")


@pytest.fixture
def known(tmp_path, monkeypatch):
    """Let settings of Hybrid, and of no other task, be known."""
    monkeypatch.setattr("agents.training.config.CONFIGS", tmp_path)
    for kind, text in ((GradientSettings, "hidden = 5\nrate = 0.1\n"), (TrainSettings, LANES)):
        (tmp_path / kind.folder).mkdir()
        (tmp_path / kind.folder / "hybrid.toml").write_text('name = "found"\n' + text)
    return tmp_path


LANES = "lanes = 3\n[ppo]\nepochs = 2\n[sac]\ntau = 0.5\n"


@pytest.mark.usefixtures("known")
def test_task_stands_for_its_good_settings_and_flags_go_over_them(monkeypatch):
    settings = read_from(monkeypatch, GradientSettings, "Hybrid", "--rate", "0.2")
    own = {"task": "mm_gym/Hybrid-v0", "name": "Hybrid-gradient"}
    assert settings == GradientSettings(hidden=5, rate=0.2, **own)
    trained = read_from(monkeypatch, TrainSettings, "mm_gym/Hybrid-v0", "--ppo.rollout", "4")
    assert (trained.name, trained.lanes) == ("Hybrid", 3)
    assert (trained.ppo.epochs, trained.ppo.rollout) == (2, 4)
    alone = read_from(monkeypatch, GradientSettings, "PreStretch")
    assert alone == GradientSettings(task="mm_gym/PreStretch-v0", name="PreStretch-gradient")


@pytest.mark.usefixtures("known")
def test_own_scene_and_another_algorithm_have_the_defaults(monkeypatch):
    scene = ["--scene", "own.toml", "--rate", "0.2"]
    settings = read_from(monkeypatch, GradientSettings, "Hybrid", *scene)
    task = "mm_gym/Hybrid-v0"
    own = {"task": task, "name": "Hybrid-gradient"}
    assert settings == GradientSettings(scene="own.toml", rate=0.2, **own)
    trained = read_from(monkeypatch, TrainSettings, "Hybrid", "--algorithm", "sac")
    assert trained == TrainSettings(algorithm="sac", task=task, name="Hybrid")


@pytest.mark.usefixtures("known")
def test_tuning_begins_without_what_was_found_before(monkeypatch):
    settings = read_from(monkeypatch, TuneSettings, "Hybrid")
    assert settings == TuneSettings(task="mm_gym/Hybrid-v0", name="Hybrid")


def test_wrong_file_of_good_settings_is_named(known, monkeypatch):
    (known / "gradient" / "hybrid.toml").write_text("hiddn = 5")
    with pytest.raises(SceneError, match=r"gradient.hybrid\.toml: hiddn: unknown key; did you"):
        read_from(monkeypatch, GradientSettings, "Hybrid", "--hidden", "3")


@pytest.mark.parametrize("kind", [TrainSettings, GradientSettings], ids=lambda kind: kind.folder)
def test_files_of_good_settings_are_of_the_tasks_whose_names_they_have(kind):
    files = sorted((CONFIGS / kind.folder).glob("*.toml"))
    stems = {task: path_of(task).stem for task in ids()}
    assert files
    for file in files:  # "pre_stretch_noise_recurrent" is another good one of "pre_stretch_noise"
        begins = [task for task, stem in stems.items() if file.stem.startswith(stem)]
        assert read_settings(file, kind).task == max(begins, key=len)


def test_results_repeat_no_good_setting_of_a_search():
    results = read_settings(CONFIGS / "results.toml", ResultsSettings)
    for task, table in results.task_settings.items():
        good = good_settings(f"mm_gym/{task}-v0", GradientSettings).model_fields_set
        assert not {f"gradient.{name}" for name in good} & table.keys()


@pytest.mark.parametrize("flag", ["--sac.learning-rate", "--recurrent-ppo.units"])
def test_flag_of_another_algorithm_is_refused_by_name(flag, monkeypatch):
    other = flag[2:].partition(".")[0].replace("-", "_")
    words = f"{flag}: got a setting without effect; allowed: with algorithm = {other}"
    with pytest.raises(SceneError, match=words):
        read_from(monkeypatch, TrainSettings, "CarriageForce", flag, "1")
    chosen = read_from(monkeypatch, TrainSettings, "Hybrid", flag, "1", "--algorithm", other)
    assert chosen.chosen.model_fields_set == {flag.partition(".")[2].replace("-", "_")}


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (("--base", "lqr", "--law", "lqg"), "--law: got a setting without effect; .* without base"),
        (("--base", "lqr", "--memory", "2"), "--memory: got a setting .* without base"),
        (("--authority", "0.5"), "--authority: got a setting .* with a base"),
        (("--schedules",), "--schedules: got a setting .* with a base"),
    ],
)
def test_flags_of_a_start_and_of_a_base_exclude_each_other(asked, words, monkeypatch):
    with pytest.raises(SceneError, match=words):
        read_from(monkeypatch, EvolveSettings, "CarriageForce", *asked)


@pytest.mark.parametrize("flag", ["--feedback", "--oscillators"])
def test_settings_without_effect_on_a_cell_are_refused_where_they_are_asked_for(
    flag, tmp_path, monkeypatch
):
    words = f"{flag[2:]}: got a setting without effect; allowed: with cell = 0"
    with pytest.raises(SceneError, match=words):
        read_from(monkeypatch, GradientSettings, "PreStretchShock", "--cell", "4", flag, "1")
    file = tmp_path / "own.toml"
    file.write_text(f"cell = 4\n{flag[2:]} = 1\n")
    with pytest.raises(SceneError, match=words):
        read_from(monkeypatch, GradientSettings, str(file))
    sweep = SweepSettings(algorithms=("recurrent",), settings={"cell": 4, flag[2:]: 1})
    with pytest.raises(SceneError, match=words):
        sweep.trials()


def test_task_file_is_read_for_a_cell(monkeypatch):
    found = read_from(monkeypatch, GradientSettings, "PreStretchShock", "--cell", "4")
    assert (found.cell, found.extra) == (4, 8)
    sweep = SweepSettings(
        tasks=("PreStretchShock",), algorithms=("recurrent",), settings={"recurrent.cell": 4}
    )
    (trial,) = sweep.trials()
    assert (trial.cell, trial.extra) == (4, 8)
