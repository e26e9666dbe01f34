"""Controllers with free numbers: what they do on their scenes, and how the numbers are searched."""

import json
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, CARRIAGE_FORCE_FRICTION, PRE_STRETCH_SHOCK, TASKS

from agents.commands import tune_controllers
from agents.commands.tune_controllers import add, main, tunables, tune
from agents.control.controller import part
from agents.controllers.inertial_drive import HOLD, INERTIAL_DRIVE, PUSH, RETURN
from agents.controllers.registry import Free, Tunable, every_entry, laws, obstacle, read_found
from agents.controllers.searched import FINALISTS, trials
from agents.scoring import VALIDATION_SEED, evaluate
from mm_gym import MovingMassVectorEnv, SceneError, files, load_scene
from mm_gym.tasks import robust_ids

DUFFING = TASKS["mm_gym/CarriageForceDuffing-v0"]
NOISE = TASKS["mm_gym/PreStretchNoise-v0"]
BY_NAME = {entry.tunable.name: entry.tunable for entry in every_entry() if entry.tunable}
FOUND = read_found()
CASES = [
    pytest.param(load_scene(task), BY_NAME[name], found, id=f"{task[7:-3]} {name}")
    for task, of_task in FOUND.items()
    for name, found in of_task.controllers.items()
]
SHORT = {"control.steps": 40}


@pytest.mark.parametrize(("scene", "tunable", "found"), CASES)
def test_tuned_numbers_cost_what_their_search_found(scene, tunable, found):
    cost = evaluate(scene, tunable.best(scene), seed=VALIDATION_SEED, episodes=100).cost
    # Numbers are rounded to six digits; switching laws and dry friction are sensitive to more.
    assert cost == pytest.approx(found.cost, rel=2e-2)
    assert found.first_cost is None or found.cost <= found.first_cost


def test_tuned_numbers_are_of_the_scenes_as_they_are():
    for task, of_task in FOUND.items():
        scene = load_scene(task)
        assert of_task.scene_digest == scene.digest
        for name, found in of_task.controllers.items():
            assert set(found.numbers) == set(BY_NAME[name].free(scene))


@pytest.mark.parametrize("variant", robust_ids())
def test_controllers_of_a_variant_are_tuned_there(variant):
    found = FOUND[variant].controllers if variant in FOUND else {}
    assert set(found) == set(tunables(load_scene(variant))), (
        f"python -m agents tune-controllers {variant} --start TASK --trials 200"
    )


@pytest.mark.parametrize(("scene", "tunable", "_"), CASES)
def test_lanes_do_not_mix(scene, tunable, _):
    def actions(lanes):
        env = MovingMassVectorEnv(scene, lanes, autoreset_mode="Disabled")
        seen, _ = env.reset(seed=7)
        controller, taken = tunable.best(scene), []
        memory = controller.begin(env)
        for _ in range(20):
            action, memory = controller.act(memory, seen, {})
            taken.append(action)
            seen, *_ = env.step(action)
        return np.array(taken)

    # A product with a matrix of another number of rows may round otherwise.
    np.testing.assert_allclose(actions(5)[:, :2], actions(2), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("scene", [CARRIAGE_FORCE_FRICTION, DUFFING])
def test_force_on_a_mirrored_state_is_mirrored(scene):
    (tunable, *_) = tunables(scene).values()
    law = tunable.best(scene).law
    state = np.random.default_rng(0).standard_normal((50, 4)) * [0.005, 0.01, 0.3, 0.3]
    one, other = law.begin(50), law.begin(50)
    applied = np.zeros((50, 1))
    for _ in range(5):
        first, one = law.action(one, state, applied)
        second, other = law.action(other, -state, applied)
        np.testing.assert_array_equal(first, -second)
        state = 0.9 * state[:, ::-1]


def test_drive_moves_the_sphere_to_the_middle_where_a_regulator_leaves_it():
    scene = CARRIAGE_FORCE_FRICTION.replace(
        initial={"sphere_offset": 0.015, "carriage_displacement": 0.0}
    )
    controller = INERTIAL_DRIVE.best(scene)  # of another scene: its first numbers
    env = MovingMassVectorEnv(scene, 1, autoreset_mode="Disabled")
    seen, info = env.reset(seed=0)
    memory, modes = controller.begin(env), []
    for _ in range(scene.control.steps - 1):
        action, memory = controller.act(memory, seen, {})
        modes.append(int(part(memory, "law")["mode"][0]))
        seen, *_, info = env.step(action)
    x1, x2, *_ = info["state"][0]
    assert abs(x2 - x1) < 0.003
    assert {HOLD, PUSH, RETURN} == set(modes)
    assert modes[-1] == HOLD


def test_feedback_linearisation_leaves_a_linear_plant():
    scene = DUFFING.replace(**{"actuation.force.limit": 1e4, "control.time_step": 5e-4})
    tunable = tunables(scene)["feedback-linearisation"]
    linear = scene.replace(**{"carriage.cubic_coefficient": 0.0})
    cancelled = evaluate(scene, tunable.first(scene), episodes=20)
    regulated = evaluate(linear, laws(linear)["lqr"](linear), episodes=20)
    # The force is held over a control step of 0.5 ms, so the cancellation is not exact.
    assert cancelled.rms == pytest.approx(regulated.rms, rel=0.1)


def test_scene_with_other_numbers_takes_the_first_ones():
    scene = CARRIAGE_FORCE_FRICTION.replace(**SHORT)
    law = INERTIAL_DRIVE.best(scene).law
    assert law.numbers == {name: one.first for name, one in INERTIAL_DRIVE.free(scene).items()}


@pytest.mark.parametrize(
    ("name", "scene", "reason"),
    [
        ("inertial-drive", CARRIAGE_FORCE, "interface.kind: got 'viscous'"),
        ("feedback-linearisation", CARRIAGE_FORCE, "carriage.cubic_coefficient: got 0"),
        (
            "feedback-linearisation",
            DUFFING.replace(**{"objective.effort_weight": 0.0}),
            "objective.effort_weight: got 0",
        ),
        ("feedforward-clipped-lqr", PRE_STRETCH_SHOCK, "the excitation has none"),
        ("weighted-clipped-lqr", CARRIAGE_FORCE, "for other actuators: stretch"),
    ],
)
def test_scene_that_a_controller_is_not_for_is_refused_by_name(name, scene, reason):
    assert name not in laws(scene)
    assert reason in obstacle(name, scene)


def test_free_numbers_stay_within_their_limits():
    one = Free(2.0, 1.0, low=1.0, high=5.0)
    assert [one.value(z) for z in (-9.0, 0.0, 9.0)] == [1.0, 2.0, 5.0]
    assert Free(2.0, 3.0, ratio=False).value(-1.0) == -1.0


@pytest.fixture
def quick(monkeypatch):
    """A search whose cost is a paraboloid, and the trials that were scored."""
    scored = []

    def cost(_, numbers):
        scored.append(numbers)
        return 0.1 + (numbers["a"] - 3.0) ** 2 + (np.log(numbers["b"]) - 1.0) ** 2

    monkeypatch.setattr("agents.controllers.searched.validation_cost", cost)
    monkeypatch.setattr(
        "agents.commands.tune_controllers.further_cost", lambda _, __, numbers: cost(_, numbers)
    )
    free = {"a": Free(0.0, 1.0, ratio=False), "b": Free(1.0, 1.0)}
    tunable = Tunable("bowl", lambda _: free, lambda _, numbers: numbers)
    monkeypatch.setattr("agents.commands.tune_controllers.tunables", lambda _: {"bowl": tunable})
    return tunable, scored


def test_search_finds_the_least_cost_within_its_budget(quick):
    tunable, scored = quick
    found = list(trials(CARRIAGE_FORCE, tunable, 301, 0))
    assert len(found) == len(scored) == 301
    coordinates, cost = min(found, key=lambda pair: pair[1])
    assert cost < 0.1 + 1e-6
    assert tunable.at(CARRIAGE_FORCE, coordinates)["a"] == pytest.approx(3.0, abs=1e-3)


def test_search_goes_on_where_it_was_interrupted(quick):
    tunable, scored = quick
    whole = list(trials(CARRIAGE_FORCE, tunable, 90, 1))
    scored.clear()
    known = [cost for _, cost in whole[:50]]
    again = list(trials(CARRIAGE_FORCE, tunable, 90, 1, known=known))
    assert len(scored) == 40
    np.testing.assert_array_equal([x for x, _ in whole], [x for x, _ in again])


def call(monkeypatch, *words):
    monkeypatch.setattr("sys.argv", ["tune-controllers", *words])
    return main()


def test_command_writes_numbers_that_it_goes_on_to_after_an_interruption(
    quick, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    words = ["CarriageForce", "--trials", "120"]
    assert call(monkeypatch, *words, "--out", "whole.json") is None
    _, scored = quick
    scored.clear()
    with monkeypatch.context() as patch:

        def stop(_, numbers):
            scored.append(numbers)
            if len(scored) == 77:
                raise KeyboardInterrupt
            return 0.1 + (numbers["a"] - 3.0) ** 2 + (np.log(numbers["b"]) - 1.0) ** 2

        patch.setattr("agents.controllers.searched.validation_cost", stop)
        assert call(patch, *words, "--out", "parts.json") == 130
    assert not Path("parts.json").exists()
    scored.clear()
    assert call(monkeypatch, *words, "--out", "parts.json") is None
    assert len(scored) == 120 - 76 + FINALISTS
    whole, parts = (json.loads(Path(f"{n}.json").read_text()) for n in ("whole", "parts"))
    assert whole == parts
    assert list(Path("runs").rglob("*.json")) == []


def test_results_that_are_written_at_once_are_all_kept(tmp_path, monkeypatch):
    def write(*written):  # so slowly that the next one reads meanwhile
        time.sleep(0.1)
        files.write_text(*written)

    monkeypatch.setattr(tune_controllers, "write_text", write)
    out, found = tmp_path / "new" / "found.json", FOUND["mm_gym/CarriageForceFriction-v0"]
    one = next(iter(found.controllers.values())).model_dump()
    with ThreadPoolExecutor() as pool:  # the lock is of each opened file, as those of processes
        list(pool.map(lambda name: add(out, "any", CARRIAGE_FORCE, name, one), "abc"))
    assert set(read_found(out)["any"].controllers) == {*"abc"}


def test_command_starts_from_the_numbers_of_another_task(quick, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tunable, scored = quick
    start = {"a": 2.5, "b": 2.0}
    monkeypatch.setattr(Tunable, "numbers", lambda *_: start)
    words = ["CarriageForceRobust", "--trials", "60", "--out", "found.json"]
    assert call(monkeypatch, *words, "--start", "CarriageForce") is None
    (found,) = json.loads(Path("found.json").read_text()).values()
    assert scored[0] == start
    assert found["controllers"]["bowl"]["first_cost"] == pytest.approx(0.4442, abs=1e-4)
    assert found["controllers"]["bowl"]["cost"] < 0.11
    assert tunable.at(CARRIAGE_FORCE, [0.0, 0.0]) == {"a": 0.0, "b": 1.0}


def test_search_from_another_start_does_not_go_on(quick, tmp_path):
    tunable, scored = quick
    file, start = tmp_path / "kept.json", {"a": 2.5, "b": 2.0}

    def interrupted(begun):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("agents.commands.tune_controllers.further_cost", interrupt)
            with pytest.raises(KeyboardInterrupt):
                tune(CARRIAGE_FORCE, tunable, 50, 0, file, start=begun)

    def interrupt(*_):
        raise KeyboardInterrupt

    for begun, other in ((start, None), (None, start)):
        interrupted(begun)
        with pytest.raises(SceneError, match="of another search"):
            tune(CARRIAGE_FORCE, tunable, 50, 0, file, start=other)
        if begun is None:  # as an earlier version kept it
            kept = json.loads(file.read_text())
            del kept["start"]
            file.write_text(json.dumps(kept))
        scored.clear()
        tune(CARRIAGE_FORCE, tunable, 50, 0, file, start=begun)
        assert len(scored) == FINALISTS
        file.unlink()


@pytest.mark.usefixtures("quick")
def test_command_refuses_a_controller_without_free_numbers(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    status = call(monkeypatch, "CarriageForce", "--controllers", "bowls")
    assert "--controllers: got 'bowls'; did you mean 'bowl'" in status
    for name, number in (("trials", "0"), ("seed", "-1")):
        with pytest.raises(SystemExit, match="2"):
            call(monkeypatch, "CarriageForce", f"--{name}", number)
        assert f"{name}: got {number}; allowed: greater than or" in capsys.readouterr().err


def test_command_says_that_no_controller_has_free_numbers(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    told = "tasks: got mm_gym/CarriageForce-v0; allowed: those to which a controller with free"
    assert told in call(monkeypatch, "CarriageForce", "--out", "numbers.json")
    assert not (tmp_path / "numbers.json").exists()


def test_damaged_numbers_are_named(tmp_path):
    path = tmp_path / "controllers.json"
    path.write_text('{"task": {"scene_digest": "x", "controllers": {"lqr": {"numbers": 1}}}}')
    with pytest.raises(SceneError, match=r"controllers\.json: task\.controllers\.lqr"):
        read_found(path)
