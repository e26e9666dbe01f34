"""Are recorded motions read correctly, or refused with the line of the error?"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mm_gym import Scene, SceneError, compile_scene, simulate
from mm_gym.records import (
    ACCELERATION_UNITS,
    FORCE_UNITS,
    LARGEST,
    UNITS,
    read_record,
    resample,
)
from mm_gym.records.text import BLOCK, MOST_BYTES
from mm_gym.scene.excitation import Recorded

from .files import COUNTS, GOOD, QUANTITY, SAMPLES, TITLE, peer, read

G = 9.80665


@pytest.mark.parametrize("counts", COUNTS)
@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_peer_header_is_read_in_all_its_forms(tmp_path, counts, newline):
    record = read(tmp_path, peer(SAMPLES, counts=counts, newline=newline))
    assert record.time_step == 0.005
    assert np.array_equal(record.values, np.array(SAMPLES) * G)
    assert np.array_equal(record.times, 0.005 * np.arange(7))


@pytest.mark.parametrize(
    ("form", "columns"),
    [("{:15.7E}", 5), ("{:16.7e}", 8), ("{:+.7E}", 7), ("{:.7f},", 3), ("{:.7E} ", 1)],
)
def test_peer_samples_are_read_from_any_columns(tmp_path, form, columns):
    record = read(tmp_path, peer(SAMPLES, form=form, columns=columns))
    assert np.array_equal(record.values, np.array(SAMPLES) * G)


def test_numbers_are_read_as_fortran_writes_them(tmp_path):
    rows = "-.1234E-02-.3456E-03 .5D-1\n1.d+0 -2.E0+3. -.0"
    content = "\n".join([*TITLE, QUANTITY, "NPTS= 7, DT= .5D-2 SEC", rows, ""])
    record = read(tmp_path, content)
    assert record.values.tolist() == [x * G for x in (-0.001234, -3.456e-4, 0.05, 1, -2, 3, -0.0)]
    assert record.time_step == 0.005


def test_content_tells_the_format_if_the_name_does_not(tmp_path):
    assert len(read(tmp_path, peer(SAMPLES), "motion.txt").values) == 7


def test_letters_beyond_ascii_in_a_station_name_are_accepted(tmp_path):
    content = peer(SAMPLES).encode().replace(b"El Centro", "Düzce".encode("latin-1"))
    assert len(read(tmp_path, content).values) == 7


@pytest.mark.parametrize("mark", [",", ";", ", ", "\t", "  ", " ; "])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("start", ["", "\ufeff", "time [s],a\n", "# 3 4 5\n\nt\na\n"])
def test_columns_of_time_and_sample_are_read(tmp_path, mark, newline, start):
    lines = [f"0.0{mark}1.5", "", f"0.01{mark}-2.5e-1  # peak", f"0.03{mark}.5", "# end"]
    content = start.replace("\n", newline) + newline.join(lines)
    record = read(tmp_path, content, "motion.csv", unit="m/s^2")
    assert record.times.tolist() == [0.0, 0.01, 0.03]
    assert record.values.tolist() == [1.5, -0.25, 0.5]
    assert record.time_step == 0.01


def test_one_column_is_read_with_a_time_step(tmp_path):
    record = read(tmp_path, "acc\n1\n2\n-3\n", "motion.csv", unit="kN", time_step=0.02)
    assert record.times.tolist() == [0.0, 0.02, 0.04]
    assert record.values.tolist() == [1000.0, 2000.0, -3000.0]


@pytest.mark.parametrize("unit", UNITS)
def test_samples_are_converted_from_every_unit(tmp_path, unit):
    record = read(tmp_path, "0 1\n1 2\n", "motion.csv", unit=unit)
    assert record.values.tolist() == [UNITS[unit], 2.0 * UNITS[unit]]


def test_units_agree_with_one_another():
    assert ACCELERATION_UNITS["ft/s^2"] == pytest.approx(12.0 * ACCELERATION_UNITS["in/s^2"])
    assert ACCELERATION_UNITS["g"] / ACCELERATION_UNITS["gal"] == pytest.approx(980.665)


def test_record_cannot_be_changed(tmp_path):
    record = read(tmp_path, peer(SAMPLES))
    with pytest.raises(ValueError, match="read-only"):
        record.values[0] = 1.0


HEAD = "\n".join([*TITLE, QUANTITY])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            GOOD.replace("NPTS=      7", "NPTS= 8"),
            ":6: got 7 samples; line 4 promises 8",
        ),
        (
            GOOD.replace("NPTS=      7", "NPTS= 6"),
            ":6: got 7 samples; line 4 promises 6",
        ),
        (GOOD + "\n\n0.5\n\n", ":9: got 8 samples; line 4 promises 7"),
        (GOOD.replace("NPTS=      7", "NPTS= -7"), ":4: NPTS: got '-7'; allowed: an integer"),
        (GOOD.replace("NPTS=      7", "NPTS= seven"), ":4: NPTS: got 'seven'; allowed: an integer"),
        (GOOD.replace("NPTS=      7", "NPTS= 7.5"), ":4: NPTS: got '7.5'; allowed: an integer"),
        (GOOD.replace("NPTS=      7,", "NPTS"), ":4: NPTS is missing; allowed: NPTS= (number"),
        (GOOD.replace("NPTS=      7,", ""), ":4: NPTS is missing; allowed: NPTS= (number"),
        (GOOD.replace("DT=.0050 SEC", ""), ":4: DT is missing; allowed: NPTS= (number of samples)"),
        (GOOD.replace("DT=.0050", "DT="), ":4: DT: got 'SEC'; allowed: a number from 1e-09 to"),
        (GOOD.replace("DT=.0050", "DT=0.00"), ":4: DT: got '0.00'; allowed: a number from 1e-09"),
        (GOOD.replace("DT=.0050", "DT=-.005"), ":4: DT: got '-.005'; allowed: a number from 1e-09"),
        (GOOD.replace("DT=.0050", "DT=nan"), ":4: DT: got 'nan'; allowed: a number from 1e-09 to"),
        (GOOD.replace(".0050 SEC", "5 MSEC"), ":4: DT: got the unit 'MSEC'; allowed: SEC"),
        (
            GOOD.replace("0.0000000E+00", "0.00x0000E+00"),
            ":6: column 1: got '0.00x0000E+00'; allowed: a num",
        ),
        (
            GOOD.replace("0.0000000E+00", "          nan"),
            ":6: column 1: got 'nan'; allowed: a number of mag",
        ),
        (
            GOOD.replace("0.0000000E+00", "     Infinity"),
            ":6: column 1: got 'Infinity'; allowed: a number ",
        ),
        (
            GOOD.replace("0.0000000E+00", "         1E99"),
            ":6: column 1: got '1E99'; allowed: a number of ma",
        ),
        (
            GOOD.replace("0.0000000E+00", "        1E999"),
            ":6: column 1: got '1E999'; allowed: a number of m",
        ),
        (
            GOOD.replace("0.0000000E+00", "    1_000.000"),
            ":6: column 1: got '1_000.000'; allowed: a number",
        ),
        (
            GOOD.replace("0.0000000E+00", "      1.5-105"),
            ":6: column 1: got '1.5-105'; allowed: a number of",
        ),
        (
            GOOD.replace("0.0000000E+00", "0.1E-010.2E-1"),
            ":6: column 1: got '0.1E-010.2E-1'; allowed: a num",
        ),
        (
            GOOD.replace("0.0000000E+00", "          \u0663.0"),
            ":6: column 1: got '\u0663.0'; allowed: a num",
        ),
        (
            GOOD.replace("0.0000000E+00", "          ***"),
            ":6: column 1: got '***'; allowed: a number of ma",
        ),
        (
            GOOD.replace("ACCELERATION", "VELOCITY"),
            ":3: the header states a velocity; allowed: an accelerat",
        ),
        (
            GOOD.replace("ACCELERATION", "DISPLACEMENT"),
            ":3: the header states a displacement; allowed: an a",
        ),
        (
            GOOD.replace("UNITS OF G", "UNITS OF CM/S/S"),
            ":3: the header states units of CM/S/S; got unit = 'g",
        ),
        (HEAD + "\n", ":4: the file ends within its header; allowed: 4 header lines, then samples"),
        (
            HEAD + "\nNPTS= 7, DT= .005 SEC",
            ":4: the file ends within its header; allowed: 4 header lines",
        ),
        (HEAD + "\nNPTS= 7, DT= .005 SEC\n", ":4: got 0 samples; line 4 promises 7"),
        (HEAD + "\nNPTS= 1, DT= .005 SEC\n.5", ": got one sample; allowed: at least two"),
        ("", ": the file is empty"),
        (" \r\n\t\n", ": the file is empty"),
        (b"\x00\x01\x02", r":1: got the character '\x00'; allowed: text"),
        (GOOD.encode("utf-16"), r"allowed: text"),
        (b"PEER\n\x7fELF", r":2: got the character '\x7f'; allowed: text"),
    ],
)
def test_peer_file_that_is_wrong_is_refused_on_its_line(tmp_path, content, words):
    with pytest.raises(SceneError) as caught:
        read(tmp_path, content)
    assert str(caught.value).startswith(str(tmp_path / "motion.at2"))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            "0 1\n0.1 2\n0.1 3\n",
            ":3: column 1: time: got 0.10000000000000001; allowed: at least 1e-09 s more",
        ),
        (
            "0 1\n\n# x\n0.2 2\n0.1 3\n",
            ":5: column 1: time: got 0.10000000000000001; allowed: at least",
        ),
        ("-1 1\n0 2\n", ":1: column 1: time: got -1; allowed: at least 0 s"),
        ("0 1\n1e-10 2\n", ":2: column 1: time: got "),
        ("t a\n0.0x 1\n1 2\n", ":2: column 1: got '0.0x'; allowed: a number"),
        ("nan nan\n1 2\n", ":1: column 1: got 'nan'; allowed: a number"),
        ("run 7\n0 1\n1 2\n", ":1: column 1: got 'run'; allowed: a number"),
        ("0,1\n1,2,\n", ":2: got 3 columns; allowed: 2 columns on every line"),
        ("0,1\n1\n", ":2: got 1 column; allowed: 2 columns on every line"),
        (
            "0,1,2\n1,2,3\n",
            ":1: got 3 columns; allowed: one, or two with the times first. Set column",
        ),
        ("0,1\n1;2\n", ":2: got 1 column; allowed"),
        ("0,1\n1\n2\n", ":2: got 1 column; allowed"),  # four cells, which would be two rows
        ("0,1\n1,2 3\n", ":2: column 2: got '2 3'; allowed: a number"),
        # As many numbers as cells, in the wrong places.
        ("0,1\n1,\n2 3,4\n", ":2: column 2: got ''; allowed: a number"),
        ("0;1.5\n1;2,5\n", ":2: column 2: got '2,5'; allowed: a number"),
        (
            "0;1,5\n1;2.5\n",
            ":2: column 2: got '2.5'; allowed: a number of magnitude at most 1e+12, with a",
        ),
        ("0;1\n1;1.234,5\n", ":2: column 2: got '1.234,5'; allowed: a number"),
        ("0,1\n1,0x10\n", ":2: column 2: got '0x10'; allowed: a number"),
        ("0,1\n1,-1-2.5\n", ":2: column 2: got '-1-2.5'; allowed: a number"),
        ("0,1\n1,1e13\n", ":2: column 2: got '1e13'; allowed: a number of magnitude at most 1e+12"),
        ("1\n2\n", ":1: a file with one column states no times; set time_step"),
        ("time, a\n# none\n", ": the file holds no samples"),
        ("0 1\n", ": got one sample; allowed: at least two"),
    ],
)
def test_columns_that_are_wrong_are_refused_on_their_line(tmp_path, content, words):
    with pytest.raises(SceneError) as caught:
        read(tmp_path, content, "motion.csv", unit="N")
    assert words in str(caught.value)


def test_options_are_checked(tmp_path):
    with pytest.raises(SceneError, match=r"unit: got 'm/s2'; did you mean 'm/s\^2'\?; allowed: "):
        read(tmp_path, GOOD, unit="m/s2")
    with pytest.raises(SceneError, match=r":3: the header states units of G; got unit = 'N'"):
        read(tmp_path, GOOD, unit="N")
    with pytest.raises(
        SceneError, match=r"PEER's format states NPTS and DT of one series, so time_step has no"
    ):
        read(tmp_path, GOOD, time_step=0.1)
    with pytest.raises(SceneError, match=r"the file states times, so time_step has no effect"):
        read(tmp_path, "0 1\n1 2\n", "motion.csv", time_step=0.1)
    with pytest.raises(SceneError, match=r"time_step: got nan; allowed: 1e-09 to"):
        read(tmp_path, "1\n2\n", "motion.csv", time_step=float("nan"))
    with pytest.raises(SceneError, match=r"time_step: got '0\.1'; allowed: 1e-09 to"):
        read(tmp_path, "1\n2\n", "motion.csv", time_step="0.1")
    with pytest.raises(SceneError, match=r"time_step: got True; allowed: 1e-09 to"):
        read(tmp_path, "1\n2\n", "motion.csv", time_step=True)


def test_file_that_cannot_be_read_is_refused(tmp_path):
    (tmp_path / "el_centro.at2").touch()
    with pytest.raises(SceneError, match=r"no such file; did you mean 'el_centro\.at2'\?"):
        read_record(tmp_path / "elcentro.at2", unit="g")
    (tmp_path / "x.at2").symlink_to(tmp_path / "nowhere")
    with pytest.raises(SceneError, match=r"x\.at2: no such file$"):
        read_record(tmp_path / "x.at2", unit="g")
    with pytest.raises(SceneError, match=r"^path: got None; allowed: the path of a file"):
        read_record(None)
    with pytest.raises(SceneError, match=r"no such file$"):
        read_record(tmp_path / "nowhere" / "x.at2", unit="g")
    with pytest.raises(SceneError, match=r"cannot be read: not a file"):
        read_record(tmp_path, unit="g")
    with pytest.raises(SceneError, match=r"cannot be read: not a file"):
        read_record("/dev/zero", unit="g")
    with pytest.raises(SceneError, match=r"cannot be read"):
        read_record("a\0b", unit="g")
    with (tmp_path / "large.csv").open("wb") as stream:
        stream.truncate(MOST_BYTES + 1)
    with pytest.raises(SceneError, match=r"bytes; allowed: at most"):
        read_record(tmp_path / "large.csv", unit="g")


finite = st.floats(-LARGEST, LARGEST, allow_subnormal=False)


@given(values=st.lists(finite, min_size=2, max_size=40), data=st.data())
def test_samples_written_are_read_back(tmp_path_factory, values, data):
    newline = data.draw(st.sampled_from(["\n", "\r\n"]))
    text = peer(
        values,
        counts=data.draw(st.sampled_from(COUNTS)),
        columns=data.draw(st.integers(1, 12)),
        form=f"{{:{data.draw(st.integers(26, 30))}.17E}}",
        newline=newline,
    )
    *head, body = text.split(newline, 4)
    letter = data.draw(st.sampled_from("EeDd"))
    text = newline.join([*head, body.replace("E", letter)])
    record = read(tmp_path_factory.mktemp("motion"), text)
    assert np.array_equal(record.values, np.array(values) * G)


@given(
    values=st.lists(st.tuples(st.floats(1e-8, 1e6), finite), min_size=2, max_size=40),
    mark=st.sampled_from([",", ";", " ", "\t"]),
)
def test_columns_written_are_read_back(tmp_path_factory, values, mark):
    times = np.cumsum([spacing for spacing, _ in values])
    samples = [sample for _, sample in values]
    lines = [f"{t!r}{mark}{x!r}" for t, x in zip(times.tolist(), samples, strict=True)]
    record = read(tmp_path_factory.mktemp("motion"), "\n".join(lines), "motion.csv", unit="N")
    assert np.array_equal(record.times, times)
    assert np.array_equal(record.values, samples)


def test_samples_on_the_grid_are_kept_to_the_last_bit(tmp_path):
    values = np.random.default_rng(1).normal(size=2000)
    record = read(tmp_path, peer(values, form="{:26.17E}", dt="0.005"))
    for parts in (1, 2, 3, 5, 7, 10):
        fine = resample(record, 0.005 / parts)
        assert len(fine) == 1999 * parts + 2
        assert np.array_equal(fine[:-1:parts], record.values)
        assert fine[-1] == 0.0
    assert np.array_equal(resample(record, 0.01)[:-1], record.values[::2])
    quick = resample(record, 0.001, scale=-2.0, time_scale=0.2)
    assert np.array_equal(quick[:-1], -2.0 * record.values)
    slow = resample(record, 0.01, time_scale=2.0)
    assert np.array_equal(slow[:-1], record.values)


def test_between_the_samples_the_motion_is_linear(tmp_path):
    record = read(tmp_path, "0.5 1\n1.0 3\n3.0 -1\n", "motion.csv", unit="N")
    assert resample(record, 0.25).tolist() == [
        *[0, 0, 1, 2],
        *[3, 2.5, 2, 1.5, 1, 0.5, 0, -0.5],
        *[-1, 0],
    ]
    # Zero before the file's first instant and after its last.
    assert resample(record, 2.0).tolist() == [0.0, 1.0, 0.0]
    assert resample(record, 10.0).tolist() == [0.0, 0.0]


def test_resampling_agrees_with_interpolation_anywhere(tmp_path):
    rng = np.random.default_rng(2)
    times, values = np.cumsum(rng.uniform(0.001, 0.1, 500)), rng.normal(size=500)
    lines = [f"{t!r} {x!r}" for t, x in zip(times.tolist(), values.tolist(), strict=True)]
    record = read(tmp_path, "\n".join(lines), "motion.csv", unit="N")
    samples = resample(record, 0.0137, scale=3.0, time_scale=1.7)
    grid = 0.0137 * np.arange(len(samples))
    expected = np.interp(grid, 1.7 * times, 3.0 * values, left=0.0, right=0.0)
    # Slopes of up to 6 / 0.0017 s, times the rounding of instants up to 43 s, give 2.5e-11.
    np.testing.assert_allclose(samples, expected, atol=2.5e-11, rtol=0.0)


def test_resampling_beyond_its_limits_is_refused(tmp_path):
    record = read(tmp_path, "0 1\n1 2\n", "motion.csv", unit="N")
    with pytest.raises(
        SceneError, match=r"the record lasts 1e\+08 steps of 1e-08 s; allowed: at most 1e"
    ):
        resample(record, 1e-8)
    with pytest.raises(SceneError, match="steps of 1 s; allowed"):
        resample(record, 1.0, time_scale=1e308)
    with pytest.raises(
        SceneError, match=r"scale: got 1e\+308, which makes samples larger than the"
    ):
        resample(record, 0.1, scale=1e308)
    for wrong in (np.nan, np.inf, None, "2", [0.1]):
        with pytest.raises(SceneError, match=r"^scale: got .*; allowed: a finite number$"):
            resample(record, 0.1, scale=wrong)
    for name in ("step", "time_scale"):
        for wrong in (0.0, -0.1, np.nan, np.inf, [0.1]):  # -0.1 gave a motion of one sample
            with pytest.raises(SceneError, match=f"^{name}: got .*; allowed: "):
                resample(record, **({"step": 0.1} | {name: wrong}))


STATEMENTS = {
    "UNITS: CM/S2": "cm/s^2",
    "Units = cm/sec^2": "cm/s^2",
    "UNITS ARE CM/SEC/SEC": "cm/s^2",
    "CORRECTED ACCELERATION IN CM/SEC**2": "cm/s^2",
    "Acceleration (cm/s/s)": "cm/s^2",
    "Acceleration [cm s^-2]": "cm/s^2",
    "UNITS: GAL": "gal",
    "(gals)": "gal",
    "The units are (g)": "g",
    "UNITS OF G. FILTER POINTS: HP=0.05 Hz": "g",
    "ACCELERATION IN G": "g",
    "acceleration, [ g ]": "g",
    "values in m/s2": "m/s^2",
    "UNITS: M / S / S": "m/s^2",
    "mm/s²": "mm/s^2",
    "acceleration [cm·s⁻²]": "cm/s^2",
    "Beschleunigung in m⋅s⁻²": "m/s^2",
    "UNITS OF FT/SEC2": "ft/s^2",
    "units: in/s^2": "in/s^2",
}


@pytest.mark.parametrize("statement", STATEMENTS)
def test_unit_that_the_header_states_is_read_and_others_are_refused(tmp_path, statement):
    content, own = GOOD.replace(QUANTITY, statement), STATEMENTS[statement]
    for unit, size in ACCELERATION_UNITS.items():
        if size == UNITS[own]:  # gal and cm/s^2 are one
            record = read(tmp_path, content, unit=unit)
            assert np.array_equal(record.values, np.array(SAMPLES) * size)
            continue
        with pytest.raises(SceneError) as caught:
            read(tmp_path, content, unit=unit)
        assert "motion.at2:3: the header states units of " in str(caught.value)
        assert f"; got unit = {unit!r}; set unit = {own!r}" in str(caught.value)


def test_unit_with_a_raised_two_of_another_encoding_is_read(tmp_path):
    content = GOOD.replace(QUANTITY, "Größe: mm/s²").encode("latin-1")
    with pytest.raises(SceneError, match="; got unit = 'g'; set unit = 'mm/s\\^2'"):
        read(tmp_path, content)
    assert read(tmp_path, content, unit="mm/s^2").values[2] == 0.5 * 0.001


@pytest.mark.parametrize("line", ["UNITS OF COUNTS", "units: volt", "Units = cm/s"])
def test_stated_unit_that_is_not_known_is_refused_unless_a_unit_is_set(tmp_path, line):
    content = GOOD.replace(QUANTITY, line)
    with pytest.raises(SceneError, match=r":3: the header states units of .*; got unit = 'g'$"):
        read(tmp_path, content)
    assert len(read(tmp_path, content, unit="cm/s^2").values) == 7


@pytest.mark.parametrize(
    "line", ["EL CENTRO (N), G. SMITH, 2 M/S", "UNIT 4", "STATION CM/S 7", "IN GENEVA (IN)"]
)
def test_header_without_a_statement_of_units_contradicts_none(tmp_path, line):
    for unit in ACCELERATION_UNITS:
        assert len(read(tmp_path, GOOD.replace(QUANTITY, line), unit=unit).values) == 7


def test_headings_of_columns_state_their_unit_too(tmp_path):
    for heading in ("time [s], a [g]", "# acceleration in g", "t (s); UNITS: g"):
        content = heading + "\n0 1\n1 2\n"
        with pytest.raises(SceneError, match=r":1: .* got unit = 'm/s\^2'; set unit = 'g'"):
            read(tmp_path, content, "motion.csv", unit="m/s^2")
        assert read(tmp_path, content, "motion.csv", unit="g").values.tolist() == [G, 2.0 * G]
    with pytest.raises(SceneError, match=r"states units of KN; got unit = 'N'; set unit = 'kN'"):
        read(tmp_path, "time, force (kN)\n0 1\n1 2\n", "motion.csv", unit="N")


@pytest.mark.parametrize("stated", ["[mg]", "(milli-g)", "(%g)", "[\u00b5g]", "(in mg)", "(cm/s)"])
def test_heading_with_a_fraction_of_g_or_a_velocity_is_not_read_in_g(tmp_path, stated):
    content = f"time [s], motion {stated}\n0 1\n1 2\n"
    with pytest.raises(SceneError, match=r":1: the header states units of .*; got unit = 'g'$"):
        read(tmp_path, content, "motion.csv")
    assert read(tmp_path, content, "motion.csv", unit="m/s^2").values.tolist() == [1.0, 2.0]


@pytest.mark.parametrize("stated", ["Time (ms)", "t [ms]", "time_ms", "T in min", "time [\u00b5s]"])
def test_times_that_the_headings_state_in_another_unit_than_seconds_are_refused(tmp_path, stated):
    content = f"{stated},a\n0,1\n10,2\n"
    with pytest.raises(SceneError, match=r"\.csv:1: the header states times in \w+; allowed: s$"):
        read(tmp_path, content, "motion.csv")
    alone = read(tmp_path, content, "motion.csv", column=2, time_step=0.01)
    assert alone.times.tolist() == [0.0, 0.01]


@pytest.mark.parametrize("heading", ["Time (s)", "t", "time [sec]", "t h", "T_1", "min t"])
def test_times_in_seconds_are_read(tmp_path, heading):
    assert read(tmp_path, f"{heading},a\n0,1\n10,2\n", "motion.csv").times.tolist() == [0.0, 10.0]


def test_lines_that_end_in_two_carriage_returns_are_read(tmp_path):
    # As some files of the PEER database do, which were sent twice as text.
    record = read(tmp_path, peer(SAMPLES, newline="\r\r\n"))
    assert np.array_equal(record.values, np.array(SAMPLES) * G)
    with pytest.raises(SceneError, match=":6: got 7 samples; line 4 promises 8"):
        read(tmp_path, peer(SAMPLES, newline="\r\r\n").replace("      7", "8"))


def test_line_is_named_in_any_block_of_a_long_file(tmp_path):
    count = 3 * BLOCK // 8
    times = [f"{0.25 * k:g} 1" for k in range(count)]
    times[count - 2] = times[count - 3]
    with pytest.raises(
        SceneError, match=rf"csv:{count + 1}: column 1: time: .*, the one before it$"
    ):
        read(tmp_path, "# t\n\n" + "\n".join(times[:-1]), "motion.csv", unit="N")
    lines = peer(np.arange(float(count)), columns=1).split("\n")
    lines[count // 2] = "1_0"
    with pytest.raises(SceneError, match=rf"at2:{count // 2 + 1}: column 1: got '1_0'"):
        read(tmp_path, "\n".join(lines))


def test_unit_is_g_by_default_in_peers_format_and_needed_elsewhere(tmp_path):
    for name in ("RSN953.AT2", "motion.txt"):
        record = read(tmp_path, peer(SAMPLES), name, unit=None)
        assert np.array_equal(record.values, np.array(SAMPLES) * G)
    with pytest.raises(SceneError, match=r"unit: missing; .*m/s\^2"):
        read(tmp_path, "0.0 1.5\n0.01 2.0\n", "motion.csv", unit=None)
    contradicted = peer(SAMPLES).replace("UNITS OF G", "UNITS OF CM/S2")
    with pytest.raises(SceneError, match="unit"):
        read(tmp_path, contradicted, unit=None)


@pytest.mark.parametrize("name", ["motion.AT2", "motion.txt"])
def test_scene_reads_a_file_of_peer_in_g_whatever_its_name(tmp_path, name):
    file = tmp_path / name
    motion = {"kind": "record", "file": str(file), "target": "ground"}
    for head in (QUANTITY, "ACCELERATION"):
        file.write_text(peer(SAMPLES).replace(QUANTITY, head))
        times = 0.005 * np.arange(len(SAMPLES))
        shaken = simulate(Scene(excitation=[motion]), times=times).excitation
        np.testing.assert_allclose(shaken[:, 1], G * np.array(SAMPLES), rtol=1e-12, atol=1e-12)
        mass = {"target": "force", "inertial_mass": 2.0}
        pushed = simulate(Scene(excitation=[motion | mass]), times=times).excitation
        np.testing.assert_allclose(pushed[:, 0], -2.0 * shaken[:, 1], rtol=1e-12, atol=1e-12)
    file.write_text(peer(SAMPLES))
    with pytest.raises(SceneError, match=r"excitation\.0\.file: .*units of G; got unit = 'N'"):
        compile_scene(Scene(excitation=[motion | {"target": "force"}]))


def test_scene_reads_columns_without_a_unit_in_si_units(tmp_path):
    (tmp_path / "motion.csv").write_text("0.0 1.5\n0.01 2.0\n")
    motion = {"kind": "record", "file": str(tmp_path / "motion.csv")}
    for column, target in enumerate(("force", "ground")):
        scene = Scene(excitation=[motion | {"target": target}])
        assert simulate(scene, times=[0.0, 0.01]).excitation[:, column].tolist() == [1.5, 2.0]


@pytest.mark.parametrize(
    ("target", "wrong", "nearest", "units"),
    [
        ("ground", "gg", "; did you mean 'g'?", ACCELERATION_UNITS),
        ("ground", "kN", "", ACCELERATION_UNITS),
        ("force", "gg", "", FORCE_UNITS),
        ("force", "g", "", FORCE_UNITS),
    ],
)
def test_wrong_unit_in_a_scene_lists_exactly_those_of_the_target(target, wrong, nearest, units):
    data = {"kind": "record", "file": "motion.csv", "target": target, "unit": wrong}
    with pytest.raises(SceneError) as caught:
        Recorded(**data)
    found, allowed = str(caught.value).split("; allowed: ")
    assert found == f"unit: got {wrong!r}{nearest}"
    assert set(allowed.split("'")[1::2]) == set(units)
    for unit in units:
        assert Recorded(**(data | {"unit": unit})).unit == unit


def test_digest_tells_which_part_has_which_records(tmp_path):
    names = [str(tmp_path / f"{name}.csv") for name in "abc"]
    for k, name in enumerate(names):
        (tmp_path / name).write_text(f"0.0 {k}.0\n0.01 2.0\n")

    def digest(*sets):
        parts = [{"kind": "record", "files": files, "target": "force"} for files in sets]
        return Scene(excitation=parts).digest

    assert digest(names[:1], names[1:]) != digest(names[:2], names[2:])
