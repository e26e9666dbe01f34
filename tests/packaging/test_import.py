"""What importing the package costs and offers."""

import subprocess
import sys

import pytest

import mm_gym

EXTRAS = ["torch", "stable_baselines3", "control", "matplotlib", "pygame", "tyro", "tensorboard"]
EXTRAS += ["minari", "h5py"]

PUBLIC = [
    "work_precision",
    *["Scene", "load_scene", "SceneError", "CompileError", "ActionError", "SimulationError"],
    *["DesignError", "LinearSystem", "Episodes"],
    *["compile_scene", "Plant", "simulate", "Trajectory", "MovingMassEnv", "MovingMassVectorEnv"],
]


def run(program):
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, check=False, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_import_loads_none_of_the_extras():
    loaded = run("import mm_gym, sys; print(*sys.modules)").split()
    assert "mm_gym" in loaded
    assert set(EXTRAS).isdisjoint(loaded)


def test_import_registers_the_tasks_without_checking_their_scenes():
    program = """
import sys, gymnasium, mm_gym
assert "mm_gym/CarriageForce-v0" in gymnasium.registry
print(*sys.modules)
"""
    assert {"pydantic", "numba", "scipy"}.isdisjoint(run(program).split())


def test_scene_is_made_and_read_without_the_compiler():
    program = """
import sys, mm_gym
mm_gym.Scene()
mm_gym.load_scene("mm_gym/CarriageForce-v0")
print(*sys.modules)
"""
    assert {"numba", "scipy"}.isdisjoint(run(program).split())


def test_public_names_are_found_in_any_order_of_imports():
    program = """
import types
import mm_gym.analysis
import mm_gym.simulation.simulate
import mm_gym
from mm_gym import simulate
assert isinstance(simulate, types.FunctionType) and mm_gym.simulate is simulate
assert {"Scene", "simulate", "MovingMassVectorEnv"} <= set(dir(mm_gym))
assert not hasattr(mm_gym, "Scenes")
"""
    run(program)


def test_making_and_stepping_loads_none_of_the_extras():
    program = """
import sys, mm_gym, gymnasium
env = gymnasium.make("mm_gym/CarriageForce-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
mm_gym.simulate(env.unwrapped.scene)
print(*sys.modules)
"""
    assert set(EXTRAS).isdisjoint(run(program).split())


@pytest.mark.parametrize("name", PUBLIC)
def test_public_name_is_exported_and_documented(name):
    assert getattr(mm_gym, name).__doc__


@pytest.mark.parametrize("name", ["explain", "linear", "discrete"])
def test_plant_has_its_public_methods(name):
    assert getattr(mm_gym.Plant, name).__doc__


def test_errors_are_of_the_kinds_one_would_catch():
    assert issubclass(mm_gym.SceneError, ValueError)
    assert issubclass(mm_gym.CompileError, ValueError)
    assert issubclass(mm_gym.ActionError, ValueError)
    assert issubclass(mm_gym.SimulationError, RuntimeError)
