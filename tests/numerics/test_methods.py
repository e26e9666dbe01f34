"""Do methods do what they declare: domain, order in the table, cost and settings?"""

import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest

from mm_gym import CompileError, Scene, SceneError, compile_scene, methods, simulate, work_precision
from mm_gym.methods.linear.method import Linear
from mm_gym.methods.support import KINDS
from mm_gym.methods.taylor import layout as series
from mm_gym.methods.taylor.method import MARGIN
from mm_gym.scene.schema import scene_schema

RELEASED = Scene(initial={"carriage_displacement": 0.01})
CUBIC = RELEASED.replace(**{"carriage.cubic_coefficient": 1e5})
SHAKEN = {
    "excitation": [
        {"kind": "kanai_tajimi", "rms": 1.0, "ground_frequency": 60.0, "sample_time": 0.001}
    ]
}
"""Ten sample intervals in each control step of 0.01 s."""


class Dummy(Linear):
    """Another method for linear plants."""

    name = "dummy"
    title = "the dummy"


def test_method_is_added_by_one_row(monkeypatch):
    with pytest.raises(SceneError, match=r"solver.method: got 'dummy'.*allowed: 'auto', 'exact'"):
        RELEASED.replace(**{"solver.method": "dummy"})
    monkeypatch.setattr(methods, "METHODS", (*methods.METHODS, Dummy()))
    asked = RELEASED.replace(**{"solver.method": "dummy"})
    assert "dummy: transition matrix" in compile_scene(asked).explain()
    assert np.array_equal(simulate(asked).state, simulate(RELEASED).state)
    with pytest.raises(CompileError, match=r"'dummy' does not apply .*: 'auto', 'splitting'"):
        compile_scene(CUBIC.replace(**{"solver.method": "dummy"}))
    solver = json.loads(scene_schema())["$defs"]["Solver"]["properties"]
    assert solver["method"]["enum"] == ["auto", *methods.names()]
    assert "dummy" in solver["method"]["enum"]
    assert "dummy" in {one.method for one in work_precision(RELEASED).settings}


def test_misspelt_method_has_a_nearest_name():
    with pytest.raises(SceneError, match=r"solver.method: got 'tailor'; did you mean 'taylor'"):
        Scene(solver={"method": "tailor"})
    with pytest.raises(SceneError, match=r"solver.method: got 5; allowed: 'auto'"):
        Scene(solver={"method": 5})


def test_every_kind_of_plant_has_a_method():
    assert {kind for method in methods.METHODS for kind in method.kinds} == set(KINDS)


@pytest.mark.parametrize("kind", [k for k in KINDS if k != "massless carriage"])
def test_auto_never_chooses_a_method_kept_for_comparison(kind):
    first = next(method for method in methods.METHODS if kind in method.kinds)
    assert first.name in {"exact", "switched", "series", "splitting", "runge_kutta", "taylor"}


PROGRAM = """
import json, sys, warnings
warnings.filterwarnings("ignore")
from mm_gym import Scene, simulate, compile_scene
from mm_gym.methods.fixed_step import kernel
count = 0
field = kernel._field
def counted(*arguments):
    global count
    count += 1
    return field(*arguments)
kernel._field = counted
scene = Scene(**json.loads(sys.argv[1]))
simulate(scene, duration=scene.control.time_step)
print(count)
"""


@pytest.mark.parametrize("excited", [{}, SHAKEN], ids=["free", "shaken"])
@pytest.mark.parametrize("method", ["rk4", "semi_implicit_euler"])
def test_explained_evaluations_are_those_that_are_made(method, excited):
    scene = RELEASED.replace(solver={"method": method, "substeps": 4}, **excited)
    cost = re.search(r"cost +(.*)", compile_scene(scene).explain())[1]
    words = re.fullmatch(
        r"(\d+) evaluations of the forces(?: in each of (\d+) sample intervals)?", cost
    )
    explained = int(words[1]) * int(words[2] or 1)
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, scene.model_dump_json()],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        check=True,
        text=True,
    )
    assert int(done.stdout) == explained
    assert explained == {"rk4": 16, "semi_implicit_euler": 4}[method] * (10 if excited else 1)


@pytest.mark.parametrize("method", ["auto", "taylor", "rk4"])
def test_sample_intervals_are_explained_for_every_method(method):
    scene = RELEASED.replace(**SHAKEN, **{"solver.method": method})
    assert "in each of 10 sample intervals" in compile_scene(scene).explain()


@pytest.mark.parametrize("excited", [{}, SHAKEN], ids=["free", "shaken"])
def test_sample_intervals_divide_the_tolerance_of_a_control_step(excited):
    plant = compile_scene(CUBIC.replace(**excited))
    intervals = plant.support.intervals_per_step
    assert intervals == (10 if excited else 1)
    # Errors of the intervals add up to what the control step aims for.
    assert intervals * plant.model[series.TOLERANCE] == pytest.approx(MARGIN * 1e-9, rel=1e-15)
