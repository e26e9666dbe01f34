"""Is dry friction tuned to the least peak of the motion that is simulated?"""

import json
from pathlib import Path

import numpy as np
import pytest
from tuning.conftest import rig

from mm_gym import load_scene
from mm_gym.__main__ import main
from mm_gym.scene.mechanics import GRAVITY
from mm_gym.tuning import DesignError, friction_absorber, lanchester_friction
from mm_gym.tuning.friction import FrictionProblem, _problem, equivalent_damping, friction_of

GOLDEN = json.loads(
    (Path(__file__).parents[1] / "golden" / "friction_absorber.json").read_text("utf-8")
)
"""Peaks under a force of 1 N, by a Runge and Kutta of its own."""

MU2, RATIO = 0.25, 0.05
FRICTION = {
    "kind": "dry_friction",
    "static_coefficient": MU2,
    "kinetic_coefficient": MU2,
    "reference_velocity": 1e-3,
}
SPRUNG = rig(RATIO).replace(interface=FRICTION)
FREE = SPRUNG.replace(springs={"kind": "none"})


def problem(scene):
    return FrictionProblem(scene, "force", 1.0, "carriage_displacement")


@pytest.fixture(scope="module")
def free():
    return friction_absorber(FREE, amplitude=1.0)


def test_friction_takes_the_energy_of_its_equivalent_damping():
    for slip_damping in (0.0, 0.7):
        law = SPRUNG.interface.model_copy(
            update={"slip_damping": slip_damping, "static_coefficient": 0.4}
        )
        friction = friction_of(law, 3.0)
        angles = (np.arange(200_000) + 0.5) * 2.0 * np.pi / 200_000
        for speed in (3e-4, 1.5e-3, 0.2):
            w = speed * np.sin(angles)
            slip = np.sign(w) * (friction.kinetic + slip_damping * (np.abs(w) - 1e-3))
            force = np.where(np.abs(w) <= 1e-3, friction.stick * w, slip)
            # The mean power of c w is c speed^2 / 2; the sum's error is a jump over its points.
            found = equivalent_damping(friction, np.array([speed]))[0]
            assert found == pytest.approx(2.0 * np.mean(force * w) / speed**2, rel=1e-4)


@pytest.mark.parametrize("ratio", [-1.0, 0.0, np.nan, np.inf, 0.62, 2.0])
def test_lanchesters_friction_needs_a_mass_ratio(ratio):
    with pytest.raises(DesignError, match=r"^mass_ratio: got .*; allowed: "):
        lanchester_friction(ratio)


@pytest.mark.parametrize("ratio", [0.3, 0.61, 0.64, 1.0])
def test_lanchesters_friction_is_best_up_to_the_golden_ratio(ratio):
    # The first harmonic in closed form: friction of amplitude R, in phase with the slip velocity,
    # on a carriage of mass and stiffness 1. Where sticking takes less, the sphere sticks.
    w2 = np.geomspace(0.05, 5.0, 40_001)
    h = (1.0 - w2) / (ratio * w2)

    def peak(force):
        r = 4.0 / np.pi * force
        slip = np.sqrt(np.maximum(1.0 + r * r * (2.0 * h - 1.0), 0.0)) / np.abs(1.0 - w2)
        stick = 1.0 / np.abs(1.0 - (1.0 + ratio) * w2)
        return np.where(r * np.abs(1.0 - h) <= 1.0, slip, stick).max()

    force = 0.5 * np.pi / np.sqrt(2.0 + ratio)
    is_best = peak(force) == pytest.approx((2.0 + ratio) / ratio, rel=1e-4)
    assert is_best == (min(map(peak, force * np.linspace(0.8, 0.99, 20))) > 0.9999 * peak(force))
    if is_best:
        assert lanchester_friction(ratio) == pytest.approx(force)
    else:
        with pytest.raises(DesignError, match="mass_ratio"):
            lanchester_friction(ratio)


@pytest.mark.parametrize("ratio", [0.03, 0.1, 0.5])
def test_first_harmonic_without_springs_has_lanchesters_peak(ratio):
    scene = rig(ratio).replace(interface=FRICTION, springs={"kind": "none"})
    scene = scene.replace(**{"interface.reference_velocity": 1e-6})
    own = problem(scene)
    best = own.first(None)
    # The peak is flat about the best force, and seen at frequencies 0.09 % apart.
    assert best[0] * MU2 == pytest.approx(lanchester_friction(ratio), rel=0.03)
    peak = own._first_harmonic(*best, np.linspace(80.0, 105.0, 4001)).max()
    assert peak * 1e4 == pytest.approx((2.0 + ratio) / ratio, rel=2e-3)


@pytest.mark.parametrize("ratio", [10.0, 50.0])
def test_first_harmonic_of_a_heavy_sphere_has_the_peak_at_which_it_begins_to_slip(ratio):
    scene = rig(ratio).replace(interface=FRICTION, springs={"kind": "none"})
    own = problem(scene.replace(**{"interface.reference_velocity": 1e-6}))
    normal, k2 = own.first(None)
    # Less than pi / 4 of the force bounds no motion at w1; more has a higher peak.
    assert normal * MU2 == pytest.approx(0.25 * np.pi, rel=0.01)
    peak = own._first_harmonic(normal, k2, own.looked_at).max()
    assert peak * 1e4 == pytest.approx(2.0 + 1.0 / ratio, rel=0.02)


def test_peak_that_the_first_harmonic_does_not_tell_is_seen():
    scene = rig(10.0).replace(interface=FRICTION, springs={"kind": "none"})
    frequency, peak = problem(scene)._highest(0.788 / MU2, 0.0, ())
    # SciPy's LSODA in 200 periods from rest: 3.655e-4 at 98.5 rad/s; the first harmonic has 1.9e-4.
    assert peak > 3.6e-4
    assert frequency == pytest.approx(100.0, rel=0.03)


def test_peaks_are_those_of_another_integration():
    # Steps of a 1200th of a period, from rest; they differ most where the sphere begins to slip.
    k = len(GOLDEN["springs"]["friction"]) // 2
    own = problem(SPRUNG)
    for i, j in ((k, k), (k, k + 1), (k + 1, k)):
        force, k2 = GOLDEN["springs"]["friction"][i], GOLDEN["springs"]["stiffness"][j]
        _, peak = own._highest(force / MU2, k2, ())
        assert peak == pytest.approx(GOLDEN["springs"]["peak"][i][j], rel=2e-3)


def test_friction_without_springs_is_the_best_of_another_integration(free):
    forces, peaks = GOLDEN["none"]["friction"], GOLDEN["none"]["peak"]
    k = int(np.argmin(peaks))
    assert abs(free.after.friction_force - forces[k]) <= forces[k + 1] - forces[k]
    assert free.after.peak == pytest.approx(peaks[k], rel=5e-3)
    # Beyond the first harmonic the best force is still Lanchester's.
    assert free.after.friction_force == pytest.approx(lanchester_friction(RATIO), rel=0.05)


def test_friction_and_stiffness_are_the_best_of_another_integration():
    found = friction_absorber(SPRUNG, amplitude=1.0)
    golden = GOLDEN["springs"]
    peaks = np.array(golden["peak"])
    i, j = np.unravel_index(np.argmin(peaks), peaks.shape)
    for value, grid, k in (
        (found.after.friction_force, golden["friction"], i),
        (found.after.stiffness, golden["stiffness"], j),
    ):
        assert abs(value - grid[k]) <= grid[1] - grid[0]
    assert 0.98 * peaks.min() <= found.after.peak <= 1.002 * peaks.min()
    assert found.out_of_reach is None
    # Equal peaks: the curve is as high on both sides of the valley.
    middle = len(found.frequencies) // 2
    low, high = found.after.curve[:middle].max(), found.after.curve[middle:].max()
    assert low == pytest.approx(high, rel=0.02)


def test_motion_is_in_proportion_to_force_friction_and_reference_velocity():
    scaled = FREE.replace(**{"interface.reference_velocity": 0.1})
    large = FrictionProblem(scaled, "force", 100.0, "carriage_displacement")
    frequencies = np.array([90.0, 98.9, 102.0])
    small = problem(FREE)._steady(4.4, 0.0, frequencies)
    np.testing.assert_allclose(large._steady(440.0, 0.0, frequencies), 100.0 * small, rtol=1e-9)


def test_numbers_that_are_drawn_have_the_middle_of_their_range():
    ranges = {
        "carriage.stiffness": [2e4, 3e4],
        "springs.stiffness": [100.0, 140.0],
        "interface.kinetic_ratio": [0.5, 0.7],
        "excitation.0.amplitude": [3.0, 5.0],
    }
    middle = {
        "carriage.stiffness": 2.5e4,
        "springs.stiffness": 120.0,
        "interface.kinetic_coefficient": 0.6 * MU2,
    }
    harmonic = {"kind": "harmonic", "amplitude": 1.0, "frequency": 100.0}
    drawn = _problem(
        SPRUNG.replace(excitation=[harmonic], randomization=ranges),
        *(None, "force", "carriage_displacement"),
    )
    assert drawn.amplitude == 4.0
    one, other = drawn.scene, problem(SPRUNG.replace(**middle)).scene
    assert one == other.replace(**{"excitation.0.amplitude": 4.0})


def test_command_tunes_friction_and_draws_it(free, tmp_path, capsys, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr("mm_gym.tuning.friction_absorber", lambda *_, **__: free)
    name = "mm_gym/CarriageForceFriction-v0"
    assert main(["tune", name, "--amplitude", "1", "--out", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    assert "under a harmonic of 1 N on the carriage" in out
    assert f"{free.after.normal_force:.5g}" in out
    tuned = load_scene(tmp_path / "out" / "tuned.toml")
    assert tuned.interface.normal_force == free.after.normal_force
    assert (tmp_path / "out" / "response.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["mm_gym/CarriageForceFriction-v0"], "amplitude: missing"),
        (["mm_gym/CarriageForceFriction-v0", "--amplitude", "nan"], "amplitude: got nan"),
        (["mm_gym/CarriageForceFriction-v0", "--criterion", "h2"], "--criterion: got 'h2'"),
        (["mm_gym/PreStretch-v0", "--amplitude", "1"], "--amplitude: no effect"),
    ],
)
def test_command_refuses_what_has_no_meaning(arguments, message, capsys):
    assert main(["tune", *arguments]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("scene", "options", "message"),
    [
        (rig(0.1), {}, "interface.kind: got 'viscous'"),
        (FREE, {"excitation": "grnd"}, "did you mean 'ground'"),
        (FREE, {"channel": "carriage_acceleration"}, "channel: got 'carriage_acceleration'"),
        (FREE, {"amplitude": 0.0}, "amplitude: got 0"),
        (FREE, {"amplitude": "1"}, "amplitude: got '1'"),
        (FREE, {"amplitude": True}, "amplitude: got True"),
        (FREE.replace(**{"carriage.mass": 0.0}), {}, r"carriage\.mass: got 0"),
        (
            FREE.replace(
                **{"interface.normal_force": 1.0},
                randomization={"interface.normal_force": [0.1, 0.2]},
            ),
            {},
            r"randomization\.interface\.normal_force",
        ),
    ],
)
def test_what_cannot_be_tuned_is_refused_with_the_reason(scene, options, message):
    with pytest.raises(DesignError, match=message):
        friction_absorber(scene, **({"amplitude": 1.0} | options))


def test_own_design_has_the_middle_of_a_drawn_mass(monkeypatch):
    # Without a stated normal force it is the weight; the simulated search is left out.
    monkeypatch.setattr(FrictionProblem, "improved", lambda _, start, __: start)
    m2 = FREE.sphere.mass
    drawn = FREE.replace(
        **{"interface.normal_force": None}, randomization={"sphere.mass": [2.0 * m2, 4.0 * m2]}
    )
    found = friction_absorber(drawn, amplitude=1.0)
    assert found.before.normal_force == pytest.approx(3.0 * m2 * GRAVITY, rel=1e-12)


def test_unreachable_stiffness_is_told_with_the_best_in_reach(monkeypatch):
    # Springs of k0 have at most 6 k0; the simulated search is left out.
    monkeypatch.setattr(FrictionProblem, "improved", lambda _, start, __: start)
    found = friction_absorber(SPRUNG.replace(**{"springs.stiffness": 20.0}), amplitude=1.0)
    assert "with springs.stiffness = 20 N/m" in found.out_of_reach
    assert found.out_of_reach in found.table()
    assert found.after.stiffness == pytest.approx(120.0, rel=1e-3)
    assert found.tuned.springs.stretch == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("actuation", [{}, {"stretch": {"minimum": 1.0, "maximum": 2.0}}])
def test_springs_too_stiff_for_the_optimum_have_their_longest_stretch(actuation, monkeypatch):
    # Springs of k0 have more than 2 k0; the first harmonic stands for the simulated search.
    def improved(own, start, limits):
        return own._minimum(own._rough, np.log(start), limits, 0.05)

    monkeypatch.setattr(FrictionProblem, "improved", improved)
    scene = SPRUNG.replace(**{"springs.stiffness": 600.0, "actuation": actuation})
    found = friction_absorber(scene, amplitude=1.0)
    assert "with springs.stiffness = 600 N/m" in found.out_of_reach
    assert found.out_of_reach in found.table()
    least = 1500.0 if actuation else 1200.0
    assert found.after.stiffness == pytest.approx(least, rel=1e-9)
    assert np.isfinite(found.stretch)
    assert np.isfinite(found.after.peak)
    assert found.tuned.range_of("springs.stretch", found.stretch) == found.stretch
