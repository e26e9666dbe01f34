"""The contract of `simulate`: its arguments and its result."""

import copy
import csv
import pickle

import numpy as np
import pytest

from mm_gym import (
    ActionError,
    Scene,
    SceneError,
    SimulationError,
    compile_scene,
    metrics,
    simulate,
)

PUSHED = Scene(
    springs={"kind": "small_on_large"},
    initial={"carriage_displacement": 0.01},
    actuation={"force": {"limit": 2.0, "rate_limit": 50.0}},
    control={"time_step": 0.01, "steps": 40},
)
BOTH = PUSHED.replace(**{"actuation.stretch": {"rate_limit": 4.0}})


def test_trajectory_has_a_row_per_step_and_one_at_the_end():
    trajectory = simulate(PUSHED)
    assert trajectory.time == pytest.approx(0.01 * np.arange(41), abs=1e-15)
    assert trajectory.state.shape == (41, 4)
    assert trajectory.action.shape == (41, 1)
    assert simulate(PUSHED, duration=0.0375).time.tolist() == [0.0, 0.01, 0.02, 0.03, 0.0375]


def test_scene_and_its_plant_give_the_same():
    plant = compile_scene(PUSHED)
    assert np.array_equal(simulate(plant, action=1.0).state, simulate(PUSHED, action=1.0).state)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])  # noqa: S301 - just written
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"interface": {"kind": "bouc_wen", "stiffness": 50.0, "yield_displacement": 0.002}},
        {"springs": {"kind": "linear", "stiffness": 35.0, "cubic_coefficient": 1e3}},
    ],
)
def test_copies_and_pickles_tell_the_same_of_plant_and_motion(changes, copied):
    plant = compile_scene(PUSHED.replace(**changes))
    assert copied(plant).explain() == plant.explain()
    trajectory = simulate(plant, action=1.0)
    other = copied(trajectory)
    assert np.array_equal(other.acceleration, trajectory.acceleration)
    assert np.array_equal(other.work.dissipated, trajectory.work.dissipated)
    assert metrics.response(other).rms_acceleration == metrics.response(trajectory).rms_acceleration
    assert np.array_equal(simulate(copied(plant), action=1.0).state, trajectory.state)


def test_states_between_steps_lie_on_the_same_motion():
    # The same instants, one by one and all at once.
    times = [0.0, 0.0031, 0.01, 0.0199, 0.125, 0.4]
    together = simulate(BOTH, times=times, action=[1.0, 2.0]).state
    alone = [simulate(BOTH, times=[t], action=[1.0, 2.0]).state[0] for t in times]
    assert np.array_equal(together, alone)


HELD = PUSHED.replace(**{"actuation": {"force": {"limit": 2.0}}, "springs.stiffness": 300.0})
WAVES = [
    {"kind": "harmonic", "amplitude": 2.0, "frequency": 40.0, "phase": 0.3},
    {"kind": "sweep", "target": "ground", "amplitude": 3.0, "duration": 1.4}
    | {"start_frequency": 20.0, "end_frequency": 60.0},
]


CONSTANT = {"kind": "harmonic", "amplitude": 2.0, "frequency": 0.0, "phase": 0.3}


@pytest.mark.parametrize("excitation", [[], [CONSTANT], WAVES[:1], WAVES])
@pytest.mark.parametrize("changes", [{}, {"randomization": {"carriage.mass": (0.09, 0.11)}}])
@pytest.mark.parametrize("damping", [1.0, 40.0])
def test_instants_within_a_long_control_step_are_those_of_short_ones(excitation, changes, damping):
    # The held force, which a control step keeps, is the same in all of them.
    changes = changes | {"excitation": excitation, "interface.damping": damping}
    scene = HELD.replace(**changes)
    times = np.arange(1, 100) * 0.0007
    fine = scene.replace(**{"control.time_step": 0.0007, "control.steps": 1000})
    exact = simulate(fine, duration=times[-1], action=1.5).state[1:]
    found = simulate(scene, times=times, action=1.5).state
    # Round-off of a hundred steps.
    assert (abs(found - exact) <= 1e-13 * abs(exact).max(axis=0)).all()


@pytest.mark.parametrize("form", ["constant", "array", "function"])
def test_action_may_be_constant_array_or_function(form):
    steps = np.tile([1.5, 2.0], (40, 1))
    action = {"constant": [1.5, 2.0], "array": steps, "function": lambda _t, _x: [1.5, 2.0]}[form]
    expected = simulate(BOTH, action=steps)
    assert np.array_equal(simulate(BOTH, action=action).state, expected.state)


def test_policy_gets_the_time_and_its_own_copy_of_the_state():
    seen = []

    def policy(time, state):
        seen.append((time, state))
        return -50.0 * state[2:3]

    trajectory = simulate(PUSHED, action=policy)
    assert [time for time, _ in seen] == trajectory.time[:-1].tolist()
    assert np.array_equal([state for _, state in seen], trajectory.state[:-1])


def test_limits_and_rate_limits_apply_to_commands():
    # From 0 N at 50 N/s in steps of 0.01 s up to 2 N.
    action = simulate(PUSHED, action=100.0).action[:, 0]
    assert action == pytest.approx(np.minimum(0.5 * np.arange(1, 42), 2.0), rel=1e-15)
    stretch = simulate(BOTH, action=[0.0, 99.0]).action[:, 1]
    assert stretch == pytest.approx(np.minimum(1.5 + 0.04 * np.arange(1, 42), 3.0), rel=1e-14)


def test_commands_beyond_the_limits_lag_as_those_of_an_environment_do():
    changes = {"actuation.force": {"lag": 0.05, "limit": 4.0}}
    scene = PUSHED.replace(**changes)
    duration = 3 * scene.control.time_step
    far, near = (simulate(scene, duration=duration, action=[force]) for force in (40.0, 4.0))
    assert np.array_equal(far.action, near.action)
    assert far.action[-1, 0] < 4.0


def test_without_an_action_actuators_keep_their_initial_values():
    trajectory = simulate(BOTH)
    assert (trajectory.action == [0.0, 1.5]).all()


@pytest.mark.parametrize(
    "action",
    [
        "push",
        1j,
        np.nan,
        [np.inf],
        [1.0, 2.0],
        np.zeros((39, 1)),
        np.zeros((40, 2)),
        [[1.0], [1.0, 2.0]],
        True,
        lambda _t, _x: np.nan,
        lambda _t, _x: [1.0, 2.0],
        lambda _t, _x: None,
    ],
)
def test_action_that_does_not_fit_is_refused(action):
    with pytest.raises(ActionError, match="action: "):
        simulate(PUSHED, action=action)


def test_scene_without_actuators_takes_no_action():
    with pytest.raises(ActionError, match="action: got shape"):
        simulate(Scene(), action=1.0)


@pytest.mark.parametrize(
    "when",
    [
        {"duration": 0.0},
        {"duration": -1.0},
        {"duration": np.nan},
        {"duration": np.inf},
        {"duration": "1"},
        {"duration": [1.0, 2.0]},
        {"duration": 1e9},
        {"times": []},
        {"times": [0.1, 0.1]},
        {"times": [0.2, 0.1]},
        {"times": [-0.1]},
        {"times": [np.nan]},
        {"times": "soon"},
        {"times": [[0.1, 0.2]]},
        {"times": [0.1], "duration": 1.0},
    ],
    ids=str,
)
def test_times_that_make_no_sense_are_refused(when):
    with pytest.raises(SimulationError, match=r"times|duration|control steps"):
        simulate(PUSHED, **when)


def test_seed_decides_what_is_drawn():
    scene = PUSHED.replace(**{"initial.sphere_offset": (-0.01, 0.01)})
    starts = {seed: simulate(scene, times=[0.0], seed=seed).state[0, 1] for seed in range(5)}
    assert len(set(starts.values())) == 5
    assert simulate(scene, times=[0.0], seed=3).state[0, 1] == starts[3]
    assert simulate(scene, times=[0.0]).state[0, 1] == starts[0]


@pytest.mark.parametrize("seed", [-1, 2**64, 1.5, "1", True])
def test_seed_that_is_no_integer_is_refused(seed):
    with pytest.raises(SceneError, match=r"seed: got .*; allowed: an integer from 0 to"):
        simulate(Scene(), duration=0.01, seed=seed)


def test_csv_keeps_every_digit(tmp_path):
    trajectory = simulate(BOTH, action=[1.0, 2.0])
    trajectory.to_csv(tmp_path / "new" / "motion.csv")
    with (tmp_path / "new" / "motion.csv").open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    assert header[:2] == ["time [s]", "x1 [m]"]
    assert header[5:7] == ["force [N]", "stretch [-]"]
    assert header[7:] == ["disturbance [N]", "ground acceleration [m/s^2]"]
    expected = np.column_stack(
        [trajectory.time, trajectory.state, trajectory.action, trajectory.excitation]
    )
    assert np.array_equal(np.array(rows, float), expected)
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["motion.csv"]
