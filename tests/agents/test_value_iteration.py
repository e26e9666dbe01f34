"""Are values those of the physics, is the law the best, and is a run what its command says?"""

import json

import kills
import numpy as np
import policy_files
import pytest
from scipy.linalg import solve_discrete_lyapunov

from agents.commands import export
from agents.controllers.learned import Learned
from agents.network.interface import Interface
from agents.policies import PolicyError, load_deployed, load_policy
from agents.scoring import VALIDATION_SEED, evaluate
from agents.sweeps.trials import SweepSettings, do_trial, write_results
from agents.training.runs import Run, RunError
from agents.value_iteration.iteration import IterateSettings, ValueIteration, iterate, problem_of
from agents.value_table import kernel
from mm_gym import DesignError, MovingMassVectorEnv, SceneError, compile_scene, load_scene

SHOCK = load_scene("mm_gym/PreStretchShock-v0")
TINY = IterateSettings(
    name="tiny", points=5, stretches=5, sizes=3, sweeps=24, evaluations=3, threads=1
)
FREE = {
    "excitation": [],
    "initial.carriage_displacement": [-0.004, 0.004],
    "initial.sphere_offset": [-0.006, 0.006],
}
"""A free decay from a random start: nothing is unknown."""

HELD = FREE | {"actuation.stretch.maximum": 2.0 + 1e-9, "actuation.stretch.minimum": 2.0}
HELD |= {"initial.stretch": 2.0, "carriage.damping": 4.0}
"""The stretch has nothing to choose."""


def swept(scene, **settings):
    own = ValueIteration(IterateSettings(**settings, threads=1), scene)
    for _ in range(own.total):
        own._advance()
        own.rounds += 1
    return own


def value(own, table, state):
    """Return the value in a table of one stretch of a state x1, x2, v1, v2 [m, m/s]."""
    x1, x2, v1, v2 = state
    objective = SHOCK.objective
    shown = np.array([x1, x2 - x1, v1, v2 - v1, 0.0])
    shown[:1] /= objective.displacement_scale
    shown[1:2] /= objective.stroke_scale
    shown[2:] /= objective.velocity_scale
    motion = own.problem.reads[:4, 1:] @ shown
    return kernel.lookup(table, motion, own.problem.squares, np.empty((3, 4)))


def cost_to_come(scene, stretch, weights):
    """Return P of the exact cost x'Px before a step without control, and the transition."""
    move, _ = compile_scene(scene).discrete(stretch)
    return solve_discrete_lyapunov(move.T, move.T @ weights @ move), move


class TestValues:
    @pytest.mark.parametrize("weight", ["displacement", "velocity", "stroke"])
    def test_value_without_choice_is_the_exact_quadratic_form(self, weight):
        others = {"objective.displacement_weight": 0.0, f"objective.{weight}_weight": 2.0}
        scene = SHOCK.replace(**HELD | others)
        row = {
            "displacement": [1.0, 0.0, 0.0, 0.0],
            "velocity": [0.0, 0.0, 1.0, 0.0],
            "stroke": [-1.0, 1.0, 0.0, 0.0],
        }[weight]
        scale = getattr(scene.objective, f"{weight}_scale")
        exact, _ = cost_to_come(scene, 2.0, 2.0 * np.outer(row, row) / scale**2)
        own = swept(scene, points=5, stretches=2, sweeps=600)
        draw = np.random.default_rng(0)
        for state in draw.standard_normal((20, 4)) * [0.002, 0.004, 0.1, 0.2]:
            # A cubic meets a quadratic form; single precision leaves 1e-7 in each of the sweeps
            # that the value remembers, some hundred.
            found = value(own, own.values[1], state)
            assert found == pytest.approx(state @ exact @ state, rel=2e-5)

    @pytest.mark.parametrize("target", ["force", "ground"])
    def test_expectation_of_a_quadratic_form_is_exact(self, target):
        impulse = {"kind": "impulse", "target": target, "size": [-0.04, 0.04], "rate": 2.0}
        scene = SHOCK.replace(excitation=[impulse])
        own = swept(scene, points=5, stretches=3, sizes=4, sweeps=1)
        weights = np.diag([1.0, 0.0, 0.0, 0.0]) / scene.objective.displacement_scale**2
        exact, _ = cost_to_come(scene, 2.0, weights)
        u, back = np.empty(4), np.linalg.inv(self._into(own))
        for face, i, j, k in np.ndindex(4, 5, 5, 5):
            kernel.point(face, i, j, k, 5, u)
            form = (back @ u) @ exact @ (back @ u)
            own.values[1, face, i, j, k] = form * own.problem.squares
        expected, jumps, chances = np.empty_like(own.values), own.problem.jumps, own.problem.chances
        kernel.expect(
            *(own.values, expected, jumps, chances, own.problem.cost, own.problem.squares, 0, 100)
        )
        half = compile_scene(scene.replace(**{"control.time_step": 0.0025})).discrete(2.0)[0]
        unit = [0, 0, 1 / scene.carriage.mass, 0] if target == "force" else [0, 0, -1.0, -1.0]
        jump, chance = half @ unit, 1.0 - np.exp(-2.0 * 0.005)
        later = 0.04**2 / 3.0 * jump @ (exact + weights) @ jump  # the mean square of the size
        draw = np.random.default_rng(1)
        for state in draw.standard_normal((20, 4)) * [0.002, 0.004, 0.1, 0.2]:
            want = chance * (state @ exact @ state + later)
            assert value(own, expected[1], state) == pytest.approx(want, rel=1e-4)

    @staticmethod
    def _into(own):
        """Return the matrix (4, 4) from a state to a motion."""
        relative = np.array([[1.0, 0, 0, 0], [-1, 1, 0, 0], [0, 0, 1, 0], [0, 0, -1, 1]])
        scales = np.array([[0.0025], [0.01], [0.15], [0.15]])
        return own.problem.reads[:4, 1:5] @ (relative / scales)

    def test_value_is_what_the_episode_then_costs(self):
        scene = SHOCK.replace(**FREE)
        own = swept(scene, points=13, stretches=9, sweeps=120)
        policy, env = own._policy(own._present()), MovingMassVectorEnv(scene, 50)
        observation, info = env.reset(seed=VALIDATION_SEED)
        # The first stretch is drawn; the value is linear between those of the grid.
        at = (info["applied"][:, 0] - 1.0) * 4.0
        predicted = []
        for state, place in zip(info["state"], at, strict=True):
            low = min(int(place), 7)
            both = [value(own, own.values[low + side], state) for side in (0, 1)]
            predicted.append(both[0] + (place - low) * (both[1] - both[0]))
        paid = np.zeros(50)
        for _ in range(scene.control.steps):
            observation, reward, *_ = env.step(policy.act(observation))
            paid -= reward
        # Motions are of all directions; the error of this grid is some 1 % of each.
        np.testing.assert_allclose(predicted, paid, rtol=0.06)
        assert np.sum(predicted) == pytest.approx(np.sum(paid), rel=0.01)

    def test_mean_cost_with_impulses_is_that_of_long_episodes(self):
        scene = SHOCK.replace(**{"excitation.0.time": None, "control.steps": 2000})
        own = swept(scene, points=9, stretches=9, sizes=6, sweeps=240)
        assert own.residual < 1e-4  # the sweeps have converged
        law = Learned(own._policy(own._present()))
        paid = evaluate(scene, law, seed=VALIDATION_SEED, episodes=400).penalties
        # Ten impulses an episode, whose costs go as squares of sizes: four standard errors, a
        # tenth. The grid's own error is some 1 %, and an episode begins at rest, which saves 1 %.
        error = 4.0 * paid.std() / np.sqrt(len(paid))
        assert error < 0.1 * own.mean
        assert own.mean == pytest.approx(paid.mean(), abs=error)

    def test_law_is_better_than_every_network_and_a_finer_grid_is_better_still(self):
        costs = [
            evaluate(
                SHOCK,
                Learned((own := swept(SHOCK, **grid))._policy(own._present())),
                seed=VALIDATION_SEED,
                episodes=100,
            ).cost
            for grid in (
                {"points": 7, "stretches": 5, "sizes": 5, "sweeps": 100},
                {"points": 11, "stretches": 9, "sizes": 7, "sweeps": 100},
            )
        ]
        # In these episodes the clipped LQR has 0.318, networks by evolution and gradients 0.290.
        assert costs[0] < 0.30
        assert costs[1] < min(0.2895, costs[0])


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory):
    run = Run("tiny", tmp_path_factory.mktemp("runs"))
    iterate(TINY, run)
    return run


def assert_same_outcome(run, other):
    assert run.metrics.read_bytes() == other.metrics.read_bytes()
    np.testing.assert_array_equal(load_policy(run.policy).after, load_policy(other.policy).after)


def shown_to(policy, scene):
    """Return what five lanes observe in the first steps under a policy."""
    env = MovingMassVectorEnv(scene, 5)
    observation, _ = env.reset(seed=3)
    seen = [observation]
    for _ in range(60):
        seen.append(env.step(policy.act(seen[-1]))[0])
    return np.concatenate(seen)


class TestPolicy:
    @pytest.mark.parametrize(
        "changes",
        [
            {"sensors.history": 2},
            {
                "sensors.channels": [
                    *("stretch", "sphere_velocity", "carriage_displacement"),
                    *("sphere_displacement", "carriage_velocity"),
                ]
            },
            {"actuation.stretch.command": "rate"},
        ],
        ids=["history", "channels", "rate"],
    )
    def test_law_is_the_same_whatever_shows_the_state_and_moves_the_stretch(
        self, changes, unbroken
    ):
        other = SHOCK.replace(**changes)
        policy = swept(other, points=5, stretches=5, sizes=3, sweeps=24)
        policy = policy._policy(policy._present())
        found = evaluate(other, Learned(policy), seed=7, episodes=20)
        want = evaluate(SHOCK, Learned(load_policy(unbroken.policy)), seed=7, episodes=20)
        # Observations are rounded to 1e-7, which moves the instants of some switches.
        np.testing.assert_allclose(found.penalties, want.penalties, rtol=0.02)
        assert found.cost == pytest.approx(want.cost, rel=1e-3)

    def test_slow_stretch_goes_as_far_as_it_can_between_the_stretches_of_the_grid(self):
        scene = SHOCK.replace(**{"actuation.stretch.rate_limit": 20.0})  # a fifth of the distance
        policy = swept(scene, points=5, stretches=5, sizes=3, sweeps=10)
        policy = policy._policy(policy._present())
        seen = shown_to(policy, scene)
        chosen, present = 2.0 + policy.act(seen)[:, 0], 2.0 + seen[:, 4]
        low, high = np.clip([present - 0.1, present + 0.1], 1.0, 3.0)
        assert (chosen > low - 1e-6).all()
        assert (chosen < high + 1e-6).all()
        ends = np.isclose(chosen, low, atol=1e-6) | np.isclose(chosen, high, atol=1e-6)
        assert ends.mean() > 0.5

    def test_saved_policy_acts_as_the_one_that_was_saved(self, unbroken, tmp_path):
        policy = load_policy(unbroken.policy)
        policy.save(tmp_path / "copy.npz")
        seen = shown_to(policy, SHOCK)
        np.testing.assert_array_equal(
            load_policy(tmp_path / "copy.npz").act(seen), policy.act(seen)
        )

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"format": 2}, "format: got 2; allowed: 1"),
            ({"travel": "far"}, "not a policy"),
            ({"travel": -1.0}, "travel: got -1.0; allowed: greater than 0"),
            ({"after": np.zeros(3)}, r"after: got shape \(3,\)"),
            ({"after": np.zeros((5, 4, 3, 3, 3, 3))}, r"allowed: .* of shape \(5, 4, 4, 4, 4, 3\)"),
            ({"cost": np.full(4, np.nan)}, "cost: got numbers that are not finite"),
            ({"stretches": np.zeros(5)}, "stretches, squares: .* allowed: numbers that increase"),
            ({"reads": np.zeros(4)}, r"reads: got shape \(4,\)"),
        ],
        ids=str,
    )
    def test_damaged_policy_is_refused_by_name(self, change, message, unbroken, tmp_path):
        arrays = policy_files.read(unbroken.policy)
        description = json.loads(str(arrays["description"]))
        for name, value in change.items():
            (arrays if name in arrays else description)[name] = value
        arrays["description"] = np.array(json.dumps(description))
        file = tmp_path / "policy.safetensors"
        file.write_bytes(unbroken.policy.read_bytes())
        policy_files.write(file, arrays)
        with pytest.raises(PolicyError, match=message):
            load_policy(file)

    def test_policy_for_another_scene_is_refused(self, unbroken):
        hybrid = load_scene("mm_gym/Hybrid-v0")
        with pytest.raises(PolicyError, match="got 5 observed numbers and 1 action; the scene has"):
            evaluate(hybrid, Learned(load_policy(unbroken.policy)), episodes=1)

    @pytest.mark.parametrize("ending", [".c", ".onnx"])
    def test_export_of_a_table_is_refused(self, ending, unbroken, tmp_path, monkeypatch):
        out = tmp_path / f"policy{ending}"
        monkeypatch.setattr("sys.argv", ["export", str(unbroken.policy), "--out", str(out)])
        said = export.main()
        assert "allowed for a policy of value iteration: .safetensors" in said
        assert "a table of 7,500 numbers" in said
        assert not out.exists()

    def test_export_tells_what_the_table_is_connected_to(self, unbroken, tmp_path, monkeypatch):
        out = tmp_path / "table.safetensors"
        monkeypatch.setattr("sys.argv", ["export", str(unbroken.folder), "--out", str(out)])
        assert export.main() is None
        policy, seen = load_policy(unbroken.policy), shown_to(load_policy(out), SHOCK)
        np.testing.assert_array_equal(load_policy(out).act(seen), policy.act(seen))
        deployed = load_deployed(out)
        assert deployed.interface == Interface.of_scene(unbroken.scene())
        measured = deployed.zero + seen[0] / deployed.factor
        wanted = deployed.interface.commanded(policy.act(seen[:1])[0])
        np.testing.assert_allclose(deployed.act_si(measured, 0.0), wanted, rtol=1e-6)


class TestScenes:
    @pytest.mark.parametrize(
        ("task", "changes", "message"),
        [
            ("CarriageForce", {}, "actuation.stretch: missing"),
            ("Hybrid", {}, "actuation.force: allowed for value iteration: none"),
            ("PreStretch", {}, "excitation: got harmonic; allowed for value iteration: impulse"),
            ("PreStretch", {}, "randomization: got excitation.0.frequency"),
            ("PreStretchShock", {"carriage.cubic_coefficient": 1e3}, "scene: got a smooth nonlin"),
            ("PreStretchShock", {"carriage.linear_coefficient": -0.1}, "linear_coefficient: got"),
            ("PreStretchShock", {"excitation.0.time": 0.5}, "excitation: got an impulse at 0.5 s"),
            ("PreStretchShock", {"excitation.0.rate": 30.0}, "got 0.15 impulses in a control"),
            ("PreStretchShock", {"excitation.0.size": 0.04}, "got random impulses of size 0.04"),
            ("PreStretchShock", {"objective.effort_weight": 0.1}, "no effort_weight"),
            ("PreStretchShock", {"objective.rail_half_length": 0.1}, "rail_half_length"),
            ("PreStretchShock", {"actuation.stretch.lag": 0.01}, "lag: got 0.01 s"),
            ("PreStretchShock", {"sensors.delay": 1}, "sensors: allowed for value iteration"),
            ("PreStretchShock", {"sensors.noise": {"stretch": 0.1}}, "without noise, bias, delay"),
            ("PreStretchShock", {"sensors.bias": {"stretch": 0.1}}, "without noise, bias, delay"),
            ("PreStretchShock", {"sensors.dropout": 0.5}, "without noise, bias, delay and dropout"),
            ("PreStretchShock", {"sensors.channels": ["stretch"]}, "show the whole state"),
        ],
        ids=str,
    )
    def test_scene_that_it_cannot_solve_is_refused(self, task, changes, message):
        scene = load_scene(f"mm_gym/{task}-v0").replace(**changes)
        with pytest.raises(DesignError) as caught:
            problem_of(scene, 5, 3)
        assert message in str(caught.value)


class TestRuns:
    def test_grid_whose_policy_could_not_be_read_again_is_refused(self):
        with pytest.raises(SceneError, match="got a table of 79 MiB; allowed: less than 64 MiB"):
            IterateSettings.of({"points": 25, "stretches": 33, "sizes": 10})

    def test_run_interrupted_in_any_sweep_ends_as_if_unbroken(
        self, unbroken, tmp_path, monkeypatch
    ):
        run, sweep, left = Run("tiny", tmp_path), kernel.sweep, 0

        def interrupt(*arguments):
            nonlocal left
            left -= 1
            if left == 0:
                raise KeyboardInterrupt
            sweep(*arguments)

        monkeypatch.setattr("agents.value_iteration.iteration.sweep", interrupt)
        for left in (1, 8, 13, 0):
            if left == 0:
                iterate(TINY, run)
                break
            with pytest.raises(KeyboardInterrupt):
                iterate(TINY, run)
            assert not run.finished
        assert_same_outcome(run, unbroken)

    def test_killed_run_ends_as_if_unbroken(self, unbroken, tmp_path):
        run = Run("tiny", tmp_path)
        process = kills.begin_iteration(TINY, tmp_path, touches=16)
        process.join()
        assert process.exitcode == -9
        assert not run.finished
        iterate(TINY, run)
        assert_same_outcome(run, unbroken)

    def test_results_depend_on_neither_threads_nor_seed(self, unbroken, tmp_path):
        run = Run("tiny", tmp_path)
        iterate(TINY.model_copy(update={"threads": 3, "seed": 5}), run)
        assert_same_outcome(run, unbroken)

    def test_finished_run_goes_on_with_more_sweeps(self, unbroken, tmp_path):
        run = Run("tiny", tmp_path)
        iterate(TINY.model_copy(update={"sweeps": 16, "evaluations": 2}), run)
        first = run.policy.read_bytes()
        iterate(TINY.model_copy(update={"evaluations": 2}), run)
        assert (run.folder / "policy-16.safetensors").read_bytes() == first
        assert run.validations()[1][-1] == unbroken.validations()[1][-1]
        with pytest.raises(RunError, match="other settings"):
            iterate(TINY.model_copy(update={"points": 6}), run)

    def test_value_iteration_is_an_algorithm_of_a_sweep(self, unbroken, tmp_path):
        own = {"points": 5, "stretches": 5, "sizes": 3, "sweeps": 24, "evaluations": 3}
        sweep = SweepSettings(
            tasks=("PreStretchShock",),
            algorithms=("value_iteration",),
            settings={f"value_iteration.{name}": value for name, value in own.items()},
        )
        (trial,) = sweep.trials()
        do_trial(trial.model_dump_json(), tmp_path)
        assert_same_outcome(Run(trial.name, tmp_path), unbroken)
        row = write_results([trial], tmp_path).read_text()
        assert "PreStretchShock,value_iteration,plain,0," in row
