"""Are response spectra those of an oscillator that is integrated otherwise, and of closed forms?"""

import csv
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.signal import lfilter, lsim

from mm_gym import SceneError
from mm_gym.__main__ import main
from mm_gym.analysis import response_spectrum
from mm_gym.records import Record

FINE = 1e-3  # step of the reference, times w
COARSE = 2e-3  # the same of the recursive filters

NAMES = ("displacement", "pseudo_velocity", "pseudo_acceleration", "absolute_acceleration")


def record_of(times, values):
    times = np.array(times, float)
    return Record(times, np.array(values, float), float(np.min(np.diff(times))))


def reference(record, period, damping):
    """Return max |x| and max |absolute acceleration|, by SciPy's exact response to lines."""
    w = 2.0 * np.pi / period
    A = [[0.0, 1.0], [-w * w, -2.0 * damping * w]]
    C = [[1.0, 0.0], [-w * w, -2.0 * damping * w]]
    system = (np.array(A), np.array([[0.0], [-1.0]]), np.array(C), np.zeros((2, 1)))
    state, most = np.zeros(2), np.zeros(2)
    after = record.times[-1] + 1.2 * period
    corners = [
        *zip(record.times, record.values, strict=True),
        (record.times[-1], 0.0),
        (after, 0.0),
    ]
    for (t0, a0), (t1, a1) in pairwise(corners):
        if t1 > t0:
            count = max(2, int(np.ceil(w * (t1 - t0) / FINE)) + 1)
            _, outputs, states = lsim(
                system, np.linspace(a0, a1, count), np.linspace(0.0, t1 - t0, count), state
            )
            most = np.maximum(most, [vertex(np.abs(column)) for column in outputs.T])
            state = states[-1]
    return most


def vertex(values):
    """Return the largest value of the parabola about the largest of evenly spaced values."""
    k = int(np.argmax(values))
    if not 0 < k < len(values) - 1:
        return values[k]
    before, top, after = values[k - 1 : k + 2]
    return top - (before - after) ** 2 / (8.0 * (before - 2.0 * top + after))


RNG = np.random.default_rng(5)
EVEN = record_of(0.02 * np.arange(30), RNG.normal(size=30))
UNEVEN = record_of(0.3 + np.cumsum(RNG.uniform(0.002, 0.05, 30)), RNG.normal(size=30))


@pytest.mark.parametrize("record", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("damping", [0.0, 0.02, 0.2, 0.999, 1.0, 3.0])
def test_spectra_are_those_of_scipy(record, damping):
    periods = [0.06, 0.47, 3.0]
    spectrum = response_spectrum(record, periods, damping)
    for k, period in enumerate(periods):
        displacement, acceleration = reference(record, period, damping)
        w = 2.0 * np.pi / period
        # A parabola through three points misses the peak by about FINE^3 of it; round-off of the
        # reference's many steps adds to it. The faster mode is six times as fast with damping 3.
        tolerance = 2e-8 if damping <= 1.0 else (6.0 * FINE) ** 3
        own = [spectrum.displacement[0, k], spectrum.absolute_acceleration[0, k]]
        np.testing.assert_allclose(own, [displacement, acceleration], rtol=tolerance)
        assert spectrum.pseudo_velocity[0, k] == pytest.approx(w * own[0], rel=1e-15)
        assert spectrum.pseudo_acceleration[0, k] == pytest.approx(w * w * own[0], rel=1e-15)


def by_modes(record, period, damping):
    """Return what `reference` does of an even record that begins with 0, by its two modes.

    Each follows z' = r z - a by a recursive filter, exact for lines, in steps of up to COARSE / w.
    The faster mode of a damping of 3 turns by 6 COARSE: a parabola through three points misses a
    peak by less than (6 COARSE)^3 / 5 = 3e-7 of it. Across a corner it misses more, so a
    step is at most a 50th of the spacing.
    """
    w = 2.0 * np.pi / period
    parts = max(50, int(np.ceil(w * record.time_step / COARSE)))
    places = np.arange((len(record.values) - 1) * parts + 1) / parts
    ground = np.interp(places, np.arange(len(record.values)), record.values)
    step = record.time_step / parts
    after = np.arange(0.0, 1.2 * 2.0 * np.pi, COARSE) / w
    turn = np.sqrt(complex(damping**2 - 1.0))
    roots, modes = [w * (-damping + turn), w * (-damping - turn)], []
    for root in roots:
        line = np.array([[root, -1.0, 0.0], [0.0, 0.0, 1.0 / step], [0.0, 0.0, 0.0]])
        decay, held, ramp = expm(line * step)[0]
        forced = lfilter([ramp, held - ramp], [1.0, -decay], ground.astype(complex))
        modes.append((forced, forced[-1] * np.exp(root * after)))
    most = np.zeros(2)
    for one, other in zip(*modes, strict=True):
        x = ((one - other) / (roots[0] - roots[1])).real
        v = ((roots[0] * one - roots[1] * other) / (roots[0] - roots[1])).real
        acceleration = -w * w * x - 2.0 * damping * w * v
        most = np.maximum(most, [vertex(np.abs(x)), vertex(np.abs(acceleration))])
    return most


@pytest.mark.parametrize("damping", [0.0, 0.02, 0.7, 3.0])
@pytest.mark.parametrize("period", [0.0005, 0.004, 0.02, 0.3, 10.0, 200.0])
def test_periods_far_from_the_spacing_of_samples(period, damping):
    # From a fortieth of the spacing of 0.02 s to ten thousand times as long.
    record = record_of(EVEN.times[:8], [0.0, *EVEN.values[1:8]])
    spectrum = response_spectrum(record, period, damping)
    displacement, acceleration = by_modes(record, period, damping)
    w = 2.0 * np.pi / period
    found = [getattr(spectrum, name)[0, 0] for name in NAMES]
    expected = [displacement, w * displacement, w * w * displacement, acceleration]
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("damping", [0.0, 0.01, 0.05, 0.3, 0.9])
def test_step_overshoots_as_the_textbook_says(damping):
    spectrum = response_spectrum(record_of([1.0, 101.0], [-2.0, -2.0]), [0.7, 5.0], damping)
    over = np.exp(-damping * np.pi / np.sqrt(1.0 - damping**2))
    # Undamped, the largest of 140 peaks has the round-off of the 7000 steps to it.
    np.testing.assert_allclose(spectrum.pseudo_acceleration, 2.0 * (1.0 + over), rtol=2e-12)
    assert spectrum.peak_acceleration == 2.0


@pytest.mark.parametrize("ratio", [0.1, 0.3, 0.49, 0.8, 2.3])
def test_pulse_is_answered_behind_its_end_too(ratio):
    # A rectangle of length ratio T without damping: 2 |sin(pi ratio)| behind it, 2 within if
    # ratio > 1/2.
    record = record_of([0.0, 0.5], [1.0, 1.0])
    spectrum = response_spectrum(record, 0.5 / ratio, 0.0)
    expected = 2.0 if ratio > 0.5 else 2.0 * np.sin(np.pi * ratio)
    assert spectrum.pseudo_acceleration[0, 0] == pytest.approx(expected, rel=1e-13)
    assert spectrum.absolute_acceleration[0, 0] == pytest.approx(expected, rel=1e-13)


def test_harmonic_at_resonance_builds_up_to_its_closed_form():
    # x'' + 2 z w x' + w^2 x = -sin(w t) from rest: after many periods the amplitude is
    # 1 / (2 z w^2), less exp(-z w t).
    z, w = 0.05, 2.0 * np.pi
    times = np.linspace(0.0, 60.0, 60 * 4000 + 1)
    spectrum = response_spectrum(record_of(times, np.sin(w * times)), 2.0 * np.pi / w, z)
    # Lines between 4000 samples a period are lower by (2 pi / 4000)^2 / 12 = 2e-7;
    # exp(-0.05 * 2 pi * 60) = 7e-9.
    assert spectrum.pseudo_acceleration[0, 0] == pytest.approx(1.0 / (2.0 * z), rel=5e-7)


@pytest.mark.parametrize("damping", [0.0, 0.05])
def test_duhamels_integral_is_met_in_long_periods(damping):
    # The closed form of the recurrence cancels there; the integral does not.
    period, record = 200.0, record_of([0.0, 0.005, 0.01, 0.02], [0.0, 1.0, -0.5, 0.25])
    w = 2.0 * np.pi / period
    wd = w * np.sqrt(1.0 - damping**2)

    def x(time):
        def response(s):
            decay = np.exp(-damping * w * (time - s)) * np.sin(wd * (time - s))
            return -np.interp(s, record.times, record.values) * decay / wd

        return quad(response, 0.0, 0.02, points=record.times, epsabs=0.0, epsrel=1e-13)[0]

    # The peak comes about a quarter of a period behind the record: of a free oscillation.
    peak = np.arctan2(np.sqrt(1.0 - damping**2), damping) / wd
    instants = peak + np.linspace(-0.02, 0.04, 61)
    own = response_spectrum(record, period, damping).displacement[0, 0]
    # Between instants 1 ms apart a peak is missed by (w dt)^2 / 8 = 1e-10 of it.
    assert own == pytest.approx(max(abs(x(time)) for time in instants), rel=3e-10)


def test_short_periods_follow_the_ground():
    spectrum = response_spectrum(record_of(0.5 * np.arange(5), [0, 1, -3, 2, 0]), 1e-3, [0.05, 0.7])
    np.testing.assert_allclose(spectrum.absolute_acceleration, 3.0, rtol=2e-3)
    assert spectrum.peak_acceleration == 3.0


@pytest.mark.parametrize(
    ("periods", "damping", "words"),
    [
        ([0.1, 0.0], 0.05, "periods: got 0; allowed: greater than 0 s"),
        ([0.1, -1.0], 0.05, "periods: got -1; allowed: greater than 0 s"),
        ([np.nan], 0.05, "periods: got NaN or infinity; allowed: finite numbers"),
        (["a"], 0.05, "periods: got type <U1"),
        ([], 0.05, "periods: got shape"),
        (1e-12, 0.05, "periods: got down to 1e-12 s of a record of 0.58 s"),
        (1.0, -0.01, "damping: got -0.01; allowed: a ratio from 0 to 10"),
        (1.0, [0.05, 11.0], "damping: got 11; allowed: a ratio from 0 to 10"),
        (1.0, [[0.05]], "damping: got shape"),
    ],
)
def test_periods_and_damping_ratios_are_checked(periods, damping, words):
    with pytest.raises(SceneError) as caught:
        response_spectrum(EVEN, periods, damping)
    assert words in str(caught.value)


@pytest.mark.parametrize("wrong", [None, "el_centro.at2", np.zeros((9, 2))])
def test_what_is_no_record_is_named(wrong):
    with pytest.raises(SceneError, match=r"^record: got .*allowed: a Record, as read_record"):
        response_spectrum(wrong)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "motion.csv"
    rows = [f"{t:.2f};{v:.6f};x" for t, v in zip(EVEN.times, EVEN.values, strict=True)]
    path.write_text("\n".join(["t;a;note", *rows]))
    return path


def test_command_prints_writes_and_draws(file, tmp_path, capsys):
    table, figure = tmp_path / "s.csv", tmp_path / "s.png"
    options = ["--unit", "g", "--column", "a", "--periods", "0.1", "1", "--damping", "0.02", "0.1"]
    outputs = ["--csv", str(table), "--plot", str(figure)]
    assert main(["spectrum", str(file), *options, *outputs]) == 0
    printed = capsys.readouterr().out
    rows = list(csv.DictReader(table.read_text().splitlines()))
    expected = response_spectrum(EVEN, [0.1, 1.0], [0.02, 0.1])
    assert [float(row["damping"]) for row in rows] == [0.02, 0.02, 0.1, 0.1]
    # The file has 6 decimals of values of about 1.
    for name, unit in (("displacement", "m"), ("absolute_acceleration", "m/s^2")):
        written = [float(row[f"{name} [{unit}]"]) for row in rows]
        np.testing.assert_allclose(written, 9.80665 * getattr(expected, name).ravel(), rtol=1e-4)
        assert f"{written[0]:.6g}" in printed
    assert figure.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--unit", "g"], "got 3 columns (t, a, note); allowed: one, or two"),
        (["--column", "2"], "unit: missing"),
        (["--unit", "g", "--column", "b"], "column: got 'b'; "),
        (["--unit", "N", "--column", "2"], "--unit: got 'N'; allowed: m/s^2, "),
        (["--unit", "g", "--column", "2", "--periods", "0"], "periods: got 0"),
        (["--unit", "g", "--column", "2", "--csv", "motion.csv"], "it is an input of this command"),
    ],
)
def test_command_refuses_what_it_cannot_do(file, capsys, monkeypatch, options, words):
    monkeypatch.chdir(file.parent)
    assert main(["spectrum", "motion.csv", *options]) == 2
    assert words in capsys.readouterr().err
