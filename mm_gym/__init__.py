"""mm_gym: vibration control by a moving mass, as a Gymnasium environment."""

from importlib import import_module
from typing import TYPE_CHECKING

from mm_gym.env.registration import register_envs

if TYPE_CHECKING:
    from mm_gym.env.own_reward import OwnReward as OwnReward
    from mm_gym.env.own_reward import rewarded as rewarded
    from mm_gym.env.single import MovingMassEnv as MovingMassEnv
    from mm_gym.env.vector import MovingMassVectorEnv as MovingMassVectorEnv
    from mm_gym.errors import ActionError as ActionError
    from mm_gym.errors import CompileError as CompileError
    from mm_gym.errors import DesignError as DesignError
    from mm_gym.errors import SceneError as SceneError
    from mm_gym.errors import SimulationError as SimulationError
    from mm_gym.plant.compile import compile_scene as compile_scene
    from mm_gym.plant.plant import Plant as Plant
    from mm_gym.plant.rigs import over_rigs as over_rigs
    from mm_gym.precision import work_precision as work_precision
    from mm_gym.scene.scene import Scene as Scene
    from mm_gym.scene.toml_file import load_scene as load_scene
    from mm_gym.simulation.closed_loop import Episodes as Episodes
    from mm_gym.simulation.simulate import simulate as simulate
    from mm_gym.simulation.trajectory import Trajectory as Trajectory
    from mm_gym.state_space.linear_system import LinearSystem as LinearSystem

_MODULES = {
    "ActionError": "errors",
    "CompileError": "errors",
    "DesignError": "errors",
    "Episodes": "simulation.closed_loop",
    "LinearSystem": "state_space.linear_system",
    "MovingMassEnv": "env.single",
    "MovingMassVectorEnv": "env.vector",
    "OwnReward": "env.own_reward",
    "Plant": "plant.plant",
    "Scene": "scene.scene",
    "SceneError": "errors",
    "SimulationError": "errors",
    "Trajectory": "simulation.trajectory",
    "compile_scene": "plant.compile",
    "over_rigs": "plant.rigs",
    "load_scene": "scene.toml_file",
    "rewarded": "env.own_reward",
    "simulate": "simulation.simulate",
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


register_envs()
