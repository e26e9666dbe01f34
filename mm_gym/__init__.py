"""mm_gym: vibration control by a moving mass, as a Gymnasium environment."""

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

from mm_gym.registration import register_envs

if TYPE_CHECKING:
    from mm_gym.compile import compile_scene as compile_scene
    from mm_gym.env import MovingMassEnv as MovingMassEnv
    from mm_gym.errors import ActionError as ActionError
    from mm_gym.errors import CompileError as CompileError
    from mm_gym.errors import SceneError as SceneError
    from mm_gym.errors import SimulationError as SimulationError
    from mm_gym.plant import Plant as Plant
    from mm_gym.precision import work_precision as work_precision
    from mm_gym.scene import Scene as Scene
    from mm_gym.scene_file import load_scene as load_scene
    from mm_gym.simulate import simulate as simulate
    from mm_gym.trajectory import Trajectory as Trajectory
    from mm_gym.vector_env import MovingMassVectorEnv as MovingMassVectorEnv

_MODULES = {
    "ActionError": "errors",
    "CompileError": "errors",
    "MovingMassEnv": "env",
    "MovingMassVectorEnv": "vector_env",
    "Plant": "plant",
    "Scene": "scene",
    "SceneError": "errors",
    "SimulationError": "errors",
    "Trajectory": "trajectory",
    "compile_scene": "compile",
    "load_scene": "scene_file",
    "simulate": "simulate",
    "work_precision": "precision",
}
"""Where each public name lives. It is imported when first used: the compiler alone takes longer to
import than everything else."""


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        msg = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(msg)
    value = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULES})


class _Package(ModuleType):
    """A package in which the function `simulate` goes before the module of the same name."""

    def __setattr__(self, name: str, value: object) -> None:
        if name not in _MODULES or not isinstance(value, ModuleType):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package

register_envs()
