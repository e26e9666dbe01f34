"""Files and Python users meet the same checks, and a file that cannot be read says why."""

import json
import os
import re
import tomllib
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mm_gym import Scene, SceneError, load_scene
from mm_gym.__main__ import main
from mm_gym.files import read_toml
from mm_gym.scene import toml_file
from mm_gym.scene.part import dotted_name
from mm_gym.scene.toml_file import lines_of, toml_of

GOOD = """
[carriage]
mass = 0.2
stiffness = 300  # an integer stands for a float

[interface]
kind = "viscous"
damping = 1e-3

[[excitation]]
kind = "harmonic"
amplitude = 1.0
frequency = 50.0

[initial]
sphere_offset = [-0.01, 0.01]

[randomization]
"excitation.0.phase" = [0.0, 6.28]
"""


def test_file_holds_what_differs_from_the_defaults(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(GOOD, "utf-8")
    expected = Scene().replace(
        **{
            "carriage.mass": 0.2,
            "carriage.stiffness": 300.0,
            "interface.damping": 1e-3,
            "excitation": [{"kind": "harmonic", "amplitude": 1.0, "frequency": 50.0}],
            "initial.sphere_offset": [-0.01, 0.01],
            "randomization.excitation.0.phase": [0.0, 6.28],
        }
    )
    assert load_scene(file) == expected
    assert load_scene(str(file)).digest == expected.digest


def test_sign_of_a_zero_is_kept(tmp_path):
    scene = Scene().replace(**{"initial.sphere_offset": -0.0})
    (tmp_path / "scene.toml").write_text(toml_of(scene, tmp_path), "utf-8")
    assert load_scene(tmp_path / "scene.toml").digest == scene.digest


def test_empty_file_is_the_default_scene(tmp_path):
    (tmp_path / "scene.toml").touch()
    assert load_scene(tmp_path / "scene.toml") == Scene()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"[sphere]\nmass = -1\nmas = 2\n", r":2: sphere\.mass: got -1; allowed: greater than 0"),
        (b"[carriage]\nmass = 1\nmass = 2\n", ":3:9: not valid TOML: Cannot overwrite a value$"),
        (b"[carriage\n", r":1:10: not valid TOML: "),
        (b"\r\ncarriage = \r\n", ":2:12: not valid TOML: Invalid value$"),
        (b"a = [1,", r": not valid TOML: .*\(at end of document\)$"),
        (b"\n\xff\xfe\x00", r":2: got the byte 0xff; allowed: UTF-8$"),
        (b"a = " + b"9" * 5000, "a: unknown key|got 5004 characters"),
        (b"a = " + b"[" * 5000, ":1: got 5004 characters; allowed: at most 2048"),
        (b"a = " + b"[\n" * 5000, "not valid TOML: nested too deeply"),
        (b"a = " + b"9\\\n" * 5000, ":1:6: not valid TOML: "),
        (b"[carriage]\nmass = nan\n", r":2: carriage\.mass: got nan"),
        (b"[carriage]\nmass = inf\n", r":2: carriage\.mass: got inf"),
        (b"[carriage]\nmass = '0.1'\n", r":2: carriage\.mass: got '0\.1'; allowed: a number"),
        (b"[carriage]\nmass = true\n", r":2: carriage\.mass: got True; allowed: a number"),
        (b"[carriage]\nmass = 2024-01-01\n", r":2: carriage\.mass: got datetime\.date\(2024, 1"),
        (b"[carriage]\nmass = 0x" + b"f" * 2000, r":2: carriage\.mass: got \d+\.\.\.\d+; allowed"),
        (b"_fields = 1\n", ":1: _fields: unknown key"),
        (b"self = 1\n", ":1: self: unknown key"),
        (b"[carriage]\nself = 1\n", r":2: carriage\.self: unknown key"),
        (b"cls = 1\n", ":1: cls: unknown key"),
        (b'"" = 1\n', ":1: '': unknown key"),
        (b'"a: b" = 1\n[a]\n', ":1: a: b: unknown key"),
        (b'[a]\n"x\\n" = 1\n[sphere]\n"y\\n" = 1', r":4: sphere\.'y\\n': unknown key"),
    ],
)
def test_bad_file_is_refused_with_path_and_line(tmp_path, content, words):
    file = tmp_path / "scene.toml"
    file.write_bytes(content)
    with pytest.raises(SceneError, match=words) as caught:
        load_scene(file)
    assert all(re.match(rf"{file}:(\d+:)* ", line) for line in str(caught.value).splitlines())


LINES = """\
# A comment, then what has no table
randomization = { "sphere.mas" = [1, 2] }
solver.tolerance = 2

[interface]  # three keys are missing
kind = "dry_friction"
carriage.mass = 3

[sensors]
history = 0
channels = [
    "carriage_displacement",  # ]
    # "stretch"
    "slip",
]

[[excitation]]
amplitude = 1.0
kind = "harmonic"

[[ excitation ]]
"kind" = "harmonic"
amplitude = \"\"\"
[carriage]
mass = -1
\"\"\"
bogus = [[1,
2], [3]]
[spher]
[carriage]
mass = -1
"""


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_every_finding_has_its_line(tmp_path, newline, mark):
    file = tmp_path / "scene.toml"
    file.write_bytes((mark + LINES.replace("\n", newline)).encode())
    with pytest.raises(SceneError) as caught:
        load_scene(file)
    places = [
        line.removeprefix(f"{file}:").split(": ")[:2] for line in str(caught.value).split("\n")
    ]
    assert sorted((int(line), name) for line, name in places) == [
        (3, "solver.tolerance"),
        (5, "interface.kinetic_coefficient"),
        (5, "interface.reference_velocity"),
        (5, "interface.static_coefficient"),
        (7, "interface.carriage"),
        (10, "sensors.history"),
        (14, "sensors.channels.1"),
        (17, "excitation.0.frequency"),
        (21, "excitation.1.frequency"),
        (23, "excitation.1.amplitude"),
        (27, "excitation.1.bogus"),
        (29, "spher"),
        (31, "carriage.mass"),
    ]


def test_rules_across_fields_have_lines_too(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text('[initial]\nstretch = 2\n[randomization]\n"sphere.mass" = [2, 1]\n')
    with pytest.raises(SceneError) as caught:
        load_scene(file)
    places = [
        line.removeprefix(f"{file}:").split(": ")[:2] for line in str(caught.value).split("\n")
    ]
    assert places == [["4", "randomization.sphere.mass"], ["2", "initial.stretch"]]


def test_record_is_looked_for_beside_the_scene(tmp_path):
    scene = tmp_path / "scene.toml"
    for name, path in {"a.at2": tmp_path / "a.at2", "/b/c.at2": Path("/b/c.at2")}.items():
        scene.write_text(f'excitation = [{{ kind = "record", file = "{name}" }}]')
        assert Path(load_scene(scene).excitation[0].file) == path
    scene.write_text('excitation = [{ kind = "record", file = "" }, { file = 1 }, 1]')
    with pytest.raises(SceneError, match=r":1: excitation\.0\.file: got ''; allowed"):
        load_scene(scene)


def as_toml(value):
    """A value in TOML; tables inline."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {as_toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(as_toml, value)) + "]"
    return json.dumps(value)


keys = st.text("ab:[]#=\"' \n\u2028", max_size=4)
leaves = st.integers() | st.booleans() | st.text("ab[]#=\"'\n\\", max_size=8)
values = st.recursive(
    leaves,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(keys, inner, max_size=3),
    max_leaves=8,
)


@given(data=st.dictionaries(keys, st.dictionaries(keys, values, max_size=4), max_size=4))
def test_lines_are_those_of_the_statements(data):
    lines, expected = ["# comment"], {}
    for table, entries in data.items():
        lines.append(f"[{json.dumps(table)}]")
        expected.setdefault(dotted_name([table]), len(lines))
        for key, value in entries.items():
            lines.append(f"{json.dumps(key)} = {as_toml(value)}")
            expected.setdefault(dotted_name([table, key]), len(lines))
            lines.append("")
    found = lines_of("\n".join(lines))
    assert {name: found.get(name) for name in expected} == expected


def test_file_that_takes_the_parser_long_is_refused_soon(tmp_path, monkeypatch):
    work = Counter()

    def parse(text):
        work["characters"] += len(text)
        return tomllib_loads(text)

    def name(path):
        work["names"] += len(path)
        return dotted_name(path)

    tomllib_loads = tomllib.loads
    monkeypatch.setattr(tomllib, "loads", parse)
    monkeypatch.setattr(toml_file, "dotted_name", name)
    file = tmp_path / "scene.toml"
    hostile = [
        "\n".join(f"c{i} = 1" for i in range(2000)),
        "a = [\n" + "1,\n" * 15000 + "]",
        "".join(f"a{i} = [\n" + "1,\n" * 90 + "]\n" for i in range(60)),
        "[[excitation]]\n" * 2000,
        "sensors.channels = [\n" + "'a',\n" * 10000 + "]",
        "\n".join("carriage.mass" + ".a" * 1000 + f".b{i} = 1" for i in range(5)),
    ]
    for text in hostile:
        work.clear()
        file.write_text(text)
        with pytest.raises(SceneError):
            load_scene(file)
        # A second or so, on any machine; each list alone would be some hundred million.
        assert 0 < work["characters"] < 2_000_000, text[:20]
        assert work["names"] < 2_000_000, text[:20]


def test_missing_file_is_named_with_the_nearest_one(tmp_path):
    (tmp_path / "pre_stretch.toml").touch()
    with pytest.raises(SceneError, match=r"no such file; did you mean 'pre_stretch\.toml'\?"):
        load_scene(tmp_path / "prestretch.toml")
    with pytest.raises(SceneError, match=r"^path: got None; allowed: the path of a file"):
        load_scene(None)
    with pytest.raises(SceneError, match=r"no such file$"):
        load_scene(tmp_path / "nowhere" / "scene.toml")


def test_what_is_not_a_scene_file_is_refused(tmp_path):
    with pytest.raises(SceneError, match=r"cannot be read: not a file but a directory"):
        load_scene(tmp_path)
    with pytest.raises(SceneError, match=r"cannot be read: not a file"):
        load_scene("/dev/zero")
    with pytest.raises(SceneError, match=r"cannot be read"):
        load_scene("a\0b")
    with (tmp_path / "large.toml").open("wb") as stream:
        stream.truncate(10**12)
    with pytest.raises(SceneError, match=r"1000000000000 bytes; allowed: at most 65536"):
        load_scene(tmp_path / "large.toml")


def test_file_that_would_have_to_be_waited_for_is_refused_at_once(tmp_path, capsys):
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "link.toml").symlink_to(tmp_path / "pipe.toml")
    # The kernel makes up the last two when they are read; the first of them may wait for ever.
    names = ["pipe.toml", "link.toml", "/dev/zero", "/dev/tty", "/proc/kmsg", "/proc/version"]
    paths = [str(tmp_path / name) for name in names]
    assert main(["validate", *paths]) == 2
    lines = capsys.readouterr().err.removeprefix("error: ").splitlines()
    assert len(lines) == len(paths)
    for path, line in zip(paths, lines, strict=True):
        assert re.match(rf"{path}: (cannot be read|no such file)", line)


def test_any_toml_file_is_read_with_the_same_guards(tmp_path):
    file = tmp_path / "config.toml"
    file.write_text("steps = 3\n[net]\nwidth = [1, 2]\n")
    assert read_toml(file) == {"steps": 3, "net": {"width": [1, 2]}}
    for text, words in {
        "a = ": r"config\.toml: not valid TOML: ",
        "a = " + "[\n" * 5000: "nested too deeply",
        "a = " + "1" * 2048: "config.toml:1: got 2052 characters; allowed: at most 2048",
        "a = 1\n" * 20000: "120000 bytes; allowed: at most 65536",
    }.items():
        file.write_text(text)
        with pytest.raises(SceneError, match=words):
            read_toml(file)
    with pytest.raises(SceneError, match=r"did you mean 'config\.toml'\?"):
        read_toml(tmp_path / "conf.toml")
