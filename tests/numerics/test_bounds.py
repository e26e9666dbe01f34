"""Do random scenes of all kinds stay within the bounds that their methods promise?"""

import mpmath as mp
import numpy as np
import pytest

from mm_gym import Scene, compile_scene
from mm_gym.lanes import extended
from mm_gym.simulation.lanes import Lanes

from . import double_double_kernel as precise
from .bounds import advance, outcome
from .decimal_series import ControlStep

WORST = {
    97: "a slow logarithmic sweep, 1.7 times the bound",
    214: "a sweep over three octaves in one sample interval, 2e6 times",
    430: "a logarithmic sweep between neighbouring frequencies, drawn masses, 105 times",
    446: "a linear sweep after 6e4 rad, 1.7 times",
    598: "a logarithmic sweep of 150 s, 242 times",
    764: "a held force that turns the carriage back, for one column of the splitting: 5.1 times",
    1135: "a sweep with a softening spring, 9e4 times",
    2306: "columns of the splitting that agree by chance, 2.0 times",
    3530: "the same, 2.2 times",
    4970: "columns too coarse for their estimate, 1.6 times",
    15929: "impulses that are placed by the time of an old episode, 6.8 times",
    20008: "a sweep with dry friction, 4e4 times",
    1000178: "a Runge-Kutta step whose error estimate vanishes by chance, 12 times",
    1000412: "many sample intervals near a spring's collapse, 78 times",
    1001192: "the same, 20 times",
    1002269: "many short steps, 1.3 times",
    1012131: "a sphere that bounces off the end of its springs, 11 times",
    2010012: "a sweep that one substep samples too coarsely, 2.2 times",
    2011828: "the same, 2.8 times",
    5000361: "springs of finite stretch that rise between two kicks of the splitting, 1.4 times",
    5000577: "such springs on a long way, for one column of the splitting, 2.5 times",
    5001879: "columns too coarse for springs near their end, 1.2 times",
    5002357: "the same, 1.3 times",
    1020081: "a spring whose force rises between the stages of a step, 1.8 times",
}
"""Seeds that exceeded their bounds, and by how much."""

LARGEST = {
    "exact": (446, 4458),
    "series": (11723, 1220, 4000166),
    "splitting": (3147, 17078, 2012473, 2010486, 5010070),
    "runge_kutta": (1021383, 1011721),
    "switched": (23274, 13551),
    "taylor": (10720, 8955),
}
"""The seeds with the largest error over its bound."""

PARTS = {
    "viscous": {"interface": {"kind": "viscous", "damping": 0.2}},
    "dry friction": {
        "interface": {
            "kind": "dry_friction",
            "static_coefficient": 0.5,
            "kinetic_coefficient": 0.2,
            "reference_velocity": 0.05,
            "normal_force": 0.4,
        }
    },
    "cubic": {"carriage": {"cubic_coefficient": 1e4}},
    "finite stretch": {"springs": {"kind": "finite_stretch", "rest_length": 0.02}},
}


@pytest.mark.parametrize("seed", WORST)
def test_scenes_that_exceeded_their_bound_keep_it(seed, tmp_path):
    assert outcome(seed, tmp_path).excess <= 1.0


@pytest.mark.parametrize("method", LARGEST)
def test_the_largest_errors_keep_their_bounds(method, tmp_path):
    found = [outcome(seed, tmp_path) for seed in LARGEST[method]]
    assert [one.method for one in found] == [method] * len(found)
    assert max(one.excess for one in found) <= 1.0


def _exceeding(seeds, folder):
    return [one for one in (outcome(seed, folder) for seed in seeds) if not one.excess <= 1.0]


def test_random_scenes_keep_their_bounds(tmp_path):
    assert _exceeding(range(60), tmp_path) == []


def test_a_thousand_random_scenes_keep_their_bounds(tmp_path):
    assert _exceeding(range(1000), tmp_path) == []


@pytest.mark.parametrize("parts", PARTS)
def test_the_fast_reference_agrees_with_decimal_series(parts):
    scene = Scene(
        initial={"carriage_displacement": 0.012, "sphere_offset": -0.007, "carriage_velocity": 0.4},
        excitation=[
            {"kind": "harmonic", "amplitude": 0.7, "frequency": 55.0, "phase": 0.3},
            {"kind": "harmonic", "target": "ground", "amplitude": 2.0, "frequency": 31.0},
        ],
        actuation={"force": {"limit": 2.0}},
        control={"time_step": 0.08},
        **PARTS[parts],
    )
    plant = compile_scene(scene)
    lanes = Lanes(plant, 1)
    lanes.restart()
    rng = np.random.default_rng(0)
    for n in range(2):
        _, starts, followed = advance(lanes, rng)
        step = followed[0].step()
        force, stretch = step.parameters[[precise.FORCE, precise.STRETCH]]
        _, got, scale = step.end(starts[:, 0])
        want, _ = ControlStep(scene, n * plant.time_step, force, stretch).end(starts[:, 0])
        # Both are rounded to doubles once, at the end.
        assert np.abs((got - want) / scale).max() < 4e-16


def test_pairs_of_doubles_have_twice_the_digits():
    rng = np.random.default_rng(0)
    with mp.workdps(50):
        for spread in 10.0 ** rng.uniform(-6.0, 3.0, 200):
            a = float(rng.uniform(0.1, 10.0))
            b = a * (1.0 + float(spread))
            got = extended.logarithm_of_ratio(b, a)
            want = mp.log(mp.mpf(b) / mp.mpf(a))
            # The ratio has 1e-32 of itself, its logarithm is smaller by `spread`.
            assert abs(mp.mpf(got[0]) + got[1] - want) < 1e-29 * max(1.0, 1e-3 / spread) * abs(want)
            grown = extended.exponential_less_one(got)
            exact = mp.expm1(mp.mpf(got[0]) + got[1])
            assert abs(mp.mpf(grown[0]) + grown[1] - exact) < 1e-29 * abs(exact)
