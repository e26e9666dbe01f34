"""Sensitivities: the exact derivatives of control steps, and what a plan's search makes of them.

Arguments that kernels have in common are those of `mm_gym.methods`; of `lanes`, the deviations are
written too. `b` are rows of vectors, room for the series of a group of lanes, `c` the same of
numbers with tangents; `unit` [s] is the length of a series, `order` or `degree` that of its last
term.
"""

from mm_gym.sensitivity.actuators import Actuator as Actuator
from mm_gym.sensitivity.jacobian import Jacobian as Jacobian
from mm_gym.sensitivity.jacobian import Sensitivities as Sensitivities
from mm_gym.sensitivity.model import TOLERANCE as TOLERANCE
from mm_gym.sensitivity.model import expected as expected
from mm_gym.sensitivity.sweep_kernel import sweep as sweep
