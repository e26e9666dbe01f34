"""Structures as scenes: one mode of a building, frame or vehicle is the carriage.

Degrees of freedom, storeys and modes are counted from 1, as engineers do: storey 1 is the lowest,
mode 1 the slowest. Displacements are relative to the ground, positive as its acceleration is.
`docs/structures.md` derives the reduction, and says what it leaves out.
"""

from mm_gym.errors import StructureError as StructureError
from mm_gym.structure.comparison import Comparison as Comparison
from mm_gym.structure.comparison import Row as Row
from mm_gym.structure.comparison import balanced_error as balanced_error
from mm_gym.structure.comparison import compare as compare
from mm_gym.structure.comparison import white_noise as white_noise
from mm_gym.structure.examples import EXAMPLES as EXAMPLES
from mm_gym.structure.examples import Example as Example
from mm_gym.structure.examples import example as example
from mm_gym.structure.structure import Reduction as Reduction
from mm_gym.structure.structure import Structure as Structure
from mm_gym.structure.structure import rayleigh_damping as rayleigh_damping
