"""Are the Jacobians of a control step those of the motion itself?"""

from __future__ import annotations

from decimal import Context, Decimal, localcontext
from typing import Any

import numpy as np
import pytest

from mm_gym import (
    ActionError,
    CompileError,
    MovingMassVectorEnv,
    Scene,
    SceneError,
    SimulationError,
    compile_scene,
    load_scene,
    simulate,
)
from mm_gym.lanes import layout
from mm_gym.sensitivity import Sensitivities
from mm_gym.tasks import ids, path_of

from .decimal_series import DIGITS, ControlStep
from .test_tolerance import random_scene

STEP = 1e-8
"""Of the differences, relative: their own error is its square, or 1e-16. The reference's series are
cut off at 1e-20, which a difference makes 1e-12 of."""

VISCOUS = {"kind": "viscous", "damping": 0.3}
KINDS = {
    "linear": (False, False, False),
    "parametric linear": (False, False, True),
    "switched linear": (True, False, False),
    "parametric switched linear": (True, False, True),
    "smooth nonlinear": (False, True, True),
    "switched nonlinear": (True, True, True),
}
"""Whether there is friction, a nonlinear spring, and an actuated stretch."""

PARAMETERS = (
    *(f"carriage.{name}" for name in ("mass", "stiffness", "damping", "linear_coefficient")),
    *("carriage.cubic_coefficient", "sphere.mass", "interface.damping"),
    *(f"interface.{name}_coefficient" for name in ("static", "kinetic")),
    *(f"interface.{name}" for name in ("reference_velocity", "slip_damping", "normal_force")),
    *("springs.stiffness", "springs.rest_length"),
    *(f"excitation.0.{name}" for name in ("amplitude", "frequency", "phase")),
)


def scene_of(rng: np.random.Generator, kind: str) -> Scene:
    slips, nonlinear, tuned = KINDS[kind]
    while True:
        scene = random_scene(rng)
        if (scene.interface.kind == "dry_friction") == slips:
            break
    changes: dict[str, Any] = {"solver": {}, "actuation.force": {"limit": 4.0}}
    if slips:
        changes["interface.normal_force"] = float(rng.uniform(0.1, 1.0))
    if scene.springs.kind == "finite_stretch" and not nonlinear:
        changes["springs"] = {"kind": "small_on_large", "stiffness": 35.0, "stretch": 1.5}
    if not nonlinear:
        changes["carriage.cubic_coefficient"] = 0.0
    scene = scene.replace(**changes)
    if tuned and scene.springs.kind != "none":
        stretch = scene.springs.stretch
        limits = {"minimum": stretch, "maximum": stretch + 1.0, "rate_limit": 1e6}
        scene = scene.replace(**{"actuation.stretch": limits})
    return scene


def start_of(scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """Return a random state; with friction, its slip velocity is near the reference velocity."""
    x1, offset = scene.initial.carriage_displacement, scene.initial.sphere_offset
    rate = np.sqrt(scene.carriage.stiffness / scene.carriage.mass)
    v1 = rate * x1 * rng.uniform(-1.0, 1.0)
    w = rate * x1 * rng.uniform(-1.0, 1.0)
    if scene.interface.kind == "dry_friction":
        w = scene.interface.reference_velocity * rng.uniform(-1.5, 1.5)
    return np.array([x1, x1 + offset, v1, v1 + w])


def excess(seed: int, kind: str) -> float:
    """Return the error of a derivative along a random direction, relative to 1e-9.

    Each column counts as much as the scale of the motion. Every other scene is without parameters:
    there are quicker kernels for state and actuators alone.
    """
    rng = np.random.default_rng([seed, list(KINDS).index(kind)])
    scene = scene_of(rng, kind)
    start, plant = start_of(scene, rng), compile_scene(scene)
    names = [n for n in PARAMETERS if n in plant.support.names and _value(scene, n) != 0.0]
    names = sorted(rng.choice(names, min(3, len(names)), replace=False)) if seed % 2 else []
    action = rng.uniform(-0.9, 0.9, len(plant.actuators))
    found = plant.jacobian(start, action, parameters=names)
    force = float(found.end[4])
    stretch = float(found.end[5]) if len(found.end) > 5 else float(plant.template[layout.STRETCH])
    columns = np.column_stack(
        [found.state[:4, :4], found.applied, *(found.parameters[n][:4] for n in names)]
    )
    step = ControlStep(scene, 0.0, force, stretch)
    return mismatch(scene, step, start, (names, columns), rng)


def mismatch(
    scene: Scene,
    step: ControlStep,
    start: np.ndarray,
    derivatives: tuple[list[str], np.ndarray],
    rng: np.random.Generator,
) -> float:
    """Return the error of the derivatives of one lane along a random direction, over 1e-9.

    They are the parameters' names, and the columns of state, actuators and parameters.
    """
    names, columns = derivatives
    scale = np.maximum(step.end(start)[1], 1e-30)
    sizes = (np.abs(columns) / scale[:, None]).max(axis=0)
    direction = 1.0 / np.where(sizes > 0.0, sizes, np.inf)
    # What has little effect is not changed by more than a millionth of itself.
    most = [float(step.stretch)] * (len(direction) - 5 - len(names))
    most += [abs(_value(scene, n)) for n in names]
    direction[5:] = np.minimum(direction[5:], 1e-6 / STEP * np.array(most))
    direction *= rng.choice([-1.0, 1.0], len(sizes))
    moved = [_moved(scene, step, start, names, sign * STEP * direction) for sign in (1, -1)]
    with localcontext(Context(prec=DIGITS)):
        ends = [step.decimal_end(state)[0] for step, state, _ in moved]
        want = np.array([float((a - b) / Decimal(2.0 * STEP)) for a, b in zip(*ends, strict=True)])
    direction[len(direction) - len(names) :] = (moved[0][2] - moved[1][2]) / (2.0 * STEP)
    return float((np.abs(columns @ direction - want) / scale).max()) / 1e-9


def _value(scene: Scene, name: str) -> float:
    part: Any = scene
    for key in name.split("."):
        part = part[int(key)] if key.isdigit() else getattr(part, key)
    return float(part)


def _moved(
    scene: Scene, step: ControlStep, start: np.ndarray, names: list[str], change: np.ndarray
) -> tuple[ControlStep, list[Decimal], np.ndarray]:
    """Return the step and its start after a change, and the parameters as doubles."""
    count = len(change) - len(names)
    values = [_value(scene, n) + c for n, c in zip(names, change[count:], strict=True)]
    with localcontext(Context(prec=DIGITS)):
        state = [Decimal(float(x)) + Decimal(c) for x, c in zip(start, change[:4], strict=True)]
        force = Decimal(step.force) + Decimal(change[4])
        stretch = Decimal(step.stretch) + (Decimal(change[5]) if count > 5 else 0)
    scene = scene.replace(**dict(zip(names, values, strict=True))) if names else scene
    return ControlStep(scene, 0.0, force, stretch), state, np.array(values)  # type: ignore[arg-type]


def violations(seeds: range, kind: str) -> dict[int, float]:
    found: dict[int, float] = {}
    for seed in seeds:
        try:
            ratio = excess(seed, kind)
        except (SimulationError, CompileError, SceneError):
            continue  # a spring of length 0, or friction too stiff for a control step
        if not ratio <= 1.0:
            found[seed] = ratio
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_jacobian_agrees_with_differences_in_34_digits(kind: str) -> None:
    assert violations(range(10), kind) == {}


@pytest.mark.parametrize("kind", KINDS)
def test_jacobian_agrees_with_differences_in_34_digits_in_a_thousand_scenes(kind: str) -> None:
    assert violations(range(1000), kind) == {}


# In the course of the step a spring is shortened to 2e-4, 1e-5 and 3e-5 of its rest length.
@pytest.mark.parametrize("seed", [21, 924, 958])
def test_jacobian_holds_where_a_spring_is_shortened_to_nearly_nothing(seed: int) -> None:
    assert excess(seed, "smooth nonlinear") <= 1.0


def cubic_excess(seed: int) -> float:
    """Return the error of the derivatives over lanes with a cubic spring, relative to 1e-9."""
    rng = np.random.default_rng([seed, 77])
    while True:
        scene = random_scene(rng)
        if scene.carriage.cubic_coefficient > 0.0 and scene.springs.kind != "finite_stretch":
            break
    changes: dict[str, Any] = {"solver": {}, "actuation.force": {"limit": 4.0}, "excitation": []}
    if scene.interface.kind == "dry_friction":
        changes["interface"] = VISCOUS
    scene = scene.replace(**changes)
    plant, first = compile_scene(scene), start_of(scene, rng)
    # More lanes than stand in a vector, of motions from large to small.
    starts = first * np.geomspace(1.0, 1e-3, 19)[:, None]
    names = [n for n in PARAMETERS if n in plant.support.names and _value(scene, n) != 0.0]
    found = plant.jacobian(starts, [0.3], parameters=names)
    worst = 0.0
    for lane in (0, 3, 18):
        step = ControlStep(
            scene, 0.0, float(found.end[lane, 4]), float(plant.template[layout.STRETCH])
        )
        columns = [found.state[lane, :4, :4], found.applied[lane]]
        columns += [found.parameters[n][lane, :4] for n in names]
        derivatives = names, np.column_stack(columns)
        error = mismatch(scene, step, starts[lane], derivatives, rng)
        worst = max(worst, error)
    return worst


@pytest.mark.parametrize("seed", range(3))
def test_jacobians_of_lanes_with_a_cubic_spring_agree_with_differences_in_34_digits(
    seed: int,
) -> None:
    assert cubic_excess(seed) <= 1.0


def scene_with(actuation: dict[str, Any], **changes: Any) -> Scene:
    springs = {"kind": "small_on_large", "stiffness": 35.0, "stretch": 1.5}
    return Scene(interface=VISCOUS, springs=springs, actuation=actuation).replace(**changes)


FORCE = {"force": {"limit": 4.0, "rate_limit": 100.0, "lag": 0.02}}
STRETCH = {"stretch": {"minimum": 1.0, "maximum": 3.0, "rate_limit": 100.0, "lag": 0.02}}
BY_RATE = {"stretch": {"minimum": 1.0, "maximum": 3.0, "rate_limit": 4.0, "command": "rate"}}
LATE = {"stretch": {**BY_RATE["stretch"], "lag": 0.02}}


@pytest.mark.parametrize(
    "actuation", [FORCE, STRETCH, BY_RATE, LATE, FORCE | STRETCH, FORCE | LATE]
)
def test_jacobian_follows_actuators_with_rate_limit_and_lag(actuation: dict[str, Any]) -> None:
    scene = scene_with(actuation)
    env = MovingMassVectorEnv(scene, 8)
    env.reset(seed=1)
    rng = np.random.default_rng(2)
    for _ in range(5):
        env.step(rng.uniform(-1.0, 1.0, env.action_space.shape))
    start, action = env.get_state(), rng.uniform(-0.9, 0.9, env.action_space.shape)
    found = env.plant.jacobian(None, action, at=start)
    rows = {"force": layout.FORCE, "stretch": layout.STRETCH, "stretch_asked": layout.STRETCH_ASKED}
    rows = [rows.get(name, k) for k, name in enumerate(found.names)]
    together = actuation is BY_RATE  # what is asked for is what is applied

    def end_of(values: np.ndarray, actions: np.ndarray) -> np.ndarray:
        env.set_state({**start, "values": values})
        env.step(actions)
        return env.get_state()["values"][rows].T

    # A difference over 2 h of a map of order 1 to 100 is wrong by round-off / h and h**2: 1e-8.
    for k, row in enumerate(rows):
        ends = []
        for sign in (1.0, -1.0):
            values = start["values"].copy()
            values[row] += sign * 1e-6
            values[layout.STRETCH_ASKED] += sign * 1e-6 * (together and row == layout.STRETCH)
            ends.append(end_of(values, action))
        np.testing.assert_allclose(found.state[:, :, k], (ends[0] - ends[1]) / 2e-6, atol=1e-6)
    for k in range(action.shape[1]):
        change = 1e-6 * np.eye(action.shape[1])[k]
        ends = [end_of(start["values"], action + sign * change) for sign in (1.0, -1.0)]
        np.testing.assert_allclose(found.action[:, :, k], (ends[0] - ends[1]) / 2e-6, atol=1e-6)


# In doubles 0.25 - 0.15 is less than 0.1, and 2.1 - 2 more.
ODD = {"minimum": 0.1, "maximum": 0.4}


@pytest.mark.parametrize(
    ("device", "start", "action", "slope"),
    [
        (ODD, 0.2, -1.0, 0.15),
        (ODD, 0.2, 1.0, 0.15),
        ({**ODD, "lag": 1e-4}, 0.1, -1.0, 0.15),
        ({"minimum": 1.9, "maximum": 2.1, "rate_limit": 10.0}, 2.0, 1.0, 0.1),
    ],
)
def test_derivative_at_a_limit_is_the_inner_one_however_it_is_rounded(
    device: dict[str, float], start: float, action: float, slope: float
) -> None:
    scene = Scene(
        interface={"kind": "viscous", "damping": start},
        actuation={"damping": device},
        control={"time_step": 0.01},
    )
    found = compile_scene(scene).jacobian([0.01, 0.0, 0.3, -0.1], [action])
    assert found.end[4] == pytest.approx(device["minimum" if action < 0.0 else "maximum"])
    assert found.action[4, 0] == pytest.approx(slope)


@pytest.mark.parametrize("mass", [0.0, 0.1])
def test_jacobian_of_a_linear_plant_is_its_transition_matrix(mass: float) -> None:
    plant = compile_scene(
        load_scene(path_of("mm_gym/CarriageForce-v0")).replace(**{"carriage.mass": mass})
    )
    found = plant.jacobian([0.01, 0.0, 0.0, 0.0], [0.5])
    state, force = plant.discrete()
    np.testing.assert_array_equal(found.state[:4, :4], state)
    np.testing.assert_array_equal(found.applied, force)
    np.testing.assert_array_equal(found.action[:4], 4.0 * force)


@pytest.mark.parametrize("task", ids())
def test_jacobian_ends_where_the_environment_does(task: str) -> None:
    env = MovingMassVectorEnv(load_scene(path_of(task)), 40)
    env.reset(seed=3)
    rng = np.random.default_rng(4)
    for _ in range(30):
        start, action = env.get_state(), rng.uniform(-1.0, 1.0, env.action_space.shape)
        found = env.plant.jacobian(None, action, at=start)
        *_, info = env.step(action)
        # The tolerance of the nonlinear task is 1e-9 in each step.
        scale = np.abs(info["state"]).max(axis=0)
        assert (np.abs(found.end[:, :4] - info["state"]) / scale).max() < 1e-9


def test_impulses_within_a_step_change_the_stretch_derivative() -> None:
    scene = scene_with(STRETCH, excitation=[{"kind": "impulse", "size": 0.04, "time": 0.004}])
    plant, action = compile_scene(scene), [0.1]
    found = plant.jacobian([0.0] * 4, action, at={"initial.stretch": 1.5})
    ends = []
    for sign in (1.0, -1.0):
        moved = plant.jacobian([0.0] * 4, action, at={"initial.stretch": 1.5 + sign * 1e-5})
        ends.append(moved.end)
    # The differences' own error is 1e-10 relative; there is no derivative without the impulse.
    np.testing.assert_allclose(found.state[:4, 4], (ends[0] - ends[1])[:4] / 2e-5, rtol=1e-6)
    assert np.abs(found.state[:4, 4]).max() > 1e-6


@pytest.mark.parametrize("cubic", [0.0, 1e3])
def test_mass_derivative_includes_impulses_on_the_carriage(cubic: float) -> None:
    changes = {"excitation": [{"kind": "impulse", "size": 0.04, "time": t} for t in (0.0, 0.004)]}
    scene = scene_with(FORCE, **changes).replace(**{"carriage.cubic_coefficient": cubic})
    found = compile_scene(scene).jacobian([0.0] * 4, [0.1], parameters=["carriage.mass"])
    ends = [
        compile_scene(scene.replace(**{"carriage.mass": 0.1 + h})).jacobian([0.0] * 4, [0.1]).end
        for h in (1e-6, -1e-6)
    ]
    want = (ends[0] - ends[1]) / 2e-6
    np.testing.assert_allclose(found.parameters["carriage.mass"][:4], want[:4], rtol=1e-6)


def test_lanes_have_the_jacobians_that_each_has_alone() -> None:
    plant = compile_scene(load_scene(path_of("mm_gym/CarriageForceFriction-v0")))
    states = np.random.default_rng(0).normal(size=(5, 4)) * [0.01, 0.01, 0.3, 0.3]
    together = plant.jacobian(states, [0.2])
    for lane, state in enumerate(states):
        alone = plant.jacobian(state, [0.2])
        np.testing.assert_array_equal(together.state[lane], alone.state)


def test_lanes_have_derivatives_at_parameters_of_their_own() -> None:
    names, masses = ["carriage.mass", "interface.damping"], [0.05, 0.3]
    scene = load_scene(path_of("mm_gym/PreStretch-v0"))
    drawn = scene.replace(randomization={"carriage.mass": masses})
    env = MovingMassVectorEnv(drawn, 20)
    env.reset(seed=1)
    start = env.get_state()
    found = env.plant.jacobian(None, [0.2], at=start, parameters=names)
    states = start["values"][:4]
    for lane in (0, 7, 19):
        mass, stretch = (float(start["values"][row, lane]) for row in (layout.M1, layout.STRETCH))
        alone = compile_scene(scene.replace(**{"randomization": {}, "carriage.mass": mass}))
        place = {"initial.stretch": stretch}
        want = alone.jacobian(states[:, lane], [0.2], at=place, parameters=names)
        for name in names:
            # The same series, whose degree follows from the fastest scene: round-off.
            got, scale = found.parameters[name][lane], np.abs(want.parameters[name]).max()
            np.testing.assert_allclose(got, want.parameters[name], atol=1e-11 * scale)


@pytest.mark.parametrize("task", ids())
def test_many_parameters_have_the_derivatives_that_each_has_alone(task: str) -> None:
    scene = load_scene(path_of(task))
    plant, without = compile_scene(scene), ("springs.rest_length", scene.actuation.damped)
    names = [n for n in PARAMETERS if n in plant.support.names and n not in without]
    state, action = [0.002, 0.004, 0.2, 0.1], [0.3] * len(plant.actuators)
    together = plant.jacobian(state, action, parameters=names)
    for name in names:
        want = plant.jacobian(state, action, parameters=[name]).parameters[name]
        # Round-off, and with a cubic spring the cut-off of the series, 1.5e-11.
        scale = np.abs(want).max()
        np.testing.assert_allclose(together.parameters[name], want, atol=1e-10 * scale, rtol=0)


@pytest.mark.parametrize("task", ["mm_gym/PreStretch-v0", "mm_gym/CarriageForceDuffing-v0"])
def test_kernels_written_by_hand_have_the_derivatives_of_tangents(task: str) -> None:
    scene = load_scene(path_of(task))
    env = MovingMassVectorEnv(scene, 20)
    env.reset(seed=1)
    plant, start, actions = env.plant, env.get_state(), np.full((1, 20), 0.3)
    known = [n for n in PARAMETERS if n in plant.support.names and n != "springs.rest_length"]
    names = [n for n in known if _value(scene, n) != 0.0]  # else there is no kernel by hand
    rows = {name: plant.support.row_of(name) for name in names}
    both = [
        Sensitivities(
            plant.support,
            (plant.model, plant.task),
            (np.asarray(start["values"]), np.asarray(start["streams"])),
            rows,
            by_tangents=by_tangents,
        ).step(actions)
        for by_tangents in (False, True)
    ]
    assert [status for status, _ in both] == [0, 0]
    by_hand, by_tangents = (found for _, found in both)
    # Cut-offs of 1.5e-11 with a cubic spring, else round-off.
    scale = np.abs(by_tangents).max(axis=0)
    assert (np.abs(by_hand - by_tangents).max(axis=0) <= 1e-10 * scale).all()
    assert (scale > 0.0).all()


def test_a_linear_plant_has_a_derivative_over_the_cubic_coefficient() -> None:
    scene, start = load_scene(path_of("mm_gym/CarriageForce-v0")), [0.01, 0.0, 0.0, 0.0]
    name = "carriage.cubic_coefficient"
    found = compile_scene(scene).jacobian(start, [0.5], parameters=[name])
    ends = [
        compile_scene(scene.replace(**{name: beta})).jacobian(start, [0.5]).end for beta in (0, 1)
    ]
    # x1 is 0.01 m: the next order is beta x1**2 = 1e-4 of the change, which is 1e-5 of x1.
    want = (ends[1] - ends[0])[:4]
    np.testing.assert_allclose(found.parameters[name][:4], want, rtol=1e-3)


@pytest.mark.parametrize(
    ("arguments", "parameters", "error", "text"),
    [
        (([0.0] * 3, [0.0]), (), SceneError, r"state: got shape \(3,\)"),
        (([0.0] * 4, [0.0, 0.0]), (), ActionError, r"action: got shape \(2,\)"),
        (([0.0] * 4, [np.nan]), (), ActionError, "finite"),
        (([[0.0] * 4, [0.0]], [0.0]), (), SceneError, "state: not an array"),
        (([0.0] * 4, [[0.0], []]), (), ActionError, "action: not an array"),
        ((np.zeros((2, 4)), np.zeros((3, 1))), (), SceneError, r"\[2, 3\] lanes"),
        (([0.0] * 4, [0.0]), ("carriage.mas",), SceneError, "carriage.mass"),
        (([0.0] * 4, [0.0]), ("initial.sphere_offset",), SceneError, "neither actuated"),
    ],
)
def test_wrong_arguments_are_named(arguments, parameters, error, text) -> None:
    plant = compile_scene(load_scene(path_of("mm_gym/CarriageForce-v0")))
    with pytest.raises(error, match=text):
        plant.jacobian(*arguments, parameters=parameters)


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("values", [[0.0], []], "at.values: not an array"),
        ("values", [["x"]], r"at.values: got shape \(1, 1\) of <U1"),
        ("streams", None, r"at.streams: got shape \(\) of object; allowed: \(2, 3\) of uint64"),
        ("streams", np.zeros((2, 2), np.uint64), r"at.streams: got shape \(2, 2\)"),
        ("streams", np.zeros((2, 3)), r"at.streams: got shape \(2, 3\) of float64"),
        ("streams", 1, r"at.streams: got shape \(\)"),  # was that of every lane
    ],
)
def test_a_snapshot_with_other_arrays_is_refused(name: str, value: Any, text: str) -> None:
    env = MovingMassVectorEnv("mm_gym/PreStretchNoise-v0", 3)
    env.reset(seed=0)
    spoilt = env.get_state() | {name: value}
    with pytest.raises(SceneError, match=text):
        env.plant.jacobian(None, [0.0], at=spoilt)
    if value is None:
        del spoilt[name]
        with pytest.raises(SceneError, match=text):
            env.plant.jacobian(None, [0.0], at=spoilt)


def test_parameters_of_a_carriage_without_mass_are_refused() -> None:
    scene = load_scene(path_of("mm_gym/CarriageForce-v0")).replace(**{"carriage.mass": 0.0})
    with pytest.raises(CompileError, match="without mass"):
        compile_scene(scene).jacobian([0.0] * 4, [0.0], parameters=["sphere.mass"])


@pytest.mark.parametrize(
    "status", [layout.TOO_MANY_EVENTS, layout.TOO_MANY_SERIES, layout.TOO_MANY_STEPS]
)
def test_a_lane_that_stays_behind_is_an_error(status: int) -> None:
    # Its numbers are finite, and those of the step's start.
    env = MovingMassVectorEnv("mm_gym/CarriageForce-v0", 2)
    env.reset(seed=0)
    plant, start = env.plant, env.get_state()
    lanes = np.asarray(start["values"]), np.asarray(start["streams"])
    physics = Sensitivities(plant.support, (plant.model, plant.task), lanes)
    physics._advance = lambda *_: status
    for step in (physics.step, physics.jacobian):
        with pytest.raises(SimulationError, match="one control step"):
            step(np.zeros((1, 2)))


STEEP = {
    "kind": "stribeck",
    "static_coefficient": 0.5,
    "kinetic_coefficient": 0.3,
    "reference_velocity": 0.002,
    "stribeck_velocity": 0.05,
}


def test_jacobian_of_steep_friction_ends_where_the_motion_does() -> None:
    """No plan of steps is short enough for it at the tolerance that others have."""
    scene = Scene(interface=STEEP, control={"time_step": 0.005}, actuation={"force": {}})
    names = "carriage_displacement", "sphere_offset", "carriage_velocity", "sphere_velocity"
    start = dict(zip(names, (0.01, 0.01, 0.3, -0.1), strict=True))
    moved = simulate(scene.replace(initial=start), duration=0.005).state[-1]
    found = compile_scene(scene).jacobian([0.01, 0.02, 0.3, -0.1], [0.0])
    np.testing.assert_allclose(found.end[:4], moved, rtol=1e-8)
    others = compile_scene(scene.replace(**{"interface.reference_velocity": 0.01}))
    others.jacobian([0.5, 0.6, 1.0, 2.0], [0.0])
    again = compile_scene(scene).jacobian([0.01, 0.02, 0.3, -0.1], [0.0])
    assert np.array_equal(again.end, found.end)
    assert np.array_equal(again.state, found.state)


HYSTERESIS = {
    "stiffness": 300.0,
    "stiffness_ratio": 0.1,
    "yield_displacement": 1e-3,
    "exponent": 2.0,
    "shape": 0.7,
    "damping": 0.1,
}


@pytest.mark.parametrize("name", HYSTERESIS)
def test_hysteresis_has_derivatives_where_an_episode_begins(name: str) -> None:
    """At z = 0 the force's derivative over the yield displacement is that of z, with its sign."""
    plants = [
        compile_scene(
            Scene(
                interface={"kind": "bouc_wen", **HYSTERESIS, name: part * HYSTERESIS[name]},
                control={"time_step": 0.01},
                actuation={"force": {}},
            )
        )
        for part in (1.0 - 1e-5, 1.0, 1.0 + 1e-5)
    ]
    start, force, field = [0.01, 0.02, 0.3, -0.1, 0.0], [0.3], f"interface.{name}"
    low, _, high = (plant.jacobian(start, force).end for plant in plants)
    slope = (high - low) / (2e-5 * HYSTERESIS[name])
    found = plants[1].jacobian(start, force, parameters=[field]).parameters[field]
    floor = 1e-7 * abs(slope).max() + 1e-300  # while z grows, the shape has no effect
    np.testing.assert_allclose(found[: len(slope)], slope, rtol=1e-5, atol=floor)


def test_masses_that_move_almost_alike_have_derivatives() -> None:
    """From rest the ground moves both alike: rounding leaves few digits of the slip velocity."""
    sweep = {"amplitude": 0.6, "start_frequency": 8.0, "end_frequency": 22.0, "duration": 6.0}
    excitation = [{"kind": "sweep", "target": "ground", "phase": 1.5, **sweep}]
    scene = Scene(
        carriage={"mass": 5.0, "stiffness": 1000.0, "damping": 2.0},
        sphere={"mass": 0.5},
        interface={"kind": "magnetorheological"},
        springs={"kind": "linear", "stiffness": 95.0},
        excitation=excitation,
        actuation={"voltage": {}},
        control={"time_step": 0.02},
    )

    def begun(**initial: float) -> MovingMassVectorEnv:
        env = MovingMassVectorEnv(scene.replace(initial=initial), 1, autoreset_mode="Disabled")
        env.reset(seed=[0])
        return env

    def end(velocity: float) -> np.ndarray:
        *_, info = begun(carriage_velocity=velocity).step(np.array([[0.3]]))
        return info["state"][0]

    env = begun()
    start = env.get_state()
    lanes = start["values"], start["streams"]
    physics = Sensitivities(env.plant.support, (env.plant.model, env.plant.task), lanes)
    found = physics.jacobian(np.array([[0.3]])).state[0][:4, 2]
    np.testing.assert_allclose(found, (end(1e-6) - end(-1e-6)) / 2e-6, rtol=1e-5)
