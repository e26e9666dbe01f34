"""What is shipped."""

import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    out = tmp_path_factory.mktemp("dist")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(out)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (path,) = out.glob("*.whl")
    with zipfile.ZipFile(path) as archive:
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
        *[d for group in project["dependency-groups"].values() for d in group],
        *project["build-system"]["requires"],
    ]
    names = {d.split(">=")[0].split("[")[0] for d in wanted} - {"mm-gym"}
    lines = (ROOT / "constraints.txt").read_text("utf-8").split()
    pinned = {line.split("==")[0] for line in lines if "==" in line}
    assert names <= pinned
    assert "torch==2.13.0" in lines
