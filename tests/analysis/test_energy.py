"""Does the energy balance close for every plant?"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from source_imports import PACKAGE, imported_by
from tasks import CARRIAGE_FORCE, PRE_STRETCH

from mm_gym import Scene, simulate

RELEASE = {"carriage_displacement": 0.01, "sphere_offset": 0.02}
STEPS = {"time_step": 0.005, "steps": 100}
FRICTION = {
    "kind": "dry_friction",
    "static_coefficient": 0.509,
    "kinetic_coefficient": 0.2545,
    "reference_velocity": 0.2,
    "slip_damping": 0.1,
}
STIFF = FRICTION | {"reference_velocity": 1e-6}
SMALL = {"kind": "small_on_large"}
FINITE = {"kind": "finite_stretch", "rest_length": 0.05}
CUBIC = {"cubic_coefficient": 2e6}
HARMONICS = [
    {"kind": "harmonic", "target": "ground", "amplitude": 3.0, "frequency": 50.0},
    {"kind": "harmonic", "target": "force", "amplitude": 1.0, "frequency": 57.0, "phase": 0.4},
]
SHAKEN = [
    {"kind": "impulse", "size": [-0.1, 0.1], "rate": 20.0},
    {"kind": "impulse", "target": "ground", "size": 0.1, "time": 0.2},
    {"kind": "kanai_tajimi", "rms": 2.0, "ground_frequency": 60.0},
    {
        "kind": "sweep",
        "amplitude": 1.0,
        "start_frequency": 20.0,
        "end_frequency": 70.0,
        "duration": 0.3,
    },
    HARMONICS[0],
]
BOTH = {"force": {"limit": 4.0}, "stretch": {"minimum": 1.0, "maximum": 3.0}}

BOUND = 1e-10  # largest residual of the balance, relative to the energy passed through

SCENES = {
    "linear": {},
    "light sphere": {"sphere": {"mass": 1e-6}},
    "massless carriage": {"carriage": {"mass": 0.0}},
    "almost massless carriage": {"carriage": {"mass": 1e-80}},
    "locked": {"interface": {"kind": "viscous", "damping": 1e9}},
    "loose": {"interface": {"kind": "viscous", "damping": 1e-12}},
    "carriage alone": {"interface": {"kind": "none"}},
    "harmonics": {"springs": SMALL, "excitation": HARMONICS},
    "long steps": {
        "springs": SMALL,
        "excitation": HARMONICS,
        "control": {"time_step": 10.0, "steps": 5},
    },
    "parametric": {"springs": SMALL, "excitation": HARMONICS, "actuation": BOTH},
    "friction": {"interface": FRICTION},
    "stiff friction": {"interface": STIFF},
    "driven friction": {"interface": FRICTION, "excitation": HARMONICS},
    "parametric friction": {
        "interface": FRICTION,
        "springs": SMALL,
        "excitation": HARMONICS,
        "actuation": BOTH,
    },
    "shaken": {"excitation": SHAKEN},
    "shaken without mass": {"carriage": {"mass": 0.0}, "excitation": SHAKEN[1:]},
    "shaken friction": {"interface": FRICTION, "excitation": SHAKEN},
    "shaken and stretched": {"springs": SMALL, "excitation": SHAKEN, "actuation": BOTH},
    "shaken finite stretch": {"springs": FINITE, "excitation": SHAKEN, "actuation": BOTH},
    "cubic": {"carriage": CUBIC},
    "finite stretch": {"springs": FINITE},
    "driven finite stretch": {"springs": FINITE, "excitation": HARMONICS, "actuation": BOTH},
    "cubic with friction": {"carriage": CUBIC, "interface": FRICTION},
    "cubic with stiff friction": {"carriage": CUBIC, "interface": STIFF},
    "everything": {
        "carriage": CUBIC,
        "interface": FRICTION,
        "springs": FINITE,
        "excitation": HARMONICS,
        "actuation": BOTH,
    },
}


def run(parts, **options):
    scene = Scene(**{"initial": RELEASE, "control": STEPS} | parts)
    rng = np.random.default_rng(5)
    action = None
    if "actuation" in parts:
        action = lambda _time, _state: [rng.uniform(-4.0, 4.0), rng.uniform(1.0, 3.0)]  # noqa: E731
    return simulate(scene, action=action, **options)


def residual(trajectory):
    work = trajectory.work
    return np.abs(trajectory.energy - trajectory.energy[0] - work.total).max() / work.throughput[-1]


@pytest.mark.parametrize("name", SCENES)
def test_balance_closes(name):
    assert residual(run(SCENES[name])) < BOUND


@pytest.mark.parametrize(
    "name",
    ["harmonics", "parametric", "friction", "cubic", "everything", "shaken", "shaken friction"],
)
def test_balance_closes_between_control_steps(name):
    rng = np.random.default_rng(2)
    trajectory = run(SCENES[name], times=np.sort(rng.uniform(0.0, 0.5, 20)))
    assert residual(trajectory) < BOUND


@pytest.mark.parametrize("name", ["cubic", "cubic with friction", "everything"])
def test_residual_of_nonlinear_plants_falls_with_their_tolerance(name):
    tight = residual(run(SCENES[name] | {"solver": {"tolerance": 1e-14}}))
    assert tight < 1e-13


def test_free_motion_only_dissipates():
    free = run({}).work
    assert not free.control.any()
    assert not free.stretch.any()
    assert not free.disturbance.any()
    assert np.all(np.diff(free.dissipated) >= 0.0)


def test_work_of_a_constant_force_is_force_times_displacement():
    trajectory = simulate(CARRIAGE_FORCE.replace(initial={}), action=2.0)
    assert trajectory.work.control == pytest.approx(2.0 * trajectory.state[:, 0], abs=1e-17)


def test_stiffening_at_an_offset_injects_energy():
    scene = PRE_STRETCH.replace(
        excitation=(), randomization={}, initial={"sphere_offset": 0.01, "stretch": 3.0}
    ).replace(**{"actuation.stretch.rate_limit": None, "control.time_step": 1e-9})
    work = simulate(scene, action=[[3.0], [1.0], [1.0]], duration=3e-9).work
    k2 = 70.0 * (1.0 + 2.0 / np.array([1.0, 3.0]) ** 3)
    assert work.stretch[1] == pytest.approx(0.5 * (k2[0] - k2[1]) * 0.01**2, rel=1e-6)


def test_finite_stretch_with_a_long_rest_length_has_the_energy_of_small_on_large():
    # The correction for finite stretch is (offset / rest_length)^2 = 1e-11.
    long = run({"springs": FINITE | {"rest_length": 1e4}, "solver": {"tolerance": 1e-13}})
    small = run({"springs": SMALL})
    assert long.energy == pytest.approx(small.energy, rel=1e-8)
    assert long.work.dissipated == pytest.approx(small.work.dissipated, rel=1e-8)


def test_nonlinear_work_tends_to_the_exact_one_as_the_cubic_term_vanishes():
    exact = run(SCENES["driven friction"]).work
    series = run(
        SCENES["driven friction"]
        | {"carriage": {"cubic_coefficient": 1e-12}, "solver": {"tolerance": 1e-14}}
    ).work
    for kind in ("disturbance", "dissipated"):
        assert getattr(series, kind) == pytest.approx(getattr(exact, kind), rel=1e-10, abs=1e-14)


def test_locked_masses_lose_the_energy_of_their_slip_at_once():
    scene = Scene(
        interface={"kind": "viscous", "damping": 1e9},
        carriage={"damping": 0.0},
        initial={"sphere_velocity": 1.0},
        control=STEPS,
    )
    reduced = 0.1 * 0.04 / 0.14
    assert simulate(scene).work.dissipated[1:] == pytest.approx(0.5 * reduced, rel=1e-8)


def test_a_coarse_integrator_shows_its_error_in_the_balance():
    coarse = {"solver": {"method": "rk4", "substeps": 1}}
    assert residual(run(coarse)) > BOUND


positive = st.floats(-3.0, 3.0).map(lambda exponent: 10.0**exponent)


@settings(max_examples=60, deadline=None)
@given(
    masses=st.tuples(positive, positive),
    dampings=st.tuples(positive, positive),
    stiffness=positive,
    step=st.floats(-6.0, 1.0).map(lambda exponent: 10.0**exponent),
    drive=st.tuples(st.floats(-1.0, 1.0), st.sampled_from(["force", "ground"])),
)
def test_balance_closes_for_any_linear_scene(masses, dampings, stiffness, step, drive):
    trajectory = simulate(
        Scene(
            carriage={"mass": masses[0], "stiffness": stiffness, "damping": dampings[0]},
            sphere={"mass": masses[1]},
            interface={"kind": "viscous", "damping": dampings[1]},
            springs=SMALL,
            excitation=[
                {"kind": "harmonic", "target": drive[1], "amplitude": 1.0, "frequency": 3.0}
            ],
            initial=RELEASE | {"sphere_velocity": drive[0]},
            control={"time_step": step, "steps": 20},
        )
    )
    assert residual(trajectory) < BOUND


@pytest.mark.parametrize("time_step", [1e-2, 1e-1])
def test_terms_that_vanish_by_symmetry_do_not_hide_the_others(time_step):
    # Almost constant, on a cubic spring at rest: one term in six differs from zero.
    push = {"kind": "harmonic", "amplitude": 20.0, "frequency": 1e-9, "phase": np.pi / 2}
    trajectory = simulate(
        Scene(
            carriage={"linear_coefficient": 0.0, "cubic_coefficient": 2e6, "damping": 0.0},
            interface={"kind": "none"},
            excitation=[push],
            solver={"tolerance": 1e-13},
            control={"time_step": time_step, "steps": 5},
        )
    )
    assert residual(trajectory) < BOUND


def test_energy_has_in_common_with_the_methods_what_it_says_and_no_more():
    """Else a balance that closes would confirm nothing."""
    room = "mm_gym.simulation.energy"
    files = set((PACKAGE / "simulation" / "energy").glob("*.py"))
    # The docstring of `work` says so of it too: `test_interfaces` compares its motion with SciPy's.
    files -= {PACKAGE / "simulation" / "energy" / "quadrature.py"}
    imported = set().union(*(imported_by(file) for file in files))
    said = {
        "law.bounds",
        "law.carriage_spring",
        "law.dry_friction",
        "law.springs",
        "law.events",
        "excitation.kinds",
        "excitation.sources",
        "sensitivity.layout",
        "sensitivity.model",
        "sensitivity.series_kernel",
        "simulation.response",
    }  # the docstring of `work`
    tools = {"arrays", "errors", "compiler.jit", "lanes.layout", "lanes.tangents"}
    tools |= {"simulation.recording"}
    others = {module for module in imported if not module.startswith(room)}
    assert others <= {f"mm_gym.{name}" for name in tools | said}
    assert any(module.startswith(room) for module in imported)
