"""What each digit costs on a scene: every method's error and time, by setting."""

from mm_gym.precision.measure import work_precision as work_precision
from mm_gym.precision.result import Setting as Setting
from mm_gym.precision.result import WorkPrecision as WorkPrecision
