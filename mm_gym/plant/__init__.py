"""The plant: the simplest model that covers a scene, compiled to plain arrays."""

from mm_gym.plant.outputs import Outputs as Outputs
from mm_gym.plant.outputs import central_differences as central_differences
from mm_gym.plant.outputs import difference_steps as difference_steps
