"""Are gradients through the physics those of the cost, and is a training what its command says?"""

from dataclasses import replace

import kills
import numpy as np
import pytest

from agents.controllers.learned import Learned
from agents.gradient import episodes, network
from agents.gradient.descent import Descent, descend
from agents.gradient.episodes import Episodes
from agents.gradient.network import (
    Network,
    _roles,
    parameters_of,
    policy_of,
    with_oscillators,
)
from agents.gradient.recurrent import SMALL, RecurrentDescent, with_cell
from agents.gradient.settings import GradientSettings
from agents.network.c_source import c_source
from agents.network.layers import GRU, Correlation
from agents.network.module import Module
from agents.policies import load_policy, policy_in
from agents.scoring import evaluate
from agents.sweeps.trials import SweepSettings, do_trial, write_results
from agents.training.network import Network as Evolved
from agents.training.runs import Run, RunError
from agents.training.starts import natural_law, start_of
from mm_gym import ActionError, DesignError, OwnReward, SceneError, load_scene, rewarded
from mm_gym.tasks import ids, path_of, robust_ids

TINY = GradientSettings(
    task="mm_gym/Hybrid-v0",
    name="tiny",
    changes={"control.steps": 40},
    episodes=8,
    iterations=12,
    evaluations=3,
    hidden=4,
    extra=1,
)
STEPS, LANES = 12, 3

SHORT = {"control.steps": STEPS, "sensors.noise": {}}
HYSTERESIS = {
    "interface": {
        "kind": "bouc_wen",
        "stiffness": 50.0,
        "yield_displacement": 0.005,
        "damping": 0.2,
    },
    "springs": {"kind": "linear", "stiffness": 20.0},
    "initial.carriage_velocity": [0.1, 0.5],
}
"""Its motion turns back within STEPS nowhere, where the second derivative would jump."""

SCENES = {
    "both actuators, three frames": ("Hybrid", {}),
    "late frames": ("Hybrid", {"sensors.delay": 2}),
    "frames late and lost, lags, all drawn": (
        "Hybrid",
        {
            "sensors.dropout": 0.3,
            "randomization": {
                "sensors.delay": [0, 2],
                "actuation.force.lag": [0.0, 0.02],
                "actuation.stretch.lag": [0.0, 0.02],
            },
        },
    ),
    "a slow stretch, and what it is": ("PreStretch", {"actuation.stretch.rate_limit": 40.0}),
    "a lag": ("PreStretchNoise", {"actuation.stretch.lag": 0.02}),
    "rate and lag": (
        "PreStretchNoise",
        {"actuation.stretch": {"command": "rate", "rate_limit": 60.0, "lag": 0.02}},
    ),
    "velocity and effort": ("CarriageForceDuffing", {}),
    "stroke": ("CarriageForce", {"objective.stroke_weight": 1.0}),
    "accelerations": (
        "CarriageForceDuffing",
        {
            "objective.carriage_acceleration_weight": 1.0,
            "objective.sphere_acceleration_weight": 0.5,
            "objective.coupling_force_weight": 0.2,
        },
    ),
    "observed accelerations": (
        "CarriageForceDuffing",
        {
            "sensors.channels": ["carriage_acceleration", "sphere_acceleration", "spring_force"],
            "sensors.history": 2,
            "objective.velocity_scale": 1.0,
        },
    ),
    "observed accelerations, both actuators, late": (
        "Hybrid",
        {
            "sensors.channels": ["carriage_acceleration", "sphere_offset", "stretch"],
            "sensors.delay": 2,
        },
    ),
    "observed accelerations, force between the masses, a lag": (
        "CarriageForce",
        {
            "actuation.force": {"limit": 4.0, "between": "masses", "lag": 0.02},
            "sensors.channels": ["sphere_acceleration", "applied_force"],
            "objective.sphere_acceleration_weight": 0.5,
        },
    ),
    "observed accelerations, a damper": (
        "SemiActiveDamper",
        {"sensors.channels": ["carriage_acceleration", "sphere_offset", "damping"]},
    ),
    "observed accelerations, a damper of the carriage": (
        "SemiActiveDamper",
        {
            "actuation.damping": {"of": "carriage", "minimum": 0.1, "maximum": 20.0, "lag": 0.03},
            "sensors.channels": ["carriage_acceleration", "sphere_acceleration"],
            "objective.carriage_acceleration_weight": 0.1,
        },
    ),
    "observed accelerations, a state of the interface": (
        "CarriageForce",
        HYSTERESIS | {"sensors.channels": ["sphere_acceleration", "carriage_velocity"]},
    ),
    "a state of the interface": ("CarriageForce", HYSTERESIS),
    "a state of the interface, accelerations": (
        "CarriageForce",
        HYSTERESIS
        | {"objective.sphere_acceleration_weight": 0.5, "objective.coupling_force_weight": 0.2},
    ),
    "a memory of the action": ("Hybrid", {}),
    "a memory of the action that settles": ("Hybrid", {}),
    "an own cost": ("CarriageForceDuffing", {}),
    "an own cost over a state of the interface": ("CarriageForce", HYSTERESIS),
}


def own_cost(sphere_offset, carriage_acceleration, sphere_acceleration, spring_force):
    of_masses = 0.01 * carriage_acceleration**2 + 0.02 * sphere_acceleration**2
    return 1e3 * sphere_offset**2 + of_masses + 0.1 * spring_force**2


class Exact:
    """The environment of episodes, but what follows from the state is not rounded to float32."""

    def __init__(self, own):
        self.own, self.env, self.plant = own, own.env, own.env.plant
        self.scene = own.env.scene
        self.get_state = own.env.get_state
        self.zero = np.array([[channel.zero * channel.factor] for channel in self.plant.observed])

    def reset(self, **options):
        observation, info = self.env.reset(**options)
        newest = observation[:, -len(self.zero) :].T.astype(np.float64)
        self.measured, self.received = [newest], [newest] * self.plant.history  # oldest first
        return observation, info

    def step(self, actions):
        _, *rest = self.env.step(actions)
        shown = self.own.outputs._values(self.get_state()["values"].copy())[:-1] - self.zero
        self.measured.append(shown)
        ages, row = np.full(shown.shape[1], self.plant.delay), self.plant.support.age_row
        if row:
            ages = self.get_state()["values"][row].astype(int)
        ages = np.minimum(ages, len(self.measured) - 1)
        newest = [self.measured[-1 - age][:, lane] for lane, age in enumerate(ages)]
        self.received = [*self.received[1:], np.stack(newest, axis=1)]
        return np.concatenate(self.received).T, *rest


class Replayed:
    """An environment that shows what another showed in its first run, whatever is done."""

    def __init__(self, own):
        self.own, self.plant, self.get_state = own, own.plant, own.get_state
        self.scene = own.scene
        self.shown = []

    def reset(self, **options):
        self.left = iter(self.shown[:])
        return self._noted(*self.own.reset(**options))

    def step(self, actions):
        return self._noted(*self.own.step(actions))

    def _noted(self, observation, *rest):
        if len(self.shown) <= STEPS:
            self.shown.append(observation)
        return next(self.left, observation), *rest


def policy_for(scene, seed=1, *, knows_action=False, settles=False):
    """Return a policy with memory and units of random weights, which asks for less than it may."""
    generator = np.random.default_rng(seed)
    settings = GradientSettings(law="none", extra=2)
    start = with_oscillators(start_of(scene, settings, generator), 2, generator)
    start.units[:, 0] = 0.8
    if knows_action:
        back = 0.1 * generator.standard_normal((len(start.keep), len(start.direct)))
        start = replace(start, back=back)
    if settles:
        weights = np.hstack([start.keep, start.enter, start.back])
        early = 0.1 * generator.standard_normal(weights.shape)
        start = replace(start, early=early, fade=np.array([0.8]))
    evolved = Evolved(start, 5, odd=False)
    policy = evolved.policy(evolved.first(generator))
    parameters = parameters_of(policy)
    for name in ("direct", "output", "last"):
        parameters[name] = 0.05 * generator.standard_normal(parameters[name].shape)
    return policy_of(parameters, policy)


def test_training_follows_an_interface_within_a_tolerance_of_its_own():
    changes = {"control.steps": 5, **HYSTERESIS}
    settings = TINY.model_copy(update={"task": "mm_gym/CarriageForce-v0", "changes": changes})
    scene = settings.rewarded_scene()
    ((own, _),) = Descent(settings, scene).parts
    exact, action = Episodes(scene, own.lanes), np.full((1, own.lanes), 0.5)
    for one in (own, exact):
        one._begin(range(own.lanes))
    found, known = own.physics.jacobian(action).state, exact.physics.jacobian(action).state
    assert np.any(found != known)  # steps are ten times as quick
    np.testing.assert_allclose(found, known, rtol=1e-2, atol=1e-3 * np.abs(known).max())


class TestGradients:
    @pytest.mark.parametrize("feedback", [0.0, 1.0])
    @pytest.mark.parametrize("kind", SCENES)
    def test_gradient_is_that_of_central_differences(self, kind, feedback, monkeypatch):
        monkeypatch.setattr(network, "REAL", np.float64)
        task, changes = SCENES[kind]
        scene = load_scene(f"mm_gym/{task}-v0").replace(**SHORT).replace(**changes)
        if "own cost" in kind:
            scene = rewarded(scene, OwnReward(own_cost))
        own = Episodes(scene, LANES, most=1e30)
        own.env = Exact(own) if feedback else Replayed(Exact(own))
        settles = kind.endswith("settles")
        policy = policy_for(scene, knows_action="memory of the action" in kind, settles=settles)
        net = Network(policy, STEPS, LANES)
        cost, draw = own.run(net, range(LANES)), np.random.default_rng(2)
        assert net.free.all()
        own.back(net, 1.0, feedback)
        first, step = net.parameters, 1e-4
        for name, values in first.items():
            way, costs = draw.standard_normal(values.shape), []
            for size in (-2.0, -1.0, 1.0, 2.0):
                net.parameters = first | {name: values + size * step * way}
                costs.append(own.run(net, range(LANES)))
            slope = np.dot([1.0, -8.0, 8.0, -1.0], costs) / (12.0 * step)
            # Of fourth order: its error is some step^4, and round-off 1e-16 / step of the cost.
            found = np.sum(net.gradient[name] * way)
            assert found == pytest.approx(slope, rel=1e-6, abs=1e-9 * cost)

    @pytest.mark.parametrize("settles", [False, True])
    def test_cost_is_that_of_an_evaluation(self, settles):
        scene = load_scene("mm_gym/Hybrid-v0")
        policy = policy_for(scene, knows_action=settles, settles=settles)
        found = Episodes(scene, 5).run(Network(policy, scene.control.steps, 5), range(7, 12))
        want = evaluate(scene, Learned(policy), seed=7, episodes=5).cost
        assert np.sqrt(found) == pytest.approx(want, rel=1e-5)  # actions in single precision

    def test_what_asks_for_too_much_learns_only_to_ask_for_less(self):
        scene = load_scene("mm_gym/CarriageForce-v0").replace(**SHORT)
        policy, slopes = policy_for(scene), []
        own, net = Episodes(scene, LANES), Network(policy, STEPS, LANES)
        net.parameters["last"][:] = 3.0
        own.run(net, range(LANES))
        assert (own.actions == 1.0).all()
        for inwards in (0.0, 1.0, 0.5):
            own.back(net, 1.0, inwards=inwards)
            slopes.append(float(net.gradient["last"][0]))
        # No cost depends on a clipped action. Its effort alone makes less of it better.
        assert slopes[0] == 0.0
        assert slopes[1] > 0.0
        # But for what earlier actions change by way of later ones.
        assert slopes[2] == pytest.approx(0.5 * slopes[1], rel=0.05)

    def test_task_asks_for_slopes_that_lead_inwards(self, monkeypatch):
        asked = GradientSettings.of({"task": "mm_gym/CarriageForce-v0", "episodes": 8})
        found = []
        monkeypatch.setattr(
            Episodes, "back", lambda *_, inwards: found.append(inwards) or np.float64(1.0)
        )
        for inwards in (False, True):
            search = Descent(asked.model_copy(update={"inwards": inwards}), asked.load_scene())
            for search.rounds in (0, 150, 600):
                search._slope(list(range(8)), 1.0)
        assert found == [0.0, 0.0, 0.0, 1.0, 0.75, 0.0]

    def test_memory_is_shortened_only_where_it_is_too_long(self):
        draw = np.random.default_rng(0).standard_normal((6, 6))
        turned, _ = np.linalg.qr(draw)
        lengths = np.diag([1.1, 0.99, 0.9, 0.5, 0.5, 0.1])
        lengths[3:5, 3:5] = 0.5 * np.array([[0.6, -0.8], [0.8, 0.6]])
        keep = (turned @ lengths @ turned.T).astype(np.float32)
        network.shorten(keep, 0.95)
        lengths[:2, :2] = 0.95 * np.eye(2)
        np.testing.assert_allclose(keep, turned @ lengths @ turned.T, atol=1e-6)  # single precision

    def test_steep_lanes_are_bounded_and_others_left_alone(self):
        factors = episodes._bounded(np.array([1.0, 2.0, 1e30, 0.0, 2.0]), 10.0)
        most = 2.0 * 10.0  # the median is 2
        np.testing.assert_allclose(factors, [1.0, 1.0, most / 1e30, 1.0, 1.0])

    @pytest.mark.parametrize(("limit", "inwards"), [(40.0, 0.0), (1.0, 0.0), (1.0, 0.5)])
    def test_torch_goes_back_as_the_own_way_does(self, limit, inwards, monkeypatch):
        monkeypatch.setattr(network, "REAL", np.float64)
        monkeypatch.setattr(RecurrentDescent, "inwards", inwards)
        settings = TINY.model_copy(
            update={
                "task": "mm_gym/CarriageForce-v0",
                "changes": {
                    "control.steps": STEPS,
                    "actuation.force.limit": limit,
                    "sensors.channels": ["carriage_displacement"],
                    "sensors.noise": {"carriage_displacement": 0.01},
                },
                "law": "lqg",  # which has to remember, and what it did
                "episodes": LANES,
                "extra": 0,
                "cell": 1,
            }
        )
        search = RecurrentDescent(settings, scene := settings.load_scene())
        start = start_of(scene, settings, np.random.default_rng(0))
        evolved = Evolved(start, 4, odd=False)
        policy = evolved.policy(evolved.first(np.random.default_rng(0)))
        policy = policy_of(parameters_of(policy) | {"output": np.full((1, 4), 0.1)}, policy)
        search.module, search.episodes.most = Module(policy), np.inf
        own, net = Episodes(scene, LANES, most=1e30), Network(policy, STEPS, LANES)
        assert net.acting
        for fade in (1.0, 0.5):
            search.module.zero_grad()
            search._cost_of(range(LANES), fade).backward()
            own.run(net, range(LANES))
            assert net.free.all() == (limit == 40.0)
            own.back(net, fade, inwards=inwards)
            found = {name: one.grad.numpy() for name, one in search.module.trained.items()}
            for role, slope in net.gradient.items():
                torchs = found[_roles(policy)[role]].reshape(slope.shape)
                # torch's passes are in single precision.
                np.testing.assert_allclose(torchs, slope, rtol=0.0, atol=1e-4 * abs(slope).max())

    def test_scene_without_gradients_is_refused(self):
        scene = load_scene("mm_gym/PreStretchShock-v0")
        with pytest.raises(DesignError, match="do not end early"):
            Episodes(scene.replace(**{"objective.displacement_limit": 0.01}), 1)
        still = {"objective.displacement_weight": 0.0, "objective.velocity_weight": 0.0}
        for shown in ("carriage_velocity", "carriage_acceleration"):
            channels = {"sensors.channels": [shown]}
            with pytest.raises(DesignError, match="are 0; allowed: one"):
                Episodes(load_scene("mm_gym/CarriageForce-v0").replace(**still, **channels), 1)


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory):
    run = Run("tiny", tmp_path_factory.mktemp("runs"))
    descend(TINY, run)
    return run


def assert_same_outcome(run, other):
    assert run.metrics.read_bytes() == other.metrics.read_bytes()
    own, others = parameters_of(load_policy(run.policy)), parameters_of(load_policy(other.policy))
    for name, array in own.items():
        np.testing.assert_array_equal(array, others[name])


class TestRuns:
    def test_training_betters_its_law_within_seconds(self, tmp_path):
        task = "mm_gym/PreStretchNoise-v0"
        settings = GradientSettings(task=task, episodes=64, iterations=20, evaluations=1)
        run = Run("quick", tmp_path)
        descend(settings, run)
        # The clipped LQR of docs/tasks.md has 0.860 on the held-out episodes, this some 0.78.
        cost = evaluate(settings.load_scene(), Learned(load_policy(run.policy)), episodes=100).cost
        assert cost < 0.82

    @pytest.mark.parametrize("cell", [0, 2])
    def test_gradient_that_is_not_finite_is_answered_by_smaller_steps(self, cell, monkeypatch):
        settings = TINY.model_copy(update={"cell": cell})
        search = (RecurrentDescent if cell else Descent)(settings, settings.load_scene())

        def present():
            if not cell:
                return {name: one.copy() for name, one in search.network.parameters.items()}
            return {
                name: one.detach().numpy().copy() for name, one in search.module.trained.items()
            }

        def advanced():
            before = search._present()
            search._advance()
            search.rounds += 1
            return before

        def rate():
            advanced()
            before = present()
            advanced()
            return max(abs(one - before[name]).max() for name, one in present().items())

        fast = rate()
        broken = search.episodes if cell else search.parts[0][0]

        def refuse(*_):
            msg = "action: got nan; allowed: finite numbers"
            raise ActionError(msg)

        with monkeypatch.context() as patch:
            patch.setattr(broken, "step" if cell else "run", refuse)
            for _ in range(3):
                mean = advanced()
        assert search.trust == 0.5**3
        for name, one in present().items():
            np.testing.assert_array_equal(one, mean[name])
        # Adam's steps are of the size of the rate, which is an eighth of what it was.
        assert 0.0 < rate() < 0.3 * fast

    def test_run_interrupted_in_any_iteration_ends_as_if_unbroken(
        self, unbroken, tmp_path, monkeypatch
    ):
        run, back = Run("tiny", tmp_path), Episodes.back
        left = 0

        def interrupt(own, *arguments, **options):
            nonlocal left
            left -= 1
            if left == 0:
                raise KeyboardInterrupt
            back(own, *arguments, **options)

        monkeypatch.setattr(Episodes, "back", interrupt)
        for left in (1, 3, 6, 0):
            if left == 0:
                descend(TINY, run)
                break
            with pytest.raises(KeyboardInterrupt):
                descend(TINY, run)
            assert not run.finished
        assert_same_outcome(run, unbroken)

    def test_cell_begins_as_the_linear_memory(self):
        settings = TINY.model_copy(
            update={"task": "mm_gym/PreStretchNoise-v0", "cell": 8, "extra": 0}
        )
        start = start_of(settings.load_scene(), settings, np.random.default_rng(0))
        assert len(start.keep) == 4
        linear = with_oscillators(start, 4, np.random.default_rng(1))
        keep, enter = linear.keep[:8, :8], linear.enter[:8]
        cell = with_cell(start, settings, np.random.default_rng(1)).find(GRU)
        # So small that gates stay as they begin, and tanh is linear, to 1e-5 of what is remembered.
        values = 1e-5 * np.random.default_rng(2).standard_normal((40, 1, enter.shape[1]))
        found, want = np.zeros((1, 8), np.float32), np.zeros((1, 8))
        for one in values:
            _, found = cell.forward(np, one.astype(np.float32), found)
            want = want @ keep.T + one @ enter.T
        # Forty steps add the round-off of single precision and the gates' changes of each.
        np.testing.assert_allclose(found, SMALL * want, rtol=0.0, atol=1e-3 * np.abs(want).max())

    @pytest.mark.parametrize("task", [*ids(), *robust_ids()])
    def test_policy_with_a_cell_is_read_as_it_was_written(self, task):
        scene = load_scene(task)
        settings = TINY.model_copy(
            update={"task": task, "changes": {}, "cell": 3, "extra": 0, "law": natural_law(scene)}
        )
        start = start_of(scene, settings, np.random.default_rng(0))
        policy = with_cell(start, settings, np.random.default_rng(1))
        found = policy_in(policy.to_bytes())
        assert found.observed == policy.observed
        for name, array in policy.arrays.items():
            np.testing.assert_array_equal(found.arrays[name], array)

    def test_recurrent_run_interrupted_ends_as_if_unbroken_and_is_exported(
        self, tmp_path, monkeypatch
    ):
        settings = TINY.model_copy(update={"cell": 3, "iterations": 6})
        whole, broken = Run("tiny", tmp_path / "whole"), Run("tiny", tmp_path / "broken")
        descend(settings, whole)
        cost_of, left = RecurrentDescent._cost_of, 3

        def interrupt(own, *arguments):
            nonlocal left
            left -= 1
            if left == 0:
                raise KeyboardInterrupt
            return cost_of(own, *arguments)

        monkeypatch.setattr(RecurrentDescent, "_cost_of", interrupt)
        with pytest.raises(KeyboardInterrupt):
            descend(settings, broken)
        descend(settings, broken)
        assert whole.metrics.read_bytes() == broken.metrics.read_bytes()
        first, policy = load_policy(whole.policy), load_policy(broken.policy)
        for name, array in policy.arrays.items():
            np.testing.assert_array_equal(array, first.arrays[name])
        assert policy.remembers == 2 * len(policy.find(Correlation).pairs) + 3
        assert "policy_act" in c_source(policy.graph()).text

    def test_killed_run_ends_as_if_unbroken(self, unbroken, tmp_path):
        run = Run("tiny", tmp_path)
        process = kills.begin_descent(TINY, tmp_path, touches=16)
        process.join()
        assert process.exitcode == -9
        assert not run.finished
        descend(TINY, run)
        assert_same_outcome(run, unbroken)

    def test_run_killed_ten_times_at_random_instants_ends_as_if_unbroken(self, tmp_path):
        settings = TINY.model_copy(update={"iterations": 3000})
        whole = Run("tiny", tmp_path / "whole")
        descend(settings, whole)
        broken = kills.kill_ten_times(kills.begin_descent, settings, tmp_path / "broken")
        descend(settings, broken)
        assert_same_outcome(broken, whole)

    def test_finished_run_goes_on_with_more_iterations(self, tmp_path):
        run = Run("tiny", tmp_path)
        descend(TINY, run)
        first = run.policy.read_bytes()
        descend(TINY.model_copy(update={"iterations": 14}), run)
        assert (run.folder / "policy-12.safetensors").read_bytes() == first
        assert run.validations()[0][-1] == 14 * 8 * 40
        with pytest.raises(RunError, match="other settings"):
            descend(TINY.model_copy(update={"seed": 1}), run)

    def test_gradient_is_an_algorithm_of_a_sweep(self, unbroken, tmp_path):
        own = {"hidden": 4, "extra": 1, "episodes": 8, "iterations": 12, "evaluations": 3}
        settings = {f"gradient.{name}": value for name, value in own.items()}
        settings["gradient.changes"] = TINY.changes
        sweep = SweepSettings(tasks=("Hybrid",), algorithms=("gradient",), settings=settings)
        (trial,) = sweep.trials()
        assert trial == TINY.model_copy(update={"name": "Hybrid-gradient-plain-0"})
        do_trial(trial.model_dump_json(), tmp_path)
        assert_same_outcome(Run(trial.name, tmp_path), unbroken)
        assert "Hybrid,gradient,plain,0," in write_results([trial], tmp_path).read_text()


class TestTwoScenes:
    """A network that learns another scene with its own."""

    def test_halves_of_one_scene_give_the_gradient_of_the_whole(self, monkeypatch):
        monkeypatch.setattr("agents.gradient.descent.MOST", 1e9)  # of the median of fewer lanes
        gradients = []
        for also in (None, "Hybrid"):
            settings = TINY.model_copy(update={"changes": {}, "also": also, "share": 0.25})
            descent = Descent(settings, settings.rewarded_scene())
            descent._advance()
            gradients.append(descent._gradient())
        for name, whole in gradients[0].items():
            # Sums in single precision, in another order.
            np.testing.assert_allclose(gradients[1][name], whole, atol=2e-4 * np.abs(whole).max())

    def test_the_other_scene_has_its_share(self):
        own = TINY.model_copy(update={"also": "HybridRobust", "share": 0.25})
        descent = Descent(own, own.rewarded_scene())
        assert [(one.lanes, one.steps) for one, _ in descent.parts] == [(6, 40), (2, 400)]

    @pytest.mark.parametrize(
        ("also", "said"),
        [
            ("PreStretch", "sensors.channels: got"),
            ("CarriageForce", "sensors.channels: got"),
            ("Hybird", "did you mean 'Hybrid'"),
            ("none.toml", "none.toml: no such file"),
        ],
    )
    def test_refuses_what_one_network_cannot_learn(self, tmp_path, also, said):
        run = Run("tiny", tmp_path)
        with pytest.raises(SceneError, match=said):
            descend(TINY.model_copy(update={"also": also}), run, bar=False)
        assert not run.folder.exists()

    def test_one_episode_is_not_of_two_scenes(self):
        settings = TINY.model_copy(update={"also": "Hybrid", "episodes": 1})
        with pytest.raises(SceneError, match="episodes: got 1 with also = 'Hybrid'; allowed"):
            Descent(settings, settings.rewarded_scene())

    def test_a_cell_learns_one_scene(self):
        with pytest.raises(SceneError, match="also: got 'Hybrid' with cell = 4"):
            GradientSettings.of({"also": "Hybrid", "cell": 4})

    def test_another_scene_in_the_file_does_not_continue_the_run(self, tmp_path):
        file, run = tmp_path / "other.toml", Run("tiny", tmp_path)
        task = path_of("mm_gym/Hybrid-v0").read_text()
        file.write_text(task)
        settings = TINY.model_copy(update={"also": str(file), "iterations": 2})
        descend(settings, run, bar=False)
        file.write_text(task.replace("damping = 0.2 ", "damping = 0.3 "))
        with pytest.raises(RunError, match="changed"):
            descend(settings.model_copy(update={"iterations": 3}), run, bar=False)
