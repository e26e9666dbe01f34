"""Do evolved networks act as their law at first, and is a search what its command says?"""

import json
import sys

import kills
import numpy as np
import pytest
from rollouts import PUSHING

from agents.commands import evolve as command
from agents.control.feedback import Feedback
from agents.controllers.clipped_lqr import ClippedLQR
from agents.controllers.learned import Learned, Residual
from agents.controllers.lqr import LQR
from agents.evolution.network_kernel import forward
from agents.evolution.search import LANES, Evolution, EvolveSettings, Population, Trial, evolve
from agents.policies import load_policy
from agents.scoring import VALIDATION_SEED, evaluate, validation_cost
from agents.sweeps.trials import do_trial, read_score
from agents.training import search
from agents.training.arrays import load_checkpoint, save_checkpoint
from agents.training.config import training_seeds
from agents.training.network import Network
from agents.training.parts import Best, Parts, agent_of, base_controller, make_parts, recorded_parts
from agents.training.progress import read_ending
from agents.training.runs import Run, RunError
from agents.training.scales import Scales, sizes_under
from agents.training.start import Start
from agents.training.starts import added_to, start_of
from mm_gym import DesignError, MovingMassVectorEnv, SceneError, load_scene
from mm_gym.tasks import path_of

TINY = EvolveSettings(
    task="mm_gym/CarriageForce-v0",
    name="tiny",
    candidates=8,
    episodes=4,
    generations=12,
    evaluations=3,
    hidden=4,
)


def changed(**fields):
    return EvolveSettings(**(TINY.model_dump() | fields))


def scene_of(task):
    return load_scene(f"mm_gym/{task}-v0")


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory):
    run = Run("tiny", tmp_path_factory.mktemp("runs"))
    evolve(TINY, run)
    return run


def assert_same_outcome(run, other):
    assert run.metrics.read_bytes() == other.metrics.read_bytes()
    own, others = load_policy(run.policy), load_policy(other.policy)
    for name, array in own.arrays.items():
        np.testing.assert_array_equal(array, others.arrays[name])


class TestNetworks:
    @pytest.mark.parametrize(
        "sizes",
        [
            (4, 0, 0, 5, 1, 0),
            (15, 0, 2, 8, 1, 0),
            (6, 2, 3, 1, 2, 0),
            (5, 4, 0, 3, 1, 0),
            (5, 4, 2, 3, 2, 2),
            (3, 1, 0, 4, 1, 1),
        ],
    )
    def test_kernel_acts_as_the_policy(self, sizes):
        n, m, r, hidden, k, known = sizes  # the last: actions in the memory
        rng = np.random.default_rng(0)
        units = np.stack(
            [np.linspace(0.0, 0.9, r), np.full(r, 1e-3), rng.normal(size=r), np.ones(r)], 1
        )
        start = Start(
            np.empty((r, 2, n + m)),
            units,
            np.empty((k, 1 + n + m + r)),
            np.ones(r),
            keep=rng.normal(size=(m, m)) / max(m, 1),
            enter=rng.normal(size=(m, n)) / n,
            back=rng.normal(size=(m, known)),
        )
        network = Network(start, hidden, odd=False)
        vectors = 0.5 * rng.standard_normal((3, network.free.size))
        lanes = 7
        sums = np.zeros((2 * r + m + known, 3 * lanes), np.float32)
        given = units, start.keep, start.enter, start.back
        fixed = tuple(array.astype(np.float32) for array in given)
        policies = [network.policy(vector) for vector in vectors]
        own = [policy.begin(lanes) for policy in policies]
        actions = np.empty((k, 3 * lanes), np.float32)
        memory = np.empty((n + m + r + 2, lanes), np.float32)
        for _ in range(4):
            observed = rng.standard_normal((n, 3 * lanes)).astype(np.float32)
            own_parameters = vectors.astype(np.float32)
            forward(observed, actions, own_parameters, fixed, sums, memory, network.sizes)
            for i, policy in enumerate(policies):
                mine = slice(i * lanes, (i + 1) * lanes)
                want = policy.act(observed[:, mine].T, own[i])
                # Some 30 products of order one in single precision.
                np.testing.assert_allclose(actions[:, mine].T, want, rtol=0.0, atol=2e-5)
        assert (np.abs(actions) < 1.0).any()

    def test_regulator_starts_as_the_lqr(self):
        scene = scene_of("CarriageForce")
        rng = np.random.default_rng(0)
        network = Network(start_of(scene, EvolveSettings(), rng), 8, odd=True)
        started = evaluate(scene, Learned(network.policy(network.first(rng))), episodes=10)
        lqr = evaluate(scene, Feedback(scene, LQR(scene)), episodes=10)
        # The observation is of single precision.
        np.testing.assert_allclose(started.penalties, lqr.penalties, rtol=1e-5)

    def test_switching_starts_no_worse_than_the_clipped_lqr(self):
        scene = scene_of("PreStretchShock")
        rng = np.random.default_rng(0)
        network = Network(start_of(scene, EvolveSettings(), rng), 8, odd=False)
        started = evaluate(scene, Learned(network.policy(network.first(rng))), episodes=50)
        law = evaluate(scene, Feedback(scene, ClippedLQR(scene, 1.25, 1.0)), episodes=50)
        assert started.cost < law.cost

    @pytest.mark.parametrize("frequency", [45.0, 52.0, 60.0, 70.0])
    def test_tracking_finds_the_frequency_whatever_the_springs_do(self, frequency):
        scene = scene_of("PreStretch")
        start = start_of(scene, EvolveSettings(), np.random.default_rng(0))
        env = MovingMassVectorEnv(scene, 16)
        observation, _ = env.reset(seed=0, options={"excitation.0.frequency": frequency})
        network, rng = Network(start, 1, odd=False), np.random.default_rng(0)
        policy = network.policy(network.first(rng))
        sums, cosines = policy.begin(16), []
        for _ in range(80):
            observation, *_ = env.step(rng.uniform(-1.0, 1.0, (16, 1)))
            policy.act(observation, sums)
            cosines.append(sums[:, 0] / sums[:, 1])
        # The unit ripples by 0.04 with the phase of the force, and not evenly at either side.
        found = np.arccos(np.mean(cosines[40:])) / scene.control.time_step
        assert found == pytest.approx(frequency, rel=0.03)

    def test_tracking_starts_alike_where_the_rate_of_the_stretch_is_commanded(self):
        scene, costs = scene_of("PreStretch"), []
        for what in ("position", "rate"):
            commanded = scene.replace(**{"actuation.stretch.command": what})
            start = start_of(commanded, EvolveSettings(law="tracking"), np.random.default_rng(0))
            costs.append(validation_cost(commanded, Learned(start.policy())))
        assert costs[1] == pytest.approx(costs[0], rel=1e-4)

    def test_odd_networks_push_the_mirrored_motion_the_other_way(self):
        scene, rng = scene_of("CarriageForceFriction"), np.random.default_rng(0)
        network = Network(start_of(scene, EvolveSettings(), rng), 8, odd=True)
        vector = network.first(rng) + network.free * rng.standard_normal(network.free.size)
        observation = rng.standard_normal((20, 4)).astype(np.float32)
        policy = network.policy(vector)
        np.testing.assert_allclose(policy.act(-observation), -policy.act(observation))

    def test_tuned_weights_make_a_better_start(self):
        scene, rng = scene_of("PreStretchShock"), np.random.default_rng(0)
        costs = [
            validation_cost(scene, Learned(start_of(scene, EvolveSettings(law=law), rng).policy()))
            for law in ("switching", "weighted")
        ]
        assert costs[1] < 0.99 * costs[0]

    @pytest.mark.parametrize(
        ("task", "law", "message"),
        [
            ("CarriageForce", "switching", "actuation.stretch is missing"),
            ("PreStretchShock", "regulator", "actuation.force is missing"),
            ("PreStretchShock", "tracking", "sensors.history: got 1"),
            ("CarriageForce", "weighted", "actuation.stretch is missing"),
            ("Hybrid", "weighted", "commands only springs; remove actuation.force"),
        ],
    )
    def test_law_for_other_actuators_is_refused(self, task, law, message):
        with pytest.raises(DesignError, match=message):
            start_of(scene_of(task), EvolveSettings(law=law), np.random.default_rng(0))


class TestMemories:
    def test_memory_foretells_the_force_of_noise(self):
        scene = scene_of("PreStretchNoise")
        start = start_of(scene, EvolveSettings(), np.random.default_rng(0))
        env = MovingMassVectorEnv(scene, 64)
        observation, _ = env.reset(seed=VALIDATION_SEED)
        network = Network(start, 1, odd=False)
        policy = network.policy(np.zeros(network.free.size))
        sums, memories, forces = policy.begin(64), [], []
        weights = start.enter[np.argmax(np.linalg.norm(start.enter, axis=1))]
        for _ in range(scene.control.steps - 1):
            observation, *_ = env.step(np.zeros((64, 1)))
            policy.act(observation, sums)
            memories.append(sums[:, :4].copy())
            forces.append(observation @ weights)
        told, wanted = np.array(memories)[50:-2], np.array(forces)[52:]
        fit = np.linalg.lstsq(told.reshape(-1, 4), wanted.ravel(), rcond=None)[0]
        left = wanted - told @ fit
        # Of the variance two steps ahead, the last two forces tell 0.31, any number of them 0.55.
        assert left.var() < 0.5 * wanted.var()

    @pytest.mark.parametrize("task", ["CarriageForce", "PreStretch", "Hybrid"])
    def test_scenes_without_band_limited_noise_need_none(self, task):
        start = start_of(scene_of(task), EvolveSettings(), np.random.default_rng(0))
        assert start.keep.size == start.enter.size == 0

    def test_no_memory_where_none_is_asked_for(self):
        settings = EvolveSettings(memory=0)
        start = start_of(scene_of("PreStretchNoise"), settings, np.random.default_rng(0))
        assert start.keep.size == 0


class TestPopulations:
    @pytest.mark.parametrize(
        ("task", "changes"),
        [
            ("CarriageForce", {}),
            ("CarriageForce", {"objective.displacement_limit": 0.004}),
            ("PreStretchNoise", {"control.steps": 40}),
        ],
    )
    @pytest.mark.parametrize(("threads", "worst"), [(1, 1.0), (2, 1.0), (3, 1.0), (2, 0.5)])
    def test_costs_are_those_of_an_evaluation(self, task, changes, threads, worst):
        scene = scene_of(task).replace(**changes)
        rng = np.random.default_rng(0)
        network = Network(start_of(scene, EvolveSettings(), rng), 4, odd=task == "CarriageForce")
        vectors = network.first(rng) + 0.3 * rng.standard_normal((5, network.free.size))
        population = Population(Trial(scene, network, 6, worst), 5, threads)
        for _ in range(2):  # what one generation leaves must not change the next
            costs = population.costs(vectors, range(VALIDATION_SEED, VALIDATION_SEED + 6))
        for vector, cost in zip(vectors, costs, strict=True):
            learned = Learned(network.policy(vector))
            penalties = evaluate(scene, learned, seed=VALIDATION_SEED, episodes=6).penalties
            want = np.sort(penalties)[-round(6 * worst) :].mean()
            # The kernel acts in single precision.
            np.testing.assert_allclose(cost, want, rtol=1e-3)

    @pytest.mark.parametrize("lanes", [1, 12, LANES])
    def test_costs_do_not_depend_on_how_candidates_are_divided(self, lanes, monkeypatch):
        scene, rng = scene_of("CarriageForceFriction"), np.random.default_rng(0)
        network = Network(start_of(scene, EvolveSettings(), rng), 8, odd=True)
        vectors = network.first(rng) + 0.5 * rng.standard_normal((5, network.free.size))
        whole = Population(Trial(scene, network, 6), 5, 1)
        monkeypatch.setattr("agents.evolution.search.LANES", lanes)
        divided = Population(Trial(scene, network, 6), 5, 3)
        got, want = (population.costs(vectors, range(6)) for population in (divided, whole))
        np.testing.assert_array_equal(got, want)

    @pytest.mark.parametrize(
        ("task", "worst"),
        [("CarriageForceFriction", 1.0), ("PreStretch", 1.0), ("PreStretch", 0.1)],
    )
    def test_validation_has_the_cost_of_an_evaluation(self, task, worst):
        settings = changed(task=f"mm_gym/{task}-v0", spread=1.0, worst=worst)
        search = Evolution(settings, settings.load_scene())
        vector = search.first + search.free * search.generator.normal(size=search.first.size)
        found = search._cost({"vector": vector})
        learned = Learned(search.network.policy(vector))
        penalties = evaluate(search.scene, learned, seed=VALIDATION_SEED, episodes=100).penalties
        want = np.sqrt(np.sort(penalties)[-round(100 * worst) :].mean())
        # The kernel acts in single precision.
        assert found == pytest.approx(want, rel=1e-4)

    def test_two_scenes_have_their_shares_of_the_cost(self, monkeypatch):
        settings = changed(
            task="mm_gym/CarriageForceRobust-v0", also="CarriageForce", share=0.25, episodes=8
        )
        scene, other = settings.load_scene(), scene_of("CarriageForce")
        search = Evolution(settings, scene)
        vectors = search._asked()
        monkeypatch.setattr(search, "_asked", lambda: vectors)
        search._advance()
        first, *_ = seeds = training_seeds(settings.seed, 8)
        assert seeds == list(range(first, first + 8))
        for vector, cost in zip(search._whole(vectors), search.costs[0], strict=True):
            learned = Learned(search.network.policy(vector))
            own = evaluate(scene, learned, seed=first, episodes=6).penalties.mean()
            there = evaluate(other, learned, seed=first + 6, episodes=2).penalties.mean()
            # The kernel acts in single precision.
            assert cost == pytest.approx(0.75 * own + 0.25 * there, rel=1e-3)


class TestBases:
    """The controllers have a memory: the drive its mode, the LQG its estimate."""

    @pytest.mark.parametrize(
        ("task", "base"),
        [("CarriageForceFriction", "inertial-drive"), ("CarriageForce", "lqg")],
    )
    def test_starts_exactly_as_the_base(self, task, base):
        settings = changed(task=f"mm_gym/{task}-v0", base=base)
        search = Evolution(settings, settings.load_scene())
        controller = base_controller(search.scene, base)
        policy = search._policy({"vector": search.first})
        added = Residual(controller, policy, settings.authority)
        got, want = (evaluate(search.scene, one, episodes=10) for one in (added, controller))
        np.testing.assert_array_equal(got.penalties, want.penalties)
        # The rewards are summed in another order.
        assert search._cost({"vector": search.first}) == pytest.approx(
            validation_cost(search.scene, controller), rel=1e-12
        )
        assert search.began_as == controller.name

    @pytest.mark.parametrize(
        ("task", "base", "changes", "spread"),
        [
            # In a large change the drive's switches fall on either side of a rounding.
            ("CarriageForceFriction", "inertial-drive", {}, 0.03),
            ("CarriageForce", "lqr", {"objective.displacement_limit": 0.004}, 0.3),
            ("PreStretchNoise", "clipped-lqr", {"control.steps": 40}, 0.3),
        ],
    )
    def test_costs_are_those_of_an_evaluation(self, task, base, changes, spread):
        scene, rng = scene_of(task).replace(**changes), np.random.default_rng(0)
        controller = base_controller(scene, base)
        network = Network(added_to(scene, EvolveSettings(), rng), 4, odd=False)
        vectors = network.first(rng) + spread * rng.standard_normal((5, network.free.size))
        around = Parts(scene, controller, 0.7)
        population = Population(Trial(scene, network, 6, 0.5, around), 5, 2)
        for _ in range(2):  # what one generation leaves must not change the next
            costs = population.costs(vectors, range(VALIDATION_SEED, VALIDATION_SEED + 6))
        for vector, cost in zip(vectors, costs, strict=True):
            added = Residual(controller, network.policy(vector), 0.7)
            penalties = evaluate(scene, added, seed=VALIDATION_SEED, episodes=6).penalties
            # The kernel acts in single precision.
            np.testing.assert_allclose(cost, np.sort(penalties)[-3:].mean(), rtol=1e-3)

    def test_agent_of_a_base_worse_than_no_control_keeps_the_base(self, tmp_path):
        (tmp_path / "bad.py").write_text(PUSHING)
        settings = changed(base=f"{tmp_path}/bad.py:Law", generations=1, authority=0.01)
        run = Run("tiny", tmp_path)
        evolve(settings, run)
        ending = read_ending(run)
        assert ending.is_worse
        parts = recorded_parts(settings.load_scene(), run.read(), trust=True)
        cost = validation_cost(parts.scene, agent_of(run, parts))
        assert cost == pytest.approx(ending.cost, rel=1e-6)

    def test_sweeps_score_it_with_its_base(self, tmp_path):
        settings = changed(base="lqr", generations=1, name="CarriageForce-evolved_residual-plain-0")
        run = Run(settings.name, tmp_path)
        evolve(settings, run)
        do_trial(settings.model_dump_json(), tmp_path)
        agent = agent_of(run, make_parts(settings))
        want = evaluate(settings.load_scene(), agent, episodes=100)
        np.testing.assert_array_equal(read_score(run).episodes, want.episode_costs)

    def test_sizes_of_an_own_scene_are_those_under_the_base(self):
        scene = scene_of("CarriageForce")
        base = base_controller(scene, "lqr")
        start = added_to(scene, EvolveSettings(extra=2), np.random.default_rng(0))
        scales = Scales.around(scene, base, start)
        assert scales.inputs.shape == (start.direct.shape[1] - 1,)
        (sizes,) = sizes_under(scene, base, lambda one: [one.action])
        assert scales.outputs[0] == pytest.approx(sizes[0], rel=1e-6)
        np.testing.assert_allclose(scales.inputs[-3], scales.outputs[0])


class TestRuns:
    def test_search_without_a_law_comes_near_the_optimum(self, tmp_path):
        run = Run("longer", tmp_path)
        evolve(changed(law="none", candidates=32, episodes=16, generations=60), run)
        learned = Learned(load_policy(run.policy))
        cost = evaluate(scene_of("CarriageForce"), learned, episodes=100).cost
        # No control costs 0.105 and the optimal regulator 0.0483.
        assert cost < 0.055

    def test_same_seed_writes_the_same_metrics(self, unbroken, tmp_path):
        run = Run("tiny", tmp_path)
        evolve(TINY, run)
        assert_same_outcome(run, unbroken)

    def test_folder_holds_what_repeats_the_run(self, unbroken):
        record = json.loads(unbroken.record.read_text())
        assert EvolveSettings(**record["settings"]) == TINY
        assert record["versions"]["cma"]
        rows = unbroken.metrics.read_text().splitlines()
        assert rows[0] == "steps [-],cost [-]"
        assert [row.split(",")[0] for row in rows[1:]] == ["0.0", "12800.0", "25600.0", "38400.0"]

    def test_run_interrupted_in_any_generation_ends_as_if_unbroken(
        self, unbroken, tmp_path, monkeypatch
    ):
        run, costs = Run("tiny", tmp_path), Population.costs
        left = 0

        def interrupt(population, *arguments):
            nonlocal left
            left -= 1
            if left == 0:
                raise KeyboardInterrupt
            return costs(population, *arguments)

        monkeypatch.setattr(Population, "costs", interrupt)
        for left in (1, 3, 6, 0):
            if left == 0:
                evolve(TINY, run)
                break
            with pytest.raises(KeyboardInterrupt):
                evolve(TINY, run)
            assert not run.finished
        assert_same_outcome(run, unbroken)

    def test_run_interrupted_in_a_validation_ends_as_if_unbroken(
        self, unbroken, tmp_path, monkeypatch
    ):
        run, validate, calls = Run("tiny", tmp_path), Evolution._cost, []

        def interrupted(*arguments):
            calls.append(1)
            if len(calls) == 2:
                raise KeyboardInterrupt
            return validate(*arguments)

        monkeypatch.setattr(Evolution, "_cost", interrupted)
        with pytest.raises(KeyboardInterrupt):
            evolve(TINY, run)
        evolve(TINY, run)
        assert_same_outcome(run, unbroken)

    def test_killed_run_ends_as_if_unbroken(self, unbroken, tmp_path):
        run = Run("tiny", tmp_path)
        process = kills.begin_evolution(TINY, tmp_path, touches=16)
        process.join()
        assert process.exitcode == -9
        assert run.checkpoint.exists()
        evolve(TINY, run)
        assert_same_outcome(run, unbroken)
        left = {path.name for path in run.folder.iterdir()}
        assert left == {path.name for path in unbroken.folder.iterdir()}

    def test_finished_run_goes_on_with_more_generations(self, unbroken, tmp_path):
        run = Run("tiny", tmp_path)
        evolve(changed(generations=8, evaluations=2), run)
        policy = run.policy.read_bytes()
        with pytest.raises(RunError, match="other settings"):
            evolve(changed(generations=7, evaluations=2), run)
        evolve(changed(generations=12, evaluations=2), run)
        assert (run.folder / "policy-8.safetensors").read_bytes() == policy
        assert run.read()["earlier"][0]["generations"] == 8
        # Validated at 4 and 8, then at the end: the search is that of a run that never stopped.
        assert run.metrics.read_bytes() == unbroken.metrics.read_bytes()

    def test_run_with_more_generations_than_are_asked_for_is_done(self, tmp_path, monkeypatch):
        monkeypatch.setattr(search, "best_controller", lambda *_, **__: Best("no-control", 9.0))
        # On your own scene time alone ends it, after any number of generations.
        small = {"law": "none", "candidates": 4, "episodes": 2, "hidden": 1, "evaluations": 1}
        path = str(path_of("mm_gym/CarriageForce-v0"))
        given = small | {"scene": path, "name": "few", "time_budget": 1e-3}
        run = Run("few", tmp_path)
        evolve(EvolveSettings.of(given), run)
        arrays = load_checkpoint(run.checkpoint)
        many = np.tile(arrays["evolution/costs"], (220, 1))
        save_checkpoint(run.checkpoint, arrays | {"evolution/costs": many})
        evolve(EvolveSettings.of(given | {"generations": 210}), run)
        assert run.finished
        assert read_ending(run).done == len(many)

    def test_run_with_an_infinite_validation_is_continued_and_read(self, tmp_path, monkeypatch):
        run, calls = Run("tiny", tmp_path), []
        validate, advance = Evolution._cost, Evolution._advance

        def first_is_infinite(*arguments):
            calls.append(1)
            return np.inf if len(calls) == 1 else validate(*arguments)

        def interrupted(search):
            if search.rounds == 2:
                raise KeyboardInterrupt
            advance(search)

        monkeypatch.setattr(Evolution, "_cost", first_is_infinite)
        monkeypatch.setattr(Evolution, "_advance", interrupted)
        with pytest.raises(KeyboardInterrupt):
            evolve(TINY, run)
        monkeypatch.setattr(Evolution, "_advance", advance)
        evolve(TINY, run)
        _, costs, _ = run.validations()
        assert np.isinf(costs).tolist() == [True, False, False, False]
        assert read_ending(run).cost == costs.min()

    def test_run_without_a_finite_validation_says_so(self, tmp_path, monkeypatch):
        monkeypatch.setattr(Evolution, "_cost", lambda *_: np.inf)
        for _ in range(2):
            with pytest.raises(RunError, match="costs inf, inf of 2 validations; allowed: a fin"):
                evolve(changed(generations=1, evaluations=1), Run("tiny", tmp_path))

    @pytest.mark.parametrize("base", [None, "lqr"])
    def test_negative_own_reward_is_refused_as_by_an_evaluation(self, base, tmp_path):
        path = tmp_path / "own.py"
        path.write_text("def gain(carriage_displacement):\n    return -1.0\n")
        settings = changed(reward=f"{path}:gain", law="none", base=base)
        with pytest.raises(SceneError, match="gain is negative on average; allowed for eval"):
            evolve(settings, Run("tiny", tmp_path))

    def test_run_of_other_settings_is_left_alone(self, unbroken):
        with pytest.raises(RunError, match=r"other settings \(seed 0, now 1\); choose another"):
            evolve(changed(seed=1), unbroken)
        fields = {"hidden": 1, "extra": 5, "memory": 1, "evaluations": 1}
        with pytest.raises(RunError) as caught:
            evolve(changed(changes={"control.steps": 2}, generations=3, **fields), unbroken)
        assert "changes.control.steps none, now 2; evaluations 3, now 1; " in str(caught.value)
        assert str(caught.value).endswith("; 2 more); choose another name with --name")


class TestCommand:
    def call(self, monkeypatch, *arguments):
        monkeypatch.setattr("sys.argv", ["evolve", *arguments])
        return command.main()

    def test_prints_the_held_out_cost_and_writes_a_run(self, tmp_path, monkeypatch, capsys):
        monkeypatch.chdir(tmp_path)
        flags = ["--generations", "2", "--evaluations", "1", "--candidates", "4", "--episodes", "2"]
        assert self.call(monkeypatch, "CarriageForce", *flags) is None
        cost = float(capsys.readouterr().out.split()[0])
        run = Run("CarriageForce")
        scene = scene_of("CarriageForce")
        want = evaluate(scene, Learned(load_policy(run.policy)), episodes=100).cost
        assert cost == pytest.approx(want, abs=5e-5)  # printed with four digits

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (["PreStrech"], "task or settings file: got 'PreStrech'; did you mean 'PreStretch'?"),
            (["CarriageForce", "--law", "tracking"], "actuation.stretch is missing"),
        ],
    )
    def test_bad_input_is_named_and_leaves_nothing(self, arguments, message, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        error = self.call(monkeypatch, *arguments)
        assert isinstance(error, str)
        assert message in error
        assert not list(tmp_path.iterdir())

    def test_folder_that_cannot_be_written_is_named(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "runs").write_text("a file in the folder's place")
        assert "runs/CarriageForce: cannot be" in self.call(monkeypatch, "CarriageForce")

    def test_full_disk_is_named(self, tmp_path, monkeypatch):
        def refuse(*_):
            raise OSError(28, "No space left on device")

        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr("agents.training.search.save_checkpoint", refuse)
        error = self.call(monkeypatch, "CarriageForce", "--generations", "1", "--candidates", "4")
        assert "No space left on device" in error

    def test_missing_extra_is_named(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setitem(sys.modules, "cma", None)
        assert "install the extra `evolve`" in self.call(monkeypatch, "CarriageForce")
        assert not list(tmp_path.iterdir())
