"""Does the work-precision measurement find the true errors, on any scene?"""

from __future__ import annotations

import csv
import itertools
import math
import time
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tasks import PRE_STRETCH, TASKS

from mm_gym import (
    Scene,
    SceneError,
    SimulationError,
    compile_scene,
    load_scene,
    work_precision,
)
from mm_gym.__main__ import main
from mm_gym.precision import Setting, WorkPrecision, episode, measure
from mm_gym.precision.oracle import Oracle
from mm_gym.precision.result import LEAST, UNKNOWN, margin
from mm_gym.scene.actuators import StretchActuator
from mm_gym.scene.mechanics import Carriage, DryFriction, SmallOnLarge
from mm_gym.scene.scene import Control, Initial

if TYPE_CHECKING:
    from pathlib import Path

START = Initial(carriage_displacement=0.01, sphere_offset=0.02, carriage_velocity=0.2)
BASE = Scene(initial=START, control=Control(time_step=1e-2, steps=30))
CUBIC = BASE.replace(**{"carriage.cubic_coefficient": 2e6})
FRICTION = DryFriction(
    static_coefficient=0.509, kinetic_coefficient=0.2545, reference_velocity=0.2, slip_damping=0.1
)
HARMONICS = [
    {"kind": "harmonic", "amplitude": 3.0, "frequency": 50.0, "phase": 0.3},
    {"kind": "harmonic", "amplitude": 20.0, "frequency": 37.0, "target": "ground"},
]
DRAWN = {"carriage.damping": (0.5, 2.0), "excitation.1.phase": (0.0, 6.0)}
SCENESTHING = BASE.replace(
    excitation=HARMONICS,
    randomization=DRAWN,
    springs=SmallOnLarge().model_dump(),
    **{
        "actuation.stretch": StretchActuator(rate_limit=20.0).model_dump(),
        "actuation.force": {"limit": 10.0},
        "initial.sphere_velocity": (-0.1, 0.1),
    },
)
SCENES = {
    "linear": BASE,
    "cubic": CUBIC,
    "friction": BASE.replace(interface=FRICTION.model_dump()),
    "friction that never slips": BASE.replace(
        interface=FRICTION.model_dump(), **{"interface.reference_velocity": 3.0}
    ),
    "massless": BASE.replace(**{"carriage.mass": 0.0}),
    "stiff": BASE.replace(**{"interface.damping": 1e9}),
    "everything, linear": SCENESTHING,
    "everything, friction": SCENESTHING.replace(interface=FRICTION.model_dump()),
    "everything, cubic": SCENESTHING.replace(**{"carriage.cubic_coefficient": 1e5}),
    "impulses, noise and a sweep": CUBIC.replace(
        excitation=[
            HARMONICS[0],
            {"kind": "impulse", "rate": 20.0, "size": (-0.1, 0.1)},
            {"kind": "noise", "rms": 2.0, "high_frequency": 100.0},
            {
                "kind": "sweep",
                "target": "ground",
                "amplitude": 1.0,
                "start_frequency": 30.0,
                "end_frequency": 80.0,
                "duration": 0.2,
            },
        ]
    ),
    "a task": PRE_STRETCH,
}


@cache
def result_of(name: str) -> WorkPrecision:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(measure, "COSTLIEST", 1.0)  # a loaded machine must not cut the curves short
        patch.setattr(episode, "MOST_CHECKED", 60)  # many scenes: less time for each
        if name != "linear":
            patch.setattr(measure, "ROUNDS", 1)  # only the costs of that one matter
        return work_precision(SCENES[name], seed=3)


@pytest.mark.parametrize("name", SCENES)
def test_auto_at_its_tightest_meets_the_oracle(name: str) -> None:
    result = result_of(name)
    own = [one for one in result.settings if one.method == result.auto]
    # Draws, commands and excitation reach the oracle; otherwise the error would be of order one.
    assert own[-1].error <= 1e-12 + result.resolution
    assert result.resolution <= 1e-11


@pytest.mark.parametrize("name", SCENES)
def test_every_method_is_measured_or_refused_with_a_reason(name: str) -> None:
    result = result_of(name)
    measured = {one.method for one in result.settings}
    tolerant = {"series", "splitting", "runge_kutta", "taylor"}
    methods = {"exact", "switched", "rk4", "semi_implicit_euler"} | tolerant
    assert measured | set(result.refused) == methods
    assert not measured & set(result.refused)
    assert all("solver.method" in why or "allow" in why for why in result.refused.values())
    for method, why in result.refused.items():
        assert f"{method} does not apply: {why}" in result.table()


@pytest.mark.parametrize("name", ["linear", "cubic", "everything, cubic"])
def test_errors_show_the_order_and_the_tolerance(name: str) -> None:
    settings = result_of(name).settings
    for method, order, low, high in (("rk4", 4, 1e-9, 1e-5), ("semi_implicit_euler", 1, 0.0, 1e-2)):
        curve = [
            (one.value, one.error)
            for one in settings
            if one.method == method and low < one.error < high
        ]
        values, errors = np.array(curve).T
        slope = np.polyfit(np.log(values), np.log(errors), 1)[0]
        assert slope == pytest.approx(-order, abs=0.2)
    floor = 1e-12 + result_of(name).resolution
    assert all(s.error <= s.value + floor for s in settings if s.option == "tolerance")


def test_cost_grows_with_the_work() -> None:
    settings = result_of("linear").settings
    rk4 = [one.seconds for one in settings if one.method == "rk4"]
    # Not by as much as the substeps: the call itself costs as much as tens of them.
    assert rk4[-1] > 10.0 * rk4[0] > 0.0
    # A control step takes microseconds at most.
    assert all(0.0 < one.seconds < 1.0 for one in settings)


def test_cheapest_is_the_cheapest_that_keeps_the_error() -> None:
    settings = (
        Setting("taylor", "tolerance", 1e-3, 1e-5, 1e-6),
        Setting("taylor", "tolerance", 1e-6, 1e-8, 2e-6),
        Setting("rk4", "substeps", 1, 1e-4, 5e-7),
        Setting("rk4", "substeps", 64, math.inf, math.inf),
        Setting("exact", "", math.nan, 0.0, 3e-6),
    )
    result = WorkPrecision(settings, {}, "taylor", "SciPy", 1e-13, 1, 1)
    assert result.cheapest(1e-3) is settings[2]
    assert result.cheapest(1e-6) is settings[1]
    assert result.cheapest(1e-9) is settings[4]
    assert result.cheapest(1e-14) is None  # the oracle's own error is larger
    assert 'for 1e-06 use method = "taylor", tolerance = 1e-06' in result.recommendations()
    assert "diverges" in result.table()
    # The margin counts, not the error alone.
    wide = WorkPrecision((replace(settings[0], margin=1e3), settings[1]), {}, "", "", 1e-13, 9, 1)
    assert wide.cheapest(1e-3) is settings[1]
    assert "too few steps (1)" in result.recommendations()
    assert "kept in all of 9 sampled steps" in wide.recommendations()
    assert "95 % confidence it is exceeded in fewer than 1 of 3 steps" in wide.recommendations()
    for bad in (0.0, -1.0, math.nan, math.inf, "small", True):
        with pytest.raises(SceneError, match=r"error: got .* greater than 0"):
            result.cheapest(bad)


@pytest.mark.parametrize("name", ["CarriageForceDuffing", "finite springs"])
def test_recommended_settings_keep_their_error_in_fresh_steps(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    finite = {"kind": "finite_stretch", "stiffness": 35.0, "rest_length": 0.1}
    scenes = {
        "CarriageForceDuffing": TASKS["mm_gym/CarriageForceDuffing-v0"],
        "finite springs": PRE_STRETCH.replace(springs=finite),
    }
    scene = scenes[name]
    plant = compile_scene(scene)
    monkeypatch.setattr(measure, "ROUNDS", 1)  # costs do not matter here
    result = work_precision(scene)
    assert result.checked == 300
    with monkeypatch.context() as patch:
        patch.setattr(episode, "MOST_CHECKED", 10)
        patch.setattr(episode, "EPISODES", 1)
        few = work_precision(scene)
    monkeypatch.setattr(episode, "MOST_CHECKED", 500)
    monkeypatch.setattr(episode, "EVALUATIONS", {"smooth": 10_000_000})
    fresh = episode.truth_of(scene, plant, episode.episodes_of(plant, 10_000))
    assert len(fresh.places) == 500

    def exceeded(settings: list[Setting], level: float) -> float:
        """Return by how much the worst setting exceeds a level in the fresh steps."""
        whole = {"substeps": int, "tolerance": float}
        solvers = [{"method": s.method, s.option: whole[s.option](s.value)} for s in settings]
        plants = [compile_scene(scene.replace(solver=solver)) for solver in solvers]
        return max(measure.errors_of(plant, fresh).max() / level for plant in plants)

    without = []
    for level in (1e-3, 1e-6, 1e-9, 1e-12):
        kept = [s for s in result.settings if max(s.bound, result.resolution) <= level]
        assert kept
        assert exceeded(kept, level) <= 1.0
        seen = [s for s in few.settings if max(s.error, few.resolution) <= level]
        without.append(exceeded(seen, level))
    # Ten steps of one episode and no margin do not suffice.
    assert max(without) > 2.0


RUN = 2.0**-10  # duration of a run [s], of a clock that does not depend on how busy the machine is


def test_cost_of_many_lanes_is_that_of_one_among_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(episode, "MOST_CHECKED", 10)
    monkeypatch.setattr(episode, "EPISODES", 1)
    clock = itertools.count(0.0, RUN)  # each run takes one tick
    monkeypatch.setattr(measure, "time", SimpleNamespace(perf_counter=clock.__next__))
    scene = load_scene("mm_gym/CarriageForceDuffing-v0")
    alone, many = (work_precision(scene, lanes=count) for count in (1, 512))
    assert (many.lanes, many.steps, many.auto) == (512, measure.STEPS_OF_LANES, "taylor")
    assert "for each of 512 lanes side by side" in many.table()
    settings = [
        next(one for one in result.settings if (one.method, one.value) == ("splitting", 1e-3))
        for result in (alone, many)
    ]
    assert settings[0].error == settings[1].error
    assert settings[0].seconds == RUN / alone.steps
    assert settings[1].seconds == RUN / (many.steps * 512)
    with pytest.raises(SceneError, match="lanes: got 0; allowed: an integer of at least 1"):
        work_precision(scene, lanes=0)


def test_margin_covers_what_is_still_to_come() -> None:
    rng = np.random.default_rng(5)
    for heavy in (0.2, 0.5, 1.0):  # log(error) with an exponential tail of this mean
        errors = np.exp(heavy * rng.exponential(size=(400, 800)))
        bounds = [margin(one[:300]) * one[:300].max() for one in errors]
        missed = np.mean(errors[:, 300:].max(axis=1) > bounds)
        # 500 steps at a hundredth of 1 / 300 each: 1.7 %; the mean that is fitted to 20 errors
        # scatters by 22 %, which makes 2.7 % of it, and 400 trials by 0.8 %.
        assert missed < 0.05
    assert margin(np.full(300, 1e-9)) == LEAST
    assert margin(np.array([1e-9])) == UNKNOWN
    assert margin(np.array([1e-9, 0.0, 0.0])) == UNKNOWN


def test_harmonic_of_many_periods_in_a_step_is_followed_or_refused_with_the_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(episode, "EVALUATIONS", {"smooth": 1})  # one sample interval suffices
    fast = CUBIC.replace(
        excitation=[{"kind": "harmonic", "amplitude": 1.0, "frequency": 1e5}],
        **{"control.steps": 2},
    )
    assert work_precision(fast).cheapest(1e-6) is not None
    with pytest.raises(SimulationError, match="SciPy cannot follow") as caught:
        work_precision(fast.replace(**{"excitation.0.frequency": 1e6}))
    message = str(caught.value)
    assert "DOP853: gave up after 100000 evaluations; Radau: gave up after 30000" in message
    assert "in a sample interval, here 0.01 s" in message
    assert "a shorter control.time_step takes fewer" in message


def test_episodes_in_which_nothing_is_random_count_once() -> None:
    plant = compile_scene(CUBIC)
    assert len(episode.episodes_of(plant, 0)) == 1
    drawn = compile_scene(CUBIC.replace(randomization={"carriage.damping": (0.5, 2.0)}))
    assert len(episode.episodes_of(drawn, 0)) == episode.EPISODES
    pushed = compile_scene(CUBIC.replace(**{"actuation.force": {"limit": 10.0}}))
    episodes = episode.episodes_of(pushed, 0)
    commands = np.abs([one.commands[:, 0] for one in episodes])
    assert (commands[1::2] == 10.0).all()
    assert (commands[::2] < 10.0).all()


def test_scene_that_scipy_cannot_follow_is_refused_however_slow_the_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = Scene(carriage=Carriage(mass=1e-80), initial=START)
    # Radau fails in the tenth sample interval: a limit in seconds ended before it.
    hours = iter(range(0, 3_600_000, 3_600))
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(hours)))
    with pytest.raises(SimulationError, match=r"SciPy cannot follow .* Required step size is less"):
        work_precision(scene)


def test_oracle_continues_a_motion_and_keeps_its_budget() -> None:
    oracle = Oracle(SCENESTHING.replace(randomization={}))
    forces, stretches = np.linspace(-5.0, 5.0, 10), np.linspace(1.0, 2.0, 10)
    held = {"forces": forces, "stretches": stretches, "start": np.array([0.01, 0.02, 0.1, 0.0])}
    whole = oracle.solve([0.03, 0.1], **held)
    rest = oracle.solve([0.1], **held | {"start": whole[0], "begin": 0.03})
    assert rest[0] == pytest.approx(whole[1], rel=1e-10)
    with pytest.raises(SimulationError, match="gave up after 20 evaluations"):
        Oracle(BASE, most_evaluations=20).solve([0.1])


def test_command_prints_recommends_and_writes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    scene = tmp_path / "scene.toml"
    scene.write_text("[carriage]\ncubic_coefficient = 2e6\n[initial]\nsphere_offset = 0.01\n")
    assert load_scene(scene).carriage.cubic_coefficient == 2e6
    assert main(["work-precision", str(scene), "--out", str(tmp_path / "new")]) == 0
    printed = capsys.readouterr().out
    assert "for 1e-06 use method = " in printed
    assert "95 % confidence it is exceeded in fewer than 1 of" in printed
    assert "exact does not apply" in printed
    with (tmp_path / "new" / "work_precision.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header[:3] == ["method", "option", "value"]
    assert header[3:] == ["error [-]", "cost of a control step [s]", "margin [-]"]
    methods = {"splitting", "runge_kutta", "taylor", "rk4", "semi_implicit_euler"}
    assert {row[0] for row in rows} == methods
    assert (tmp_path / "new" / "work_precision.png").stat().st_size > 20_000
