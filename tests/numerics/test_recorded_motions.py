"""Records: every plant responds to the piecewise-linear interpolant of any samples."""

from itertools import pairwise

import numpy as np
import pytest

from mm_gym import MovingMassEnv, Scene, compile_scene, simulate
from mm_gym.excitation import record
from mm_gym.precision.oracle import Oracle

from .conftest import assert_lanes_equal_single
from .excited import FRICTION

BASE = Scene(initial={"carriage_displacement": 0.01}, control={"time_step": 0.01, "steps": 2000})
SHORT = {"control.steps": 60}
PLANTS = {
    "linear": {},
    "massless": {"carriage.mass": 0.0},
    "parametric": {"springs": {"kind": "small_on_large"}, "actuation": {"stretch": {}}},
    "friction": {"interface": FRICTION},
    "cubic": {"carriage.cubic_coefficient": 2e6, "solver.tolerance": 1e-13},
    "finite stretch": {
        "springs": {"kind": "finite_stretch", "rest_length": 0.05},
        "solver.tolerance": 1e-13,
    },
    "cubic with friction": {
        "interface": FRICTION,
        "carriage.cubic_coefficient": 2e6,
        "solver.tolerance": 1e-13,
    },
}
HARMONIC = {"kind": "harmonic", "amplitude": 0.3, "frequency": 33.0, "phase": 0.4}
SPACINGS = {
    "milliseconds": lambda rng: 0.001 * rng.integers(7, 60, 60),
    "any": lambda rng: rng.uniform(0.0005, 0.06, 60),
    "even": lambda _: np.full(150, 0.005),
}


CLOSE = 1e-14  # instants that are so near [s] are one: SciPy cannot step from one to the next


class Motion:
    """A random record, and the interpolant that is true of it."""

    def __init__(self, folder, rng, spacing, target="ground", **options):
        gaps = SPACINGS[spacing](rng)
        self.times, self.target = np.concatenate([[0.0], np.cumsum(gaps)]), target
        self.values = rng.normal(0.0, 3.0 if target == "ground" else 0.5, len(self.times))
        path = folder / f"{spacing}.csv"
        np.savetxt(path, np.column_stack([self.times, self.values]), "%.17g", delimiter=",")
        self.part = {"kind": "record", "file": str(path), "target": target, **options}
        self.scale = options.get("scale", 1.0)
        self.time_scale, self.start = options.get("time_scale", 1.0), options.get("start", 0.0)

    def at(self, times):
        own = self.start + times / self.time_scale
        return self.scale * np.interp(own, self.times, self.values, left=0.0, right=0.0)

    def corners(self):
        return (self.times - self.start) * self.time_scale

    def response(self, scene, instants, impulses=()):
        """Return the states by SciPy, integrated from corner to corner.

        Impulses are (time, jump of v1 and v2); a state at one is that before it.
        """
        corners, jumps = self.corners(), dict(impulses)
        inner = np.concatenate([corners, list(jumps)])
        inner = inner[(inner > 0.0) & (inner < instants[-1])]
        stops = np.unique(np.concatenate([[0.0], inner, instants]))
        state, states = None, {}
        for start, end in pairwise(stops):
            if end - start < CLOSE:
                states[end] = state
                state = np.add(state, [0.0, 0.0, *jumps.get(end, (0.0, 0.0))])
                continue
            # The line through two points inside: at an end the record may jump.
            first, last = 0.75 * start + 0.25 * end, 0.25 * start + 0.75 * end
            slope = (self.at(last) - self.at(first)) / (last - first)
            middle = 0.5 * (self.at(first) + self.at(last))

            def line(t, target, slope=slope, middle=middle, centre=0.5 * (start + end)):
                own = middle + slope * (t - centre) if target == self.target else 0.0
                if target == "force":
                    own += HARMONIC["amplitude"] * np.sin(HARMONIC["frequency"] * t + 0.4)
                return own

            # SciPy sees a crossing of the reference velocity only between two of its steps.
            oracle = Oracle(scene, max_step=0.002, disturbance=line)
            begin = oracle.initial_state() if state is None else state
            state = oracle.solve([end], start=begin, begin=start)[0]
            states[end] = state
            state = np.add(state, [0.0, 0.0, *jumps.get(end, (0.0, 0.0))])
        return np.array([states[instant] for instant in instants])


def check(scene, motion, rng, impulses=()):
    """Compare states, excitation and energies at random instants with SciPy."""
    sizes = [(time, scene.carriage.mass * jump[0]) for time, jump in impulses]
    parts = [{"kind": "impulse", "time": float(time), "size": size} for time, size in sizes]
    scene = scene.replace(excitation=[motion.part, HARMONIC, *parts])
    instants = np.sort(np.append(rng.uniform(0.0, 0.25, 3), [0.1, 0.2]))
    trajectory = simulate(scene, times=instants)
    expected = motion.response(scene, instants, impulses)
    scale = np.abs(expected).max(axis=0)
    assert np.all(np.abs(trajectory.state - expected) < 1e-9 * scale)
    column = int(motion.target == "ground")
    shown, force = trajectory.excitation[:, column], HARMONIC["amplitude"]
    if column == 0:
        shown = shown - force * np.sin(HARMONIC["frequency"] * instants + HARMONIC["phase"])
    # Times of up to 1 s are rounded by 1e-16, and slopes reach 20 / 0.0005 s.
    assert np.abs(shown - motion.at(instants)).max() < 1e-11 * np.abs(motion.values).max()
    work = trajectory.work
    balance = trajectory.energy - trajectory.energy[0] - work.total
    assert np.abs(balance).max() < 1e-11 * work.throughput.max()


@pytest.mark.parametrize("spacing", SPACINGS)
@pytest.mark.parametrize("plant", PLANTS)
def test_plants_respond_to_the_exact_interpolant(tmp_path, plant, spacing):
    rng = np.random.default_rng(list(PLANTS).index(plant))
    check(BASE.replace(**PLANTS[plant]), Motion(tmp_path, rng, spacing), rng)


@pytest.mark.parametrize("plant", ["linear", "parametric", "friction", "cubic with friction"])
def test_impulses_come_between_corners_and_at_them(tmp_path, plant):
    rng = np.random.default_rng(11)
    motion = Motion(tmp_path, rng, "any", target="force")
    corner = float(motion.times[motion.times > 0.05][0])
    times = [0.0437, 0.0438, np.nextafter(corner, 0.0), corner + 0.001, 0.1, 0.1234]
    impulses = [(float(time), (rng.normal(), 0.0)) for time in times]
    check(BASE.replace(**PLANTS[plant]), motion, rng, impulses)


@pytest.mark.parametrize("seed", range(100))
def test_random_records_are_exact(tmp_path, seed):
    rng = np.random.default_rng(seed)
    plant, spacing = list(PLANTS)[seed % len(PLANTS)], list(SPACINGS)[seed // 7 % len(SPACINGS)]
    options = {
        "scale": rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 2.0),
        "time_scale": rng.uniform(0.5, 2.0),
        "start": rng.uniform(0.0, 0.1),
    }
    target = ("ground", "force")[seed % 2]
    scene = BASE.replace(**PLANTS[plant], **{"control.time_step": rng.choice([0.004, 0.01, 0.02])})
    check(scene, Motion(tmp_path, rng, spacing, target, **options), rng)


def test_record_that_begins_late_and_ends_early_jumps(tmp_path):
    rng = np.random.default_rng(5)
    motion = Motion(tmp_path, rng, "even")
    motion.times, motion.values = np.array([0.023, 0.031, 0.142]), np.array([2.0, -1.0, 3.0])
    np.savetxt(motion.part["file"], np.column_stack([motion.times, motion.values]), delimiter=",")
    for plant in ("linear", "friction"):
        check(BASE.replace(**PLANTS[plant]), motion, rng)


def test_corners_are_sample_instants_where_the_spacing_allows_it(tmp_path):
    rng = np.random.default_rng(6)
    even, uneven = Motion(tmp_path, rng, "even"), Motion(tmp_path, rng, "milliseconds")
    support = compile_scene(BASE.replace(excitation=[even.part])).support
    assert (support.intervals_per_step, support.terms) == (2, 2)
    support = compile_scene(BASE.replace(excitation=[uneven.part])).support
    assert support.terms == record.TERMS
    fine = uneven.part | {"sample_time": 0.001}
    support = compile_scene(BASE.replace(excitation=[fine])).support
    assert (support.intervals_per_step, support.terms) == (10, 2)
    moving = BASE.replace(excitation=[even.part], randomization={"excitation.0.start": [0.0, 0.1]})
    assert compile_scene(moving).support.terms == record.TERMS


def test_very_fine_spacing_needs_no_fine_sample_intervals(tmp_path):
    path = tmp_path / "steep.csv"
    path.write_text("0 1\n0.1 2\n0.100000002 -1\n0.9 0\n")
    scene = BASE.replace(
        excitation=[{"kind": "record", "file": str(path)}], **{"control.steps": 90}
    )
    assert compile_scene(scene).support.intervals_per_step < 10
    jump = scene.replace(interface=FRICTION)
    for each in (scene, jump):
        work = simulate(each).work
        assert np.all(np.isfinite(work.total))


def test_record_that_no_episode_reaches_the_end_of_is_warned_of(tmp_path):
    path = tmp_path / "long.csv"
    path.write_text("0 1\n0.3 1\n0.9 0.5\n1.5 0\n2 0\n")
    part = {"kind": "record", "file": str(path)}
    with pytest.warns(
        UserWarning, match=r"excitation\.1: the record lasts 1.5 s, of which an epis"
    ):
        compile_scene(BASE.replace(excitation=[HARMONIC, part], **SHORT))
    for reached in ({"start": 0.9}, {"time_scale": 0.4}):
        compile_scene(BASE.replace(excitation=[part | reached], **SHORT))
    ranges = {"excitation.0.start": [0.0, 0.9]}
    compile_scene(BASE.replace(excitation=[part], randomization=ranges, **SHORT))


MOVED = {"excitation.0.start": [0.0, 0.3], "excitation.0.time_scale": [0.8, 1.5]}
"""Ranges that put the corners of every episode in other places."""


def test_drawn_start_and_time_scale_move_the_interpolant(tmp_path):
    motion = Motion(tmp_path, np.random.default_rng(8), "any")
    for plant in ("linear", "parametric", "friction"):
        scene = BASE.replace(excitation=[motion.part], **PLANTS[plant], randomization=MOVED)
        rows = [simulate(scene, duration=0.6, seed=seed) for seed in range(3)]
        for row in rows:
            p, names = row.parameters, row.recording.plant.support.names
            own = p[names["excitation.0.start"]] + row.time / p[names["excitation.0.time_scale"]]
            expected = np.interp(own, motion.times, motion.values, right=0.0)
            assert np.abs(row.excitation[:, 1] - expected).max() < 1e-10


@pytest.mark.parametrize("plant", ["linear", "parametric", "friction", "cubic with friction"])
def test_lanes_with_corners_in_different_places_equal_single_ones(tmp_path, plant):
    motion = Motion(tmp_path, np.random.default_rng(8), "any")
    scene = BASE.replace(excitation=[motion.part, HARMONIC], **PLANTS[plant], randomization=MOVED)
    assert compile_scene(scene).support.terms == record.TERMS  # there are corners inside
    assert_lanes_equal_single(compile_scene(scene), 20)


def test_channel_shows_the_record_at_the_end_of_each_control_step(tmp_path):
    motion = Motion(tmp_path, np.random.default_rng(9), "any")
    for plant in ("linear", "parametric", "friction"):
        scene = BASE.replace(excitation=[motion.part], **PLANTS[plant])
        actuators = {**PLANTS[plant].get("actuation", {}), "force": {}}
        scene = scene.replace(sensors={"channels": ["ground_acceleration"]}, actuation=actuators)
        environment = MovingMassEnv(scene=scene)
        shown = [environment.reset()[0][0]]
        action = np.zeros(environment.action_space.shape, np.float32)
        shown += [environment.step(action)[0][0] for _ in range(40)]
        scale = environment.unwrapped.plant.observed[0].factor
        expected = scale * motion.at(0.01 * np.arange(41))
        # Observations are single precision.
        assert np.abs(shown - expected).max() < 1e-6 * np.abs(expected).max()
