"""Files and Python users meet the same checks, and a file that cannot be read says why."""

import pytest

from mm_gym import Scene, SceneError, load_scene

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


def test_empty_file_is_the_default_scene(tmp_path):
    (tmp_path / "scene.toml").touch()
    assert load_scene(tmp_path / "scene.toml") == Scene()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"[sphere]\nmass = -1\nmas = 2\n", r"sphere\.mass: got -1; allowed: greater than 0"),
        (b"[carriage]\nmass = 1\nmass = 2\n", "not valid TOML: Cannot overwrite a value"),
        (b"[carriage\n", "not valid TOML: "),
        (b"carriage = \n", "not valid TOML: "),
        (b"\xff\xfe\x00", r"cannot be read: .*utf-8"),
        (b"[carriage]\nmass = nan\n", r"carriage\.mass: got nan"),
        (b"[carriage]\nmass = inf\n", r"carriage\.mass: got inf"),
        (b"[carriage]\nmass = '0.1'\n", r"carriage\.mass: got '0\.1'; allowed: a number"),
        (b"[carriage]\nmass = true\n", r"carriage\.mass: got True; allowed: a number"),
        (b"[carriage]\nmass = 2024-01-01\n", r"carriage\.mass: got datetime\.date\(2024, 1, 1\)"),
        (b"_fields = 1\n", "_fields: unknown key"),
        (b'"" = 1\n', ": unknown key"),
    ],
)
def test_bad_file_is_refused_with_its_path_on_every_line(tmp_path, content, words):
    file = tmp_path / "scene.toml"
    file.write_bytes(content)
    with pytest.raises(SceneError, match=words) as caught:
        load_scene(file)
    assert all(line.startswith(f"{file}: ") for line in str(caught.value).splitlines())


def test_missing_file_is_named_with_the_nearest_one(tmp_path):
    (tmp_path / "pre_stretch.toml").touch()
    with pytest.raises(SceneError, match=r"no such file; did you mean 'pre_stretch\.toml'\?"):
        load_scene(tmp_path / "prestretch.toml")
    with pytest.raises(SceneError, match=r"no such file$"):
        load_scene(tmp_path / "nowhere" / "scene.toml")


def test_directory_is_not_a_scene(tmp_path):
    with pytest.raises(SceneError, match=r"cannot be read: .*directory"):
        load_scene(tmp_path)
