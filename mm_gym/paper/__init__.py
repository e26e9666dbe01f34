"""The systems, figures and numbers of Argenziano et al., "the paper".

Nonlinear Dynamics (2023), no. 13, pp. 12033-12052; docs/model.md has its full title.
"""

from mm_gym.paper.scenes import NAMES as NAMES
from mm_gym.paper.scenes import scene as scene
