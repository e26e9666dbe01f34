"""Response and effort of a motion, and their ratios to those of uncontrolled and passive motions.

The indices are in the tradition of the structural-control benchmarks: Ohtori, Christenson, Spencer
and Dyke, *Benchmark control problems for seismically excited nonlinear buildings*, Journal of
Engineering Mechanics 130 (2004). See docs/evaluation.md.
"""

from mm_gym.metrics.indices import Indices as Indices
from mm_gym.metrics.indices import indices as indices
from mm_gym.metrics.lanes import LaneResponse as LaneResponse
from mm_gym.metrics.lanes import passive_response as passive_response
from mm_gym.metrics.lanes import passive_scene as passive_scene
from mm_gym.metrics.lanes import uncontrolled_response as uncontrolled_response
from mm_gym.metrics.response import Response as Response
from mm_gym.metrics.trajectory import response as response
