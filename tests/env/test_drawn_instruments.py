"""Sensors and actuators that differ between episodes, against a slow simulation in plain Python.

The simulation hashes the random numbers with Python's integers, moves the masses by SciPy's matrix
exponential, and keeps its own list of frames.
"""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm

from mm_gym import (
    MovingMassEnv,
    MovingMassVectorEnv,
    Scene,
    SceneError,
    compile_scene,
    load_scene,
    simulate,
)

DRAWN = {
    "carriage.stiffness": [320.0, 480.0],
    "sphere.mass": [0.03, 0.05],
    "sensors.delay": [0, 3],
    "sensors.dropout": [0.0, 0.5],
    "sensors.noise.carriage_displacement": [0.0, 2e-3],
    "sensors.noise.applied_force": [0.1, 0.2],
    "sensors.noise.sphere_velocity": [0.0, 0.1],
    "sensors.bias.sphere_offset": [-2e-3, 2e-3],
    "sensors.bias.sphere_velocity": [-0.05, 0.05],
    "actuation.force.lag": [0.0, 0.03],
    "actuation.force.rate_limit": [20.0, 200.0],
}
SCENE = Scene(
    interface={"kind": "viscous", "damping": 0.3},
    excitation=[{"kind": "harmonic", "amplitude": 2.0, "frequency": 55.0}],
    initial={"carriage_displacement": [-0.01, 0.01], "sphere_velocity": [-0.1, 0.1]},
    actuation={"force": {"limit": 2.0, "rate_limit": 100.0}},
    sensors={
        "channels": ["carriage_displacement", "sphere_offset", "applied_force", "sphere_velocity"],
        "history": 2,
    },
    control={"time_step": 0.01, "steps": 40},
    randomization=DRAWN,
)
WORD = 2**64
GOLDEN, SENSORS = 0x9E3779B97F4A7C15, 0xD1B54A32D192ED03


def mix(z):
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 % WORD
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB % WORD
    return z ^ (z >> 31)


class Stream:
    """The numbers of a seed's episode."""

    def __init__(self, seed, episode):
        self.key, self.count = mix((mix(seed) + GOLDEN) % WORD), episode << 32

    def bits(self, ahead):
        return mix((self.key + (self.count + ahead) * GOLDEN) % WORD)

    def uniform(self):
        self.count += 1
        return (self.bits(0) >> 11) * 2.0**-53

    def normals(self, count):
        """The next normal numbers, an even number of them, which are not passed over."""
        found = []
        for k in range(0, count, 2):
            first, second = self.bits(k + 1), self.bits(k + 2)
            radius = math.sqrt(-2.0 * math.log(((first >> 11) + 1) * 2.0**-53))
            angle = (second - WORD if second >= WORD // 2 else second) >> 11
            angle *= 2.0**-53 * math.pi / 2.0
            radius *= -1.0 if second & 1 else 1.0
            pair = radius * math.cos(angle), radius * math.sin(angle)
            found += pair[::-1] if second & 2 else pair
        return found

    def chance(self, ahead):
        key = mix((self.key + self.count * GOLDEN + SENSORS) % WORD)
        return (mix((key + (ahead + 1) * GOLDEN) % WORD) >> 11) * 2.0**-53


def draws_of(scene, stream):
    """Name -> value, of what an episode draws first: the state, the mechanics, then the rest."""
    errors = [f"{what}.{c}" for c in scene.sensors.channels for what in ("noise", "bias")]
    names = [
        *("initial.carriage_displacement", "initial.sphere_velocity"),
        *("sphere.mass", "carriage.stiffness"),
        *(f"sensors.{name}" for name in ("delay", "dropout", *errors)),
        *("actuation.force.lag", "actuation.force.rate_limit"),
    ]
    state = {f"initial.{name}": ends for name, ends in scene.initial if isinstance(ends, tuple)}
    ranges = state | scene.randomization
    found = {}
    for name in (name for name in names if name in ranges):
        low, high = ranges[name]
        if name == "sensors.delay":
            found[name] = math.floor(low + (high + 1 - low) * stream.uniform())
        else:
            found[name] = low + (high - low) * stream.uniform()
    return found


def matrix_of(drawn):
    """The map of x1, x2, v1, v2, the force, and cosine and sine of the disturbance over a step."""
    k, m2, w = drawn["carriage.stiffness"], drawn["sphere.mass"], 55.0
    m1, c, d = SCENE.carriage.mass, 0.3, SCENE.carriage.damping
    a = np.zeros((7, 7))
    a[0, 2] = a[1, 3] = 1.0
    a[2] = np.array([-k, 0.0, -(c + d), c, 1.0, 0.0, 2.0]) / m1
    a[3, 2:4] = c / m2, -c / m2
    a[5, 6], a[6, 5] = -w, w
    return expm(0.01 * a)


def frame_of(state, force, drawn, stream):
    """What the sensors measure, in SI units."""
    x1, x2, _, v2 = state[:4]
    true = [x1, x2 - x1, force, v2]
    numbers, shown = iter(stream.normals(4)), []
    for channel, value in zip(SCENE.sensors.channels, true, strict=True):
        spread = drawn.get(f"sensors.noise.{channel}")
        noise = 0.0 if spread is None else spread * next(numbers)
        shown.append(value + drawn.get(f"sensors.bias.{channel}", 0.0) + noise)
    return shown


def slow_episode(seed, episode, actions):
    """Return the observations (steps + 1, frames, channels) in SI units, and what is drawn."""
    stream = Stream(seed, episode)
    drawn = draws_of(SCENE, stream)
    x1, v2 = drawn["initial.carriage_displacement"], drawn["initial.sphere_velocity"]
    state = np.array([x1, x1, 0.0, v2, 0.0, 1.0, 0.0])
    step, lag = matrix_of(drawn), drawn["actuation.force.lag"]
    travel = 0.01 * drawn["actuation.force.rate_limit"]
    measured = [frame_of(state, 0.0, drawn, stream)]
    stream.count += 4
    received = [measured[0]] * 2
    observed = [received[-2:]]
    for n, action in enumerate(actions, 1):
        force = state[4]
        share = 1.0 if lag == 0.0 else -math.expm1(-0.01 / lag)
        aim = force + (2.0 * action - force) * share
        state[4] = min(max(force + min(max(aim - force, -travel), travel), -2.0), 2.0)
        state = step @ state
        measured.append(frame_of(state, state[4], drawn, stream))
        is_lost = stream.chance(4) < drawn["sensors.dropout"]
        stream.count += 4
        # The first frame stands for those before it.
        arriving = measured[max(n - drawn["sensors.delay"], 0)]
        received.append(received[-1] if is_lost else arriving)
        observed.append(received[-2:])
    return np.array(observed), drawn


@pytest.mark.parametrize("count", [40, 500])
def test_two_episodes_a_lane_are_those_of_a_slow_simulation(count):
    env = MovingMassVectorEnv(SCENE, count)
    factors = np.array([channel.factor for channel in env.plant.observed])
    rng = np.random.default_rng(3)
    for episode in (1, 2):
        observation, _ = env.reset(seed=70 if episode == 1 else None)
        actions = rng.uniform(-1.0, 1.0, (39, count)).astype(np.float32)
        seen = [observation, *(env.step(action[:, None])[0] for action in actions)]
        seen = np.stack(seen, 1).reshape(count, 40, 2, 4)
        for lane in range(count):
            observed, drawn = slow_episode(70 + lane, episode, actions[:, lane].astype(float))
            for name, value in drawn.items():
                assert env.drawn(name)[lane] == pytest.approx(value, rel=1e-12), name
            # Single precision of numbers up to 40, and the round-off of 39 steps of either.
            np.testing.assert_allclose(seen[lane], observed * factors, rtol=1e-6, atol=2e-6)


FILTERED = load_scene("mm_gym/Hybrid-v0")
CASES = {
    "force": SCENE,
    "filtered noise": FILTERED.replace(
        randomization={
            **FILTERED.randomization,
            "sensors.delay": [0, 2],
            "sensors.noise.carriage_velocity": [0.0, 0.02],
            "actuation.stretch.lag": [0.0, 0.02],
        },
        **{"sensors.dropout": 0.2, "control.steps": 40},
    ),
    "a device by rate": load_scene("mm_gym/SemiActiveDamper-v0").replace(
        randomization={
            "sensors.delay": [1, 2],
            "actuation.damping.lag": [0.0, 0.02],
            "actuation.damping.rate_limit": [100.0, 1000.0],
        },
        **{
            "actuation.damping.command": "rate",
            "actuation.damping.rate_limit": 500.0,
            "control.steps": 40,
        },
    ),
}


def episodes(env, seed, steps=60):
    """Observations, rewards and what was applied, through restarts."""
    rng, found = np.random.default_rng(1), []
    count = getattr(env, "num_envs", 1)
    asked = rng.uniform(-1.2, 1.2, (steps, 1500, len(env.plant.actuators)))
    observation, info = env.reset(seed=seed)
    found.append([observation, info["state"], info["applied"]])
    for actions in asked:
        observation, *_, info = env.step(actions[:count].astype(np.float32))
        found.append([observation, info["state"], info["applied"]])
    return [np.stack(column) for column in zip(*found, strict=True)]


@pytest.mark.parametrize("kind", CASES)
def test_lanes_are_single_environments_on_any_number_of_threads(kind):
    scene = CASES[kind]
    together = episodes(MovingMassVectorEnv(scene, 1500), 5)
    for one, other in zip(
        together, episodes(MovingMassVectorEnv(scene, 1500, threads=2), 5), strict=True
    ):
        assert one.tobytes() == other.tobytes()
    few = episodes(MovingMassVectorEnv(scene, 3), 5)
    for one, other in zip(together, few, strict=True):
        assert one[:, :3].tobytes() == other.tobytes()
    env = MovingMassEnv(scene)
    rng = np.random.default_rng(1)
    asked = rng.uniform(-1.2, 1.2, (60, 1500, len(env.plant.actuators)))[:40, 0]
    seen = [env.reset(seed=5)[0], *(env.step(a.astype(np.float32))[0] for a in asked)]
    assert np.array(seen).tobytes() == together[0][:41, 0].tobytes()


@pytest.mark.parametrize("delay", [0, 2])
def test_ranges_of_one_number_are_that_number(delay):
    noise = {"carriage_displacement": 1e-3, "sphere_velocity": 0.02}
    fixed = SCENE.replace(
        randomization={},
        **{"sensors.delay": delay, "sensors.noise": noise, "actuation.force.lag": 0.01},
    )
    ranges = {f"sensors.noise.{channel}": [value, value] for channel, value in noise.items()}
    one = fixed.replace(
        randomization={
            **ranges,
            "sensors.delay": [delay, delay],
            "actuation.force.lag": [0.01, 0.01],
            "sensors.bias.carriage_displacement": [0.0, 0.0],
        }
    )
    # A bias of an unseen size makes each lane keep its own sensors; a dropout that never comes too.
    own = one.replace(**{"sensors.dropout": 1e-300})
    expected = episodes(MovingMassVectorEnv(fixed, 70), 3)
    for scene in (one, own):
        for got, array in zip(episodes(MovingMassVectorEnv(scene, 70), 3), expected, strict=True):
            assert got.tobytes() == array.tobytes()


def test_a_drawn_lag_is_that_of_the_fixed_one():
    lags = np.array([0.0, 1e-6, 1e-3, 0.03, 1.0, 1e5])
    drawn = SCENE.replace(randomization={"actuation.force.lag": [0.0, 1e5]})
    env = MovingMassVectorEnv(drawn, len(lags))
    env.reset(seed=1, options={"actuation.force.lag": lags})
    for _ in range(5):
        *_, info = env.step(np.ones((len(lags), 1), np.float32))
    for lane, lag in enumerate(lags):
        alone = MovingMassEnv(SCENE.replace(randomization={}, **{"actuation.force.lag": lag}))
        alone.reset(seed=1)
        for _ in range(5):
            *_, one = alone.step(np.ones(1, np.float32))
        assert info["applied"][lane, 0] == pytest.approx(one["applied"][0], rel=1e-14)


def test_a_simulation_has_the_drawn_lag():
    env = MovingMassEnv(SCENE)
    env.reset(seed=4)
    applied = [env.step([1.0])[-1]["applied"][0] for _ in range(20)]
    assert simulate(SCENE, action=2.0, duration=0.2, seed=4).action[:20, 0] == pytest.approx(
        applied
    )


def test_every_delay_is_as_likely_and_a_frame_is_lost_as_often_as_it_says():
    scene = Scene(
        actuation={"force": {}},
        initial={"carriage_displacement": 0.01},
        sensors={"dropout": 0.3},
        randomization={"sensors.delay": [1, 3]},
    )
    env = MovingMassVectorEnv(scene, 30_000, info="none")
    env.reset(seed=1)
    delays = env.drawn("sensors.delay")
    for delay in (1, 2, 3):  # four standard deviations of the share
        assert np.mean(delays == delay) == pytest.approx(1 / 3, abs=4 * np.sqrt(2 / 9 / 30_000))
    ages = []
    for _ in range(20):
        env.step(np.zeros((30_000, 1), np.float32))
        ages.append(env.get_state()["values"][env.plant.support.age_row])
    late = np.array(ages[10:]) - delays
    # A frame is n control steps overdue if the last n were lost.
    assert np.mean(late == 0) == pytest.approx(0.7, abs=0.01)
    assert np.mean(late == 1) == pytest.approx(0.7 * 0.3, abs=0.01)
    assert np.mean(late == 2) == pytest.approx(0.7 * 0.09, abs=0.01)


def test_bias_and_dropout_may_be_the_same_in_all_episodes():
    plain = Scene(actuation={"force": {}}, initial={"carriage_displacement": 0.01})
    biased = plain.replace(**{"sensors.bias.carriage_displacement": -0.02})
    (first, _), (second, _) = (MovingMassEnv(s).reset(seed=0) for s in (plain, biased))
    assert second - first == pytest.approx([-2.0, 0.0, 0.0, 0.0])
    assert plain.digest != biased.digest
    lossy = MovingMassEnv(plain.replace(**{"sensors.dropout": 0.5}))
    seen = [lossy.reset(seed=0)[0], *(lossy.step([0.0])[0] for _ in range(60))]
    held = sum(bool((one == other).all()) for one, other in pairwise(seen))
    assert 15 < held < 45  # of 60, four standard deviations about 30


def test_a_state_continues_with_frames_on_the_way():
    env, other = MovingMassVectorEnv(SCENE, 5), MovingMassVectorEnv(SCENE, 5)
    env.reset(seed=1)
    action = np.full((5, 1), 0.5, np.float32)
    for _ in range(3):
        env.step(action)
    state = env.get_state()
    other.set_state(state)
    for _ in range(6):
        assert env.step(action)[0].tobytes() == other.step(action)[0].tobytes()
    state["values"][env.plant.support.names["sensors.delay"], 1] = 1.5
    with pytest.raises(SceneError, match=r"sensors\.delay.*whole numbers"):
        other.set_state(state)


def test_what_was_drawn_can_be_asked_for_and_given():
    env = MovingMassEnv(SCENE)
    env.reset(seed=1, options={"sensors.delay": 2, "sensors.dropout": 0.25})
    assert (env.drawn("sensors.delay"), env.drawn("sensors.dropout")) == (2.0, 0.25)
    with pytest.raises(SceneError, match=r"sensors\.delay: got 1.5; allowed: whole numbers"):
        env.reset(options={"sensors.delay": 1.5})
    with pytest.raises(SceneError, match=r"sensors\.delay: got 4; allowed: 0 to 3"):
        env.reset(options={"sensors.delay": 4})


def test_a_plant_has_the_middle_of_what_is_drawn():
    plant = compile_scene(SCENE)
    assert plant.delay == 2  # of 0 to 3, and of 1 and 2 the larger
    assert compile_scene(SCENE.replace(randomization={"sensors.delay": [0, 2]})).delay == 1
    assert [channel.noise for channel in plant.observed] == pytest.approx([1e-3, 0, 0.15, 0.05])
    assert np.isinf(MovingMassEnv(SCENE).observation_space.high).all()


@pytest.mark.parametrize(
    ("name", "ends", "finding"),
    [
        ("sensors.delay", [0, 1.5], "got 1.5; allowed: an integer"),
        ("sensors.delay", [-1, 1], "got -1; allowed: greater than or equal to 0"),
        ("sensors.dropout", [0.0, 1.0], "got 1.0; allowed: less than 1"),
        ("sensors.noise.sphere_offset", [-1.0, 1.0], "got -1.0; allowed: greater than"),
        ("sensors.noise.stretch", [0.0, 1.0], "not a number of this scene that can be drawn"),
        ("sensors.bias.sphere_ofset", [0.0, 1.0], "did you mean 'sensors.bias.sphere_offset'?"),
        ("sensors.dealy", [0, 1], "did you mean 'sensors.delay'?"),
        ("actuation.force.lag", [-1.0, 1.0], "got -1.0; allowed: greater than or equal to 0"),
        ("actuation.force.limit", [1.0, 2.0], "not a number of this scene that can be drawn"),
        ("actuation.stretch.lag", [0.0, 1.0], "did you mean 'actuation.force.lag'?"),
    ],
)
def test_what_cannot_be_drawn_is_refused_by_name(name, ends, finding):
    with pytest.raises(SceneError) as caught:
        SCENE.replace(randomization={name: ends})
    assert f"randomization.{name}: " in str(caught.value)
    assert finding in str(caught.value)


def test_dropout_and_bias_of_a_range_of_one_number_are_kept():
    kept = {"sensors.dropout": [0.5, 0.5], "sensors.bias.carriage_displacement": [1e-3, 1e-3]}
    moving = {"carriage_velocity": [0.1, 0.2]}
    env = MovingMassVectorEnv(
        Scene(actuation={"force": {}}, initial=moving, randomization=kept), 400, info="full"
    )
    first, info = env.reset(seed=0)
    scale = env.scene.objective.displacement_scale
    shown = first[:, 0] * scale - info["state"][:, 0]
    np.testing.assert_allclose(shown, 1e-3, rtol=0.0, atol=1e-8)
    second, *_ = env.step(np.zeros((400, 1), np.float32))
    # Five standard deviations of 400 draws of one half.
    assert (first == second).all(axis=1).mean() == pytest.approx(0.5, abs=0.125)
