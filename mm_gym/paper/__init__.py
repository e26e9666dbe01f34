"""The systems, figures and numbers of Argenziano et al., Meccanica (2023), "the paper"; its errata are in docs/model.md."""

from mm_gym.paper.scenes import NAMES as NAMES
from mm_gym.paper.scenes import scene as scene
