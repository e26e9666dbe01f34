"""Does training learn, repeat itself, and survive a kill?"""

import json
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from agents.commands import train as command
from agents.commands.evaluate import report_run
from agents.control.feedback import Feedback
from agents.controllers.constant import no_control
from agents.controllers.learned import Learned
from agents.policies import load_policy
from agents.scoring import VALIDATION_SEED, evaluate, limit_penalty, validation_cost
from agents.training import parts
from agents.training.arrays import load_checkpoint
from agents.training.config import TrainSettings, read_settings
from agents.training.parts import agent_of, recorded_parts
from agents.training.reinforcement import train
from agents.training.runs import Run, RunError
from mm_gym import SceneError, load_scene

ROOT = Path(__file__).parents[2]

QUICK = TrainSettings(
    task="mm_gym/CarriageForce-v0",
    name="quick",
    lanes=16,
    steps=12_800,
    evaluations=4,
    ppo={"rollout": 50, "batch_size": 400, "epochs": 4, "reward_scale": 10.0},
)


def changed(ppo: dict[str, object] | None = None, **fields: object) -> TrainSettings:
    data = QUICK.model_dump() | fields
    return TrainSettings(**(data | {"ppo": data["ppo"] | (ppo or {})}))


def weights(run: Run) -> list[np.ndarray]:
    policy = load_policy(run.policy)
    return list(policy.arrays.values())


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Run:
    run = Run("quick", tmp_path_factory.mktemp("runs"))
    train(QUICK, run)
    return run


def test_training_with_one_seed_repeats_itself(finished: Run, tmp_path: Path) -> None:
    again = Run("quick", tmp_path)
    train(QUICK, again)
    for first, second in zip(weights(finished), weights(again), strict=True):
        np.testing.assert_array_equal(first, second)


def test_training_learns_to_still_the_carriage(tmp_path: Path) -> None:
    settings = changed(steps=160_000, lanes=64, ppo={"batch_size": 800, "learning_rate": 3e-3})
    run = Run("longer", tmp_path)
    train(settings, run)
    scene = settings.load_scene()
    learned = evaluate(scene, Learned(load_policy(run.policy)), episodes=100)
    nothing = evaluate(scene, Feedback(scene, no_control(scene)), episodes=100)
    # No control costs 0.105 and the optimal regulator 0.048: half way is learning, not luck.
    assert learned.returns.mean() > 0.6 * nothing.returns.mean()


def test_run_folder_holds_what_is_needed_to_repeat_it(finished: Run) -> None:
    record = json.loads(finished.record.read_text())
    assert TrainSettings(**record["settings"]) == QUICK
    assert record["scene_digest"] == QUICK.load_scene().digest
    assert record["versions"]["torch"].startswith("2.")
    rows = (finished.folder / "metrics.csv").read_text().splitlines()
    assert rows[0] == "steps [-],cost [-]"
    assert len(rows) == 2 + QUICK.evaluations  # with the header, and what it begins as
    assert list((finished.folder / "tensorboard").rglob("events*"))


def test_report_writes_tables_and_figures(
    finished: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    results = report_run(finished, episodes=20)
    names = [result.name for result in results]
    assert (names[0], names[1], names[-1]) == ("no control", "LQR", "learned")
    assert "LQR" in capsys.readouterr().out
    scores = (finished.folder / "scores.csv").read_text().splitlines()
    assert len(scores) == 1 + len(results)
    assert len((finished.folder / "episodes.csv").read_text().splitlines()) == 21
    for name in ("response.png", "costs.png"):
        assert (finished.folder / name).read_bytes().startswith(b"\x89PNG")


def test_killed_run_continues_from_its_checkpoint(tmp_path: Path) -> None:
    run = Run("killed", tmp_path)
    settings = changed(steps=16_000, evaluations=8)

    class Killed(Exception):  # noqa: N818 - not an error
        pass

    def kill(*_: object, **__: object) -> float:
        msg = "as if the process had died"
        raise Killed(msg)

    calls = iter([*[validation_cost] * 3, kill])

    def next_validation(*arguments: object, **options: object) -> object:
        return next(calls)(*arguments, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("agents.training.reinforcement.validation_cost", next_validation)
        with pytest.raises(Killed):
            train(settings, run)
    drawing = [t for t in threading.enumerate() if type(t).__module__.startswith("rich")]
    for thread in drawing:  # rich tells its thread to stop, and does not wait
        thread.join(10.0)
        assert not thread.is_alive()  # the progress bar is closed
    assert not run.finished
    stopped = int(load_checkpoint(run.checkpoint)["model/steps"])
    assert 0 < stopped < settings.steps
    train(settings, run)
    assert run.finished
    steps = [
        float(row.split(",")[0])
        for row in (run.folder / "metrics.csv").read_text().splitlines()[1:]
    ]
    assert steps == sorted(set(steps))
    assert steps[-1] >= settings.steps


def test_other_settings_do_not_overwrite_a_run(finished: Run) -> None:
    with pytest.raises(RunError, match="other settings"):
        train(changed(seed=5), finished)


def test_unfinished_run_is_not_reported(tmp_path: Path) -> None:
    run = Run("nothing", tmp_path)
    with pytest.raises(RunError, match="train first"):
        report_run(run)


def test_time_budget_stops_training(tmp_path: Path) -> None:
    run = Run("brief", tmp_path)
    train(changed(steps=100_000_000, time_budget=2.0), run)
    assert run.finished


def test_divergence_is_told_in_a_line(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"diverged before control step \d+; a smaller ppo\.learn"):
        train(changed(ppo={"learning_rate": 1e30}), Run("wild", tmp_path))


@pytest.mark.parametrize(
    "file", sorted((ROOT / "configs" / "agents").glob("*.toml")), ids=lambda file: file.stem
)
def test_every_agent_file_loads(file: Path) -> None:
    assert read_settings(file, TrainSettings).load_scene()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stepps = 3", "did you mean 'steps'"),
        ("steps = -3", "steps: got -3"),
        ("[ppo]\nlearning_rate = 'fast'", "ppo.learning_rate: got 'fast'"),
        ("steps = ", "Invalid value"),
    ],
)
def test_bad_agent_file_names_file_and_field(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "agent.toml"
    file.write_text(text)
    with pytest.raises(SceneError, match=message) as caught:
        read_settings(file, TrainSettings)
    assert str(file) in str(caught.value)


def test_missing_agent_file_and_unknown_task_are_named(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"absent\.toml"):
        read_settings(tmp_path / "absent.toml", TrainSettings)
    with pytest.raises(SceneError, match="task: "):
        TrainSettings(task="mm_gym/PreStretsh-v0").load_scene()
    with pytest.raises(SceneError, match=r"task: got .CartPole-v1.; allowed"):
        TrainSettings(task="CartPole-v1").load_scene()


def test_command_line_reads_file_then_flags(tmp_path: Path, monkeypatch) -> None:
    file = tmp_path / "agent.toml"
    file.write_text(
        'task = "mm_gym/CarriageForce-v0"\nlanes = 16\nsteps = 1600\nevaluations = 1\n'
        "[ppo]\nrollout = 50\nbatch_size = 400\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "agents.commands.evaluate.baselines", lambda s: ([Feedback(s, no_control(s))], {})
    )
    words = ["agents.train", str(file), "--name", "from_flags", "--ppo.epochs", "1"]
    monkeypatch.setattr("sys.argv", words)
    assert command.main() is None
    record = json.loads((tmp_path / "runs" / "from_flags" / "run.json").read_text())
    assert (record["settings"]["lanes"], record["settings"]["ppo"]["epochs"]) == (16, 1)


@pytest.mark.usefixtures("untuned")
def test_validation_charges_the_same_terminal_cost_as_the_report(tmp_path: Path) -> None:
    file = tmp_path / "limited.toml"
    text = (ROOT / "configs" / "scenes" / "carriage_force.toml").read_text()
    limited = text.replace("velocity_weight", "displacement_limit = 0.004\nvelocity_weight")
    file.write_text(limited)
    run = Run("limited", tmp_path)
    settings = changed(steps=800, evaluations=1, scene=str(file))
    train(settings, run)
    cost = run.validations()[1].min()
    scene = settings.load_scene()
    learned = agent_of(run, recorded_parts(scene, run.read(), trust=False))
    assert cost == evaluate(scene, learned, seed=VALIDATION_SEED, episodes=100).cost
    # Most episodes begin beyond the limit, so the cost is above that of the limit itself.
    assert cost**2 > limit_penalty(scene)


def test_agent_that_is_a_known_controller_leaves_its_name_alone(tmp_path: Path, monkeypatch):
    scene = load_scene("mm_gym/CarriageForce-v0")
    cached = parts.base_controller(scene, "no-control")
    monkeypatch.setattr(parts, "base_controller", lambda *_: cached)
    monkeypatch.setattr(
        parts, "read_ending", lambda _: SimpleNamespace(returned="no-control", numbers=None)
    )
    assert agent_of(Run("any", tmp_path), parts.Parts(scene), "learned").name == "learned"
    assert cached.name == "no control"


def test_run_whose_own_code_has_changed_is_not_scored(tmp_path: Path) -> None:
    law = (
        "class Law:\n    name = 'mine'\n    def __init__(self, scene): pass\n"
        "    def action(self, memory, state, applied): return -3.0 * state[:, 2:3], memory\n"
    )
    file, run = tmp_path / "law.py", Run("own", tmp_path)
    file.write_text(law)
    small = {"lanes": 4, "steps": 400, "evaluations": 1}
    ppo = {"batch_size": 100, "epochs": 1}
    settings = changed(ppo, name="own", base=f"{file}:Law", **small)
    train(settings, run, bar=False)

    def recorded() -> parts.Parts:
        return recorded_parts(run.scene(), run.read(), trust=True)

    agent_of(run, recorded())
    parts.trained_parts(run, trust=True)
    file.write_text(law.replace("-3.0", "3.0"))
    with pytest.raises(RunError, match=r"law\.py has changed since the training"):
        agent_of(run, recorded())
    with pytest.raises(RunError, match=r"law\.py has changed since the training"):
        parts.trained_parts(run, trust=True)
