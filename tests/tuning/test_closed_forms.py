"""Are the closed forms those of the golden file, and the optima that they claim to be?"""

import numpy as np
import pytest
from tuning.conftest import GOLDEN, rig

from mm_gym.tuning import CLOSED_FORMS, DesignError, closed_form, evaluate, tune

NAMES = {
    "DenHartog": "den_hartog",
    "NishiharaAsami": "nishihara_asami",
    "base_reldisp_harm": "warburton_ground_displacement",
    "base_absacc_harm": "warburton_ground_acceleration",
    "force_acc_harm": "warburton_force_acceleration",
    "H2_force_disp": "h2_force_displacement",
    "H2_force_vel": "h2_force_velocity",
    "H2_base_disp": "h2_ground_displacement",
    "maxstab": "maximum_stability",
    "Krenk": "krenk",
    "Lanchester_Hinf": "lanchester_h_infinity",
    "Lanchester_H2": "lanchester_h2",
    "Lanchester_stab": "lanchester_stability",
}
"""Name in the golden file -> here."""

CASES = [(ratio, golden) for ratio in GOLDEN for golden in NAMES]


def test_every_closed_form_has_golden_values():
    assert set(NAMES.values()) == set(CLOSED_FORMS)
    assert all(set(case) == set(NAMES) for case in GOLDEN.values())


@pytest.mark.parametrize(("ratio", "golden"), CASES)
def test_closed_form_equals_the_golden_one(ratio, golden):
    expected, found = GOLDEN[ratio][golden], closed_form(NAMES[golden], float(ratio))
    assert found.damping_ratio == pytest.approx(expected["z"], rel=1e-9)
    if "f" in expected:
        assert found.frequency_ratio == pytest.approx(expected["f"], rel=1e-9)
    key = next(key for key in ("fixed", "h", "closed", "peak") if key in expected)
    if golden != "Krenk":  # whose golden value is the peak, and not that of the fixed points
        assert found.value == pytest.approx(expected[key], rel=1e-9)


@pytest.mark.parametrize(("ratio", "golden"), CASES)
def test_measured_value_of_a_closed_form_equals_the_golden_one(ratio, golden):
    # The peaks and variances of the golden file are numerical; its abscissa of a double pair of
    # eigenvalues keeps half of the digits, as every eigenvalue solver does.
    expected, name = GOLDEN[ratio][golden], NAMES[golden]
    form, optimum = CLOSED_FORMS[name], closed_form(name, float(ratio))
    scene = rig(float(ratio)).replace(
        interface={"kind": "viscous", "damping": optimum.damping(float(ratio), 100.0)}
    )
    k2 = optimum.stiffness(float(ratio), 100.0)
    springs = {"kind": "small_on_large", "stiffness": k2 / 6.0, "stretch": 1.0}
    scene = scene.replace(springs={"kind": "none"} if k2 == 0.0 else springs)
    found = evaluate(
        scene, excitation=form.excitation, channel=form.channel, criterion=form.criterion
    )
    keys = ("actual_peak", "actual", "peak_at_formula", "peak", "closed")
    key = next(key for key in keys if key in expected)
    bound = 1e-6 if golden == "maxstab" else 1e-9
    assert found.value == pytest.approx(expected[key], rel=bound)


@pytest.mark.parametrize(
    "name", [name for name, form in CLOSED_FORMS.items() if not form.value.startswith("amplitude")]
)
@pytest.mark.parametrize("ratio", [0.01, 0.1, 0.4, 1.0])
def test_numerical_optimum_is_the_closed_form(name, ratio):
    form, expected = CLOSED_FORMS[name], closed_form(name, ratio)
    scene = rig(ratio)
    if name.startswith("lanchester"):
        scene = scene.replace(springs={"kind": "none"})
    found = tune(
        scene, excitation=form.excitation, channel=form.channel, criterion=form.criterion
    ).free
    assert found.frequency_ratio == pytest.approx(expected.frequency_ratio, rel=1e-6, abs=1e-6)
    assert found.damping_ratio == pytest.approx(expected.damping_ratio, rel=1e-6)
    # At a double pair the abscissa is as flat as a root: 1e-10 of the unknowns is 1e-5 of a root.
    bound = 1e-8 if name == "maximum_stability" else 1e-12
    assert found.value == pytest.approx(expected.value, rel=bound)


@pytest.mark.parametrize("name", ["nishihara_asami", "h2_force_displacement"])
def test_numerical_optimum_of_a_sphere_much_heavier_than_the_carriage(name):
    form, expected = CLOSED_FORMS[name], closed_form(name, 100.0)
    goal = {"channel": form.channel, "criterion": form.criterion}
    found = tune(rig(100.0), excitation=form.excitation, **goal).free
    assert found.ends() == []
    assert found.frequency_ratio == pytest.approx(expected.frequency_ratio, rel=1e-6)
    assert found.value == pytest.approx(expected.value, rel=1e-9)


@pytest.mark.parametrize("ratio", [1e-9, 1e-5, 1e3, 1e6])
def test_nishihara_and_asami_keep_their_digits_at_the_extremes(ratio):
    mpmath = pytest.importorskip("mpmath")
    with mpmath.workdps(60):
        mu = mpmath.mpf(ratio)
        q = mpmath.sqrt(4 + 3 * mu)
        cubes = (8 + 9 * mu) ** 2 * (16 + 9 * mu) - 128 * q**3
        value = mpmath.sqrt(cubes / (3 * (32 + 27 * mu))) / (3 * mu)
        zeta = mpmath.sqrt((8 + 9 * mu - 4 * q) / (1 + mu)) / 4
        found = closed_form("nishihara_asami", ratio)
        assert abs(found.value / value - 1) <= 1e-14
        assert abs(found.damping_ratio / zeta - 1) <= 1e-14


@pytest.mark.parametrize("name", ["maximum_stability", "lanchester_stability"])
def test_slowest_decay_is_that_of_a_pair_for_mass_ratios_below_4_and_refused_above(name):
    ratio = 3.99
    optimum = closed_form(name, ratio)
    c, k2 = optimum.damping(ratio, 1.0), optimum.stiffness(ratio, 1.0)
    slowest = np.roots(
        np.trim_zeros([ratio, c * (1.0 + ratio), k2 + ratio * (1.0 + k2), c, k2], "b")
    )
    assert slowest.real.max() == pytest.approx(optimum.value, rel=1e-6)
    for above in (4.0, 5.0):
        with pytest.raises(DesignError, match="below 4"):
            closed_form(name, above)


def test_wrong_names_and_mass_ratios_are_refused():
    with pytest.raises(DesignError, match="did you mean 'den_hartog'"):
        closed_form("den_hartogg", 0.1)
    with pytest.raises(DesignError, match=r"closed form: got array"):
        closed_form(np.array(["krenk", "krenk"]), 0.1)
    for ratio in (0.0, -1.0, np.nan, np.inf, None, "0.1", [0.1, 0.2]):
        with pytest.raises(DesignError, match=r"mass ratio: got .*greater than 0"):
            closed_form("den_hartog", ratio)
    with pytest.raises(DesignError, match="below 2"):
        closed_form("h2_ground_displacement", 2.5)


@pytest.mark.parametrize("wrong", [0.0, -1.0, np.nan, "1", True])
def test_absorber_refuses_a_mass_and_a_frequency_that_are_none(wrong):
    absorber = closed_form("h2_ground_displacement", 0.05)
    for of in (absorber.stiffness, absorber.damping):
        with pytest.raises(DesignError, match=r"m2: got .*; allowed: .* greater than 0"):
            of(wrong, 10.0)
        with pytest.raises(DesignError, match=r"w1: got .*; allowed: .* greater than 0"):
            of(0.01, wrong)
