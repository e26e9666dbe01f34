"""What is shipped."""

import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def build(target, source, folder):
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(folder)]
    subprocess.run(command, cwd=source, check=True, capture_output=True)
    (path,) = (path for path in folder.iterdir() if path.is_file())
    return path


@pytest.fixture(scope="module", params=["checkout", "source distribution"])
def wheel(request, tmp_path_factory):
    out, source = tmp_path_factory.mktemp("dist"), ROOT
    if request.param != "checkout":
        with tarfile.open(build("sdist", ROOT, out)) as archive:
            # Python before 3.11.4 has no filters.
            archive.extraction_filter = getattr(tarfile, "data_filter", None)
            archive.extractall(out)  # noqa: S202 - an archive of our own
        (source,) = (path for path in out.iterdir() if path.is_dir())
    with zipfile.ZipFile(build("wheel", source, tmp_path_factory.mktemp("wheel"))) as archive:
        yield archive


def test_wheel_has_one_top_level_name(wheel):
    tops = {name.split("/")[0] for name in wheel.namelist()}
    packages = {top for top in tops if not top.endswith(".dist-info")}
    assert packages == {"mm_gym"}
    assert len(tops) == 2


def test_wheel_holds_every_module_and_nothing_generated(wheel):
    shipped = {name for name in wheel.namelist() if name.startswith("mm_gym/")}
    sources = {str(p.relative_to(ROOT).as_posix()) for p in (ROOT / "mm_gym").rglob("*.py")}
    assert sources <= shipped
    assert not [name for name in shipped if "__pycache__" in name or name.endswith(".nbi")]


def test_wheel_holds_the_tasks_and_their_schema(wheel, tmp_path):
    tasks = (ROOT / "mm_gym" / "tasks").rglob("*.*")
    files = {path.relative_to(ROOT).as_posix() for path in tasks if "__pycache__" not in path.parts}
    assert {"mm_gym/tasks/pre_stretch.toml", "mm_gym/tasks/scene.schema.json"} <= files
    assert files == {name for name in wheel.namelist() if name.startswith("mm_gym/tasks/")}
    shutil.unpack_archive(wheel.filename, tmp_path, "zip")
    program = """
import gymnasium, mm_gym
names = [name for name in gymnasium.registry if name.startswith("mm_gym/")]
assert all(isinstance(mm_gym.load_scene(name), mm_gym.Scene) for name in names)
print(mm_gym.__file__, len(names))
"""
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, check=True, text=True
    )
    assert done.stdout.split() == [
        str(tmp_path / "mm_gym" / "__init__.py"),
        str(sum(name.endswith(".toml") for name in files)),
    ]


def test_wheel_names_its_extras_and_licence(wheel):
    (name,) = [n for n in wheel.namelist() if n.endswith("/METADATA")]
    metadata = wheel.read(name).decode()
    for extra in ("agents", "plot", "render", "all"):
        assert f"Provides-Extra: {extra}\n" in metadata
    assert "License-File: LICENSE\n" in metadata


def test_every_direct_dependency_is_pinned():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    wanted = [
        *project["project"]["dependencies"],
        *[d for group in project["project"]["optional-dependencies"].values() for d in group],
        *[
            d
            for group in project["dependency-groups"].values()
            for d in group
            if isinstance(d, str)  # the others include a group
        ],
        *project["build-system"]["requires"],
    ]
    names = {d.split(">=")[0].split("[")[0] for d in wanted} - {"mm-gym"}
    lines = (ROOT / "constraints.txt").read_text("utf-8").split()
    pinned = {line.split("==")[0] for line in lines if "==" in line}
    assert names <= pinned
    assert "torch==2.13.0" in lines
