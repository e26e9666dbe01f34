"""How the ground moves the carriage and the device of a reduced structure."""

from itertools import pairwise

import gymnasium
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from mm_gym import SceneError, compile_scene, load_scene, simulate
from mm_gym.env.vector import MovingMassVectorEnv
from mm_gym.scene import Harmonic, Recorded
from mm_gym.structure import Structure, StructureError, balanced_error, example, white_noise

FRAME = Structure.of_storeys([3.0, 2.0, 1.5], [900.0, 700.0, 400.0], 0.03).reduce(3)
PARTS = {
    "interface": {"kind": "viscous", "damping": 0.4},
    "springs": {"kind": "small_on_large", "stiffness": 3.0, "stretch": 1.5},
    "control": {"time_step": 0.01, "steps": 100},
}
K2 = 6.0 * (1.0 + 2.0 / 1.5**3)
HARMONIC = {"kind": "harmonic", "amplitude": 2.0, "frequency": 7.0, "phase": 0.4}
SWEEP = {
    "kind": "sweep",
    "amplitude": -1.5,
    "start_frequency": 3.0,
    "end_frequency": 20.0,
    "duration": 0.8,
}


def reference(reduction, mass, acceleration, times, start=(0.0, 0.0, 0.0, 0.0)):
    """The two masses as a structural engineer writes them: Gamma a on one, r a on the other."""
    m1, k1, d = reduction.mass, reduction.stiffness, reduction.damping

    def field(t, y):
        x1, x2, v1, v2 = y
        inner, a = 0.4 * (v2 - v1) + K2 * (x2 - x1), acceleration(t)
        first = (inner - k1 * x1 - d * v1) / m1 - reduction.participation * a
        return [v1, v2, first, -inner / mass - reduction.ground * a]

    return solve_ivp(
        field, (0.0, times[-1]), start, "DOP853", t_eval=times, rtol=1e-12, atol=1e-15
    ).y.T


TIMES = np.linspace(0.0, 1.0, 41)


def close(states, expected):
    # DOP853 at 1e-12; states are around 0.1.
    return np.abs(states - expected).max() < 1e-10 * np.abs(expected).max()


def test_harmonic_moves_carriage_and_device_each_by_its_own():
    scene = FRAME.scene(0.3, ground=HARMONIC, **PARTS)
    expected = reference(FRAME, 0.3, lambda t: 2.0 * np.sin(7.0 * t + 0.4), TIMES)
    assert close(simulate(scene, times=TIMES).state, expected)


def test_sweep_and_a_part_of_a_scene_move_them_so_too():
    def swept(t):
        phase = 3.0 * t + 0.5 * 17.0 / 0.8 * t**2 if t < 0.8 else 9.2 + 20.0 * (t - 0.8)
        return -1.5 * np.sin(phase)

    part = Harmonic(amplitude=2.0, frequency=7.0, phase=0.4)
    scene = FRAME.scene(0.3, ground=[SWEEP, part], **PARTS)
    both = reference(FRAME, 0.3, lambda t: swept(t) + 2.0 * np.sin(7.0 * t + 0.4), TIMES)
    assert close(simulate(scene, times=TIMES).state, both)


def test_record_moves_them_so_too(tmp_path):
    times, values = 0.05 * np.arange(21), np.random.default_rng(2).normal(size=21)
    np.savetxt(tmp_path / "motion.csv", np.column_stack([times, values]), delimiter=",")
    entry = {"kind": "record", "file": str(tmp_path / "motion.csv"), "unit": "g", "scale": 0.5}
    scene = FRAME.scene(0.3, ground=entry, **PARTS)
    # From corner to corner: the integrator would step over them.
    states, state = [np.zeros(4)], np.zeros(4)
    for k in range(20):
        ends = 0.5 * 9.80665 * values[k : k + 2]
        state = reference(
            *(FRAME, 0.3), lambda t, e=ends: e[0] + (e[1] - e[0]) * t / 0.05, [0.05], state
        )[0]
        states.append(state)
    assert close(simulate(scene, times=times).state, np.array(states))
    array = np.column_stack([times, 0.5 * 9.80665 * values])
    assert close(FRAME.simulate(FRAME.scene(0.3, **PARTS), array, times=times).state, states)


def test_impulse_of_the_ground_jumps_both_velocities_by_their_own():
    entry = {"kind": "impulse", "size": 0.2, "time": 0.0}
    scene = FRAME.scene(0.3, ground=entry, **PARTS)
    jump = (0.0, 0.0, -0.2 * FRAME.participation, -0.2)
    expected = reference(FRAME, 0.3, lambda _: 0.0, TIMES, jump)
    assert close(simulate(scene, times=TIMES).state[1:], expected[1:])


def test_influence_of_the_ground_on_the_device_is_counted():
    tilted = Structure(np.diag([2.0, 1.0]), [[9.0, -4.0], [-4.0, 4.0]], 0.02, influence=[1.0, 0.5])
    for reduction in (tilted.reduce(2), tilted.reduce(1, 2)):
        scene = reduction.scene(0.3, ground=HARMONIC, **PARTS)
        expected = reference(reduction, 0.3, lambda t: 2.0 * np.sin(7.0 * t + 0.4), TIMES)
        assert close(simulate(scene, times=TIMES).state, expected)
    still = Structure(np.diag([2.0, 1.0]), [[9.0, -4.0], [-4.0, 4.0]], 0.02, influence=[1.0, 0.0])
    assert [e["target"] for e in still.reduce(2).excitation(HARMONIC, 0.3)] == ["force"]


def test_one_storey_needs_no_force():
    one = Structure.of_storeys([2.0], [50.0], 0.02).reduce(1)
    assert one.excitation(HARMONIC, 0.3) == [HARMONIC | {"target": "ground"}]


def test_noise_is_one_entry_that_moves_both_masses_together_as_it_should():
    noise = {"kind": "kanai_tajimi", "rms": 1.5, "ground_frequency": 15.0}
    (entry,) = FRAME.excitation(noise, 0.3)
    share = (FRAME.participation * FRAME.mass + 0.3) / (FRAME.mass + 0.3)
    assert entry == noise | {"rms": pytest.approx(1.5 * share), "target": "ground"}
    (random,) = FRAME.excitation({"kind": "impulse", "size": [-0.1, 0.2], "rate": 2.0}, 0.3)
    assert random["size"] == pytest.approx([-0.1 * share, 0.2 * share])
    (balanced,) = FRAME.excitation(HARMONIC, 0.3, "balanced")
    assert balanced["amplitude"] == pytest.approx(2.0 * share)


def test_balanced_error_is_that_of_the_responses():
    scene = FRAME.scene(0.3, **PARTS)
    share = (FRAME.participation * FRAME.mass + 0.3) / (FRAME.mass + 0.3)
    m1, k1, d = FRAME.mass, FRAME.stiffness, FRAME.damping

    def responses(w):
        inner = K2 + 0.4j * w
        matrix = [[k1 + inner + 1j * w * d - m1 * w**2, -inner], [-inner, inner - 0.3 * w**2]]
        exact = np.linalg.solve(matrix, [-FRAME.participation * m1, -0.3])
        return exact, np.linalg.solve(matrix, [-share * m1, -share * 0.3])

    def power(pick):
        # The resonances lie below 40 rad/s; beyond 400 the power falls as the fourth power.
        points = np.linspace(2.0, 40.0, 39)
        ends = [0.0, *points, 400.0]
        return sum(
            quad(lambda w: abs(pick(*responses(w))) ** 2, *part)[0] for part in pairwise(ends)
        )

    error = balanced_error(FRAME, scene)
    x1 = power(lambda exact, _: exact[0])
    difference = power(lambda exact, other: exact[0] - other[0])
    assert error.displacement == pytest.approx(np.sqrt(difference / x1), rel=1e-5)
    scaled = power(lambda _, other: other[0])
    assert error.displacement_rms == pytest.approx(np.sqrt(scaled / x1) - 1.0, abs=1e-6)
    stroke = power(lambda exact, _: exact[1] - exact[0])
    moved = power(lambda exact, other: exact[1] - exact[0] - other[1] + other[0])
    assert error.stroke == pytest.approx(np.sqrt(moved / stroke), rel=1e-5)


@pytest.mark.parametrize(
    ("name", "displacement", "stroke"),
    [("three_storeys", 0.016, 0.023), ("five_storeys", 0.028, 0.054)],
)
def test_balanced_error_of_the_examples_is_as_documented(name, displacement, stroke):
    made = example(name)
    error = balanced_error(made.reduction, made.scene())
    assert error.displacement == pytest.approx(displacement, abs=5e-4)
    assert error.stroke == pytest.approx(stroke, abs=5e-4)
    assert abs(error.displacement_rms) < 1e-3


def test_balanced_error_of_a_device_whose_mass_is_drawn_is_that_of_the_middle():
    scene = FRAME.scene(0.3, **PARTS)
    drawn = scene.replace(randomization={"sphere.mass": [0.5, 0.7]})
    middle = scene.replace(**{"sphere.mass": 0.6})
    assert balanced_error(FRAME, drawn) == pytest.approx(balanced_error(FRAME, middle), rel=1e-9)


def test_balanced_error_of_a_device_without_damping_and_springs_has_no_value():
    with pytest.raises(StructureError, match="no variance"):
        balanced_error(FRAME, FRAME.scene(0.3, interface={"kind": "none"}))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"ground": {"kind": "harmonics"}}, ["ground.0: unknown kind", "did you mean 'harmonic'?"]),
        ({"ground": [HARMONIC, {}]}, ["ground.1: 'kind' is missing"]),
        ({"ground": HARMONIC | {"target": "force"}}, ["ground.0.target", "'ground'"]),
        ({"mapping": "exakt"}, ["mapping", "did you mean 'exact'?"]),
        ({"mass": -1.0}, ["mass", "-1.0", "greater than 0"]),
        ({"mass": "heavy"}, ["mass", "'heavy'"]),
        ({"mass": float("nan")}, ["mass", "nan"]),
        ({"carriage": {"mass": 1.0}}, ["carriage", "twice"]),
        (
            {"ground": HARMONIC, "randomization": {"excitation.0.frequency": [1.0, 2.0]}},
            ["randomization.excitation.0.frequency", "mapping='balanced'"],
        ),
        ({"controls": {}}, ["controls", "did you mean 'control'?"]),
        (
            {"ground": {"kind": "harmonic", "amplitude": "2", "frequency": 1.0}},
            ["ground.0.amplitude", "'2'"],
        ),
    ],
)
def test_bad_arguments_are_named(arguments, words):
    with pytest.raises(SceneError) as caught:
        FRAME.scene(**{"mass": 0.3, **PARTS, **arguments})
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_scene_with_an_actuator_is_a_task():
    scene = FRAME.scene(0.3, ground=HARMONIC, actuation={"force": {"limit": 5.0}}, **PARTS)
    env = gymnasium.make("mm_gym/CarriageForce-v0", scene=scene)
    env.reset(seed=1)
    *_, info = env.step(np.zeros(1, np.float32))
    expected = simulate(scene, times=[0.0, scene.control.time_step]).state[1]
    np.testing.assert_array_equal(info["state"], expected)
    env.close()


def test_base_shear_is_gamma_times_the_force_of_the_spring():
    motion = simulate(FRAME.scene(0.3, ground=HARMONIC, **PARTS), times=TIMES)
    floors, rates = (
        np.outer(motion.state[:, 0], FRAME.shape),
        np.outer(motion.state[:, 2], FRAME.shape),
    )
    structure = FRAME.structure
    shear = (floors @ structure.stiffness + rates @ structure.damping).sum(axis=1)
    np.testing.assert_allclose(shear, FRAME.participation * motion.base_force, atol=1e-12)


def test_draws_of_one_entry_are_allowed():
    drawn = {"excitation.0.amplitude": [1.0, 2.0]}
    scene = FRAME.scene(0.3, ground=HARMONIC, mapping="balanced", randomization=drawn, **PARTS)
    assert len(scene.excitation) == 1
    pushed = FRAME.scene(0.3, excitation=[HARMONIC], randomization=drawn, **PARTS)
    assert pushed.excitation[0].target == "force"


SHARE = FRAME.shaking.balance(0.3)
NOISE = {"kind": "noise", "rms": 1.5, "high_frequency": 20.0}
LIMITED = {"actuation": {"force": {"limit": 10.0}}, **PARTS}


def drawn_values(scene, *names):
    env = MovingMassVectorEnv(scene=scene, num_envs=200)
    env.reset(seed=0)
    return [env.drawn(name) for name in names]


@pytest.mark.parametrize(
    ("entry", "mapping", "field", "factor"),
    [
        (NOISE, "exact", "rms", SHARE),
        (HARMONIC, "balanced", "amplitude", SHARE),
        (HARMONIC, "balanced", "frequency", 1.0),
        ({"kind": "impulse", "size": 0.2, "time": 0.0}, "balanced", "size", SHARE),
    ],
)
def test_drawn_strengths_of_the_ground_are_scaled_as_its_entry(entry, mapping, field, factor):
    drawn = {f"excitation.0.{field}": [1.0, 2.0], "sphere.mass": [0.2, 0.3]}
    scene = FRAME.scene(0.3, ground=entry, mapping=mapping, randomization=drawn, **LIMITED)
    values, masses = drawn_values(scene, f"excitation.0.{field}", "sphere.mass")
    assert SHARE > 1.1
    assert [values.min(), values.max()] == pytest.approx([factor, 2.0 * factor], rel=0.02)
    assert factor <= values.min() < values.max() <= 2.0 * factor
    assert 0.2 <= masses.min() < masses.max() <= 0.3
    assert drawn[f"excitation.0.{field}"] == [1.0, 2.0]


@pytest.mark.parametrize(("entry", "field"), [(HARMONIC, "amplitude"), (NOISE, "rms")])
def test_drawn_strengths_are_scaled_where_the_ground_moves_against_the_device(entry, field):
    opposed = Structure([[2.0]], [[50.0]], 0.02, influence=[-0.5]).reduce(1)
    drawn = {f"excitation.0.{field}": [1.0, 2.0]}
    scene = opposed.scene(0.3, ground=entry, randomization=drawn, **PARTS)
    expected = (0.5, 1.0) if field == "rms" else (-1.0, -0.5)
    assert scene.randomization[f"excitation.0.{field}"] == expected


@pytest.fixture
def files(tmp_path):
    for name, peak in (("a", 1.0), ("b", 2.0)):
        np.save(tmp_path / f"{name}.npy", [[0.0, 0.0], [0.1, peak], [0.2, -0.5]])
    return [str(tmp_path / f"{name}.npy") for name in "ab"]


def test_record_that_draws_by_itself_is_one_entry(files):
    pattern = files[0].replace("a.npy", "*.npy")
    own = {"kind": "record", "unit": "m/s^2"}
    for entry in (
        own | {"files": files},
        own | {"files": pattern},
        own | {"file": files[0], "scale_to": {"peak": [1.0, 3.0]}},
        own | {"file": files[0], "scale_to": {"spectral_acceleration": (1.0, 3.0), "period": 0.1}},
        Recorded(**own, target="ground", file=files[0], scale_to={"peak": [1.0, 3.0]}),
    ):
        scene = FRAME.scene(0.3, ground=entry, **LIMITED)
        (part,) = scene.excitation
        assert part.target == "ground"
        if part.scale_to is None:
            assert part.scale == pytest.approx(SHARE)
            continue
        measure = part.scale_to.peak or part.scale_to.spectral_acceleration
        assert measure == pytest.approx((SHARE, 3.0 * SHARE))
    (values,) = drawn_values(scene, "excitation.0.scale_to.peak")
    assert SHARE <= values.min() < values.max() <= 3.0 * SHARE
    for entry in (
        own | {"files": files[:1]},
        own | {"file": files[0], "scale_to": {"peak": 2.0}},
    ):
        assert [one["target"] for one in FRAME.excitation(entry, 0.3)] == ["ground", "force"]


def test_balanced_record_is_scaled_to_more(files):
    entry = {"kind": "record", "file": files[0], "unit": "m/s^2", "scale_to": {"peak": 2.0}}
    scene = FRAME.scene(0.3, ground=entry, mapping="balanced", **PARTS)
    motion = simulate(scene, times=np.linspace(0.0, 0.3, 31)).excitation
    assert motion[:, 1].max() == pytest.approx(2.0 * SHARE)
    assert not motion[:, 0].any()
    assert entry["scale_to"] == {"peak": 2.0}
    opposed = Structure([[2.0]], [[50.0]], 0.02, influence=[-0.5]).reduce(1)
    with pytest.raises(StructureError, match=r"ground\.0\.scale_to: got .*-0\.5; allowed"):
        opposed.scene(0.3, ground=entry, **PARTS)
    with pytest.raises(SceneError, match=r"ground\.0\.scale_to: got 3"):
        FRAME.scene(0.3, ground=entry | {"scale_to": 3}, mapping="balanced", **PARTS)


def test_scene_is_written_whole_and_read_as_it_was(tmp_path):
    (tmp_path / "records").mkdir()
    motion = tmp_path / "records" / "motion.csv"
    np.savetxt(motion, white_noise(1.0, 0.02), delimiter=",")
    entry = {"kind": "record", "file": str(motion), "unit": "m/s^2"}
    scene = FRAME.scene(0.3, ground=entry, **PARTS)
    FRAME.to_toml(scene, tmp_path / "scenes" / "frame.toml")
    text = (tmp_path / "scenes" / "frame.toml").read_text()
    assert text.startswith("# mode 1 of 3, device at floor 3\n")
    assert 'file = "../records/motion.csv"' in text
    read = load_scene(tmp_path / "scenes" / "frame.toml")
    assert read.carriage == scene.carriage
    assert [file.name for file in (tmp_path / "scenes").iterdir()] == ["frame.toml"]
    states = [simulate(one, duration=1.0).state for one in (scene, read)]
    np.testing.assert_array_equal(*states)


def test_record_of_the_ground_as_a_force_is_that_on_its_inertial_mass(tmp_path):
    np.savetxt(tmp_path / "motion.csv", [[0.0, 0.1], [0.5, -0.3]], delimiter=",")
    data = {"kind": "record", "file": str(tmp_path / "motion.csv"), "target": "force"}
    part = Recorded(**data, inertial_mass=2.5, unit="g")
    scene = FRAME.scene(0.3, excitation=[part], **PARTS)
    force = simulate(scene, times=[0.0, 0.25, 0.5]).excitation
    expected = -2.5 * 9.80665 * np.array([0.1, -0.1, -0.3])
    np.testing.assert_allclose(force[:, 0], expected, rtol=1e-14)
    assert not force[:, 1].any()
    with pytest.raises(SceneError, match=r"unit: got 'kN'; allowed: 'm/s\^2'"):
        Recorded(**data, inertial_mass=2.5, unit="kN")
    with pytest.raises(SceneError, match="inertial_mass: has no effect on the ground"):
        Recorded(**(data | {"target": "ground"}), inertial_mass=2.5)


@pytest.mark.parametrize("name", ["quarter_car", "three_storeys", "five_storeys", "tower"])
def test_examples_load_compile_and_simulate(name, tmp_path):
    made = example(name)
    assert len(made.source) > 100
    scene = made.scene(ground={"kind": "harmonic", "amplitude": 0.1, "frequency": 1.0})
    made.reduction.to_toml(scene, tmp_path / "scene.toml")
    read = load_scene(tmp_path / "scene.toml")
    assert compile_scene(read).kind == "linear"
    assert np.isfinite(simulate(read, duration=10 * read.control.time_step).state).all()
