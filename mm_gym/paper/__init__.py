"""The systems, figures and numbers of Argenziano et al., Meccanica (2023): "the paper"."""

from mm_gym.paper.scenes import NAMES as NAMES
from mm_gym.paper.scenes import scene as scene
