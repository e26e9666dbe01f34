"""Measurement of error against time for every method and setting on a scene."""

from mm_gym.precision.measure import work_precision as work_precision
from mm_gym.precision.result import Setting as Setting
from mm_gym.precision.result import WorkPrecision as WorkPrecision
