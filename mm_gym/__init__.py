"""mm_gym: vibration control by a moving mass, as a Gymnasium environment."""

from mm_gym.compile import compile_scene as compile_scene
from mm_gym.env import MovingMassEnv as MovingMassEnv
from mm_gym.errors import ActionError as ActionError
from mm_gym.errors import CompileError as CompileError
from mm_gym.errors import SceneError as SceneError
from mm_gym.errors import SimulationError as SimulationError
from mm_gym.plant import Plant as Plant
from mm_gym.precision import work_precision as work_precision
from mm_gym.registration import register_envs
from mm_gym.scene import Scene as Scene
from mm_gym.scene_file import load_scene as load_scene
from mm_gym.simulate import simulate as simulate
from mm_gym.trajectory import Trajectory as Trajectory
from mm_gym.vector_env import MovingMassVectorEnv as MovingMassVectorEnv

register_envs()
