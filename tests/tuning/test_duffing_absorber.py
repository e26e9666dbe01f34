"""Does the nonlinear absorber keep both peaks equal?"""

import numpy as np
import pytest
from tuning.conftest import rig

from mm_gym import simulate
from mm_gym.compiler.jit import plain
from mm_gym.law import springs
from mm_gym.tuning import DesignError, OutOfReachError, duffing_absorber, tune

STIFFENING = rig(0.05, damping=0.2).replace(**{"carriage.cubic_coefficient": 100.0})


def peaks(scene, force):
    """Return the amplitudes of both peaks over the static displacement, by simulation."""
    found = []
    # Under this force each peak lies within its band.
    for low, high in ((88.0, 95.0), (105.0, 112.5)):
        sizes = []
        for frequency in np.linspace(low, high, 4):
            harmonic = {"kind": "harmonic", "amplitude": force, "frequency": frequency}
            driven = scene.replace(**{"excitation": [harmonic], "solver.tolerance": 1e-6})
            # Transients decay as exp(-4 t) or faster.
            times = np.linspace(3.9, 4.0, 40)
            sizes.append(np.abs(simulate(driven, times=times).state[:, 0]).max())
        found.append(max(sizes) * 1e4 / force)
    return found


def test_springs_have_the_cubic_term_of_the_source():
    # Its example: mass ratio 0.05, k1 = knl1 = 1, and then k2 = 0.0454 and knl2 = 0.0042.
    tuned = duffing_absorber(STIFFENING)
    k0, l0, stretch = tuned.springs.stiffness, tuned.springs.rest_length, tuned.springs.stretch
    offset = 1e-3 * l0
    force = plain(springs.spring_force)(k0, l0, stretch, np.array([offset, 10.0 * offset]))
    k2 = plain(springs.stiffness)(k0, stretch)
    cubic = (force[1] - k2 * 10.0 * offset) / (10.0 * offset) ** 3
    assert k2 / 1e4 == pytest.approx(0.0454, abs=5e-5)
    assert cubic / 1e6 == pytest.approx(0.0042, abs=5e-5)
    assert cubic / 1e6 == pytest.approx(2.0 * 0.05**2 / 1.2, rel=1e-3)


def test_peaks_stay_equal_where_those_of_a_linear_absorber_part():
    nonlinear = peaks(duffing_absorber(STIFFENING), 40.0)
    linear = tune(rig(0.05)).tuned.replace(
        **{"carriage.cubic_coefficient": 100.0, "carriage.damping": 0.2}
    )
    apart = peaks(linear, 40.0)
    assert abs(nonlinear[0] / nonlinear[1] - 1.0) <= 0.06
    assert apart[1] / apart[0] - 1.0 >= 0.25
    assert max(nonlinear) <= 0.9 * max(apart)


def test_what_has_no_cubic_spring_or_no_reach_is_refused():
    with pytest.raises(DesignError, match=r"carriage\.cubic_coefficient"):
        duffing_absorber(rig(0.05))
    with pytest.raises(DesignError, match=r"springs\.kind"):
        duffing_absorber(STIFFENING.replace(springs={"kind": "none"}))
    with pytest.raises(OutOfReachError):
        duffing_absorber(STIFFENING.replace(**{"springs.stiffness": 10.0}))
    drawn = {"interface.damping": [0.1, 0.2]}, {"springs.stretch": [1.2, 1.3]}
    for ranges in drawn:
        with pytest.raises(DesignError, match=next(iter(ranges))):
            duffing_absorber(STIFFENING.replace(randomization=ranges))


def test_carriage_that_is_drawn_has_the_middle_of_its_ranges():
    ranges = {"carriage.cubic_coefficient": [200.0, 600.0], "carriage.stiffness": [8e3, 1.0e4]}
    drawn = duffing_absorber(STIFFENING.replace(randomization=ranges)).springs
    middle = {"carriage.cubic_coefficient": 400.0, "carriage.stiffness": 9e3}
    assert drawn == duffing_absorber(STIFFENING.replace(**middle)).springs
