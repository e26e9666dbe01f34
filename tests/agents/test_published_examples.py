"""Published numbers of controllers, reproduced: the table of docs/controllers.md.

LQR: one mass, and a quarter car with a force between its masses; continuous gains are the limit of
ours for short control steps.

Semi-active: a quarter car crosses a bump of 0.05 m and 0.5 m at 20 km/h (technical report of VISTA,
Virtual Suspension Test Bench, v1.30, 2026). Controllers run at 1 kHz, the valve has a lag of 15 ms
between 500 and 3000 N s/m. Improvements are over a passive damper of 2000 N s/m. Its public
demonstration says in which order things happen: at each millisecond the controller, then four times
the valve, by the backward Euler method, and a quarter of a millisecond of motion.
"""

from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from agents.controllers.clipped_optimal import ClippedOptimal
from agents.controllers.lqr import design
from agents.controllers.semi_active import Hook
from mm_gym import Scene, simulate

PAGE = (Path(__file__).parents[2] / "docs" / "controllers.md").read_text("utf-8")

STEPS = (8e-3, 4e-3, 2e-3, 1e-3)
"""Control steps [s] of the designs that are extrapolated to a step of zero."""


def mass(stiffness, damping, weights, step):
    """One mass of 1 kg; `weights` are those of displacement, velocity and force."""
    on_displacement, on_velocity, on_force = weights
    return Scene(
        carriage={"mass": 1.0, "stiffness": stiffness, "damping": damping},
        interface={"kind": "none"},
        actuation={"force": {"limit": 1.0}},
        objective={
            "displacement_weight": on_displacement,
            "displacement_scale": 1.0,
            "velocity_weight": on_velocity,
            "velocity_scale": 1.0,
            "effort_weight": on_force,
        },
        control={"time_step": step},
    )


def continuous(scene_of):
    """Gains, and P, of the regulator in continuous time: those of each step, extrapolated."""
    designs = [design(scene_of(step)) for step in STEPS]
    # A sum over steps is the integral over time divided by the step.
    values = [
        np.concatenate([d.gain.ravel(), step * d.cost[np.triu_indices(len(d.cost))]])
        for d, step in zip(designs, STEPS, strict=True)
    ]
    for order in range(1, len(STEPS)):  # Richardson: each halving takes a power of the step away
        pairs = zip(values[1:], values, strict=False)
        values = [finer + (finer - coarser) / (2**order - 1) for finer, coarser in pairs]
    return values[0]


def row(source, quantity, printed, ours, digits):
    """The row of the page."""
    difference = f"{round(ours - printed, digits) + 0.0:.{digits}f}"  # not -0.0
    cells = (source, quantity, f"{printed:.{digits}f}", f"{ours:.{digits}f}", difference)
    return f"| {' | '.join(cells)} |".replace("| -", "| \N{MINUS SIGN}")


@pytest.mark.parametrize(
    ("source", "plant", "names", "printed", "digits"),
    [
        (
            "LQR of a mass on spring and damper [P1]",
            (10.0, 1.0, (100.0, 1.0, 0.001)),
            ("gain of x1 [N/m]", "gain of v1 [N s/m]"),
            (306.386, 39.1718),
            (3, 4),
        ),
        (
            "LQR of a free mass [P2]",
            (1e-9, 0.0, (1.0, 1.0, 1.0)),  # a scene has no carriage without a spring
            ("gain of x1", "gain of v1", "P11", "P12", "P22"),
            (1.0, np.sqrt(3.0), np.sqrt(3.0), 1.0, np.sqrt(3.0)),
            (6, 6, 6, 6, 6),
        ),
    ],
)
def test_regulators_of_one_mass_have_the_printed_gains(source, plant, names, printed, digits):
    gains = continuous(partial(mass, *plant))
    for name, value, ours, places in zip(names, printed, gains, digits, strict=False):
        # Half a unit of the last place that is printed, or stated.
        assert abs(ours - value) < 0.5 * 10.0**-places, name
        assert row(source, name, value, ours, places) in PAGE


BODY, WHEEL, SUSPENSION, TYRE = 600.0, 75.0, 30.0, 300.0  # the paper's quarter car [kg, N/m]


def quarter_car(damping, step):
    """The quarter car with a force between its masses, for a cost of its energy.

    The paper weighs s^2, x1^2, v1^2 and v2^2 by the suspension's k, the tyre's K and the masses m
    and M, and u^2 by 1. A reward has no weight of v2^2. But rates of quadratic functions of the
    state add the same to the cost of every controller that comes to rest, and change no gain. Let
    F = M a2, and ~ mean "is, but for such a rate". Without a damper

        M v2^2 + m v1^2 ~ -s F + K x1^2 ~ k s^2 - s u + K x1^2
        F^2 = (u - k s)^2

    so that -s u can be written as F^2, u^2 and s^2. A damper c adds to F^2 terms in s' u and s'^2:

        s' F ~ 0, s'^2 ~ -s F / M + (1 + m / M) v1^2 - (K / M) x1^2
    """
    share = 2.0 * SUSPENSION - damping**2 / BODY
    on_stroke = 2.0 * SUSPENSION - (SUSPENSION**2 - damping**2 * SUSPENSION / BODY) / share
    return Scene(
        carriage={"mass": WHEEL, "stiffness": TYRE, "damping": 0.0},
        sphere={"mass": BODY},
        interface={"kind": "viscous", "damping": damping},
        springs={"kind": "linear", "stiffness": SUSPENSION},
        actuation={"force": {"limit": 1.0, "between": "masses"}},
        objective={
            "displacement_weight": 2.0 * TYRE - damping**2 * TYRE / (BODY * share),
            "displacement_scale": 1.0,
            "velocity_weight": damping**2 * (1.0 + WHEEL / BODY) / share,
            "velocity_scale": 1.0,
            "stroke_weight": on_stroke,
            "stroke_scale": 1.0,
            "coupling_force_weight": 1.0 / share,
            "coupling_force_scale": 1.0,
            "effort_weight": 1.0 - 1.0 / share,
        },
        control={"time_step": step},
    )


@pytest.mark.parametrize(
    ("damping", "printed"),
    [
        (0.0, (0.49590136, -1.14546156, 35.69758159, -11.83173935)),
        (60.0, (0.49590136, -1.5503297, 10.16911434, -1.10355288)),
    ],
)
def test_regulator_of_a_quarter_car_has_the_printed_gains(damping, printed):
    gains = continuous(partial(quarter_car, damping))[:4]
    names = ("x2 [N/m]", "x1 [N/m]", "v2 [N s/m]", "v1 [N s/m]")
    source = f"LQR of a quarter car, {damping:.0f} N s/m [P4]"
    # Theirs is positive towards the body, ours towards the wheel.
    for name, value, ours in zip(names, printed, -gains[[1, 0, 3, 2]], strict=True):
        assert abs(ours - value) < 0.5e-8, name  # half a unit of the last place that is printed
        assert row(source, f"gain of {name}", value, ours, 8) in PAGE


HEIGHT, LENGTH, BEGIN = 0.05, 0.09, 1.0
"""The bump [m], how long it takes to cross it and when that begins [s]."""

SAMPLE, PART, END = 1e-3, 4, 3.0
"""The controllers' step [s], and into how many the valve's lag is divided; the end [s]."""

LAG = SAMPLE / PART / np.log1p(SAMPLE / PART / 0.015)
"""That of the valve [s] for which our steps are theirs: 15 ms by the backward Euler method."""

CAR = {
    "carriage": {"mass": 40.0, "stiffness": 190e3, "damping": 0.0},
    "sphere": {"mass": 250.0},
    "interface": {"kind": "viscous", "damping": 2000.0},
    "springs": {"kind": "linear", "stiffness": 10e3},
}
VALVE = {"damping": {"minimum": 500.0, "maximum": 3000.0}}
WEIGHTS = {
    "displacement_weight": 1e6,  # of the tyre's deflection
    "displacement_scale": 1.0,
    "stroke_weight": 1e4,
    "stroke_scale": 1.0,
    "sphere_acceleration_weight": 1.0,
    "sphere_acceleration_scale": 1.0,
}
FORCE_WEIGHT = 1e-8


def road_velocity(time):
    """Of the half sine [m/s]; at its ends, that before the jump."""
    phase = np.pi * (time - BEGIN) / LENGTH
    inside = BEGIN < time <= BEGIN + LENGTH + 1e-9
    return HEIGHT * np.pi / LENGTH * np.cos(phase) if inside else 0.0


def crossing(scene, action=None):
    """Accelerations of the body [m/s^2] and strokes [m] at each sample from the bump on."""
    times = np.linspace(0.0, LENGTH, 901)
    jerk = -HEIGHT * (np.pi / LENGTH) ** 2 * np.sin(np.pi * times / LENGTH)
    jump = {"kind": "impulse", "target": "ground", "size": HEIGHT * np.pi / LENGTH}
    ends = [jump | {"time": BEGIN}, jump | {"time": BEGIN + LENGTH}]
    motion = simulate(
        scene.replace(excitation=ends),
        duration=END,
        action=action,
        ground=np.column_stack([BEGIN + times, jerk]),
    )
    chosen = slice(round(BEGIN / SAMPLE) * PART, None, PART)
    stroke, slip = (motion.state[:, k + 1] - motion.state[:, k] for k in (0, 2))
    damping = CAR["interface"]["damping"] if action is None else motion.action[:, 0]
    # The valve moves at the beginning of a step; a sample is taken before it does.
    held = np.roll(np.broadcast_to(damping, stroke.shape), 1)
    acceleration = -(CAR["springs"]["stiffness"] * stroke + held * slip) / CAR["sphere"]["mass"]
    return acceleration[chosen], stroke[chosen]


def controlled(law):
    """The crossing with a law that sees the true state, velocities not relative to the road."""
    lagging = {"damping": VALVE["damping"] | {"lag": LAG}}
    scene = Scene(**CAR, actuation=lagging, control={"time_step": SAMPLE / PART})
    low, high = VALVE["damping"].values()
    held = [low]

    def action(time, state):
        if round(time / SAMPLE * PART) % PART == 0:
            seen = (state + road_velocity(time) * np.array([0.0, 0.0, 1.0, 1.0]))[None]
            ratio = float(law.action(law.begin(1), seen, np.array([held]))[0][0, 0])
            held[0] = 0.5 * (low + high + (high - low) * ratio)
        return held[0]

    return crossing(scene, action)


@cache
def passive():
    return crossing(Scene(**CAR, control={"time_step": SAMPLE / PART}))


STILL = Scene(**CAR, actuation=VALVE, objective=WEIGHTS, control={"time_step": 1e-5})
"""What the laws are designed for: a road at rest, a valve without lag, continuous time."""

WEIGHT = FORCE_WEIGHT * CAR["carriage"]["stiffness"] ** 2


@pytest.mark.parametrize(
    ("source", "law", "printed"),
    [
        (
            "skyhook, continuous, 8000 N s/m [P3]",
            lambda: Hook(STILL, "skyhook", "continuous", gain=8000.0),
            (40.1, 50.7, None),
        ),
        ("skyhook, on-off [P3]", lambda: Hook(STILL, "skyhook", "on-off"), (8.4, -12.0, -42.2)),
        (
            "clipped LQR [P3]",
            lambda: ClippedOptimal(STILL, "continuous", WEIGHT),
            (18.4, 13.3, None),
        ),
    ],
)
def test_semi_active_quarter_car_improves_as_the_report_prints(source, law, printed):
    (acceleration, stroke), (passive_acceleration, passive_stroke) = controlled(law()), passive()
    ratios = (
        np.sqrt(np.mean(acceleration**2) / np.mean(passive_acceleration**2)),
        np.abs(acceleration).max() / np.abs(passive_acceleration).max(),
        np.abs(stroke).max() / np.abs(passive_stroke).max(),
    )
    names = ("rms acceleration [%]", "peak acceleration [%]", "largest stroke [%]")
    for name, value, ratio in zip(names, printed, ratios, strict=True):
        if value is None:
            continue
        ours = 100.0 * (1.0 - ratio)
        assert abs(ours - value) < 0.05, name  # half a unit of the last place that is printed
        assert row(source, name, value, ours, 1) in PAGE
