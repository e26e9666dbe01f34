"""Do the committed scores hold, and is there something to gain on every task?"""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from tasks import ACTIVE_MASS_DAMPER, CARRIAGE_FORCE, TASKS

from agents.commands import headroom as command
from agents.control.feedback import Feedback
from agents.controllers.constant import ConstantAction, held
from agents.controllers.inertial_drive import INERTIAL_DRIVE
from agents.controllers.predictive_control import ROLLOUTS
from agents.evaluation.headroom import (
    BEST,
    EPISODES,
    KEPT,
    LEARNED,
    ROUNDING,
    SCORES,
    controllers_of,
    interval,
    least_cost,
    over_plans,
    passive_rows,
    varied,
)
from agents.evaluation.plans import CHILDREN, Effort, LocalSearch, Planner
from agents.policies import network
from agents.scoring import HELD_OUT_SEED, evaluate
from mm_gym import MovingMassVectorEnv, compile_scene

COMMITTED = json.loads(SCORES.read_text("utf-8"))
COMMAND = "python -m agents headroom"


@pytest.mark.parametrize("name", TASKS)
def test_scores_are_of_the_present_scene(name) -> None:
    assert COMMITTED[name]["scene_digest"] == TASKS[name].digest, f"run `{COMMAND} {name}`"


@pytest.mark.parametrize("name", TASKS)
def test_something_known_gains_a_fifth_on_the_best_constant(name) -> None:
    rows = COMMITTED[name]["rows"]
    constant = next(row["cost"] for row in rows if row["role"] == "constant")
    assert least_cost(rows) <= 0.8 * constant


@pytest.mark.parametrize("name", TASKS)
def test_no_fixed_action_beats_the_best_constant(name) -> None:
    costs = {row["role"]: row["cost"] for row in COMMITTED[name]["rows"]}
    # Where a rate is commanded, going to the best stretch costs effort that staying does not.
    assert costs["constant"] <= costs["zero"] * 1.001


@pytest.mark.parametrize("name", TASKS)
def test_scores_come_out_again(name) -> None:
    # Predictive control and plans take an hour. Another processor rounds otherwise.
    committed = {(row["role"], row["controller"]): row["cost"] for row in COMMITTED[name]["rows"]}
    apart = {LEARNED, "predictive", "planner"}
    again = {
        (role, one.name): evaluate(TASKS[name], one, episodes=EPISODES).cost
        for role, one in controllers_of(TASKS[name])
        if role not in apart
    }
    again |= {("passive", row["controller"]): row["cost"] for row in passive_rows(TASKS[name])}
    assert again == {
        key: pytest.approx(cost, rel=1e-3) for key, cost in committed.items() if key[0] not in apart
    }


def test_interval_is_that_of_the_central_limit() -> None:
    penalties = 1.0 + 0.2 * np.random.default_rng(3).standard_normal(400)
    low, high = interval(penalties)
    half = 1.96 * penalties.std() / 400**0.5
    # A percentile of 10,000 resamples scatters by about 2 % of the half width.
    assert low**2 == pytest.approx(penalties.mean() - half, abs=0.1 * half)
    assert high**2 == pytest.approx(penalties.mean() + half, abs=0.1 * half)


SHORT = Effort(
    random=2, rounds=1, first=8, second=15, steps=8, searches=1, generations=20, descent=10, last=15
)


@pytest.mark.parametrize("lag", [0.0, 0.01])
def test_planner_reaches_the_riccati_value_where_the_force_limit_does_not_bind(lag) -> None:
    # From small displacements: there the force stays within its limit.
    changes = {"initial.carriage_displacement": [-1e-3, 1e-3], "initial.sphere_offset": 0.0}
    scene = CARRIAGE_FORCE.replace(**changes, **{"actuation.force.lag": lag})
    planned = evaluate(scene, Planner(scene, {}, SHORT), episodes=5)
    assert np.abs(planned.applied).max() < scene.actuation.force.limit
    goal, limit, share = scene.objective, scene.actuation.force.limit, 1.0
    if lag:
        share -= np.exp(-scene.control.time_step / lag)
    # The fifth state is the force, which goes a share of the way to its command in a step.
    (motion, push), a, b = compile_scene(scene).discrete(), np.zeros((5, 5)), np.zeros((5, 1))
    a[:4, :4], a[:4, 4:], a[4, 4] = motion, (1.0 - share) * push, 1.0 - share
    b[:4], b[4] = share * push, share
    q = np.zeros((5, 5))
    q[0, 0] = goal.displacement_weight / goal.displacement_scale**2
    q[2, 2] = goal.velocity_weight / goal.velocity_scale**2
    r, p = goal.effort_weight / limit**2, np.zeros((5, 5))
    for _ in range(scene.control.steps):  # the cost is that of the states at the steps' ends
        p += q
        gain = b.T @ p @ a / (r + b.T @ p @ b)
        p = a.T @ p @ (a - b @ gain)
    env = MovingMassVectorEnv(scene, 5)
    _, info = env.reset(seed=HELD_OUT_SEED)
    value = np.einsum("li,ij,lj->l", info["state"], p[:4, :4], info["state"])
    np.testing.assert_allclose(planned.penalties * scene.control.steps, value, rtol=1e-6)


def test_planner_is_not_worse_than_what_it_starts_from_in_any_episode() -> None:
    scene = TASKS["mm_gym/PreStretchShock-v0"].replace(**{"control.steps": 60})
    law = evaluate(scene, Feedback(scene, held(scene, "stretch", 2.0)), episodes=8)
    none = Effort(random=0, kept=1, first=1, second=1, rounds=0, searches=0, last=1)
    planned = evaluate(scene, Planner(scene, {"law": law.applied}, none), episodes=8)
    assert np.all(planned.penalties <= law.penalties * (1.0 + 1e-9))


def test_random_changes_better_plans_that_steps_of_gauss_and_newton_leave() -> None:
    scene = TASKS["mm_gym/PreStretchShock-v0"].replace(**{"control.steps": 80})
    ended = Effort(random=2, rounds=0, searches=0, last=200)
    stuck = evaluate(scene, Planner(scene, {}, ended), episodes=6).penalties
    searched = evaluate(scene, Planner(scene, {}, replace(ended, searches=2)), episodes=6).penalties
    # 200 more steps of Gauss and Newton gain less than a millionth; the random changes 0.8 % here.
    assert np.all(searched < stuck)
    assert searched.mean() < 0.995 * stuck.mean()


def test_random_changes_keep_off_ends_and_say_what_is_applied() -> None:
    # Episodes end on a rail that the cart reaches without control, and must be held off it.
    changes = {"objective.rail_half_length": 0.02, "control.steps": 60}
    scene = ACTIVE_MASS_DAMPER.replace(randomization={}, **changes)
    env = MovingMassVectorEnv(scene, 5, autoreset_mode="Disabled")
    env.reset(seed=HELD_OUT_SEED)
    search = LocalSearch(scene, env.get_state(), np.random.default_rng(0))
    pushed = np.ones((60, 1, 5 * CHILDREN))
    assert np.all(np.isinf(search._costs(pushed)))
    still = np.zeros((60, 1, 5))
    assert np.all(np.isfinite(search._costs(np.tile(still, CHILDREN))))
    applied = search.improve(still, 30)
    again = LocalSearch(scene, env.get_state(), np.random.default_rng(0)).improve(still, 30)
    np.testing.assert_array_equal(applied, again)
    # Without rate limit and lag an action is what is applied over the limit.
    actions = np.moveaxis(applied / scene.actuation.force.limit, 1, 2)
    found, before = (search._costs(np.tile(plan, CHILDREN))[:5] for plan in (actions, still))
    assert np.all(found < before)


def test_plans_also_start_from_controllers_with_other_numbers(monkeypatch) -> None:
    scene = TASKS["mm_gym/CarriageForceFriction-v0"]
    monkeypatch.setattr("agents.evaluation.headroom.VARIED", 6)
    few = [replace(ROLLOUTS, horizon=steps, plans=8, rounds=1) for steps in (2, 4, 6)]
    monkeypatch.setattr("agents.evaluation.headroom.THOROUGH", few)
    starts = varied(scene, episodes=4)
    assert len(starts) == len(few) + BEST
    tuned = evaluate(scene, INERTIAL_DRIVE.best(scene), episodes=4).applied
    for applied in starts.values():
        assert applied.shape == tuned.shape
        assert np.any(applied != tuned)
    again = varied(scene, episodes=4)
    assert all(np.array_equal(starts[name], again[name]) for name in starts)
    # Each is what a controller applied: planning from it alone costs no more.
    none = Effort(random=0, kept=1, first=1, second=1, rounds=0, searches=0, last=1)
    planned = evaluate(scene, Planner(scene, starts, none), episodes=4)
    assert planned.cost < evaluate(scene, INERTIAL_DRIVE.best(scene), episodes=4).cost
    assert varied(TASKS["mm_gym/CarriageForce-v0"]) == {}


@pytest.mark.parametrize("name", TASKS)
def test_planner_beats_the_best_constant_in_every_episode(name) -> None:
    scene = TASKS[name].replace(**{"control.steps": 40})
    planner = Planner(scene, {}, SHORT)
    planned = evaluate(scene, planner, episodes=4)
    # What the search found is what the environment gives, with its noise and its sensors'.
    np.testing.assert_allclose(planner.cost, planned.penalties * 40, rtol=1e-6)
    assert np.all(planned.penalties <= evaluate(scene, ConstantAction(scene), episodes=4).penalties)


@pytest.mark.parametrize("name", TASKS)
def test_no_committed_score_is_better_than_the_best_known_plan(name) -> None:
    rows = COMMITTED[name]["rows"]
    best = next(row for row in rows if row["role"] == "planner")
    assert best["cost"] == least_cost(rows)
    costs = np.array([plan["cost"] for plan in best["plans"]])
    assert np.sqrt((costs**2).mean()) == pytest.approx(best["cost"], rel=1e-5)


def test_planner_uses_the_rail_to_its_end_and_not_beyond() -> None:
    rail, strong = 0.02, {"excitation.0.rms": 1.2, "excitation.1.rms": 0.5}
    scene = ACTIVE_MASS_DAMPER.replace(
        randomization={}, **strong, **{"objective.stroke_weight": 0.0, "control.steps": 80}
    )
    reached, costs = [], []
    for limit in (None, rail):
        limited = scene.replace(**{"objective.rail_half_length": limit})
        planner = Planner(limited, {}, SHORT)
        planned = evaluate(limited, planner, episodes=4)
        # The environment ended no episode: a terminal cost would more than double the penalty.
        np.testing.assert_allclose(planner.cost, 80 * planned.penalties, rtol=0.01)
        states = planner.problem.follow(np.arange(4), planner.controls).states
        reached.append(np.abs(states[:, 1] - states[:, 0]).max(axis=0))
        costs.append(planned.penalties)
    assert np.all(reached[0] > 1.5 * rail)
    # Plans keep off the limit by a fiftieth of it, but for a little of that.
    np.testing.assert_allclose(reached[1], 0.98 * rail, rtol=5e-3)
    assert np.all(costs[1] > costs[0])


def test_planner_refuses_a_lag_of_what_is_commanded_by_its_rate() -> None:
    limited = {"lag": 0.01, "rate_limit": 9.0, "command": "rate"}
    changes = {f"actuation.force.{name}": value for name, value in limited.items()}
    scene = CARRIAGE_FORCE.replace(**changes)
    with pytest.raises(ValueError, match=r"actuation\.force: .* no lag of an actuator"):
        evaluate(scene, Planner(scene, {}, SHORT), episodes=1)


def test_check_names_the_episodes_in_which_a_run_is_better_than_the_plan(
    tmp_path, monkeypatch, capsys
) -> None:
    name, folder = "mm_gym/CarriageForce-v0", tmp_path / "small"
    folder.mkdir()
    record = {"settings": {"task": name}, "scene_digest": CARRIAGE_FORCE.digest}
    record["scene"] = json.loads(CARRIAGE_FORCE.model_dump_json())
    (folder / "run.json").write_text(json.dumps(record))
    ends = np.array([1.0], np.float32)
    weight = np.array([[0.0, 0.0, -1.0, 0.0]], np.float32)
    network((weight,), (np.zeros(1, np.float32),), "tanh", -ends, ends).save(
        folder / "policy.safetensors"
    )
    scores = tmp_path / "scores.json"
    scores.write_text(json.dumps({name: COMMITTED[name]}))
    flags = ["headroom", "--check", "--runs", str(folder), "--out", str(scores)]
    monkeypatch.setattr(sys, "argv", flags)
    assert command.main() is None
    assert "small: 1." in capsys.readouterr().out
    dearer = json.loads(scores.read_text())
    (planner,) = (row for row in dearer[name]["rows"] if row["role"] == "planner")
    planner["plans"][17]["cost"] *= 10.0
    scores.write_text(json.dumps(dearer))
    told = str(command.main())
    assert (
        "small is better than the clairvoyant optimum of mm_gym/CarriageForce-v0 in episodes 17"
        in told
    )
    assert "--runs" in told
    scores.write_text("{}")
    assert "no scores of the present scene" in str(command.main())


@pytest.mark.parametrize(
    ("words", "of", "told"),
    [
        (["Hybrid", "--check"], "mm_gym/CarriageForce-v0", "allowed: runs of Hybrid"),
        ([], "mm_gym/HybridRobust-v0", "got 'HybridRobust'; did you mean 'Hybrid'"),
    ],
)
def test_runs_of_other_tasks_are_refused_before_anything_is_scored(
    words, of, told, monkeypatch
) -> None:
    monkeypatch.setattr(command, "agents_of", lambda _: {of: [None]})
    for name in ("score", "check"):
        monkeypatch.setattr(command, name, lambda *_: pytest.fail("scored"))
    monkeypatch.setattr(sys, "argv", ["headroom", *words, "--runs", "some"])
    assert told in str(command.main())


def test_what_cannot_be_kept_is_refused_before_the_search(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    monkeypatch.setattr(command, "score", lambda *_: pytest.fail("scored"))
    monkeypatch.setattr(sys, "argv", ["headroom", "CarriageForce", "--plans", "file"])
    told = "file/carriage_force.npy: cannot be written: Not a directory"
    assert told in str(command.main())


def test_number_that_is_not_allowed_is_refused(monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys, "argv", ["headroom", "CarriageForce", "--seed", "-1"])
    with pytest.raises(SystemExit, match="2"):
        command.main()
    assert "seed: got -1; allowed: greater than or equal to 0" in capsys.readouterr().err


def test_scores_that_another_process_writes_meanwhile_stay(tmp_path, monkeypatch) -> None:
    name, other = "mm_gym/CarriageForce-v0", "mm_gym/PreStretchNoise-v0"
    scores = tmp_path / "scores.json"
    scores.write_text(json.dumps({task: COMMITTED[task] for task in (name, other)}))
    monkeypatch.setattr(sys, "argv", ["headroom", "CarriageForce", "--out", str(scores)])
    rows = [one | {"reads": "anew"} for one in COMMITTED[name]["rows"]]

    def long_search(*_):
        now = json.loads(scores.read_text())
        now[other]["preview"] = {"expected": 2.0, "foreseen": 1.0}
        now[name]["preview"] = {"expected": 4.0, "foreseen": 3.0}
        scores.write_text(json.dumps(now))
        return rows

    monkeypatch.setattr(command, "score", long_search)
    assert command.main() is None
    found = json.loads(scores.read_text())
    assert found[name]["rows"] == rows
    assert found[name]["preview"]["expected"] == 4.0
    assert found[other]["preview"]["expected"] == 2.0


@pytest.mark.parametrize("name", TASKS)
def test_no_law_is_better_than_the_best_known_plan_in_any_episode(name) -> None:
    controllers = [controller for _, controller in controllers_of(TASKS[name])]
    for label, ratios in over_plans(TASKS[name], controllers, COMMITTED[name]["rows"]).items():
        assert np.all(ratios >= 1.0 - ROUNDING), label


def test_earlier_cost_stands_where_it_is_less() -> None:
    earlier = [{"role": "planner", "plans": [{"cost": c, "start": "first"} for c in (0.1, 0.3)]}]
    plans = [{"cost": 0.2, "start": "second"}, {"cost": 0.25, "start": f"{KEPT}, changed"}]
    planner = {"role": "planner", "plans": plans, "cost": 1.0, "low": 1.0, "high": 1.0}
    planner["displacement"] = 1.0
    command._keep_better(planner, earlier)
    assert planner["plans"] == [
        {"cost": 0.1, "start": "first"},
        {"cost": 0.25, "start": "first, changed"},
    ]
    assert planner["cost"] == pytest.approx(np.sqrt((0.1**2 + 0.25**2) / 2.0), rel=1e-5)
    assert planner["displacement"] == planner["cost"]
    assert planner["low"] == pytest.approx(0.1)
    assert planner["high"] == pytest.approx(0.25)
