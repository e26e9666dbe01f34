"""Structures as scenes: one mode of a building, frame or vehicle is the carriage.

Degrees of freedom, storeys and modes are counted from 1, as engineers do: storey 1 is the lowest,
mode 1 the slowest. Displacements are relative to the ground, positive as its acceleration is.
`docs/structures.md` derives the reduction, and says what it leaves out.
"""

from mm_gym.errors import StructureError
from mm_gym.structure.comparison import Comparison, Row, balanced_error, compare, white_noise
from mm_gym.structure.examples import EXAMPLES, Example, example
from mm_gym.structure.structure import Reduction, Structure, rayleigh_damping

__all__ = [
    "EXAMPLES",
    "Comparison",
    "Example",
    "Reduction",
    "Row",
    "Structure",
    "StructureError",
    "balanced_error",
    "compare",
    "example",
    "rayleigh_damping",
    "white_noise",
]
