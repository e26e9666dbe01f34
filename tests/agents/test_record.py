"""Are recorded datasets whole, and do their seeds and actions reproduce them?"""

from functools import partial

import gymnasium
import minari
import numpy as np
import pytest
from tasks import CARRIAGE_FORCE, HYBRID, PRE_STRETCH, TASKS
from transitions import CHANGES, SCENE, STEPS, check_transitions

from agents.commands import record as command
from agents.commands.record import RecordSettings, record
from agents.controllers.noise import RandomActions
from agents.controllers.registry import laws
from agents.errors import DatasetError
from agents.evaluation.contestants import law_of
from agents.policies import network
from agents.recording import play, with_noise, write
from agents.training.config import TrainSettings
from agents.training.runs import Run, RunError
from mm_gym import DesignError, SceneError, load_scene

CARRIAGE = "mm_gym/CarriageForce-v0"


@pytest.fixture(autouse=True)
def datasets(tmp_path, monkeypatch):
    folder = tmp_path / "datasets"
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder))
    return folder


def replay(dataset, episode):
    """Make the episode again from its seed and its actions alone, in an environment of its own."""
    env = dataset.recover_environment()
    (metadata,) = dataset.storage.get_episode_metadata([episode.id])
    observation, info = env.reset(seed=metadata["seed"])
    rows = [(observation, info["state"], info["applied"])]
    steps = []
    for action in episode.actions:
        observation, reward, terminated, truncated, info = env.step(action)
        rows.append((observation, info["state"], info["applied"]))
        steps.append((reward, terminated, truncated))
    env.close()
    return [np.array(column) for column in (*zip(*rows, strict=True), *zip(*steps, strict=True))]


def assert_replays(dataset, episode):
    stored = (
        episode.observations,
        episode.infos["state"],
        episode.infos["applied"],
        episode.rewards,
        episode.terminations,
        episode.truncations,
    )
    for mine, again in zip(stored, replay(dataset, episode), strict=True):
        assert (mine.dtype, mine.shape) == (again.dtype, again.shape)
        assert mine.tobytes() == again.tobytes()


@pytest.mark.parametrize("name", TASKS)
def test_seed_and_actions_reproduce_an_episode_bitwise(name):
    dataset = minari.load_dataset(
        record(RecordSettings(task=name, lanes=3, episodes=5, noise=0.1, controller="no-control"))
    )
    assert dataset.total_episodes == 5
    for episode in (dataset[0], dataset[4]):  # of two batches
        assert_replays(dataset, episode)
        assert dataset.observation_space.contains(episode.observations[0])
        assert dataset.action_space.contains(episode.actions[0])


def test_changed_scene_is_recovered_with_the_dataset():
    dataset = minari.load_dataset(
        record(RecordSettings(task=CARRIAGE, lanes=5, episodes=20, changes=CHANGES))
    )
    assert dataset.recover_environment().unwrapped.scene == SCENE
    assert dataset.storage.metadata["scene_digest"] == SCENE.digest
    assert {bool(episode.terminations[-1]) for episode in dataset} == {True, False}
    for episode in dataset:
        assert_replays(dataset, episode)


def played(lanes, seeds=range(20), deviation=0.0):
    """Episodes under random actions, of which half end early."""
    generator = np.random.default_rng(1)
    batches = play(
        SCENE,
        RandomActions(SCENE, generator),
        seeds,
        lanes=lanes,
        changed=partial(with_noise, deviation=deviation, generator=generator),
    )
    return [episode for batch in batches for episode in batch]


@pytest.mark.parametrize("lanes", [1, 7, 64])
def test_every_seed_has_one_whole_episode_on_any_number_of_lanes(lanes):
    episodes = played(lanes)
    assert [episode.seed for episode in episodes] == list(range(20))
    env = gymnasium.make(CARRIAGE, scene=SCENE)
    for episode in episodes:
        assert np.array_equal(env.reset(seed=episode.seed)[0], episode.observations[0])
        ended = episode.terminations | episode.truncations
        assert not ended[:-1].any()
        assert ended[-1]
    lengths = {len(episode.rewards) for episode in episodes}
    assert STEPS in lengths
    assert len(lengths) > 3


def test_recorded_transitions_follow_the_plant_through_all_ends():
    columns = [
        np.concatenate(arrays)[:, None]
        for arrays in zip(
            *(
                (e.observations[:-1], e.actions, e.observations[1:], e.terminations, e.truncations)
                for e in played(7)
            ),
            strict=True,
        )
    ]
    check_transitions(*columns)


def test_random_actions_differ_between_batches():
    first, second = played(1, seeds=[5, 5])
    assert np.array_equal(first.observations[0], second.observations[0])
    assert not np.array_equal(first.actions[0], second.actions[0])


def test_noise_has_its_deviation_and_stays_in_the_action_space():
    generator = np.random.default_rng(0)
    noisy = with_noise(np.zeros((10_000, 1)), 0.1, generator)
    # The standard deviation of 10,000 samples scatters by 0.7 %.
    assert noisy.std() == pytest.approx(0.1, rel=0.04)
    assert noisy.dtype == np.float32
    assert np.abs(with_noise(np.zeros((100, 1)), 1.0, generator)).max() == 1.0


@pytest.mark.parametrize("scene", [CARRIAGE_FORCE, PRE_STRETCH, HYBRID])
def test_laws_of_a_scene_have_an_action_for_each_actuator(scene):
    names = {
        1: {"random", "no-control", "best-constant", "predictive-control"},
        2: {"random", "no-control", "best-constant", "lqr", "feedforward-lqr-and-clipped-lqr"},
    }
    applicable = laws(scene)
    actuators = sum(
        actuator is not None for actuator in (scene.actuation.force, scene.actuation.stretch)
    )
    assert names[actuators] <= set(applicable)


@pytest.mark.parametrize("name", TASKS)
def test_every_law_of_a_task_plays(name):
    scene = TASKS[name]
    generator = np.random.default_rng(1)
    refused = set()
    for controller in laws(scene):
        try:
            law = law_of(controller, scene, generator)
        except DesignError:
            refused.add(controller)
            continue
        changed = partial(with_noise, deviation=0.0, generator=generator)
        (batch,) = play(scene, law, [1, 2], lanes=2, changed=changed)
        whole = scene.control.steps
        # A controller that does not know of the rail's ends may reach one.
        assert all(len(e.rewards) == whole or e.terminations[-1] for e in batch)
    # No force moves the place at which a sphere that sticks would come to rest.
    estimates = {"lqg", "detuned-lqg", "predictive-lqg"}
    assert refused == (estimates if scene.interface.kind == "dry_friction" else set())


def test_regulator_is_recorded_by_its_name(capsys):
    dataset_id = record(RecordSettings(task=CARRIAGE, controller="lqr", lanes=4, episodes=4))
    assert dataset_id == "mm_gym/CarriageForce/lqr-v0"
    assert f'minari.load_dataset("{dataset_id}")' in capsys.readouterr().out
    dataset = minari.load_dataset(dataset_id)
    assert dataset.storage.metadata["algorithm_name"] == "LQR"
    assert dataset.env_spec.id == CARRIAGE
    assert list(minari.list_local_datasets()) == [dataset_id]
    # It stills the carriage: the last displacement is far below the first ones.
    ends = [(episode.observations[0, 0], episode.observations[-1, 0]) for episode in dataset]
    first, last = np.abs(ends).mean(axis=0)
    assert last < 0.05 * first


def trained_run(root, task=CARRIAGE, *, finished=True):
    run = Run("given", root)
    run.open(TrainSettings(task=task, name="given"))
    if finished:
        policy = network(
            (np.full((1, 4), 0.25, np.float32),),
            (np.zeros(1, np.float32),),
            "tanh",
            -np.ones(1, np.float32),
            np.ones(1, np.float32),
        )
        policy.save(run.policy)
    return run


@pytest.mark.parametrize("name", ["given", "given/policy.safetensors"])
def test_policy_of_a_run_is_recorded(tmp_path, name):
    trained_run(tmp_path)
    settings = RecordSettings(
        task=CARRIAGE, controller=str(tmp_path / name), lanes=2, episodes=2, out="mine/y"
    )
    (episode, _) = minari.load_dataset(record(settings))
    expected = np.clip(episode.observations[:-1].mean(axis=1, keepdims=True), -1, 1)
    # Sums of four products of order one, in single precision.
    np.testing.assert_allclose(episode.actions, expected, atol=1e-6)


def test_run_that_is_not_over_is_refused(tmp_path):
    run = trained_run(tmp_path, finished=False)
    with pytest.raises(RunError, match="training is not finished"):
        law_of(str(run.folder), CARRIAGE_FORCE, np.random.default_rng())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ["--controller", "lqrr"],
            "did you mean 'lqr'?; allowed for this scene: random, no-control",
        ),
        (["--controller", "phase-law"], "got 'phase-law'"),
        (["--out", "../x"], "out: got '../x'; allowed: NAMESPACE/NAME-vVERSION"),
        (["--out", "/x"], "out: got '/x'"),
        (["--out", "x/y"], "the namespace of two or more"),
        (["--out", "mine//y"], "out: got 'mine//y'"),
        (["--out", "a b"], "out: got 'a b'"),
        (["--out", ""], "out: got ''"),
        (["--changes", '{"control.stps": 3}'], "did you mean 'steps'?"),
    ],
)
def test_wrong_argument_is_named_and_nothing_is_written(arguments, words, monkeypatch, datasets):
    monkeypatch.setattr("sys.argv", ["record", CARRIAGE, *arguments])
    assert words in (command.main() or "")
    assert not minari.list_local_datasets()
    assert not [path for path in datasets.rglob("*") if path.is_file()]


@pytest.mark.parametrize(
    ("task", "words"),
    [
        ("CariageForce", "got 'CariageForce'; did you mean 'CarriageForce'?"),
        ("CartPole-v1", "task or scene file: got 'CartPole-v1'"),
        ("mine.toml", "mine.toml: no such file"),
    ],
)
def test_wrong_task_is_named(task, words, monkeypatch):
    monkeypatch.setattr("sys.argv", ["record", task])
    assert words in (command.main() or "")
    assert not minari.list_local_datasets()


def test_own_scene_is_recorded_and_the_dataset_does_without_its_file(tmp_path):
    file = tmp_path / "heavy.toml"
    file.write_text("carriage.mass = 2.0\nactuation.force.limit = 4.0\ncontrol.steps = 30\n")
    recorded = record(RecordSettings(task=str(file), lanes=2, episodes=3))
    assert recorded == "mm_gym/heavy/random-v0"
    expected = load_scene(file)
    file.unlink()
    dataset = minari.load_dataset(recorded)
    env = dataset.recover_environment()
    assert env.unwrapped.scene == expected
    assert env.spec.max_episode_steps == 30
    assert dataset.storage.metadata["scene_digest"] == expected.digest
    for episode in dataset:
        assert len(episode.rewards) == 30
        assert_replays(dataset, episode)


def test_short_name_is_that_of_a_task():
    assert record(RecordSettings(task="CarriageForce", lanes=2, episodes=2)) == (
        "mm_gym/CarriageForce/random-v0"
    )
    assert minari.load_dataset("mm_gym/CarriageForce/random-v0").env_spec.id == CARRIAGE


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"lanes": 0}, "lanes: got 0"),
        ({"episodes": 0}, "episodes: got 0"),
        ({"noise": -0.1}, r"noise: got -0\.1"),
        ({"noise": float("nan")}, "noise: got nan"),
        ({"seed": -1}, "seed: got -1"),
    ],
)
def test_wrong_setting_is_refused(settings, message):
    with pytest.raises(SceneError, match=message):
        RecordSettings(**settings)


def test_existing_dataset_is_kept_and_a_new_version_is_made_on_request():
    settings = RecordSettings(task=CARRIAGE, lanes=2, episodes=2, out="mine/random-v3")
    first = minari.load_dataset(record(settings))
    with pytest.raises(DatasetError, match=r"mine/random-v3: exists at .*--new-version"):
        record(settings)
    assert np.array_equal(minari.load_dataset("mine/random-v3")[0].actions, first[0].actions)
    again = settings.model_copy(update={"new_version": True, "seed": 7})
    assert record(again) == "mine/random-v4"
    assert sorted(minari.list_local_datasets()) == ["mine/random-v3", "mine/random-v4"]


def interrupted(error):
    yield played(4, seeds=range(4))
    raise error


def test_interrupted_recording_leaves_nothing(datasets):
    env = gymnasium.make(CARRIAGE)
    with pytest.raises(KeyboardInterrupt):
        write("mine/x-v0", env, interrupted(KeyboardInterrupt()), {})
    assert not minari.list_local_datasets()
    assert not list(datasets.rglob("*.hdf5"))
    assert not list(datasets.glob(".*"))


def test_dataset_that_another_process_wrote_meanwhile_is_kept(datasets):
    def batches():
        yield played(4, seeds=range(4))
        other = datasets / "mine" / "x-v0"
        other.mkdir()
        (other / "theirs").touch()

    with pytest.raises(DatasetError, match="another process has written it"):
        write("mine/x-v0", gymnasium.make(CARRIAGE), batches(), {})
    assert [path.name for path in (datasets / "mine" / "x-v0").iterdir()] == ["theirs"]


def test_folder_that_cannot_be_written_to_is_named(datasets):
    datasets.mkdir()
    (datasets / "mine").touch()
    with pytest.raises(DatasetError, match=r"mine/x-v0: cannot be written at .*mine"):
        write("mine/x-v0", gymnasium.make(CARRIAGE), iter([]), {})
