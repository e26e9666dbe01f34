"""Is the exponential as a cubic in the generator right wherever the decision table chooses it?"""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from oracle import System

from mm_gym import Scene, compile_scene, simulate
from mm_gym.methods.cayley_hamilton import kernel as ch
from mm_gym.methods.cayley_hamilton.method import CayleyHamilton
from mm_gym.methods.linear_series.method import ExponentialAction
from mm_gym.methods.support import fastest_rate

STEPS = 60


def exponents(low, high):
    return st.floats(low, high).map(lambda x: 10.0**x)


systems = st.fixed_dictionaries(
    {
        "m1": exponents(-2.0, 1.0),
        "m2": exponents(-2.0, 1.0),
        "k1": exponents(0.0, 4.0),
        "k0": exponents(0.0, 3.0),
        "c": exponents(-3.0, 1.0),
        "d": exponents(-3.0, 1.0),
    }
)
stretches = st.lists(st.floats(0.0, 1.0), min_size=STEPS, max_size=STEPS).map(np.array)


ABSORBER = {"m1": 0.1, "m2": 0.04, "k1": 400.0, "k0": 35.0, "c": 0.1, "d": 1.0}


def scene_of(system, phase, harmonics=0, *, limit=None, highest=3.0):
    """Return a scene whose fastest rate times the control step is the phase.

    Its harmonics have multiples of 2/5 of the fastest rate.
    """
    data = {
        "carriage": {"mass": system["m1"], "stiffness": system["k1"], "damping": system["d"]},
        "sphere": {"mass": system["m2"]},
        "interface": {"kind": "viscous", "damping": system["c"]},
        "springs": {"kind": "small_on_large", "stiffness": system["k0"]},
        "initial": {"carriage_displacement": 0.01, "sphere_offset": -0.02, "stretch": [1.0, 1.5]},
        "actuation": {"stretch": {"minimum": 1.0, "maximum": highest}},
    }
    if limit is not None:
        data["actuation"]["force"] = {"limit": limit}
    rate = fastest_rate(compile_scene(Scene(**data, control={"time_step": 1e-9})).support)
    data["control"] = {"time_step": phase / rate, "steps": STEPS}
    data["excitation"] = [
        {"kind": "harmonic", "amplitude": 3.0, "frequency": 0.4 * rate * (j + 1), "phase": 0.7 * j}
        for j in range(harmonics)
    ]
    return Scene(**data)


def by_series(plant):
    series = ExponentialAction()
    return replace(plant, method=series, model=series.constants(plant.support, plant.settings))


def difference(plant, **options):
    """Return the largest difference, relative to the largest position or velocity until then."""
    assert isinstance(plant.method, CayleyHamilton)
    got, want = (simulate(one, **options).state[1:] for one in (plant, by_series(plant)))
    largest = np.maximum.accumulate(np.abs(want))
    scale = np.repeat([largest[:, :2].max(axis=1), largest[:, 2:].max(axis=1)], 2, axis=0).T
    return float((np.abs(got - want) / scale).max())


@given(systems, st.floats(0.1, 2.0), st.integers(0, 2), stretches)
def test_any_stretch_and_harmonics_agree_with_the_series(system, phase, harmonics, stretches):
    scene = scene_of(system, phase, harmonics)
    if harmonics:  # from rest, so that the whole motion is due to the force
        scene = scene.replace(
            **{"initial.carriage_displacement": 0.0, "initial.sphere_offset": 0.0}
        )
    plant = compile_scene(scene)
    assume(isinstance(plant.method, CayleyHamilton))
    # Round-off of 60 steps, and of differences of motions 256 times as large as that of one step.
    assert difference(plant, action=1.0 + 2.0 * stretches) <= 1e-12


@given(systems, st.floats(0.001, 2.0), stretches)
def test_held_force_agrees_with_the_series(system, phase, stretches):
    scene = scene_of(system, phase, limit=100.0)
    action = np.column_stack([200.0 * stretches[::-1] - 100.0, 1.0 + 2.0 * stretches])
    # Up to phase 2 each of the cubic's four terms is at most 2**3 of the state, and rounded once a
    # step. A held force repeats the same rounding, which adds up.
    assert difference(compile_scene(scene), action=action) <= STEPS * 4 * 2**3 * 2.0**-53


@pytest.mark.parametrize("part", [0.0, 0.25, 0.5, 1.0])
@given(systems, st.floats(0.01, 2.0))
def test_cubic_is_the_exponential(part, system, phase):
    highest = 50.0  # there the springs are nearly as soft as possible
    plant = compile_scene(scene_of(system, phase, highest=highest))
    assume(isinstance(plant.method, CayleyHamilton))
    stretch = 1.0 + part * (highest - 1.0)
    k2 = 2.0 * system["k0"] * (1.0 + 2.0 / stretch**3)
    h = plant.support.sample_interval
    t = plant.model[ch.SCALE] * (h * h / system["m1"] * k2 - plant.model[ch.MIDDLE])
    assert abs(t) <= 1.0 + 1e-14
    polynomials = plant.model[ch.OF_STATE : ch.OF_FORCE].reshape(4, ch.COEFFICIENTS)
    generator = System(**{name: system[name] for name in system if name != "k0"}, k2=k2).matrix()
    a = np.array((mpmath.mpf(h) * generator).tolist(), dtype=np.float64)
    cubic = sum(
        np.polyval(polynomial, t) * np.linalg.matrix_power(a, n)
        for n, polynomial in enumerate(polynomials)
    )
    want = np.array(mpmath.expm(mpmath.mpf(h) * generator).tolist(), dtype=np.float64)
    # In the energy norm, positions scaled by the rate: the generator's norm is at most 2.
    scale = np.sqrt([system["m1"], system["m2"]] * 2) * np.array([2.0 / h, 2.0 / h, 1.0, 1.0])
    assert (
        np.abs((cubic - want) * scale[:, None] / scale).max()
        <= 4e-15 * np.abs(want * scale[:, None] / scale).max()
    )


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"carriage.damping": 0.0}, "too little damping"),
        ({"interface.damping": 0.0}, "too little damping"),
        ({"excitation.0.frequency": 0.01}, "its steady motion may be"),
        ({"excitation.0.target": "ground"}, "a harmonic shakes the ground"),
        ({"carriage.mass": (0.1, 0.2)}, "carriage.mass is randomised"),
        ({"control.time_step": 0.1}, "fastest rate times sample interval is"),
    ],
)
def test_series_is_chosen_where_the_cubic_does_not_apply(changes, why):
    scene = scene_of(ABSORBER, 1.0, harmonics=1)
    assert isinstance(compile_scene(scene).method, CayleyHamilton)
    for name, value in changes.items():
        if isinstance(value, tuple):
            scene = scene.replace(randomization={name: value})
        else:
            scene = scene.replace(**{name: value})
    plant = compile_scene(scene)
    assert isinstance(plant.method, ExponentialAction)
    assert "not a cubic in the generator" in plant.reasons[-1]
    assert why in plant.reasons[-1]


def test_cubic_needs_no_damping_without_harmonics():
    scene = scene_of(ABSORBER | {"c": 0.0, "d": 0.0}, 1.0)
    assert difference(compile_scene(scene), action=2.0) <= 1e-14


def test_impulses_change_the_velocities_between_cubics():
    scene = scene_of(ABSORBER, 1.0).replace(
        excitation=[{"kind": "impulse", "size": 0.05, "rate": 20.0}]
    )
    assert difference(compile_scene(scene), action=2.0, seed=1) <= 1e-14
    assert np.abs(np.diff(simulate(scene, seed=1).state[:, 2])).max() > 0.1


NOISE = {"kind": "noise", "rms": 2.0, "low_frequency": 30.0, "high_frequency": 80.0}
SOIL = {"kind": "kanai_tajimi", "rms": 3.0, "ground_frequency": 75.0}
SWEEP = {
    "kind": "sweep",
    "target": "ground",
    "amplitude": 3.0,
    "start_frequency": 20.0,
    "end_frequency": 90.0,
    "duration": 0.5,
}
SAMPLED = {
    "force": [NOISE],
    "ground": [SOIL],
    "both": [NOISE, SOIL],
    "sweep": [SWEEP, NOISE],
    "harmonics too": [
        {"kind": "harmonic", "amplitude": 2.0, "frequency": 90.0},
        NOISE,
        {"kind": "harmonic", "amplitude": 1.0, "frequency": 120.0},
    ],
    "impulses too": [SOIL, {"kind": "impulse", "size": 0.05, "rate": 20.0}],
}


@pytest.mark.parametrize("kind", SAMPLED)
@pytest.mark.parametrize("phase", [0.4, 2.0])
def test_sampled_excitation_agrees_with_the_series(kind, phase):
    # Taylor's terms are at most 2**n / n! of the state: a few roundings of 1e-16 a step.
    system, bound = ABSORBER, 1e-13
    if kind == "harmonics too":  # whose steady motions need damping, and are up to 256 times larger
        system, bound = ABSORBER | {"c": 2.0, "d": 2.0}, 1e-12
    scene = scene_of(system, phase, limit=5.0).replace(
        excitation=SAMPLED[kind],
        **{"initial.carriage_displacement": 0.0, "initial.sphere_offset": 0.0},
    )
    rng = np.random.default_rng(3)
    action = np.column_stack([rng.uniform(-5.0, 5.0, STEPS), rng.uniform(1.0, 3.0, STEPS)])
    assert difference(compile_scene(scene), action=action, seed=2) <= bound


def test_corners_of_records_agree_with_the_series(tmp_path):
    file, rng = tmp_path / "motion.csv", np.random.default_rng(0)
    np.savetxt(file, np.column_stack([np.cumsum(rng.uniform(0.01, 0.03, 40)), rng.normal(size=40)]))
    scene = scene_of(ABSORBER, 2.0).replace(excitation=[{"kind": "record", "file": str(file)}])
    plant = compile_scene(scene)
    assert plant.support.terms > ch.LINE
    assert difference(plant, action=2.0) <= 1e-13


def test_states_between_control_steps_agree_with_the_series():
    scene = scene_of(ABSORBER, 1.0, harmonics=2)
    times = np.sort(np.random.default_rng(0).uniform(0.0, STEPS * scene.control.time_step, 20))
    assert difference(compile_scene(scene), times=times) <= 1e-13
